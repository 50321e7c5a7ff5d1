"""The command: reads arguments, calls the public functions, prints, and sets the exit code."""

from __future__ import annotations

import contextlib
import math
import os
import signal
import sys
import time
import warnings
from collections.abc import Callable
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer.exceptions import TyperException

from pqmesh.cli_meshes import (
    check_near,
    check_outputs,
    check_quads,
    check_shape,
    read_quads_to_move,
    read_to_move,
    reference_of,
    write_moved,
)
from pqmesh.cli_said import (
    Session,
    moved_summary,
    optimized_notes,
    optimized_summary,
    progress,
    reached,
    roof_summary,
    say,
)
from pqmesh.cli_typed import (
    design_text,
    drop,
    edge_of,
    file_and_name,
    length,
    lengths,
    limits,
    pairs,
    put,
    transform_of,
)
from pqmesh.errors import PqmeshError, SpecError

if TYPE_CHECKING:
    from pqmesh.design import Design
    from pqmesh.mesh.quadmesh import PolyMesh
    from pqmesh.optimize.constraints import Constraints
    from pqmesh.optimize.recipes import Weights
    from pqmesh.optimize.solver import Solution, Step
    from pqmesh.results import Roof
    from pqmesh.source import Source
    from pqmesh.surface.reference import Reference

OK, BAD_INPUT, NOT_REACHED, INTERRUPTED = 0, 2, 3, 130
# What judging and writing a mesh takes for each vertex: about 2000 measured.
REPORT_BYTES = 4000
# Threads of dense kernels, read when numpy is imported. The matrices here are small: more threads
# are no faster, stall where other programs run, and may change the last digits of a result.
THREADS = ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OMP_NUM_THREADS", "VECLIB_MAXIMUM_THREADS")

app = typer.Typer(
    name="pqmesh",
    help="Freeform surfaces to flat panels with exact offsets.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)


class Kind(StrEnum):
    """Mesh classes."""

    planar = "planar"
    conical = "conical"
    circular = "circular"
    conical_circular = "conical-circular"
    edge_offset = "edge-offset"


class Boundary(StrEnum):
    """What the rim may do."""

    free = "free"
    fixed = "fixed"
    glide = "glide"


class Network(StrEnum):
    """Curve networks."""

    principal = "principal"
    uv = "uv"
    geodesic = "geodesic"
    conjugate = "conjugate"


class Offset(StrEnum):
    """What keeps its distance in an offset."""

    vertex = "vertex"
    edge = "edge"
    face = "face"


def _version(wanted: bool) -> None:
    if wanted:
        import pqmesh

        typer.echo(f"pqmesh {pqmesh.__version__}")
        raise typer.Exit


@app.callback()
def _common(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Say the version.")
    ] = False,
    quiet: Annotated[bool, typer.Option("--quiet", help="Print errors only.")] = False,
    debug: Annotated[bool, typer.Option("--debug", help="Show the traceback of an error.")] = False,
) -> None:
    Session.quiet, Session.debug = quiet, debug


@app.command()
def panelize(
    source: Annotated[
        Path,
        typer.Argument(metavar="INPUT", help="Design (.toml) or surface file (.3dm, .json)."),
    ],
    output: Annotated[Path, typer.Option("-o", "--output", help="Folder for the files.")] = Path(
        "out"
    ),
    kind: Annotated[Kind | None, typer.Option(help="Mesh class; conical by default.")] = None,
    edge: Annotated[
        str | None, typer.Option(help="Wanted panel edge, or two: LENGTH[,LENGTH].")
    ] = None,
    network: Annotated[Network | None, typer.Option(help="Curve network.")] = None,
    curves: Annotated[
        str | None,
        typer.Option(help="Given family of a conjugate network.", metavar="FILE[:NAME]"),
    ] = None,
    direction_deg: Annotated[
        float | None, typer.Option(help="Plan direction of the given family, from the x axis.")
    ] = None,
    select: Annotated[
        str | None, typer.Option(help="Object or layer of the surface file.", metavar="NAME")
    ] = None,
    outline: Annotated[
        str | None,
        typer.Option(help="Plan outline: dxf, svg, 3dm, csv.", metavar="FILE[:NAME]"),
    ] = None,
    boundary: Annotated[Boundary | None, typer.Option(help="What the rim may do.")] = None,
    layers: Annotated[
        str | None, typer.Option(help="Signed offset distances: D1,D2,...", metavar="D1,D2,...")
    ] = None,
    within: Annotated[str | None, typer.Option(help="Stay this close to the surface.")] = None,
    flat: Annotated[
        str | None, typer.Option(help="Panels may be out of plane by so much.", metavar="LENGTH")
    ] = None,
    extend: Annotated[
        str | None, typer.Option(help="Continue the surface by so much.", metavar="LENGTH")
    ] = None,
    units: Annotated[
        str | None, typer.Option(help="Unit of a file that does not say: m mm cm km ft in.")
    ] = None,
    tolerance: Annotated[
        list[str] | None,
        typer.Option(
            help="KEY=VALUE: flat offset twist deviation deviation_rms area conical cover."
        ),
    ] = None,
    flip: Annotated[bool, typer.Option("--flip", help="Turn the orientation.")] = False,
    seed: Annotated[int | None, typer.Option(help="Seed; the same gives the same bytes.")] = None,
    allow_many: Annotated[
        bool, typer.Option("--allow-many", help="More than a million panels are meant.")
    ] = False,
    figures: Annotated[
        bool | None, typer.Option("--figures/--no-figures", help="Draw the pictures; by default.")
    ] = None,
) -> None:
    """Surface to panels: network, mesh, optimisation, layers, support structure, report."""
    began = time.perf_counter()
    from pqmesh.design import Design
    from pqmesh.outputs import check_folder

    text = design_text(source)
    options: dict[str, tuple[tuple[str, ...], Any]] = {
        "--kind": (("panels", "kind"), kind),
        "--edge": (("panels", "edge"), edge_of(edge)),
        "--network": (("panels", "network"), network),
        "--curves": (("panels", "curves"), file_and_name(curves, text.folder)),
        "--direction-deg": (("panels", "curves", "direction_deg"), direction_deg),
        "--select": (("surface", "select"), select),
        "--outline": (("outline",), file_and_name(outline, text.folder)),
        "--boundary": (("boundary", "mode"), boundary),
        "--layers": (("layers", "distances"), lengths(layers)),
        "--within": (("panels", "within"), length(within)),
        "--flat": (("panels", "flat"), length(flat)),
        "--extend": (("surface", "extend"), length(extend)),
        "--units": (("surface", "units"), units),
        **{f"--tolerance {key}": (("tolerance", key), value) for key, value in pairs(tolerance)},
        "--seed": (("run", "seed"), seed),
        "--allow-many": (("run", "most_panels"), 10**12 if allow_many else None),
        "--figures": (("output", "figures"), figures),
    }
    if direction_deg is not None and curves is None:
        drop(text.tables, ("panels", "curves"), ("file", "select", "points"))
    given = {flag: option for flag, option in options.items() if option[1] is not None}
    if network in (Network.principal, Network.uv):
        # The option wins over the design, whose curves belong to another network.
        put(text.tables, ("panels", "curves"), None)
    for path, value in given.values():
        put(text.tables, path, value)
    if source.suffix.lower() != ".toml" and edge is None:
        raise SpecError(
            f"A surface file needs the wanted panel edge beside it; {source.name} came without. "
            f"Add --edge LENGTH."
        )
    check_folder(output)
    where = text.where.without([path for path, _ in given.values()])
    if given:
        where = where._replace(name=f"{where.name} with {', '.join(given)}")
    design = Design.of(text.tables, where)
    raise typer.Exit(_panelize(design, text.folder, source.name, output, flip, began))


def _panelize(
    design: Design, folder: Path, name: str, output: Path, flip: bool, began: float
) -> int:
    """The job itself, behind the options: its exit code."""
    from pqmesh.results import part_folders, write_index
    from pqmesh.source import opened

    sources = opened(design, folder)
    spent = time.perf_counter() - began
    if len(sources) == 1:
        return _written(_roof(sources[0], name, flip=flip), output, spent)
    folders = part_folders(output, [source.name for source in sources])
    # All parts before any file: bad input leaves nothing behind.
    roofs = [_roof(source, name, flip=flip) for source in sources]
    codes = [_written(roof, place, spent) for roof, place in zip(roofs, folders, strict=True)]
    write_index(output, sources, folders, codes)
    return max(codes)


def _roof(source: Source, name: str, *, flip: bool) -> Roof:
    """One surface panelled, and its report."""
    from pqmesh.job import panelize as run
    from pqmesh.report import panelization_report
    from pqmesh.results import Roof, figures_available
    from pqmesh.source import placed, spec_of

    with progress() as tell, placed(source.origin, source.name):
        result = run(
            source.surface, spec_of(source, flip=flip), source.outline, tell, source.region
        )
        report = panelization_report(
            result, source=name, design=source.design, origin=source.origin, notes=source.notes
        )
    wanted = source.design.output.figures
    if wanted and not figures_available():
        wanted = False
        report["warnings"].append("no pictures: install the extra 'viz' for them")
    return Roof(result, report, source.origin, wanted)


def _written(roof: Roof, output: Path, spent: float) -> int:
    """The files of one surface written, and what to say of it: the exit code."""
    from pqmesh.results import write_panelization

    with progress() as tell:
        tell("write", None)
        report = write_panelization(output, roof, began=spent)
    return OK if reached(roof_summary(report, output), report) else NOT_REACHED


@app.command()
def optimize(
    mesh: Annotated[Path, typer.Argument(metavar="MESH", help="Mesh: obj, off, ply.")],
    output: Annotated[Path, typer.Option("-o", "--output", help="Mesh file to write.")],
    kind: Annotated[Kind, typer.Option(help="Mesh class.")] = Kind.conical,
    reference: Annotated[
        Path | None, typer.Option(help="Surface to stay close to: design, net or mesh file.")
    ] = None,
    boundary: Annotated[Boundary, typer.Option(help="What the rim may do.")] = Boundary.free,
    within: Annotated[float | None, typer.Option(help="Stay this close to the surface.")] = None,
    constraints: Annotated[
        Path | None, typer.Option(help="What else is asked of the mesh.", metavar="FILE.toml")
    ] = None,
    tolerance: Annotated[
        list[str] | None,
        typer.Option(
            help="T (planarity), or KEY=VALUE: planar conical offset twist circular edge-offset "
            "deviation_rms area."
        ),
    ] = None,
    report: Annotated[Path | None, typer.Option(help="Report file to write, JSON.")] = None,
) -> None:
    """Move the vertices of a mesh as little as makes it planar, conical or circular."""
    from pqmesh.design import read_constraints
    from pqmesh.linear import room_kept
    from pqmesh.optimize.advice import advice
    from pqmesh.optimize.constrained import constraint_miss
    from pqmesh.optimize.mending import mended
    from pqmesh.optimize.outlook import outlook
    from pqmesh.optimize.recipes import SURFACE, problem_for
    from pqmesh.report import optimization_report
    from pqmesh.report_limits import limits_of

    given = limits(tolerance)
    _positive("--within", within)
    if kind is Kind.edge_offset and (boundary is not Boundary.free or constraints is not None):
        asked = "--constraints" if constraints is not None else f"--boundary {boundary}"
        raise SpecError(
            f"--kind edge-offset fits a mesh with a free boundary; found {asked}. Leave it out."
        )
    check_outputs(output, report)
    wanted = None if constraints is None else read_constraints(constraints)
    start = read_to_move(mesh)
    check_near(start, mesh.name)
    if kind is Kind.edge_offset:
        check_quads(start, mesh.name)
    is_placed = wanted is None and reference is None
    judged_by = limits_of(kind, start, given, within, is_placed=is_placed)
    held = None if boundary is Boundary.free else start.topology.is_boundary_vertex
    mending = mended(start, held)
    target = reference_of(reference, mending.mesh)
    if wanted is not None:
        # What contradicts itself is refused before anything is said of the mesh.
        problem_for(kind, mending.mesh, target, boundary=boundary, constraints=wanted)
    seen = outlook(kind, mending.mesh, target if reference else None, boundary=boundary)
    for text in advice(seen):
        say(f"note: {text}")
    with progress() as tell, room_kept(REPORT_BYTES * start.topology.n_vertices):
        tell("optimize", None)
        solution = _optimized(
            kind,
            mending.mesh,
            target,
            boundary,
            SURFACE if reference else None,
            within,
            wanted,
            lambda step: tell("optimize", step),
        )
    moved = start.with_vertices(solution.blocks["vertices"])
    found = optimization_report(
        start,
        moved,
        solution,
        target,
        kind=kind,
        source=mesh.name,
        units="",
        limits=judged_by,
        seen=seen,
        mending=mending,
        missed=constraint_miss(mending.mesh, target, wanted, solution),
    )
    write_moved(moved, found, output, report)
    if reached(optimized_summary(found, output), found):
        raise typer.Exit(OK)
    for text in optimized_notes(found):
        say(f"note: {text}")
    raise typer.Exit(NOT_REACHED)


@app.command()
def offset(
    mesh: Annotated[Path, typer.Argument(metavar="MESH", help="Mesh: obj, off, ply.")],
    output: Annotated[Path, typer.Option("-o", "--output", help="Mesh file to write.")],
    distance: Annotated[float, typer.Option(help="Signed distance, along the face normals.")],
    kind: Annotated[Offset, typer.Option(help="What keeps its distance.")] = Offset.face,
    report: Annotated[Path | None, typer.Option(help="Report file to write, JSON.")] = None,
) -> None:
    """Offset a mesh at a constant distance of its vertices, edges or faces."""
    from pqmesh.moves import offset_mesh

    check_outputs(output, report)
    start = read_to_move(mesh)
    moved, found = offset_mesh(start, kind.value, distance, source=mesh.name)
    write_moved(moved, found, output, report)
    raise typer.Exit(OK if reached(moved_summary(found, output), found) else NOT_REACHED)


@app.command()
def transform(
    mesh: Annotated[Path, typer.Argument(metavar="MESH", help="Quad mesh: obj, off, ply.")],
    output: Annotated[Path, typer.Option("-o", "--output", help="Mesh file to write.")],
    offset: Annotated[
        float | None, typer.Option(help="Laguerre: faces move along their normals.")
    ] = None,
    boost: Annotated[
        str | None, typer.Option(help="Laguerre: a boost.", metavar="X,Y,Z,RAPIDITY")
    ] = None,
    center: Annotated[
        str | None, typer.Option(help="Point of the boost; the origin.", metavar="X,Y,Z")
    ] = None,
    laguerre: Annotated[
        Path | None, typer.Option(help="Laguerre: matrix, translation, scale.", metavar="FILE.json")
    ] = None,
    invert: Annotated[
        str | None, typer.Option(help="Moebius: an inversion.", metavar="X,Y,Z,R")
    ] = None,
    moebius: Annotated[
        Path | None, typer.Option(help="Moebius: matrix or inversions.", metavar="FILE.json")
    ] = None,
    report: Annotated[Path | None, typer.Option(help="Report file to write, JSON.")] = None,
) -> None:
    """Transform a conical mesh by Laguerre or a circular one by Moebius."""
    from pqmesh.moves import transformed_mesh

    options = {
        "--offset": offset,
        "--boost": boost,
        "--laguerre": laguerre,
        "--invert": invert,
        "--moebius": moebius,
    }
    wanted = transform_of(options, center)
    check_outputs(output, report)
    start = read_quads_to_move(mesh)
    image, found = transformed_mesh(start, wanted, source=mesh.name)
    write_moved(image, found, output, report)
    raise typer.Exit(OK if reached(moved_summary(found, output), found) else NOT_REACHED)


@app.command()
def check(
    mesh: Annotated[Path, typer.Argument(metavar="MESH", help="Mesh: obj, off, ply.")],
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON on standard output.")] = False,
    tolerance: Annotated[float, typer.Option(help="Dimensionless; judges all verdicts.")] = 1e-6,
) -> None:
    """Say what a mesh is: planar, circular, conical, dim P(M), which offsets, what is unusual."""
    from pqmesh.check import check_lines, check_report
    from pqmesh.io.formats import read_mesh
    from pqmesh.outputs import json_bytes

    _positive("--tolerance", tolerance)
    polygons = read_mesh(mesh)
    check_shape(polygons, mesh.name, edges=False)
    found = check_report(polygons, source=mesh.name, units=None, tolerance=tolerance)
    if as_json:
        typer.echo(json_bytes(found).decode(), nl=False)
        return
    for line in check_lines(found):
        typer.echo(line)


@app.command()
def example(
    name: Annotated[str | None, typer.Argument(metavar="NAME", help="Which one.")] = None,
    output: Annotated[Path, typer.Option("-o", "--output", help="Folder for the files.")] = Path(
        "."
    ),
) -> None:
    """Write a ready design to edit; without NAME, list them."""
    from pqmesh.outputs import check_folder, write_new
    from pqmesh.ready import EXAMPLES, example_files

    if name is None:
        for known, (text, _) in EXAMPLES.items():
            typer.echo(f"{known:10} {text}")
        return
    files = example_files(name)
    check_folder(output)
    write_new(output, files)
    design = next(file for file in files if file.endswith(".toml"))
    say(f"wrote {', '.join(files)}; run: pqmesh panelize {output / design} -o out")


def _optimized(
    kind: Kind,
    start: PolyMesh,
    target: Reference,
    boundary: Boundary,
    weights: Weights | None,
    within: float | None,
    constraints: Constraints | None,
    told: Callable[[Step], None],
) -> Solution:
    """The optimisation of a kind."""
    from pqmesh.koebe.best import HELD, edge_offset_solution
    from pqmesh.mesh.quadmesh import QuadMesh
    from pqmesh.optimize.schedule import optimized

    if kind is not Kind.edge_offset:
        return optimized(
            kind,
            start,
            target,
            boundary=boundary,
            weights=weights,
            within=within,
            constraints=constraints,
            progress=told,
        )
    quads = QuadMesh(start.vertices, start.topology)
    return edge_offset_solution(quads, target, quads.vertex_normals, told, weights=HELD)[0]


# --- helpers of the shell -------------------------------------------------------------------


def _positive(name: str, value: float | None) -> None:
    """Refuse an option that is not a finite number above 0."""
    if value is not None and not 0 < value < math.inf:
        raise SpecError(f"{name} must be a number above 0; found {value:g}. Raise it.")


def _interrupt(number: int, frame: object) -> None:
    raise KeyboardInterrupt


def main() -> None:
    """Run the command; bad input ends in one line and exit code 2."""
    Session.quiet = Session.debug = False
    for name in THREADS:
        os.environ.setdefault(name, "1")
    with contextlib.suppress(ValueError):  # not in the main thread
        signal.signal(signal.SIGTERM, _interrupt)
    with warnings.catch_warnings():
        # Numbers out of range are refused where they matter; their warnings tell a user nothing.
        warnings.simplefilter("ignore")
        code, line = _outcome()
    if line:
        typer.echo(f"pqmesh: {line}", err=True)
    sys.exit(code)


def _outcome() -> tuple[int, str]:
    """Exit code of the command, and the one line that a failure leaves."""
    try:
        code = app(prog_name="pqmesh", standalone_mode=False)
    except KeyboardInterrupt:
        code = INTERRUPTED
    except (ValueError, MemoryError, ArithmeticError) as error:
        # numpy's LinAlgError by name: importing numpy would make `--help` slow.
        known = not isinstance(error, ValueError) or isinstance(error, PqmeshError)
        if Session.debug or not (known or type(error).__name__ == "LinAlgError"):
            raise
        return BAD_INPUT, _reason(error)
    except TyperException as error:
        return BAD_INPUT, f"{_one_line(error)} See pqmesh --help."
    if code == INTERRUPTED:
        return code, "interrupted; nothing was written"
    return code if isinstance(code, int) else OK, ""


def _reason(error: Exception) -> str:
    """One line about an error."""
    if isinstance(error, PqmeshError):
        return " ".join(str(error).split())
    if isinstance(error, MemoryError):
        return (
            "The job must fit into memory; it does not. Use longer edges or a coarser mesh, or a "
            "machine with more memory."
        )
    return (
        f"Sizes must allow to compute with them; found a failure of arithmetic ({error}). Check "
        f"coordinates and lengths for values far too large or too small."
    )


def _one_line(error: TyperException) -> str:
    """What is wrong with the arguments."""
    text = " ".join(error.format_message().split()).replace("Value error, ", "").replace("?.", "?")
    text = text or "A command must be named; found none."
    return text if text.endswith((".", "?")) else text + "."
