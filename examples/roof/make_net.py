"""The control nets of the example roof: the first sketch, and the roof that was made of it.

A vault over the short span carries a wave along its crown, so that it is dome-like in places and
saddle-like in others; a twist and a bulge off the centre take away all symmetry. The sketch has a
dome in the middle besides, which the roof leaves out: where it turns the vault from long to round,
the two principal curvatures meet. Heights are rounded to centimetres, as a drawing would give them.

Run it to write net.json and sketch.json again: `python examples/roof/make_net.py`.
"""

import json
from pathlib import Path

import numpy as np

# Height of the sketch's dome in the control net, metres.
SKETCH_DOME = 3.5


def control_points(dome: float = 0.0) -> np.ndarray:
    """Control points (11, 10, 3) in metres, with a dome of so many metres in the middle."""
    x, y = np.meshgrid(np.linspace(-36, 36, 11), np.linspace(-29, 29, 10), indexing="ij")
    across = y - 1.13 * 6.0 * np.sin(1.7 * x / 36 + 0.4)
    z = 8.1 * (1 - (across / 27) ** 2)
    z += 1.38 * np.sin(2 * np.pi * x / 74 + 0.48) * (1 - 0.35 * across / 27)
    z += 0.0046 * x * y
    z += 2.2 * np.exp(-(((x + 7) / 15) ** 2) - ((y - 4) / 13) ** 2)
    z += 0.81 * (x / 36) ** 3
    z += dome * np.exp(-((x / 10) ** 2) - ((y - 4) / 11) ** 2)
    return np.stack([x, y, z], axis=-1).round(2)


if __name__ == "__main__":
    for name, dome in (("net.json", 0.0), ("sketch.json", SKETCH_DOME)):
        net = {"degree": [5, 5], "points": control_points(dome).tolist()}
        Path(__file__).with_name(name).write_text(json.dumps(net) + "\n", encoding="utf-8")
