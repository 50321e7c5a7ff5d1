"""The spine: a surface becomes a conical mesh with exact layers, end to end."""

from __future__ import annotations

import filecmp
import json
import re
import statistics
import subprocess
import sys
import tempfile
import time
from functools import cache
from pathlib import Path

import high_precision
import numpy as np
from mpmath import mp
from scipy.optimize import minimize
from starts import euler_mesh, parameter_mesh
from table import (
    DATA,
    ROOT,
    Row,
    Run,
    at_least,
    at_most,
    between,
    holds,
    median_seconds,
    note,
    order,
    run,
    skipped,
)

from pqmesh.io.formats import read_quad_mesh
from pqmesh.mesh.measure import (
    circularity_defect,
    conicality_defect,
    fitted_cones,
    measures,
    planarity_deviation,
)
from pqmesh.mesh.quadmesh import QuadMesh
from pqmesh.network.meshing import quads_from_network
from pqmesh.network.principal import trace_principal_network
from pqmesh.optimize.schedule import optimized
from pqmesh.optimize.terms import TERMS
from pqmesh.source import Source, read_design
from pqmesh.surface.analytic import ellipsoid
from pqmesh.surface.curvature import first_form, shape_data
from pqmesh.surface.reference import SurfaceReference, TriangleReference
from pqmesh.vectors import norm

ROOF = ROOT / "examples" / "roof" / "roof.toml"


@cache
def roof_source() -> Source:
    """The example roof's design, opened."""
    return read_design(ROOF)


@cache
def roof_runs() -> tuple[Path, dict, list]:
    """The roof by the command, three times: folder, report, runs."""
    folder = Path(tempfile.mkdtemp(prefix="pqmesh-verify-"))
    runs = [run("panelize", ROOF, "-o", folder / str(i)) for i in range(3)]
    report = json.loads((folder / "0" / "report.json").read_text(encoding="utf-8"))
    return folder, report, runs


def roof_job() -> list[Row]:
    """Times, memory and import costs."""
    _, _, runs = roof_runs()
    with tempfile.TemporaryDirectory(prefix="pqmesh-clone-") as empty:
        clone = Path(empty) / "pqmesh"
        subprocess.run(["git", "clone", "--quiet", str(ROOT), str(clone)], check=True)
        began = time.perf_counter()
        done = subprocess.run(["make", "roof"], cwd=clone, capture_output=True, text=True)
        fresh = time.perf_counter() - began
        made = (clone / "out" / "roof" / "report.json").exists()
    python = sys.executable
    imported = median_seconds([python, "-c", "import pqmesh"])
    bare = median_seconds([python, "-c", "pass"])
    helped = median_seconds([str(Path(python).with_name("pqmesh")), "--help"])
    return [
        holds(
            "make roof in a fresh clone ends in 0 with its report",
            "yes",
            done.returncode,
            made and done.returncode == 0,
        ),
        at_most("make roof in a fresh clone, downloads included, s", 360, fresh),
        holds(
            "the job ends within every tolerance (exit code)", "0", runs[0].code, runs[0].code == 0
        ),
        at_most("the job, wall s, median of 3", 20, statistics.median(r.seconds for r in runs)),
        at_most("the job, peak MB", 1024, max(r.megabytes for r in runs)),
        at_most("import pqmesh, s, median of 3 (interpreter included)", 0.35, imported),
        note("bare interpreter, s", f"{bare:.3f}"),
        at_most("pqmesh --help, s, median of 3", 0.6, helped),
    ]


def roof_character() -> list[Row]:
    """Is the roof lively enough to prove anything?"""
    folder, report, _ = roof_runs()
    surface, outline = roof_source().surface, roof_source().outline
    uv = surface.domain.grid(200, 200).reshape(-1, 2)
    uv = uv[outline.on(surface)(uv)]
    jet = surface.jet(uv)
    shape = shape_data(jet)
    weights = np.sqrt(np.linalg.det(first_form(jet)))
    weights /= weights.sum()
    curvature = shape.k[:, 0] * shape.k[:, 1]
    few = shape.normal[:: max(len(uv) // 3000, 1)]
    spread = np.degrees(np.arccos(np.clip((few @ few.T).min(), -1, 1)))
    mesh = read_quad_mesh(folder / "0" / "mesh.obj")
    extent = np.ptp(np.array(outline.polygon), axis=0)
    return [
        note("outline, m", f"{extent[0]:.1f} x {extent[1]:.1f}, {outline.area:.0f} m2"),
        at_least("share of area with K > 0", 0.10, float(weights[curvature > 0].sum())),
        at_least("share of area with K < 0", 0.10, float(weights[curvature < 0].sum())),
        at_least("balance before, deg", 2.0, report["before"]["conicality_max_deg"]),
        at_least("normals spread over, deg", 30, float(spread)),
        at_least("rise, m", 6, float(np.ptp(jet.point[:, 2]))),
        at_least("best mirrored or rotated copy still lies away by, m", 0.5, asymmetry(mesh)),
        at_least("panels", 700, report["panels"]["count"]),
        note("viability min|k1-k2| / median", f"{report['network']['viability']:.3f}"),
    ]


def asymmetry(mesh: QuadMesh) -> float:
    """Smallest, over mirrorings in upright planes and turns about upright axes, of the largest
    distance of a copied vertex from the roof."""
    triangles = TriangleReference.of_polygons(mesh.vertices, mesh.topology.face_lists())
    points = mesh.vertices[:: max(mesh.topology.n_vertices // 250, 1)]
    center = mesh.vertices.mean(axis=0)

    def away(parameters: np.ndarray, mirror: bool) -> float:
        angle, x, y, z = parameters
        cos, sin = np.cos(angle), np.sin(angle)
        turn = (
            np.array([[cos, sin, 0], [sin, -cos, 0], [0, 0, 1]])
            if mirror
            else np.array([[cos, -sin, 0], [sin, cos, 0], [0, 0, 1]])
        )
        copy = (points - center) @ turn.T + center + np.array([x, y, z])
        return float(norm(triangles.closest(copy)[0] - copy).max())

    best = np.inf
    for mirror in (True, False):
        # A turn by little is no symmetry; mirrors are tried all around.
        angles = np.radians(np.arange(0, 360, 10) if mirror else np.arange(30, 331, 10))
        first = sorted((away(np.array([a, 0, 0, 0]), mirror), a) for a in angles)
        for _, angle in first[:4]:
            found = minimize(
                away,
                [angle, 0, 0, 0],
                args=(mirror,),
                method="Nelder-Mead",
                options={
                    "maxfev": 300,
                    "initial_simplex": np.array([angle, 0, 0, 0])
                    + np.vstack([np.zeros(4), np.diag([0.15, 2.0, 2.0, 0.5])]),
                },
            )
            if mirror or abs(np.degrees(found.x[0]) % 360 - 180) < 160:
                best = min(best, float(found.fun))
    return best


def roof_exactness() -> list[Row]:
    """What the optimised roof and its layers reach."""
    _, report, _ = roof_runs()
    after, deviation, network = report["after"], report["deviation"], report["network"]
    layers, support = report["layers"], report["support"]
    return [
        at_most("planarity_max", 1e-11, after["planarity_max"]),
        at_most("cone_spread_max", 1e-8, after["cone_spread_max"]),
        at_most("offset_misfit_max", 1e-10, after["offset_misfit_max"]),
        holds("layers", "3", len(layers), len(layers) == 3),
        at_most(
            "layers: distance_error_max, m", 1e-10, max(x["distance_error_max"] for x in layers)
        ),
        at_most("layers: parallel_error_max", 1e-9, max(x["parallel_error_max"] for x in layers)),
        note(
            "layers: parallel_error_boundary_max",
            f"{max(x['parallel_error_boundary_max'] for x in layers):.2g}",
        ),
        at_most("support planarity_max_length, m", 1e-9, support["planarity_max_length"]),
        at_most("twist, deg", 1e-6, max(support["twist_max_deg"], after["twist_max_deg"])),
        at_most("non-convex faces", 0, after["nonconvex_faces"]),
        at_most("flipped faces", 0, after["flipped_faces"]),
        at_most("deviation max, mm", 5, 1e3 * deviation["max"]),
        at_most("deviation rms, mm", 1.5, 1e3 * deviation["rms"]),
        at_most("moved_max, m", 0.15, deviation["moved_max"]),
        at_most("edge_max / edge_min", 4, after["edge_max"] / after["edge_min"]),
        at_least("smallest corner, deg", 80, after["min_corner_deg"]),
        at_most("largest corner, deg", 100, after["max_corner_deg"]),
        at_least("share of the region that the mesh covers", 0.98, network["covered_share"]),
        note(
            "largest distance from the region to the mesh, m",
            f"{network['surface_to_mesh_max']:.4f}",
        ),
    ]


def three_starts() -> list[Row]:
    """Euler tracing as the thesis does it, our tracing, a parameter grid."""
    surface, outline = roof_source().surface, roof_source().outline
    inside = outline.on(surface)
    rows, ours = [], []

    def described(name: str, mesh: QuadMesh, uv: np.ndarray) -> dict:
        found = measures(mesh)
        solution = optimized("conical", mesh, SurfaceReference(surface, uv))
        vertices = solution.blocks["vertices"]
        after = measures(mesh.with_vertices(vertices))
        moved = norm(vertices - mesh.vertices).max() / mesh.mean_edge_length
        feet = SurfaceReference(surface, uv).closest(vertices)[0]
        rows.append(
            note(
                name,
                f"{mesh.topology.n_faces} panels; planarity {found['planarity_max']:.2e} -> "
                f"{after['planarity_max']:.1e}; balance {found['conicality_max_deg']:.3g} -> "
                f"{after['conicality_max_deg']:.1e} deg; moved {moved:.3g} edges; deviation "
                f"{1e3 * norm(feet - vertices).max():.3g} mm; broken "
                f"{after['nonconvex_faces'] + after['flipped_faces']}; "
                f"{'converged' if solution.converged else solution.reason}",
            )
        )
        return found

    edge = roof_source().design.edges[0]
    described("Euler steps (thesis)", *euler_mesh(surface, outline, edge))
    for size in (edge, edge / 2):
        network = quads_from_network(trace_principal_network(surface, (size, size), inside), inside)
        mesh = (
            network.mesh
            if network.mesh.face_area_vectors[:, 2].sum() > 0
            else network.mesh.reversed()
        )
        ours.append(described(f"our network, edge {size:g} m", mesh, network.uv))
    described("parameter grid", *parameter_mesh(surface, outline, edge))
    balance = ours[0]["conicality_mean_deg"] / ours[1]["conicality_mean_deg"]
    flat = ours[0]["planarity_mean"] / ours[1]["planarity_mean"]
    rows.append(between("our network: mean balance falls, edge halved, times", 3.2, 5, balance))
    rows.append(between("our network: mean planarity falls, edge halved, times", 6.4, 10, flat))
    worst = ours[0]["conicality_max_deg"] / ours[1]["conicality_max_deg"]
    rows.append(note("our network: largest balance falls, times", f"{worst:.2f}"))
    worst = ours[0]["planarity_max"] / ours[1]["planarity_max"]
    rows.append(note("our network: largest planarity falls, times", f"{worst:.2f}"))
    return rows


def oracles() -> list[Row]:
    """Exact cases: the test folders, and the ellipsoid's lines and orders."""
    rows = []
    for folder in (
        "theorems",
        "contracts",
        "mesh",
        "surface",
        "network",
        "optimize",
        "offset",
        "koebe",
        "transform",
        "fabricate",
        "view",
        "cli",
        "io",
        "examples",
        "convergence",
    ):
        done = subprocess.run(
            [sys.executable, "-m", "pytest", f"tests/{folder}", "-p", "no:cacheprovider"],
            cwd=ROOT,
            capture_output=True,
            text=True,
        )
        lines = done.stdout.strip().splitlines() or [done.stderr[-80:]]
        failed = [line for line in lines if line.startswith(("FAILED", "ERROR"))]
        last = "; ".join([lines[-1], *failed[:3]])
        counts = re.search(r"(\d+) passed", last)
        rows.append(
            holds(f"tests/{folder}", "all pass", last, done.returncode == 0 and bool(counts))
        )
    surface = ellipsoid(3.0, 2.0, 1.2, u=(0.2, 1.2), v=(0.15, 1.1))
    network = trace_principal_network(surface, (0.1, 0.1))
    drift = max(_drift(surface, lines) for lines in network.families)
    rows.append(at_most("ellipsoid: drift of mu or nu along a traced line", 1e-8, drift))
    sizes, errors = [0.2, 0.1, 0.05], []
    for size in sizes:
        part = quads_from_network(trace_principal_network(surface, (size, size)))
        solution = optimized("conical", part.mesh, SurfaceReference(surface, part.uv))
        errors.append(
            _face_deviation(surface, part.mesh.with_vertices(solution.blocks["vertices"]))
        )
    rows.append(
        note(
            "ellipsoid: deviation of the conical mesh at h, h/2, h/4",
            ", ".join(f"{e:.2e}" for e in errors),
        )
    )
    rows.append(between("ellipsoid: order of that deviation", 1.8, 2.4, order(errors, sizes)))
    return rows


def _drift(surface, lines) -> float:
    """Largest relative change of the confocal coordinate that should be constant."""
    worst = 0.0
    for line in range(len(lines)):
        segments = np.repeat(np.arange(lines.start[line], lines.start[line + 1]), 4)
        theta = np.tile(np.linspace(0, 1, 4), lines.start[line + 1] - lines.start[line])
        x = surface.jet(lines.at(segments, theta)).point
        total = 9 + 4 + 1.44 - (x**2).sum(axis=1)
        product = 9 * 4 * 1.44 * (x**2 / np.array([81.0, 16.0, 1.44**2])).sum(axis=1)
        root = np.sqrt(np.maximum(total**2 / 4 - product, 0))
        worst = max(worst, min(np.ptp(c) / c.mean() for c in (total / 2 - root, total / 2 + root)))
    return worst


def _face_deviation(surface, mesh: QuadMesh) -> float:
    """Largest distance of face centres and vertices from the surface: chord height included."""
    points = np.concatenate([mesh.vertices, mesh.face_centers])
    return float(norm(SurfaceReference(surface).closest(points)[0] - points).max())


def derivatives() -> list[Row]:
    """Jacobians against central differences; invariance; the whole chain in millimetres."""
    rng = np.random.default_rng(5)
    surface, outline = roof_source().surface, roof_source().outline
    part = quads_from_network(
        trace_principal_network(surface, (6.0, 6.0), outline.on(surface)), outline.on(surface)
    )
    mesh = part.mesh.with_vertices(
        part.mesh.vertices + rng.normal(0, 0.2, part.mesh.vertices.shape)
    )
    worst, moved = 0.0, 0.0
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    turn *= np.sign(np.linalg.det(turn))
    for name in ALONE:
        term = _term(name, mesh, part.mesh)
        blocks = {"vertices": mesh.vertices, "axes": mesh.vertex_normals * 1.05}
        rows_of = np.concatenate([blocks[b][r] for b, r in term.stencils.items()], axis=1)
        if not len(rows_of):
            continue
        _, jacobian = term.evaluate(rows_of)
        numeric = np.zeros_like(jacobian)
        step = 1e-5
        for k in range(rows_of.shape[1]):
            for i in range(3):
                shift = np.zeros_like(rows_of)
                shift[:, k, i] = step
                numeric[:, :, k, i] = (
                    term.evaluate(rows_of + shift)[0] - term.evaluate(rows_of - shift)[0]
                ) / (2 * step)
        worst = max(worst, float(np.abs(numeric - jacobian).max() / np.abs(jacobian).max()))
        for factor in (1.0, 1000.0):
            other = [
                m.with_vertices(factor * m.vertices @ turn.T + 7.0 * factor)
                for m in (mesh, part.mesh)
            ]
            term_moved = _term(name, *other)
            blocks_moved = {"vertices": other[0].vertices, "axes": blocks["axes"] @ turn.T}
            rows_moved = np.concatenate(
                [blocks_moved[b][r] for b, r in term_moved.stencils.items()], axis=1
            )
            first, second = (
                np.linalg.norm(t.evaluate(r)[0], axis=1)
                for t, r in ((term, rows_of), (term_moved, rows_moved))
            )
            moved = max(moved, float(np.abs(first - second).max()))
    return [
        at_most(
            "Jacobians against central differences, relative, terms of the recipes", 1e-6, worst
        ),
        at_most(
            "terms when mesh and surface are turned, moved, scaled by 1000: change of |residual|",
            1e-9,
            moved,
        ),
        *_in_millimetres(),
    ]


# Terms that need nothing but a mesh and its surface; the tests go over all the others, too.
ALONE = (
    "planarity",
    "polygon_planarity",
    "conicality",
    "cone",
    "circularity",
    "closeness",
    "held_edges",
    "fairness",
    "anchor",
)


def _term(name: str, mesh: QuadMesh, surface_mesh: QuadMesh):
    """A term on a mesh, with the unperturbed mesh as the reference."""
    if name == "closeness":
        return TERMS[name](
            mesh,
            TriangleReference.of_polygons(
                surface_mesh.vertices, surface_mesh.topology.face_lists()
            ),
        )
    if name in ("anchor", "fairness", "held_edges"):
        return TERMS[name](surface_mesh)
    return TERMS[name](mesh)


def _in_millimetres() -> list[Row]:
    """The roof in millimetres gives the roof in metres times 1000."""
    folder, _, _ = roof_runs()
    table = json.loads((ROOF.parent / "net.json").read_text(encoding="utf-8"))
    table["points"] = (1000 * np.array(table["points"])).tolist()
    with tempfile.TemporaryDirectory(prefix="pqmesh-mm-") as name:
        place = Path(name)
        (place / "net.json").write_text(json.dumps(table), encoding="utf-8")
        text = (
            ROOF.read_text(encoding="utf-8")
            .replace('units = "m"', 'units = "mm"')
            .replace("edge = 1.5", "edge = 1500")
        )
        scaled = (1000 * roof_source().outline.polygon).tolist()
        text = re.sub(r'file = "site.svg"\nselect = "roof"', f"polygon = {scaled}", text)
        (place / "roof.toml").write_text(text, encoding="utf-8")
        done = run("panelize", place / "roof.toml", "-o", place / "out", "--no-figures")
        first = read_quad_mesh(folder / "0" / "mesh.obj")
        second = read_quad_mesh(place / "out" / "mesh.obj")
        same = first.topology.n_vertices == second.topology.n_vertices
        gap = float(np.abs(second.vertices / 1000 - first.vertices).max()) if same else np.inf
        found = json.loads((place / "out" / "report.json").read_text(encoding="utf-8"))
    return [
        holds("the chain in millimetres: exit code", "0", done.code, done.code == 0),
        at_most("the chain in millimetres: vertices differ by, m", 1e-6, gap),
        at_most("the chain in millimetres: planarity_max", 1e-11, found["after"]["planarity_max"]),
    ]


def real_data() -> list[Row]:
    """Meshes of other people."""
    if not DATA.is_dir():
        return [skipped("real meshes", "the data folder is missing")]
    rows = []
    with tempfile.TemporaryDirectory(prefix="pqmesh-data-") as name:
        place = Path(name)
        for file in (
            "six.off",
            "YasIsland.off",
            "inspired_mesh_quads_Conjugate.off",
            "formfinding-circular.off",
            "conical1.obj",
        ):
            done, report = _planarised(DATA / file, place)
            before, after, deviation = report["before"], report["after"], report["deviation"]
            broken = sum(max(after[k] - before[k], 0) for k in ("nonconvex_faces", "flipped_faces"))
            rows += [
                at_most(f"{file}: planarity_max", 1e-9, after["planarity_max"]),
                at_least(
                    f"{file}: edge_min over its start", 0.3, after["edge_min"] / before["edge_min"]
                ),
                at_most(f"{file}: newly broken faces", 0, broken),
                at_most(
                    f"{file}: rms deviation, % of the mean edge",
                    15,
                    100 * deviation["rms"] / before["edge_mean"],
                ),
                at_most(f"{file}: s", 20, done.seconds),
            ]
        for file in ("hypar.obj", "tubemesh.obj"):
            done, report = _planarised(DATA / file, place)
            after = report["after"]
            flat = after["planarity_max"] <= 1e-9 and done.code == 0
            told = done.code == 3 and "not reached" in done.err
            rows += [
                at_most(
                    f"{file}: broken faces", 0, after["nonconvex_faces"] + after["flipped_faces"]
                ),
                holds(
                    f"{file}: flat to 1e-9, or code 3 with the reason",
                    "either",
                    f"code {done.code}, planarity {after['planarity_max']:.1e}, moved "
                    f"{report['deviation']['moved_max'] / after['edge_mean']:.2f} edges; "
                    f"{report['solver']['reason']}",
                    flat or told,
                ),
            ]
        loose, tight = (
            json.loads(run("check", DATA / "conical1.obj", "--json", "--tolerance", t).out)
            for t in ("1e-3", "1e-6")
        )
        rows.append(
            holds(
                "check conical1 at 1e-3: planar, conical",
                "True, True",
                (loose["planar"], loose["conical"]),
                loose["planar"] and loose["conical"],
            )
        )
        rows.append(
            holds(
                "check conical1 at 1e-6: planar, conical",
                "False, False",
                (tight["planar"], tight["conical"]),
                not tight["planar"] and not tight["conical"],
            )
        )
        rows += _formfinding(
            json.loads(
                run("check", DATA / "formfinding-circular.off", "--json", "--tolerance", "1e-3").out
            )
        )
    return rows


def _planarised(mesh: Path, place: Path) -> tuple[Run, dict]:
    """A mesh made planar by the command: the run and its report."""
    options = ["--kind", "planar", "--report", place / "r.json"]
    done = run("optimize", mesh, "-o", place / "m.obj", *options)
    return done, json.loads((place / "r.json").read_text(encoding="utf-8"))


def _formfinding(found: dict) -> list[Row]:
    """Figures of the data index: planarity over the mean edge of the quad, half the defect."""
    mesh = read_quad_mesh(DATA / "formfinding-circular.off")
    edges = mesh.edge_lengths[mesh.topology.face_edges].reshape(-1, 4).mean(axis=1)
    converted = planarity_deviation(mesh) / edges
    half = np.degrees(np.abs(circularity_defect(mesh))) / 2
    return [
        between(
            "formfinding: planarity max over mean edge (index 7.01e-5)",
            7.01e-5 * 0.99,
            7.01e-5 * 1.01,
            float(converted.max()),
        ),
        between(
            "formfinding: planarity median over mean edge (index 5.15e-6)",
            5.15e-6 * 0.99,
            5.15e-6 * 1.01,
            float(np.median(converted)),
        ),
        between(
            "formfinding: max over the mesh's mean edge (index 3.38e-5)",
            3.38e-5 * 0.99,
            3.38e-5 * 1.01,
            float((planarity_deviation(mesh) / mesh.mean_edge_length).max()),
        ),
        holds(
            "formfinding: faces beyond 0.1 deg (index 12)",
            "12",
            int((half > 0.1).sum()),
            int((half > 0.1).sum()) == 12,
        ),
        between(
            "formfinding: largest opposite-angle defect, deg (index 35)",
            34.5,
            35.5,
            float(half.max()),
        ),
        holds(
            "formfinding: check at 1e-3 says planar, circular",
            "True, False",
            (found["planar"], found["circular"]),
            found["planar"] and not found["circular"],
        ),
    ]


def high_digits() -> list[Row]:
    """Measures of the roof, recomputed at 50 digits."""
    folder, _, _ = roof_runs()
    mesh = read_quad_mesh(folder / "0" / "mesh.obj")
    rng = np.random.default_rng(11)
    edge = mesh.mean_edge_length
    faces = rng.choice(mesh.topology.n_faces, 100, replace=False)
    flat = planarity_deviation(mesh)
    circle = circularity_defect(mesh)
    worst_flat = (
        max(
            abs(float(high_precision.planarity_deviation(mesh.corners[f]) - mp.mpf(float(flat[f]))))
            for f in faces
        )
        / edge
    )
    worst_circle = max(
        abs(float(high_precision.circularity_defect(mesh.corners[f]) - mp.mpf(float(circle[f]))))
        for f in faces
    )
    vertices, balance = conicality_defect(mesh)
    picked = rng.choice(len(vertices), 100, replace=False)
    worst_balance = 0.0
    for i in picked:
        neighbors, _ = mesh.topology.star(int(vertices[i]))
        exact = high_precision.balance(mesh.vertices[vertices[i]], mesh.vertices[neighbors])
        worst_balance = max(worst_balance, abs(float(exact - mp.mpf(float(balance[i])))))
    cones = fitted_cones(mesh)
    worst_cone = 0.0
    for i in rng.choice(len(cones.vertices), 100, replace=False):
        _, around = mesh.topology.star(int(cones.vertices[i]))
        exact = high_precision.cone([mesh.corners[f] for f in around])
        misfit = exact[1]
        worst_cone = max(worst_cone, abs(float(misfit - mp.mpf(float(cones.misfit[i])))))
    return [
        at_most("planarity of 100 faces against 50 digits, in edges", 1e-12, worst_flat),
        at_most("circle balance of 100 faces, rad", 1e-12, worst_circle),
        at_most("balance of 100 vertices, rad", 1e-12, worst_balance),
        at_most("offset misfit of 100 vertices, per unit", 1e-12, worst_cone),
    ]


def same_bytes() -> list[Row]:
    """Two runs, all files but the timings."""
    folder, _, _ = roof_runs()
    first, second = folder / "0", folder / "1"
    names = sorted(p.relative_to(first).as_posix() for p in first.rglob("*") if p.is_file())
    others = sorted(p.relative_to(second).as_posix() for p in second.rglob("*") if p.is_file())
    different = [
        n
        for n in names
        if n != "report.json" and not filecmp.cmp(first / n, second / n, shallow=False)
    ]
    reports = [json.loads((f / "report.json").read_text(encoding="utf-8")) for f in (first, second)]
    for report in reports:
        report.pop("timing")
    return [
        holds("the same files", "yes", f"{len(names)} files", names == others),
        holds("files with other bytes", "none", different or "none", not different),
        holds(
            "report without timing",
            "equal",
            "equal" if reports[0] == reports[1] else "differs",
            reports[0] == reports[1],
        ),
    ]


groups = {
    "the job": roof_job,
    "a lively roof": roof_character,
    "exactness of the roof": roof_exactness,
    "three starts": three_starts,
    "oracles": oracles,
    "derivatives and units": derivatives,
    "real data": real_data,
    "fifty digits": high_digits,
    "same bytes": same_bytes,
}
