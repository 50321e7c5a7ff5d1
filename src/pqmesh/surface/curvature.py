"""Fundamental forms, shape operator, principal curvatures and directions of a jet."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from pqmesh.surface.base import Jet
from pqmesh.vectors import TINY, Floats, cross, dot, unit


class Curvature(NamedTuple):
    """Principal data at N points of a surface.

    Attributes
    ----------
    normal : (N, 3)
        Unit normal, along X_u x X_v.
    k : (N, 2)
        Principal curvatures, k1 >= k2, 1/length; positive where the surface bends towards
        the normal.
    directions : (N, 2, 3)
        Orthonormal principal directions in space; their sign means nothing.
    directions_uv : (N, 2, 2)
        The same as steps (du, dv) that move the surface point at unit speed.
    deviator : (N, 2)
        ((II11 - II22)/2, II12) of the second form in `frame`; zero exactly at umbilics.
    frame : (N, 2, 3)
        Orthonormal tangent frame, first vector along X_u.
    """

    normal: Floats
    k: Floats
    directions: Floats
    directions_uv: Floats
    deviator: Floats
    frame: Floats


def first_form(jet: Jet) -> Floats:
    """First fundamental form, shape (N, 2, 2)."""
    e, f, g = dot(jet.du, jet.du), dot(jet.du, jet.dv), dot(jet.dv, jet.dv)
    return np.stack([np.stack([e, f], -1), np.stack([f, g], -1)], -2)


def second_form(jet: Jet) -> Floats:
    """Second fundamental form against the normal X_u x X_v, shape (N, 2, 2)."""
    normal = unit(cross(jet.du, jet.dv))
    entries = (dot(jet.duu, normal), dot(jet.duv, normal), dot(jet.dvv, normal))
    a, b, c = entries
    return np.stack([np.stack([a, b], -1), np.stack([b, c], -1)], -2)


def shape_data(jet: Jet) -> Curvature:
    """Normals, principal curvatures and directions.

    The second form is written in an orthonormal tangent frame, where the eigenproblem is that
    of a symmetric 2x2 matrix: real and ordered for every regular jet. At an umbilic the
    directions are those of the frame and mean nothing.

    References: [docarmo1976] chapter 3; [thesis] definition 2.1.9.

    Examples
    --------
    >>> import numpy as np
    >>> z, x, y = np.zeros(3), np.array([1.0, 0, 0]), np.array([0, 1.0, 0])
    >>> up = np.array([0, 0, 1.0])
    >>> jet = Jet(*(row[None] for row in (z, x, y, 2 * up, z, -up)))
    >>> shape_data(jet).k
    array([[ 2., -1.]])
    """
    du, dv = jet.du, jet.dv
    area = cross(du, dv)
    normal = unit(area)
    length_u = np.sqrt(dot(du, du))
    length_u = np.where(length_u > TINY, length_u, 1.0)
    e1 = du / length_u[:, None]
    e2 = cross(normal, e1)
    # e1 = X_u / |X_u| and e2 = shear X_u + stretch X_v, as parameter steps.
    across = dot(dv, e2)
    stretch = 1.0 / np.where(np.abs(across) > TINY, across, 1.0)
    shear = -dot(dv, e1) / length_u * stretch
    zero = np.zeros_like(shear)
    steps = np.stack([np.stack([1.0 / length_u, zero], -1), np.stack([shear, stretch], -1)], -2)
    l11, l12, l22 = dot(jet.duu, normal), dot(jet.duv, normal), dot(jet.dvv, normal)
    a = l11 / length_u**2
    b = (shear * l11 + stretch * l12) / length_u
    c = shear**2 * l11 + 2.0 * shear * stretch * l12 + stretch**2 * l22
    p, q = 0.5 * (a - c), b
    radius, mean = np.hypot(p, q), 0.5 * (a + c)
    half = 0.5 * np.arctan2(q, p)
    cos, sin = np.cos(half), np.sin(half)
    turn = np.stack([np.stack([cos, sin], -1), np.stack([-sin, cos], -1)], -2)
    frame = np.stack([e1, e2], 1)
    return Curvature(
        normal=normal,
        k=np.stack([mean + radius, mean - radius], -1),
        directions=turn @ frame,
        directions_uv=turn @ steps,
        deviator=np.stack([p, q], -1),
        frame=frame,
    )


def gaussian_curvature(jet: Jet) -> Floats:
    """Product of the principal curvatures, shape (N,), 1/length^2."""
    first, second = first_form(jet), second_form(jet)
    return np.asarray(np.linalg.det(second) / np.linalg.det(first))


def second_form_in(jet: Jet, a: Floats, b: Floats) -> Floats:
    """Second form II(a, b) of two tangent vectors given as parameter steps (N, 2)."""
    return np.asarray(np.einsum("ni,nij,nj->n", a, second_form(jet), b))
