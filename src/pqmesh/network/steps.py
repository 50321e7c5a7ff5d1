"""One step of a differential equation for many states: Dormand and Prince of order five."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

import numpy as np

from pqmesh.vectors import Floats

Told = TypeVar("Told")

# Dormand-Prince 5(4): nodes, stages, embedded error and the fourth-order continuous extension.
# References: [dormand1980]; [hairer1993] section II.6.
_STAGES = [
    np.array([1 / 5]),
    np.array([3 / 40, 9 / 40]),
    np.array([44 / 45, -56 / 15, 32 / 9]),
    np.array([19372 / 6561, -25360 / 2187, 64448 / 6561, -212 / 729]),
    np.array([9017 / 3168, -355 / 33, 46732 / 5247, 49 / 176, -5103 / 18656]),
    np.array([35 / 384, 0.0, 500 / 1113, 125 / 192, -2187 / 6784, 11 / 84]),
]
_ERROR = np.array([71 / 57600, 0, -71 / 16695, 71 / 1920, -17253 / 339200, 22 / 525, -1 / 40])
_DENSE = np.array(
    [
        -12715105075 / 11282082432,
        0.0,
        87487479700 / 32700410799,
        -10690763975 / 1880347072,
        701980252875 / 199316789632,
        -1453857185 / 822651844,
        69997945 / 29380423,
    ]
)


def stages(
    start: Floats, first: Floats, h: Floats, motion: Callable[[Floats], tuple[Floats, Told]]
) -> tuple[Floats, Floats, Told]:
    """Rates of change at the seven stages of one step, (7, n, k), and its end (n, k).

    `motion` tells the rates (n, k) at a state (n, k), and anything else; what it tells of the
    end comes last.
    """
    rates = np.empty((7, *start.shape))
    rates[0] = first
    for i, weights in enumerate(_STAGES):
        finish = start + h * np.tensordot(weights, rates[: i + 1], 1)
        rates[i + 1], last = motion(finish)
    return rates, finish, last


def continuous(start: Floats, finish: Floats, h: Floats, rates: Floats) -> Floats:
    """Continuous extension of order four of a step from its stages, (n, 5, k)."""
    rise = finish - start
    bend = h * rates[0] - rise
    twist = rise - h * rates[6] - bend
    return np.stack([start, rise, bend, twist, h * np.tensordot(_DENSE, rates, 1)], 1)


def embedded_error(h: Floats, rates: Floats) -> Floats:
    """Difference of the step to that of order four, (n, k)."""
    return np.asarray(h * np.tensordot(_ERROR, rates, 1))
