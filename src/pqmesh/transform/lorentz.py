"""Rotations and boosts as matrices: the two kinds of exponentials in the Lorentz group."""

from __future__ import annotations

import numpy as np

from pqmesh.vectors import Floats, cross, norm, unit


def rotation_matrix(turn: Floats) -> Floats:
    """Rotation about the direction of a vector (3,) by its length, radians; shape (3, 3).

    Examples
    --------
    >>> rotation_matrix(np.array([0.0, 0.0, np.pi / 2])).round(12) + 0.0
    array([[ 0., -1.,  0.],
           [ 1.,  0.,  0.],
           [ 0.,  0.,  1.]])
    """
    angle = float(norm(turn))
    spin = np.stack([cross(e, turn) for e in np.eye(3)])
    # sin(t)/t and (1 - cos t)/t^2, without loss near 0.
    first, second = np.sinc(angle / np.pi), 0.5 * np.sinc(0.5 * angle / np.pi) ** 2
    return np.asarray(np.eye(3) + first * spin + second * (spin @ spin))


def boost_matrix(push: Floats) -> Floats:
    """Boost along the direction of a vector (3,) with its length as rapidity; shape (4, 4).

    Examples
    --------
    >>> boost_matrix(np.array([0.0, 0.0, np.log(2.0)]))[2:, 2:]
    array([[1.25, 0.75],
           [0.75, 1.25]])
    """
    rapidity = float(norm(push))
    along = unit(push)
    matrix = np.eye(4)
    # cosh - 1 without loss near 0.
    matrix[:3, :3] += 2.0 * np.sinh(0.5 * rapidity) ** 2 * np.outer(along, along)
    matrix[:3, 3] = matrix[3, :3] = np.sinh(rapidity) * along
    matrix[3, 3] = np.cosh(rapidity)
    return matrix
