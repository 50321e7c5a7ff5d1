"""The command: reads arguments, calls the public functions, prints, and sets the exit code."""

from __future__ import annotations

import contextlib
import json
import signal
import sys
import time
from collections.abc import Iterator
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer.exceptions import TyperException

from pqmesh.errors import PqmeshError, SpecError

if TYPE_CHECKING:
    from pqmesh.optimize.solver import Step
    from pqmesh.surface.reference import Reference

OK, BAD_INPUT, NOT_REACHED, INTERRUPTED = 0, 2, 3, 130

app = typer.Typer(
    name="pqmesh",
    help="Freeform surfaces to planar, conical and circular quad meshes with exact offsets.",
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


class Boundary(StrEnum):
    """What the rim may do."""

    free = "free"
    fixed = "fixed"
    glide = "glide"


class Network(StrEnum):
    """Curve networks."""

    principal = "principal"


class _Session:
    """Options that hold for every command."""

    quiet = False
    debug = False


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
    _Session.quiet, _Session.debug = quiet, debug


@app.command()
def panelize(
    source: Annotated[Path, typer.Argument(metavar="INPUT", help="Design (.toml) or net (.json).")],
    output: Annotated[Path, typer.Option("-o", "--output", help="Folder for the files.")] = Path(
        "out"
    ),
    kind: Annotated[Kind | None, typer.Option(help="Mesh class; conical by default.")] = None,
    edge: Annotated[
        str | None, typer.Option(help="Wanted panel edge, or two: LENGTH[,LENGTH].")
    ] = None,
    network: Annotated[Network | None, typer.Option(help="Curve network.")] = None,
    boundary: Annotated[Boundary | None, typer.Option(help="What the rim may do.")] = None,
    layers: Annotated[
        str | None, typer.Option(help="Signed offset distances: D1,D2,...", metavar="D1,D2,...")
    ] = None,
    within: Annotated[str | None, typer.Option(help="Stay this close to the surface.")] = None,
    units: Annotated[str | None, typer.Option(help="Model unit: m, mm, cm, km, ft, in.")] = None,
    tolerance: Annotated[
        list[str] | None, typer.Option(help="KEY=VALUE: flat offset twist deviation conical.")
    ] = None,
    flip: Annotated[bool, typer.Option("--flip", help="Turn the orientation.")] = False,
    seed: Annotated[int | None, typer.Option(help="Seed; the same gives the same bytes.")] = None,
    allow_many: Annotated[
        bool, typer.Option("--allow-many", help="More than a million panels are meant.")
    ] = False,
    figures: Annotated[bool, typer.Option(help="Draw the pictures.")] = True,
) -> None:
    """Surface to panels: network, mesh, optimisation, layers, support structure, report."""
    began = time.perf_counter()
    from pqmesh.design import Design

    table, folder = _tables(source)
    panels = _section(table, "panels")
    _put(panels, "kind", kind)
    _put(panels, "network", network)
    _put(panels, "within", within)
    if edge is not None:
        lengths = [_number_or_text(part) for part in edge.split(",")]
        panels["edge"] = lengths[0] if len(lengths) == 1 else lengths
    _put(_section(table, "boundary"), "mode", boundary)
    if layers is not None:
        distances = [_number_or_text(part) for part in layers.split(",") if part.strip()]
        _section(table, "layers")["distances"] = distances
    _put(_section(table, "surface"), "units", units)
    for pair in tolerance or []:
        key, found, value = pair.partition("=")
        if not found:
            raise SpecError(
                f"A tolerance must be KEY=VALUE; found {pair!r}. Write flat=0.1mm, say."
            )
        _section(table, "tolerance")[key.strip()] = _number_or_text(value)
    _put(_section(table, "run"), "seed", seed)
    if allow_many:
        _section(table, "run")["most_panels"] = 10**12
    _panelize(Design.of(table, source.name), folder, source, output, flip, figures, began)


def _panelize(
    design: Any, folder: Path, source: Path, output: Path, flip: bool, figures: bool, began: float
) -> None:
    """The job itself, behind the options."""
    from pqmesh.panelize import Spec
    from pqmesh.panelize import panelize as run
    from pqmesh.report import failed, panelization_report
    from pqmesh.results import figures_available, write_panelization

    spec = Spec(
        edges=design.edges,
        kind=design.panels.kind,
        distances=tuple(design.distances),
        boundary=design.boundary.mode,
        within=design.within,
        flip=flip,
        most_panels=design.run.most_panels,
    )
    surface, outline = design.build_surface(folder), design.build_outline()
    read = time.perf_counter() - began
    with _progress() as tell:
        result = run(surface, spec, outline, tell)
        report = panelization_report(
            result,
            source=source.name,
            units=design.units,
            seed=design.run.seed,
            design=design.model_dump(mode="json", exclude_none=True),
            tolerances=design.tolerances,
        )
        wanted = figures and design.output.figures
        if wanted and not figures_available():
            wanted = False
            report["warnings"].append("no pictures: install the extra 'viz' for them")
        tell("write", None)
        write_panelization(output, result, report, figures=wanted, began=read)
    _say(_summary(report, output))
    for row in failed(report):
        _say(f"not reached: {row['key']} {row['reached']:.3g}, asked {row['asked']:.3g}")
    raise typer.Exit(NOT_REACHED if failed(report) else OK)


@app.command()
def optimize(
    mesh: Annotated[Path, typer.Argument(metavar="MESH", help="Quad mesh: obj, off, ply.")],
    output: Annotated[Path, typer.Option("-o", "--output", help="Mesh file to write.")],
    kind: Annotated[Kind, typer.Option(help="Mesh class.")] = Kind.conical,
    reference: Annotated[
        Path | None, typer.Option(help="Surface to stay close to: design, net or mesh file.")
    ] = None,
    boundary: Annotated[Boundary, typer.Option(help="What the rim may do.")] = Boundary.free,
    within: Annotated[float | None, typer.Option(help="Stay this close to the surface.")] = None,
    tolerance: Annotated[float, typer.Option(help="Planarity that counts as reached.")] = 1e-9,
    report: Annotated[Path | None, typer.Option(help="Report file to write, JSON.")] = None,
) -> None:
    """Move the vertices of a quad mesh as little as makes it planar, conical or circular."""
    from pqmesh.io.atomic import write_bytes
    from pqmesh.io.formats import read_quad_mesh, write_mesh
    from pqmesh.optimize.schedule import optimized
    from pqmesh.report import failed, optimization_report
    from pqmesh.results import json_bytes

    if not tolerance > 0:
        raise SpecError(f"--tolerance must be above 0; found {tolerance:g}. Raise it.")
    start = read_quad_mesh(mesh)
    target = _reference(reference, start)
    with _progress() as tell:
        tell("optimize", None)
        solution = optimized(
            kind,
            start,
            target,
            boundary=boundary,
            within=within,
            progress=lambda step: tell("optimize", step),
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
        flat=tolerance,
    )
    write_mesh(moved, output)
    if report is not None:
        write_bytes(report, json_bytes(found))
    before, after, deviation = found["before"], found["after"], found["deviation"]
    mean = before["edge_mean"]
    _say(
        f"{kind}: planarity {before['planarity_max']:.2e} -> {after['planarity_max']:.2e}, "
        f"moved {deviation['moved_max']:.4g} ({deviation['moved_max'] / mean:.3g} edges), "
        f"deviation rms {deviation['rms']:.4g} ({100 * deviation['rms'] / mean:.3g} % of an edge), "
        f"{after['nonconvex_faces']} non-convex, {after['flipped_faces']} flipped; "
        f"{solution.reason}"
    )
    for row in failed(found):
        _say(f"not reached: {row['key']} {row['reached']:.3g}, asked {row['asked']:.3g}")
    raise typer.Exit(NOT_REACHED if failed(found) else OK)


@app.command()
def check(
    mesh: Annotated[Path, typer.Argument(metavar="MESH", help="Quad mesh: obj, off, ply.")],
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON on standard output.")] = False,
    tolerance: Annotated[float, typer.Option(help="Dimensionless; judges all verdicts.")] = 1e-6,
) -> None:
    """Say what a mesh is: planar, circular, conical, which offsets, what is unusual."""
    from pqmesh.io.formats import read_quad_mesh
    from pqmesh.report import check_report

    if not tolerance > 0:
        raise SpecError(f"--tolerance must be above 0; found {tolerance:g}. Raise it.")
    found = check_report(read_quad_mesh(mesh), source=mesh.name, units=None, tolerance=tolerance)
    if as_json:
        typer.echo(json.dumps(found, indent=2, allow_nan=False))
        return
    counts = found["mesh"]
    typer.echo(
        f"{mesh.name}: {counts['vertices']} vertices, {counts['faces']} quads, "
        f"{counts['boundary_loops']} boundary loops, Euler characteristic "
        f"{counts['euler_characteristic']}"
    )
    for key in ("planar", "circular", "conical"):
        typer.echo(f"{key:9} {'yes' if found[key] else 'no'} (tolerance {tolerance:g})")
    for key, value in found["measures"].items():
        typer.echo(f"  {key:22} {'-' if value is None else format(value, '.6g')}")
    for problem in found["problems"]:
        typer.echo(f"note: {problem['text']}")


# --- helpers of the shell -------------------------------------------------------------------


def _tables(source: Path) -> tuple[dict[str, Any], Path]:
    """Tables of a design, or of a bare surface file."""
    from pqmesh.design import Design

    if source.suffix.lower() == ".toml":
        return Design.read(source)
    return {"surface": {"file": source.name}}, source.parent


def _section(table: dict[str, Any], name: str) -> dict[str, Any]:
    """A section of the design, made when it is missing; a wrong one is left to the check."""
    section = table.setdefault(name, {})
    return section if isinstance(section, dict) else {}


def _put(section: dict[str, Any], key: str, value: Any) -> None:
    """An option that was given wins over the file."""
    if value is not None:
        section[key] = value.value if isinstance(value, StrEnum) else value


def _number_or_text(part: str) -> float | str:
    """A plain number as such, all else as text that may carry a unit."""
    try:
        return float(part)
    except ValueError:
        return part.strip()


def _reference(path: Path | None, start: Any) -> Reference:
    """The surface to stay close to; the start mesh itself without one."""
    from pqmesh.surface.reference import SurfaceReference, TriangleReference

    if path is None:
        return TriangleReference.of_polygons(start.vertices, start.topology.face_lists())
    if path.suffix.lower() in (".toml", ".json"):
        from pqmesh.design import Design

        table, folder = _tables(path)
        table.setdefault("panels", {"edge": 1.0})
        return SurfaceReference(Design.of(table, path.name).build_surface(folder))
    from pqmesh.io.formats import read_mesh

    other = read_mesh(path)
    return TriangleReference.of_polygons(other.vertices, other.topology.face_lists())


def _summary(report: dict[str, Any], output: Path) -> str:
    """One line about a roof."""
    after, deviation = report["after"], report["deviation"]
    return (
        f"{report['panels']['count']} panels ({report['orientation']}), planarity "
        f"{after['planarity_max']:.1e}, twist "
        f"{after['twist_max_deg'] if after['twist_max_deg'] is not None else 0.0:.1e} deg, "
        f"deviation {deviation['max']:.3g} {report['units']}; written to {output}"
    )


def _say(text: str) -> None:
    """A line on standard error, unless quiet."""
    if not _Session.quiet:
        typer.echo(text, err=True)


@contextlib.contextmanager
def _progress() -> Iterator[Any]:
    """Told of stages and steps: a live line on a terminal, plain lines elsewhere."""
    if _Session.quiet or not sys.stderr.isatty():
        seen: list[str] = []

        def plain(stage: str, step: Step | None) -> None:
            if step is None:
                _say(f"{stage} ...")
            seen.append(stage)

        yield plain
        return
    from rich.console import Console
    from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

    columns = (SpinnerColumn(), TextColumn("{task.description}"), TimeElapsedColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("read")

        def live(stage: str, step: Step | None) -> None:
            detail = "" if step is None else f"  worst residual {step.hard:.1e}"
            bar.update(task, description=stage + detail)

        yield live


def _interrupt(number: int, frame: object) -> None:
    raise KeyboardInterrupt


def main() -> None:
    """Run the command; bad input ends in one line and exit code 2."""
    with contextlib.suppress(ValueError):  # not in the main thread
        signal.signal(signal.SIGTERM, _interrupt)
    try:
        code = app(standalone_mode=False)
    except KeyboardInterrupt:
        typer.echo("pqmesh: interrupted; nothing was written", err=True)
        code = INTERRUPTED
    except PqmeshError as error:
        if _Session.debug:
            raise
        typer.echo(f"pqmesh: {' '.join(str(error).split())}", err=True)
        code = BAD_INPUT
    except MemoryError:
        typer.echo("pqmesh: the job needs more memory than there is. Use longer edges.", err=True)
        code = BAD_INPUT
    except TyperException as error:
        typer.echo(f"pqmesh: {_one_line(error)} See pqmesh --help.", err=True)
        code = BAD_INPUT
    sys.exit(code if isinstance(code, int) else OK)


def _one_line(error: TyperException) -> str:
    """What is wrong with the arguments."""
    text = " ".join(error.format_message().split()).replace("Value error, ", "")
    return text if text.endswith(".") else text + "."
