"""The three offsets, of vertices, edges and faces: all of one box, and one each of three roofs.

A box has all three. A freeform mesh has one of them when it is made for it: vertex offsets when
circular, edge offsets when parallel to a Koebe mesh, face offsets when conical. Run it with
`python examples/three_offsets.py`, and with a path to get a picture.
"""

import sys
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

import pqmesh
from pqmesh.job import Spec, panelize
from pqmesh.koebe.edge_offset import edge_offset
from pqmesh.mesh.quadmesh import QuadMesh
from pqmesh.mesh.solids import cube
from pqmesh.offset.distances import (
    KINDS,
    edge_distance,
    face_distance,
    is_offset,
    vertex_distance,
)
from pqmesh.offset.offsets import face_offset
from pqmesh.source import read_design, spec_of
from pqmesh.vectors import dot, norm, unit

if TYPE_CHECKING:
    from pqmesh.view.camera import Box
    from pqmesh.view.sheet import Sheet

HERE = Path(__file__).parent
MEASURED = {"vertex": vertex_distance, "edge": edge_distance, "face": face_distance}
MADE_FOR = {"vertex": "circular", "edge": "edge-offset", "face": "conical"}
PLURAL = {"vertex": "vertices", "edge": "edges", "face": "faces"}


@dataclass(frozen=True)
class Pair:
    """A mesh and its layer at a distance, metres; `kind` says what has the distance everywhere."""

    name: str
    kind: str
    mesh: QuadMesh
    layer: QuadMesh
    distance: float

    def extremes(self, kind: str) -> tuple[float, float]:
        """Smallest and largest distance of vertices, edges' lines or face planes over the asked."""
        shares = MEASURED[kind](self.mesh, self.layer) / self.distance
        return float(shares.min()), float(shares.max())


def box_pairs(distance: float) -> list[Pair]:
    """A box of 12 x 6 x 4 about the origin and its three offsets, by the asked distance.

    All are the box plus d times another box S, the Gauss image: with its corners on the unit
    sphere, with its edges touching it, or with its faces touching it. The last two are cubes, one
    larger than the other. The first may be any box of diagonal 2, and is the one here that makes
    the offset a scaled box: from the middle to a corner are 7.
    """
    box = cube().with_vertices(cube().vertices * [6.0, 3.0, 2.0])
    layers = {
        "vertex": box.with_vertices(box.vertices * (1.0 + distance / 7.0)),
        "edge": edge_offset(box, distance),
        "face": face_offset(box, distance),
    }
    return [Pair("box", kind, box, layers[kind], distance) for kind in KINDS]


def roof_pairs() -> list[Pair]:
    """A circular vault, a dome with edge offsets and a conical roof, each with its layer."""
    vault = read_design(HERE / "designs" / "vault.toml")
    roof = read_design(HERE / "roof" / "roof.toml")
    dome = pqmesh.graph_surface("6 - x**2/20 - y**2/12", (-7, 7), (-5, 5))
    asked = {
        "vertex": ("vault", vault.surface, spec_of(vault), vault.outline, 0.6),
        "edge": ("dome", dome, Spec(edges=(1.2, 1.2)), None, 0.6),
        "face": ("roof", roof.surface, replace(spec_of(roof), edges=(3.0, 3.0)), roof.outline, 2.0),
    }
    pairs = []
    for kind, (name, surface, spec, outline, distance) in asked.items():
        spec = replace(spec, kind=MADE_FOR[kind], distances=(distance,))
        made = panelize(surface, spec, outline)
        pairs.append(Pair(name, kind, made.mesh, made.layers[0].mesh, distance))
    return pairs


def main(picture: str | None = None) -> dict[str, float]:
    """Make all pairs, print the numbers, and return them.

    The distances are shares of the asked one; `kinds` counts those that are the same everywhere.
    """
    pairs = [*box_pairs(1.0), *roof_pairs()]
    found = {}
    for pair in pairs:
        title = f"{pair.name}_{pair.kind}_offset"
        found[f"{title}:panels"] = float(pair.mesh.topology.n_faces)
        kinds = [is_offset(pair.mesh, pair.layer, kind) for kind in KINDS]
        found[f"{title}:kinds"] = float(sum(kinds))
        for kind in KINDS:
            low, high = pair.extremes(kind)
            found |= {f"{title}:{kind}_min": low, f"{title}:{kind}_max": high}
    for name, value in found.items():
        print(f"{name:30} {value:.6g}")
    if picture:
        Path(picture).write_bytes(drawn(pairs))
    return found


# --- picture ------------------------------------------------------------------------------------


def pins(pair: Pair) -> np.ndarray:
    """Segments (n, 2, 3) from the mesh to its layer that have the constant length."""
    mesh, layer = pair.mesh, pair.layer
    if pair.kind == "vertex":
        return np.stack([mesh.vertices, layer.vertices], axis=1)
    if pair.kind == "edge":
        feet = mesh.vertices[mesh.edges].mean(axis=1)
        ways = layer.vertices[mesh.edges].mean(axis=1) - feet
        along = unit(mesh.edge_vectors)
        return np.stack([feet, feet + ways - dot(ways, along)[:, None] * along], axis=1)
    feet = mesh.face_centers
    heights = dot(layer.face_centers - feet, mesh.face_normals)
    return np.stack([feet, feet + heights[:, None] * mesh.face_normals], axis=1)


def draw_pair(sheet: "Sheet", pair: Pair, box: "Box") -> None:
    """A mesh, its layer (over a half of a roof only), and the equal distances in red."""
    from pqmesh.view.camera import Camera, View
    from pqmesh.view.layered import BASE, BASE_LINE, GLASS, GLASS_LINE, lit
    from pqmesh.view.scene import Scene, rgba

    mesh, layer, is_box = pair.mesh, pair.layer, pair.name == "box"
    camera = Camera.around(mesh.vertices, mesh.face_normals)
    if is_box:
        camera = Camera.orbit(np.zeros(3), np.radians(-62), np.radians(28))
    scene = Scene(View.fitted(camera, np.concatenate([mesh.vertices, layer.vertices]), box))
    across = camera.project(mesh.face_centers)[:, 0]
    covered = np.ones(len(across), dtype=bool) if is_box else across > np.median(across)
    scene.add(mesh.corners, lit(BASE, camera.light(mesh.face_normals), 1.0), rgba(BASE_LINE), 0.9)
    glass = lit(GLASS, camera.light(layer.face_normals), 0.25 if is_box else 0.7)[covered]
    scene.add(layer.corners[covered], glass, rgba(GLASS_LINE, 0.9), 1.2)
    segments = pins(pair)
    starts = camera.project(segments[:, 0])[:, 0]
    if not is_box:
        segments = segments[starts < np.median(across)]
    lift = 0.1 * float(norm(layer.vertices - mesh.vertices).max())
    scene.add_lines(segments, rgba("#c2452d"), 2.2, lift)
    scene.paint(sheet)


def drawn(pairs: list[Pair]) -> bytes:
    """PNG of the six pairs with their distances."""
    from pqmesh.view.camera import Box
    from pqmesh.view.sheet import GREY, INK, paper

    title = "Three offsets: of vertices, of edges, of faces"
    caption = "Red: the distance that is the same everywhere. Figures: shares of the asked distance"
    with paper(title, caption) as sheet:
        for place, pair in enumerate(pairs):
            left, floor = 60 + 510 * (place % 3), 500 - 440 * (place // 3)
            draw_pair(sheet, pair, Box(left, floor + 115, left + 440, floor + 370))
            words = f"{pair.name}, {MADE_FOR[pair.kind]}" if pair.name != "box" else "box"
            sheet.text(left, floor + 72, f"{words}: offset of {PLURAL[pair.kind]}", weight="bold")
            for row, kind in enumerate(KINDS):
                low, high = pair.extremes(kind)
                is_constant = high - low < 1e-9
                shown = f"{low:.4f}" if is_constant else f"{low:.4f} to {high:.4f}"
                style = {"color": INK if is_constant else GREY}
                sheet.text(left, floor + 46 - 24 * row, PLURAL[kind], **style)
                sheet.text(left + 110, floor + 46 - 24 * row, shown, **style)
        return sheet.png()


if __name__ == "__main__":
    main(*sys.argv[1:2])
