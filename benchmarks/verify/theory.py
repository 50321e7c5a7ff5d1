"""The theorems by figures: parallel meshes, Laguerre images, Koebe meshes, edge offsets."""

from __future__ import annotations

import json
import os
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from cli.test_transform import DESIGN
from koebe.graphs import divided_cube
from koebe.test_example import loaded
from sphere_samples import cyclide_mesh, rotational
from table import (
    COMMAND,
    DATA,
    ROOT,
    Row,
    Run,
    at_least,
    at_most,
    holds,
    measured_command,
    note,
    run,
    skipped,
)
from theorems.test_errata_spheres import laguerre, plane_rotation
from theorems.test_parallel import DIMENSIONS
from transform.test_laguerre import centered, worst_losses

from pqmesh.errors import MeshError
from pqmesh.io.formats import read_quad_mesh, write_mesh
from pqmesh.job import panelize
from pqmesh.koebe.polyhedron import koebe_polyhedron, tangency_deviation
from pqmesh.koebe.square_patch import square_edges
from pqmesh.mesh.cones import vertex_cones
from pqmesh.mesh.exact import rotational_mesh
from pqmesh.mesh.measure import fitted_cones, planarity
from pqmesh.mesh.planes import face_planes
from pqmesh.mesh.quadmesh import QuadMesh
from pqmesh.offset.distances import edge_distance, parallel_error
from pqmesh.offset.parallel import parallel_space
from pqmesh.offset.vectors import face_offset_vectors
from pqmesh.source import read_design, spec_of
from pqmesh.surface.formula import graph_surface
from pqmesh.transform.conical import rapidity_range
from pqmesh.transform.laguerre import LaguerreTransform
from pqmesh.vectors import dot

T = TypeVar("T")
ROOF = ROOT / "examples" / "roof" / "roof.toml"
# Errors that count as conical, and what a planted error must exceed.
CONICAL, PLANTED = 1e-9, 1e-4
DOME_HEIGHT, DOME_X, DOME_Y = "-0.02*x**2 - 0.03*y**2", (-4.0, 4.0), (-3.0, 3.0)


def timed(call: Callable[[], T]) -> tuple[T, float]:
    """What a call gives, and its wall seconds."""
    began = time.perf_counter()
    found = call()
    return found, time.perf_counter() - began


# --- parallel meshes --------------------------------------------------------------------------


def dimensions() -> list[Row]:
    """dim P(M) of meshes whose number is known from theory."""
    rows, longest = [], 0.0
    for name, (mesh, wanted) in DIMENSIONS.items():
        space, seconds = timed(partial(parallel_space, mesh))
        longest = max(longest, seconds)
        found = f"{space.dimension}, gap {space.gap:.1e}"
        rows.append(holds(f"dim P(M), {name}", str(wanted), found, space.dimension == wanted))
    return [*rows, at_most("slowest of these, s", 2.0, longest)]


def _counted(
    name: str, mesh: QuadMesh, wanted: int, gap: float, *, exact: bool = True
) -> list[Row]:
    """Rows about the dimension of one mesh, its gap and its time."""
    space, seconds = timed(partial(parallel_space, mesh))
    right = space.dimension == wanted if exact else space.dimension >= wanted
    asked = str(wanted) if exact else f">= {wanted}"
    return [
        holds(f"{name}: dim P(M)", asked, space.dimension, right),
        at_least(f"{name}: gap of singular values", gap, space.gap),
        at_most(f"{name}: time, s", 2.0, seconds),
    ]


def _refusal(name: str, mesh: QuadMesh) -> Row:
    """Whether a mesh is refused with the planarity of its worst face."""
    try:
        text = f"dim P(M) = {parallel_space(mesh).dimension}"
    except MeshError as error:
        text = str(error)
    worst = f"{planarity(mesh).max():.2g}"
    line = f"{name} as delivered: refused with its planarity"
    said = text[text.find("planarity of") :][:40]
    return holds(line, worst, said, f"is {worst}," in said)


def real_meshes() -> list[Row]:
    """dim P(M) of real meshes, as delivered and after the command that makes them planar."""
    if not DATA.is_dir():
        return [skipped("real meshes", "the data folder is missing")]
    rows = []
    for file, wanted, gap in (("conical1.obj", 69, 1e3), ("formfinding-circular.off", 38, 1e2)):
        rows += _counted(file, read_quad_mesh(DATA / file), wanted, gap)
    for file, wanted in (("YasIsland.off", 107), ("six.off", 64)):
        rows.append(_refusal(file, read_quad_mesh(DATA / file)))
        with tempfile.TemporaryDirectory(prefix="pqmesh-theory-") as name:
            flat = Path(name) / "planar.off"
            done = run("optimize", DATA / file, "--kind", "planar", "-o", flat)
            rows.append(
                holds(f"{file}: optimize --kind planar ends in", "0", done.code, done.code == 0)
            )
            mesh = read_quad_mesh(flat)
        rows += _counted(f"{file}, planar", mesh, wanted, 1e2, exact=file.startswith("Yas"))
    return rows


def _basis(before: str) -> tuple[list[str], Run]:
    """Seconds of both bases of P(M) and their sizes, in a process of its own."""
    program = (
        f"{before}import sys, time; sys.path.insert(0, {str(ROOT / 'tests')!r});"
        "from offset.test_parallel import large_grid, parallel_space;"
        "mesh = large_grid(100); began = time.perf_counter();"
        "space = parallel_space(mesh); middle = time.perf_counter() - began;"
        "basis = space.basis; end = time.perf_counter() - began;"
        "print(middle, end, space.dimension, *basis.shape)"
    )
    done = measured_command([sys.executable, "-c", program])
    return done.out.split(), done


def large_basis() -> list[Row]:
    """Time and memory of a basis of P(M) of 10 000 faces; busy machines slow threads down."""
    (factors, whole, dimension, *shape), done = _basis("")
    alone, _ = _basis("import os; os.environ['OPENBLAS_NUM_THREADS'] = '1';")
    return [
        holds("grid of 100 x 100 faces: dim P(M)", "203", dimension, dimension == "203"),
        holds("entries of the basis", "30603 x 203", " x ".join(shape), shape == ["30603", "203"]),
        at_most("basis in edge factors, s", 3.0, float(factors)),
        at_most("basis in edge factors and in vertex coordinates, s", 3.0, float(whole)),
        note("both with one thread, s", f"{float(alone[0]):.2f}, {float(alone[1]):.2f}"),
        note("processors, others at work on them", f"{os.cpu_count()}, {os.getloadavg()[0]:.1f}"),
        at_most("largest memory of the whole process, MiB", 1024.0, done.megabytes),
    ]


# --- Laguerre ---------------------------------------------------------------------------------


def _worst_images(mesh: QuadMesh, seeds: int) -> np.ndarray:
    """Worst planarity, |n'.w' - 1|, cone spread and cone deviation of random images."""
    limit, planes = rapidity_range(mesh)[1], face_planes(mesh)
    corners, faces = mesh.topology.indices, mesh.topology.corner_faces
    worst = np.zeros(4)
    for seed in range(seeds):
        rng = np.random.default_rng(seed)
        found = LaguerreTransform.random(rng, 0.5 * limit * rng.uniform(-1, 1))
        image = found.of_mesh(mesh)
        normals = found.on_planes(planes)[faces, :3]
        figures = (
            planarity(image.mesh).max(),
            np.abs(dot(normals, image.vectors[corners]) - 1.0).max(),
            fitted_cones(image.mesh).relative_spread.max(),
            vertex_cones(image.mesh).deviation.max(),
        )
        worst = np.maximum(worst, figures)
    return worst


def laguerre_images() -> list[Row]:
    """A thousand random images of two exact conical meshes."""
    rows = []
    for name, build in (("rotational", rotational), ("cyclide", cyclide_mesh)):
        flat, fit, spread, angle = _worst_images(centered(build()), 1000)
        rows += [
            at_most(f"{name}, 1000 images: planarity", 1e-10, flat),
            at_most(f"{name}, 1000 images: |n'.w' - 1|", 1e-9, fit),
            at_most(f"{name}, 1000 images: spread of their cones / theta", CONICAL, spread),
            at_most(f"{name}, 1000 images: planes off their cones, rad", CONICAL, angle),
        ]
    return rows


def _turned_star(mesh: QuadMesh, angle: float) -> QuadMesh:
    """The mesh with the neighbours of one interior vertex turned about it."""
    star = next(star for star in mesh.topology.stars() if star.neighbors.shape[1] == 4)
    middle, around = star.vertices[0], star.neighbors[0]
    turn = LaguerreTransform.rotation([0.3, 1.0, 0.2], angle).matrix[:3, :3]
    points = mesh.vertices.copy()
    points[around] = points[middle] + (points[around] - points[middle]) @ turn.T
    return mesh.with_vertices(points)


def planted_errors() -> list[Row]:
    """The cone test sees what is not a Laguerre image: flat faces alone do not pass it."""
    rows = []
    for name, build in (("rotational", rotational), ("cyclide", cyclide_mesh)):
        mesh = centered(build())
        vectors = face_offset_vectors(mesh).vectors
        # About an axis across that of the rotational mesh, which bears turns along its own.
        matrix = plane_rotation(0.1)[[2, 1, 0, 3]][:, [2, 1, 0, 3]]
        wrong, _ = laguerre(mesh, vectors, matrix, np.zeros(4))
        image = LaguerreTransform.boost([1, 2, 0], 0.1).of_mesh(mesh).mesh
        turned = vertex_cones(_turned_star(image, 0.1)).deviation.max()
        found = fitted_cones(wrong).spread.max()
        rows += [
            at_most(
                f"{name}, normals turned with the radius: planarity", 1e-10, planarity(wrong).max()
            ),
            at_least(f"{name}, normals turned with the radius: spread, rad", PLANTED, found),
            at_least(f"{name}, one star turned: planes off their cones, rad", PLANTED, turned),
        ]
    return rows


def laguerre_roof() -> list[Row]:
    """Images of the example roof's conical mesh, against what the boost stretches."""
    source = read_design(ROOF)
    roof = panelize(source.surface, spec_of(source), source.outline, region=source.region).mesh
    flat, spread = worst_losses(centered(roof), 200)
    return [
        note("roof: faces, images", f"{roof.topology.n_faces}, 200"),
        note(
            "roof: planarity, cone spread / theta before",
            f"{planarity(roof).max():.2g}, {fitted_cones(roof).relative_spread.max():.2g}",
        ),
        at_most("roof: planarity / (before, or a rounding of places, cosh^2)", 10.0, flat),
        at_most("roof: cone spread / (before cosh^2)", 10.0, spread),
    ]


# --- Koebe meshes and edge offsets ------------------------------------------------------------


def koebe_cubes() -> list[Row]:
    """Divided cubes whose edges touch the sphere."""
    rows = []
    for n, limit, most in ((10, 1e-12, 1.0), (30, 1e-10, 20.0)):
        topology = divided_cube(n)
        mesh, seconds = timed(partial(koebe_polyhedron, topology))
        title = f"cube of {topology.n_faces} faces"
        rows += [
            at_most(
                f"{title}: edges from the sphere", limit, np.abs(tangency_deviation(mesh)).max()
            ),
            at_most(f"{title}: time, s", most, seconds),
        ]
    return rows


def edge_offset_patches() -> list[Row]:
    """Meshes with edge offsets near a shallow elliptic dome, a saddle, and freer patches."""
    approximated, rows = loaded().approximated, []
    for name in ("dome", "saddle", "free-dome", "free-saddle"):
        _, fit = approximated(name, 16)
        moved = fit.mesh.with_vertices(fit.mesh.vertices + 0.3 * fit.image.vertices)
        gap = np.abs(edge_distance(fit.mesh, moved) - 0.3).max()
        rms = fit.figures["deviation_rms_pct"]
        rows += [
            note(
                f"{name}: faces, rms of the deviation, % of an edge",
                f"{fit.mesh.topology.n_faces}, {rms:.2g}",
            ),
            at_most(f"{name}: deviation, % of an edge", 1.0, fit.figures["deviation_max_pct"]),
            at_most(f"{name}: edge offset at 0.3, its error", 1e-12, gap),
            at_most(
                f"{name}: offset's edges parallel, sine",
                1e-12,
                parallel_error(fit.mesh, moved).max(),
            ),
        ]
    return rows


def _dome_design(kind: str, edges: list[float]) -> str:
    """Design of the gentle dome."""
    return (
        f'[surface]\ngraph = {{z = "{DOME_HEIGHT}", x = {list(DOME_X)}, y = {list(DOME_Y)}}}\n'
        f'[panels]\nkind = "{kind}"\nedge = {edges}\n'
        "[layers]\ndistances = [-0.3, 0.1]\n[output]\nfigures = false\n"
    )


def _report(path: Path) -> dict[str, Any]:
    """A report of a command."""
    found: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    return found


def _ends(line: str, wanted: int, done: Run) -> Row:
    """Row about an exit code."""
    return holds(f"{line}: ends in", str(wanted), done.code, done.code == wanted)


def edge_offset_dome() -> list[Row]:
    """`panelize` and `optimize` with kind edge-offset on a gentle dome: beams of one depth."""
    surface = graph_surface(DOME_HEIGHT, DOME_X, DOME_Y)
    square = square_edges(surface, surface.domain.grid(40, 40).reshape(-1, 2), 0.8)
    with tempfile.TemporaryDirectory(prefix="pqmesh-theory-") as name:
        place = Path(name)
        design, start = place / "dome.toml", place / "start.toml"
        design.write_text(_dome_design("edge-offset", [0.8, 0.8]), encoding="utf-8")
        start.write_text(_dome_design("planar", list(square)), encoding="utf-8")
        first = run("panelize", design, "-o", place / "dome")
        depth = _report(place / "dome" / "report.json")["support"]
        run("panelize", start, "-o", place / "start")
        best = place / "best.obj"
        second = run(
            *("optimize", place / "start" / "mesh.obj", "--kind", "edge-offset"),
            *("--reference", design, "-o", best, "--report", place / "best.json"),
        )
        third = run("offset", best, "--kind", "edge", "--distance=0.4", "-o", place / "moved.obj")
        beams = edge_distance(read_quad_mesh(best), read_quad_mesh(place / "moved.obj"))
        moved = _report(place / "best.json")["deviation"]
    return [
        _ends("dome: panelize --kind edge-offset", 0, first),
        at_most("dome: depth_max - depth_min, m", 1e-9, depth["depth_max"] - depth["depth_min"]),
        at_most("dome: depth - 0.4, m", 1e-9, abs(depth["depth_max"] - 0.4)),
        _ends("dome: optimize --kind edge-offset", 0, second),
        note("dome: deviation after optimize, m", f"{moved['max']:.2g}"),
        _ends("dome: offset --kind edge of it", 0, third),
        at_most("dome: depth_max - depth_min of that offset, m", 1e-9, float(np.ptp(beams))),
    ]


def edge_offset_roof() -> list[Row]:
    """`panelize` and `optimize` with kind edge-offset on the example roof: refused with figures."""
    with tempfile.TemporaryDirectory(prefix="pqmesh-theory-") as name:
        place = Path(name)
        first = run("panelize", ROOF, "--kind", "edge-offset", "-o", place / "roof", "--no-figures")
        report = _report(place / "roof" / "report.json")
        second = run(
            *("optimize", place / "roof" / "mesh.obj", "--kind", "edge-offset"),
            *("--reference", ROOF, "-o", place / "best.obj"),
        )
    missed = [row for row in report["tolerance"] if row["pass"] is False]
    said = [line for line in first.err.splitlines() if line.startswith("not reached")]
    reached = [line for line in second.err.splitlines() if line.startswith("not reached")]
    depth, why = report["support"], [text for text in report["warnings"] if "edge offset" in text]
    return [
        _ends("roof: panelize --kind edge-offset", 3, first),
        holds(
            "roof: what is missed",
            "offset",
            ", ".join(row["key"] for row in missed),
            "offset" in [row["key"] for row in missed],
        ),
        holds(
            "roof: said with what was reached",
            "not reached: offset",
            "; ".join(said),
            any("offset" in line and "asked" in line for line in said),
        ),
        note("roof: why", why[0] if why else "-"),
        note(
            "roof: depth of the beams, m", f"{depth['depth_min']:.6f} .. {depth['depth_max']:.6f}"
        ),
        _ends("roof: optimize --kind edge-offset", 3, second),
        holds("roof: said by optimize", "not reached", "; ".join(reached), bool(reached)),
    ]


# --- commands ---------------------------------------------------------------------------------


def offset_agreement() -> list[Row]:
    """`offset`, `transform --offset` and `panelize --layers` put faces at the same places."""
    rows = []
    with tempfile.TemporaryDirectory(prefix="pqmesh-theory-") as name:
        place = Path(name)
        (place / "roof.toml").write_text(DESIGN, encoding="utf-8")
        run("panelize", "roof.toml", "--layers=0.15,-0.2", "-o", "out", cwd=place)
        mesh = read_quad_mesh(place / "out" / "mesh.obj")
        for number, distance in ((1, 0.15), (2, -0.2)):
            run("offset", "out/mesh.obj", f"--distance={distance}", "-o", "a.obj", cwd=place)
            run("transform", "out/mesh.obj", f"--offset={distance}", "-o", "b.obj", cwd=place)
            layer, first, second = (
                read_quad_mesh(place / file)
                for file in (f"out/layer-{number}.obj", "a.obj", "b.obj")
            )
            for title, other in (
                ("panelize --layers", layer),
                ("offset", first),
                ("transform --offset", second),
            ):
                step = face_planes(other)[:, 3] - face_planes(mesh)[:, 3] - distance
                away = np.abs(other.vertices - layer.vertices).max()
                rows += [
                    at_most(
                        f"{title} by {distance:g}: faces from there", 1e-12, np.abs(step).max()
                    ),
                    at_most(f"{title} by {distance:g}: vertices from the layer's", 1e-12, away),
                ]
    return rows


def _cpu(*arguments: str | Path) -> tuple[int, float]:
    """Exit code and CPU seconds of a command."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    done = subprocess.run([*COMMAND, *map(str, arguments)], capture_output=True, check=False)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    spent = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return done.returncode, spent


def _median_cpu(*arguments: str | Path) -> float:
    """Median CPU seconds of three runs of a command that must end in 0."""
    runs = [_cpu(*arguments) for _ in range(3)]
    if any(code for code, _ in runs):
        raise RuntimeError(f"{arguments[0]} ended in {max(code for code, _ in runs)}")
    return statistics.median(spent for _, spent in runs)


def _revolved(n: int) -> QuadMesh:
    """Conical mesh of revolution, n x n faces."""
    z = np.linspace(-1, 1, n + 1)
    profile = np.column_stack([2 + 0.3 * np.cos(2 * z), z])
    return rotational_mesh(profile, 2 / n * np.arange(n + 1))


def large_moves() -> list[Row]:
    """CPU time of `offset` and `transform` on 10 000 faces, beyond that of starting."""
    rows = []
    with tempfile.TemporaryDirectory(prefix="pqmesh-theory-") as name:
        small, large, end = (Path(name) / f"{part}.obj" for part in ("small", "large", "end"))
        write_mesh(_revolved(4), small)
        write_mesh(_revolved(100), large)
        idle = _median_cpu("--version")
        for options in (
            ("offset", "--distance=0.1"),
            ("transform", "--offset=0.1"),
            ("transform", "--boost=0,1,1,0.1"),
        ):
            spent = _median_cpu(options[0], large, options[1], "-o", end)
            least = _median_cpu(options[0], small, options[1], "-o", end)
            title = f"{' '.join(options)} of 10000 faces"
            rows += [
                at_most(f"{title}: CPU beyond that of --version, s", 1.0, spent - idle),
                note(f"{title}: CPU beyond that of 16 faces, s", f"{spent - least:.2f}"),
            ]
    return [note("CPU of --version, s", f"{idle:.2f}"), *rows]


groups = {
    "dimensions of P(M)": dimensions,
    "P(M) of real meshes": real_meshes,
    "a large basis of P(M)": large_basis,
    "Laguerre images": laguerre_images,
    "planted errors": planted_errors,
    "Laguerre images of the roof": laguerre_roof,
    "Koebe cubes": koebe_cubes,
    "edge offsets of patches": edge_offset_patches,
    "edge offsets of a dome": edge_offset_dome,
    "edge offsets of the roof": edge_offset_roof,
    "three ways to offset": offset_agreement,
    "offset and transform, 10 000 faces": large_moves,
}
