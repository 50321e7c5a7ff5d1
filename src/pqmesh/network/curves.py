"""What every tracer of networks returns: two families of lines and their crossings."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from pqmesh.network.crossings import Crossings
from pqmesh.network.lines import Lines
from pqmesh.network.walker import End, Field
from pqmesh.surface.base import Surface
from pqmesh.surface.umbilics import conjugacy_defect
from pqmesh.vectors import Floats, Indices, angle

# Panels of families that meet under a smaller angle are narrow rhombs: worth a warning.
NARROW_ANGLE = np.radians(30.0)

# Family, parameters (2,) and place (3,) where neighbouring geodesics meet.
Focus = tuple[int, Floats, Floats]


@dataclass(frozen=True, eq=False)
class CurveNetwork:
    """Two transversal families of lines on a surface and all their crossings.

    Attributes
    ----------
    surface : Surface
    families : (Lines, Lines)
        In a principal network the lines along the larger (0) and the smaller (1) principal
        curvature; in a parameter network along u and along v; in a conjugate one the given
        family and its conjugate; in a geodesic one the lines beside the first start curve
        and those that leave it at right angles.
    found : Crossings
    kind : str
        A key of `pqmesh.network.kinds.NETWORKS`.
    field : Field, optional
        What the lines follow.
    focal : tuple of (family, (2,) parameters, (3,) place)
        Where the lines of a geodesic family focus: one entry a line end.
    """

    surface: Surface
    families: tuple[Lines, Lines]
    found: Crossings
    kind: str = "principal"
    field: Field | None = None
    focal: tuple[Focus, ...] = ()

    @cached_property
    def points(self) -> Floats:
        """Crossings in space, shape (N, 3)."""
        return self.surface.jet(self.found.uv).point

    @cached_property
    def slopes(self) -> Floats:
        """Parameter steps along both families at the crossings, of any length, (N, 2, 2).

        Those of the field where there is one: the slope of dense output is less true by some
        digits.
        """
        jet, steps = self.surface.jet(self.found.uv), []
        for family, lines in enumerate(self.families):
            line, arc = self.found.lines[:, family], self.found.arcs[:, family]
            step = lines.slope(*lines.locate(line, arc))
            if self.field is not None:
                along = jet.du * step[:, :1] + jet.dv * step[:, 1:]
                which = np.full(len(line), family)
                step = self.field(self.surface, self.found.uv, along, which).velocity
            steps.append(step)
        return np.stack(steps, axis=1)

    @cached_property
    def angles(self) -> Floats:
        """Angles between the families at the crossings, radians in [0, pi/2], shape (N,)."""
        jet, steps = self.surface.jet(self.found.uv), self.slopes
        a, b = (jet.du * steps[:, i, :1] + jet.dv * steps[:, i, 1:] for i in (0, 1))
        between = angle(a, b)
        return np.minimum(between, np.pi - between)

    @property
    def narrow(self) -> Indices:
        """Crossings at which the families meet under less than 30 degrees, the narrowest first."""
        order = np.argsort(self.angles, kind="stable")
        return np.asarray(order[self.angles[order] < NARROW_ANGLE])

    @cached_property
    def conjugacy(self) -> Floats:
        """How far the families are from conjugate at the crossings, in [0, 1], shape (N,)."""
        steps = self.slopes
        return conjugacy_defect(self.surface, self.found.uv, steps[:, 0], steps[:, 1])

    def ended(self, reason: End) -> Floats:
        """Parameters at which lines of either family end for the given reason, (n, 2)."""
        places = [np.empty((0, 2))]
        for lines in self.families:
            for side, theta in ((0, 0.0), (1, 1.0)):
                which = np.flatnonzero((lines.ends[:, side] == reason) & (np.diff(lines.start) > 0))
                segment = lines.start[which] if side == 0 else lines.start[which + 1] - 1
                places.append(lines.at(segment, np.full(len(which), theta)))
        return self.surface.domain.reduce(np.concatenate(places))
