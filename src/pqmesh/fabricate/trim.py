"""Trimming: panels of every layer, and webs, cut by the vertical prism over the outline."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pqmesh.errors import SpecError
from pqmesh.fabricate.clip import Pieces, cut_faces
from pqmesh.fabricate.slivers import is_sliver, merged_slivers
from pqmesh.fabricate.tidy import area_vectors
from pqmesh.fabricate.walls import outline_walls
from pqmesh.mesh.quadmesh import QuadMesh
from pqmesh.network.region import PlanOutline
from pqmesh.offset.support import SupportStructure
from pqmesh.vectors import Floats, Indices, Mask, norm, read_only


@dataclass(frozen=True, eq=False)
class TrimmedPanels:
    """Plane polygons of a mesh inside an outline, oriented like their faces.

    Attributes
    ----------
    polygons : tuple of (k, 3), model unit
        In the order of the faces. Corners that neighbours share are equal bit for bit, and a
        face that is not cut has its four corners as they were.
    face : (P,)
        Face of the mesh that the panel is cut from; of the larger part after a merger.
    is_trimmed : (P,)
    corner_vertex : tuple of (k,)
        Mesh vertex at each corner, -1 at a cut corner.
    corner_edge : tuple of (k,)
        Mesh edge on which a cut corner lies, -1 at vertices and at outline corners in a face.
    slivers : (S,)
        Panels that were cut too small and found no neighbour to merge with.
    area, area_plan : (P,), square model units
        In space and in plan, both positive.
    outline : PlanOutline
    """

    polygons: tuple[Floats, ...]
    face: Indices
    is_trimmed: Mask
    corner_vertex: tuple[Indices, ...]
    corner_edge: tuple[Indices, ...]
    slivers: Indices
    area: Floats
    area_plan: Floats
    outline: PlanOutline

    @property
    def sliver_places(self) -> Floats:
        """Mean corner of each sliver, shape (S, 3)."""
        places = [self.polygons[k].mean(axis=0) for k in self.slivers.tolist()]
        return np.array(places).reshape(-1, 3)

    @property
    def covered_share(self) -> float:
        """Area in plan over the area of the outline: 1 where the mesh covers it all, once."""
        return float(self.area_plan.sum()) / self.outline.area


@dataclass(frozen=True, eq=False)
class TrimmedWebs:
    """Plane polygons of a support structure inside an outline.

    Attributes
    ----------
    polygons : tuple of (k, 3), model unit
    edge : (W,)
        Mesh edge that each stands on; an edge that leaves the outline and comes back has
        several.
    is_trimmed : (W,)
    """

    polygons: tuple[Floats, ...]
    edge: Indices
    is_trimmed: Mask


def trimmed_panels(mesh: QuadMesh, outline: PlanOutline, edge: float) -> TrimmedPanels:
    """Panels of a mesh cut by the vertical prism over an outline.

    The walls cut edges in space, once for both neighbours; outline corners inside a face are
    lifted into its plane, so a cut panel is as flat as its face. A face that falls apart gives
    one panel a piece, one with a hole of the outline inside is split through the hole. Faces
    may be steep, overhang, or stand upright (within 1e-7 of the vertical they are cut in their
    own plane, and outline corners nearer than that to their trace are passed over). Points
    nearer than 1e-9 of the mean edge count as one, and thinner pieces as none.

    A sliver is a cut panel with less than 15 % of the mean area of the whole ones, or with a
    side below 5 % of the wanted edge. It is merged into the neighbour with the longest common
    side among those in its plane (to 5e-10 edges, as flat zones have); otherwise it stays and
    is listed. No uncut vertex is ever moved for it.

    Parameters
    ----------
    mesh : QuadMesh
        With plane faces, reaching over the outline; a layer as well as the mesh itself.
    outline : PlanOutline
    edge : float, model unit
        Wanted panel edge.

    Raises
    ------
    SpecError
        When the outline crosses itself, or misses the mesh.
    MeshError
        When a face that must be cut crosses itself.

    Examples
    --------
    >>> from pqmesh.mesh.exact import translational_mesh
    >>> line = np.arange(4.0)
    >>> mesh = translational_mesh([[x, 0, 0] for x in line], [[0, y, 0.3 * y] for y in line])
    >>> outline = PlanOutline([[0.5, 0.5], [3, 0.5], [3, 2.5], [0.5, 2.5]])
    >>> panels = trimmed_panels(mesh, outline, 1.0)
    >>> len(panels.polygons), int(panels.is_trimmed.sum()), float(panels.area_plan.sum())
    (9, 7, 5.0)
    """
    pieces = cut_faces(mesh.vertices, mesh.faces, outline_walls(outline))
    if not pieces.loops:
        raise SpecError(
            f"The outline must lie over the mesh; the mesh reaches from "
            f"{mesh.vertices[:, :2].min(axis=0).round(6).tolist()} to "
            f"{mesh.vertices[:, :2].max(axis=0).round(6).tolist()} in plan and the outline "
            f"nowhere over it. Move one of the two, and check their units."
        )
    merged = merged_slivers(pieces, mesh, edge)
    polygons = tuple(read_only(pieces.nodes.at(loop)) for loop in merged.loops)
    vectors = area_vectors(polygons)
    vertex, on_edge = _corner_sources(pieces, merged.loops)
    small = is_sliver(polygons, norm(vectors), merged.is_trimmed, merged.mean_area, edge)
    return TrimmedPanels(
        polygons,
        read_only(merged.face, np.int64),
        read_only(merged.is_trimmed, np.bool_),
        vertex,
        on_edge,
        read_only(np.flatnonzero(small), np.int64),
        read_only(norm(vectors)),
        read_only(np.abs(vectors[:, 2])),
        outline,
    )


def trimmed_webs(support: SupportStructure, outline: PlanOutline) -> TrimmedWebs:
    """Webs of a support structure cut by the vertical prism over an outline.

    A web is cut as a panel is, and falls into as many pieces; a cut end is a vertical line, or
    a polyline where an outline corner stands over the web. Cut points of its lower and upper
    side are those of the layers, bit for bit, where these are the lowest and the highest one.

    Parameters
    ----------
    support : SupportStructure
    outline : PlanOutline

    Examples
    --------
    >>> from pqmesh.mesh.exact import translational_mesh
    >>> from pqmesh.offset.support import support_structure
    >>> mesh = translational_mesh([[0, 0, 0], [2, 0, 0]], [[0, 0, 0], [0, 1, 0]])
    >>> up = np.tile([0.0, 0.0, 1.0], (4, 1))
    >>> support = support_structure(mesh, up, mesh, mesh.with_vertices(mesh.vertices + up))
    >>> webs = trimmed_webs(support, PlanOutline([[1, -1], [3, -1], [3, 2], [1, 2]]))
    >>> webs.edge.tolist(), webs.is_trimmed.tolist()
    ([1, 2, 3], [True, True, False])
    """
    low, high = support.edges[:, 0], support.edges[:, 1]
    count = int(support.edges.max()) + 1
    points = np.zeros((2 * count, 3))
    # The lower layer's vertices, then the upper one's: webs at a node share its axis.
    quads = np.stack([low, high, count + high, count + low], axis=1)
    points[quads] = support.quads
    pieces = cut_faces(points, quads, outline_walls(outline), what="web")
    whole = quads.tolist()
    trimmed = [loop != whole[web] for loop, web in zip(pieces.loops, pieces.face, strict=True)]
    return TrimmedWebs(
        tuple(read_only(pieces.nodes.at(loop)) for loop in pieces.loops),
        read_only(pieces.face, np.int64),
        read_only(trimmed, np.bool_),
    )


def _corner_sources(
    pieces: Pieces, loops: list[list[int]]
) -> tuple[tuple[Indices, ...], tuple[Indices, ...]]:
    """Mesh vertex and mesh edge of each corner, -1 where there is none."""
    last = pieces.nodes.n_vertices
    vertex = tuple(read_only([n if n < last else -1 for n in loop], np.int64) for loop in loops)
    edge = tuple(read_only([pieces.nodes.edge[n] for n in loop], np.int64) for loop in loops)
    return vertex, edge
