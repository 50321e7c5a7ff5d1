"""The control net of the example roof: a crooked vault that bends both ways.

A vault over the short span carries a wave along its crown, so that it is dome-like in places and
saddle-like in others; a twist and a bulge off the centre take away all symmetry. Heights are
rounded to centimetres, as a drawing would give them.

Run it to write net.json again: `python examples/roof/make_net.py`.
"""

import json
from pathlib import Path

import numpy as np


def control_points() -> np.ndarray:
    """Control points (11, 10, 3) in metres."""
    x, y = np.meshgrid(np.linspace(-36, 36, 11), np.linspace(-29, 29, 10), indexing="ij")
    across = y - 1.13 * 6.0 * np.sin(1.7 * x / 36 + 0.4)
    z = 8.1 * (1 - (across / 27) ** 2)
    z += 1.38 * np.sin(2 * np.pi * x / 74 + 0.48) * (1 - 0.35 * across / 27)
    z += 0.0046 * x * y
    z += 2.2 * np.exp(-(((x + 7) / 15) ** 2) - ((y - 4) / 13) ** 2)
    z += 0.81 * (x / 36) ** 3
    return np.stack([x, y, z], axis=-1).round(2)


if __name__ == "__main__":
    net = {"degree": [5, 5], "points": control_points().tolist()}
    Path(__file__).with_name("net.json").write_text(json.dumps(net) + "\n", encoding="utf-8")
