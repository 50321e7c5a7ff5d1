"""Cameras: from points in space to pixels of a picture, and the light that goes with them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from pqmesh.vectors import Floats, cross, dot, norm, unit

# Usual view of a roof: its long side turned this much from the horizontal, seen from this height.
TURN = math.radians(-32.0)
ELEVATION = math.radians(36.0)
# A light over the viewer's left shoulder: right, up, towards the viewer.
LIGHT = np.array([-0.62, 0.52, 0.59])


@dataclass(frozen=True, eq=False)
class Camera:
    """Orthographic camera, or a perspective one at a finite distance.

    Attributes
    ----------
    target : (3,), model unit
        The point in the middle of the picture.
    axes : (3, 3)
        Orthonormal rows: right, up, and towards the viewer.
    distance : float, model unit
        From the eye to the target; infinite for an orthographic camera.
    """

    target: Floats
    axes: Floats
    distance: float = math.inf

    @classmethod
    def orbit(
        cls, target: Floats, azimuth: float, elevation: float, distance: float = math.inf
    ) -> Camera:
        """Camera that looks at the target from an azimuth and an elevation, radians, z upwards.

        Examples
        --------
        >>> top = Camera.orbit(np.zeros(3), -np.pi / 2, np.pi / 2)
        >>> bool(np.allclose(top.project(np.array([[2.0, 3.0, 5.0]])), [[2.0, 3.0, 5.0]]))
        True
        """
        ca, sa = math.cos(azimuth), math.sin(azimuth)
        ce, se = math.cos(elevation), math.sin(elevation)
        axes = np.array([[-sa, ca, 0.0], [-se * ca, -se * sa, ce], [ce * ca, ce * sa, se]])
        return cls(np.asarray(target, dtype=np.float64), axes, distance)

    @classmethod
    def around(cls, points: Floats, normals: Floats) -> Camera:
        """The usual view of points (N, 3) with normals (M, 3): long side across, from above.

        Of four such views the one that shows most of the outer side is taken.
        """
        middle = 0.5 * (points.min(axis=0) + points.max(axis=0))
        plan = points[:, :2] - points[:, :2].mean(axis=0)
        spread = plan.T @ plan
        long = 0.5 * math.atan2(2.0 * spread[0, 1], spread[0, 0] - spread[1, 1])
        # A roof is seen from above whichever side its normals are on.
        outside = -normals if len(normals) and normals[:, 2].mean() < -1e-9 else normals
        best, most = cls.orbit(middle, long - 0.5 * math.pi + TURN, ELEVATION), -math.inf
        for half in (-0.5, 0.5):
            for turn in (TURN, -TURN):
                camera = cls.orbit(middle, long + half * math.pi + turn, ELEVATION)
                shown = np.clip(outside @ camera.axes[2], 0.0, None)
                # Clearly more to see, or the first: symmetric shapes shall not flicker.
                if len(shown) and float(shown.mean()) > most + 1e-3:
                    best, most = camera, float(shown.mean())
        return best

    @classmethod
    def at_node(cls, target: Floats, up: Floats, from_side: Floats, distance: float) -> Camera:
        """Perspective camera with a given up vector, which looks down on the target from a side."""
        side = unit(from_side - float(dot(from_side, up)) * up)
        elevation = math.radians(30.0)
        towards = math.cos(elevation) * side + math.sin(elevation) * up
        right = unit(cross(up, towards))
        axes = np.stack([right, cross(towards, right), towards])
        return cls(np.asarray(target, dtype=np.float64), axes, distance)

    def project(self, points: Floats) -> Floats:
        """Picture coordinates right and up, and nearness to the viewer; (..., 3), model unit."""
        seen = np.asarray((points - self.target) @ self.axes.T)
        if math.isinf(self.distance):
            return seen
        eye = np.array([0.0, 0.0, self.distance])
        scale = self.distance / np.maximum(self.distance - seen[..., 2], 1e-3 * self.distance)
        nearness = self.distance - norm(eye - seen)
        return np.concatenate([seen[..., :2] * scale[..., None], nearness[..., None]], axis=-1)

    def light(self, normals: Floats, *, depth: float = 1.0) -> Floats:
        """Brightness of surfaces with unit normals (N, 3), both sides alike; about 0.6 to 1.1.

        Parameters
        ----------
        depth : float
            0 leaves all at 1, 1 is the full play of light.
        """
        seen = normals @ self.axes.T
        seen = np.where(seen[:, 2:] < 0, -seen, seen)
        lambert = np.clip(seen @ (LIGHT / norm(LIGHT)), 0.0, 1.0)
        rim = (1.0 - np.clip(seen[:, 2], 0.0, 1.0)) ** 3
        return np.asarray(1.0 + depth * (0.46 * lambert - 0.12 * rim - 0.37))


class Box(NamedTuple):
    """Rectangle on a picture, pixels from the lower left."""

    left: float
    bottom: float
    right: float
    top: float

    @property
    def middle(self) -> tuple[float, float]:
        """Its centre."""
        return 0.5 * (self.left + self.right), 0.5 * (self.bottom + self.top)


@dataclass(frozen=True, eq=False)
class View:
    """A camera with the place of its picture on the sheet.

    Attributes
    ----------
    scale : float
        Pixels per model unit at the target.
    origin : (2,)
        Pixel of the target.
    """

    camera: Camera
    scale: float
    origin: Floats

    @classmethod
    def fitted(cls, camera: Camera, points: Floats, box: Box) -> View:
        """The largest picture of the points (N, 3) within a box, centred."""
        seen = camera.project(points)[:, :2]
        low, high = seen.min(axis=0), seen.max(axis=0)
        room = np.array([box.right - box.left, box.top - box.bottom])
        extent = np.maximum(high - low, 1e-9 * max(float(np.max(high - low)), 1e-300))
        scale = float(np.min(room / extent))
        return cls(camera, scale, np.array(box.middle) - scale * 0.5 * (low + high))

    def pixels(self, points: Floats) -> Floats:
        """Pixel right, pixel up and nearness in the model unit of points (..., 3)."""
        seen = self.camera.project(points)
        return np.concatenate([seen[..., :2] * self.scale + self.origin, seen[..., 2:]], axis=-1)

    def magnified(self, point: Floats, factor: float, place: tuple[float, float]) -> View:
        """The same view some times larger, with the given point (3,) at a pixel."""
        seen = self.camera.project(point)[:2]
        scale = factor * self.scale
        return View(self.camera, scale, np.array(place) - scale * seen)
