"""A design opened: its surface, outline and given curves, in one unit and near the origin."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pqmesh.design import Design
from pqmesh.design_keys import CurvesSpec
from pqmesh.design_words import LARGEST_LENGTH
from pqmesh.errors import PqmeshError, SpecError, SurfaceError
from pqmesh.io.outlines import plausible_units, read_curves, read_outline
from pqmesh.job_spec import Spec
from pqmesh.network.kinds import Given
from pqmesh.network.region import PlanOutline
from pqmesh.source_faces import Faces, faces_of
from pqmesh.source_joined import joined_faces
from pqmesh.surface.base import Surface
from pqmesh.surface.extended import extended
from pqmesh.surface.face import Patch
from pqmesh.surface.faces import FaceRegion, plan_rims
from pqmesh.surface.plan import PlanSurface
from pqmesh.surface.regular import check_regular
from pqmesh.vectors import Floats


@dataclass(frozen=True, eq=False)
class Source:
    """What a design is about: everything in the model unit, about an origin near it.

    Attributes
    ----------
    design : Design
        In the model unit.
    surface : Surface
    region : FaceRegion or None
        The faces, where they are less than the whole surface.
    outline : PlanOutline or None
    given : Given or None
        The family that a network starts from.
    origin : (3,)
        To be added to all results.
    notes : tuple of str
        What a user should know of how the files were read.
    name : str
        Of the face, where several are panelled each on its own.
    """

    design: Design
    surface: Surface
    region: FaceRegion | None
    outline: PlanOutline | None
    given: Given | None
    origin: Floats
    notes: tuple[str, ...] = ()
    name: str = ""


def opened(design: Design, folder: Path) -> tuple[Source, ...]:
    """The design with its files read: one source, or one a face where faces do not join.

    Parameters
    ----------
    design : Design
    folder : path
        Where the design's files are sought.

    Raises
    ------
    PqmeshError
        Naming the file, the key or the place on the surface.
    """
    faces = faces_of(design.surface, folder)
    design, stated = _in_one_unit(design, faces)
    _check_digits(design, faces.origin)
    with placed(faces.origin):
        return _opened(design, folder, faces, is_stated=stated)


@contextmanager
def placed(origin: Floats, name: str = "") -> Iterator[None]:
    """Errors raised inside say of which face they are, and from which far origin places count."""
    try:
        yield
    except PqmeshError as error:
        text = f"{name}: {error}" if name else str(error)
        if origin.any():
            text += f" (Places count from {_point(origin)}.)"
        raise type(error)(text) from None


def _opened(design: Design, folder: Path, faces: Faces, *, is_stated: bool) -> tuple[Source, ...]:
    """The sources of faces, the design in their unit."""
    outline = _outline(design, folder, faces.origin)
    given = _given(design.panels.curves, folder, design.units, faces.origin)
    sources = []
    for patches, notes in joined_faces(faces.patches):
        surface, region = _surface(patches, design.extend, _rim(design))
        if outline is not None:
            points = surface.jet(surface.domain.grid(40, 40).reshape(-1, 2)).point[:, :2]
            extent = float(np.ptp(points, axis=0).max())
            plausible_units(outline, extent, design.units, is_stated=is_stated)
        name = patches[0].name if len(patches) < len(faces.patches) else ""
        own, more = _own_outline(outline, patches, region, is_alone=bool(name))
        sources.append(
            Source(design, surface, region, own, given, faces.origin, (*notes, *more), name)
        )
    return tuple(sources)


def read_design(path: str | Path) -> Source:
    """A design file opened, where its surface is one.

    Parameters
    ----------
    path : str or path
        A .toml; its files are sought beside it.

    Raises
    ------
    PqmeshError
        Naming the file, the line and the key, or the place on the surface.
    """
    text = Design.read(path)
    sources = opened(Design.of(text.tables, text.where), text.folder)
    if len(sources) > 1:
        raise SpecError(
            f"{text.where.name}: the faces of the surface must join smoothly; they are "
            f"{len(sources)} parts. Select one of them."
        )
    return sources[0]


def spec_of(source: Source, *, flip: bool = False) -> Spec:
    """What the main job is asked for."""
    design = source.design
    return Spec(
        edges=design.edges,
        kind=design.panels.kind,
        network=design.panels.network,
        given=source.given,
        distances=tuple(design.distances),
        boundary=design.boundary.mode,
        within=design.tolerances["deviation"],
        flat=design.flat,
        constraints=design.constraints_about(source.origin),
        flip=flip,
        most_panels=design.run.most_panels,
    )


def opened_surface(design: Design, folder: Path) -> Surface:
    """The surface of a design alone, where it must be one; about its origin.

    Raises
    ------
    SpecError
        When its faces do not join, or lie far from the origin.
    """
    faces = faces_of(design.surface, folder)
    groups = joined_faces(faces.patches)
    if len(groups) > 1:
        raise SpecError(
            f"A reference must be one surface; found {len(groups)} faces that do not join "
            f"smoothly. Select one of them."
        )
    if faces.origin.any():
        raise SpecError(
            f"A reference must lie near the origin; this one lies around "
            f"{faces.origin.tolist()}. Move it and the mesh there."
        )
    return _surface(groups[0][0], design.extend, design.extend)[0]


def _in_one_unit(design: Design, faces: Faces) -> tuple[Design, bool]:
    """The design in the unit of its surface, and whether that unit was stated anywhere."""
    said = design.surface.units
    if faces.units is None:
        return design, said is not None
    if said is not None and said != faces.units:
        raise SpecError(
            f"surface.units must agree with the file; the file is in {faces.units} and the design "
            f"says {said}. Leave units out: the file knows its own."
        )
    design = design.in_units(faces.units)
    # Lengths with a unit of their own are converted only now.
    _ = design.edges, design.distances, design.tolerances
    return design, True


def _check_digits(design: Design, origin: Floats) -> None:
    """Refuse places so far away that the numbers of the files are coarser than flat panels."""
    step, flat = float(np.spacing(np.abs(origin).max())), design.tolerances["flat"]
    if 4.0 * step > flat:
        raise SpecError(
            f"A surface must lie where coordinates are finer than tolerance.flat ({flat:.3g} "
            f"{design.units}); around {_point(origin)} they step by {step:.3g}. Move the model "
            f"near the origin, and all that belongs to it."
        )


def _point(place: Floats) -> str:
    return f"({', '.join(f'{x:.12g}' for x in place)})"


def _rim(design: Design) -> float:
    """How far joined faces are continued around: three panels and the shift of the layers.

    What is used of it beyond `surface.extend` is cut away with the panels that reach over.
    """
    shift = max((abs(d) for d in design.distances), default=0.0)
    return design.extend + 3.0 * max(design.edges) + shift


def _surface(
    patches: tuple[Patch, ...], extend: float, rim: float
) -> tuple[Surface, FaceRegion | None]:
    """One surface of the faces, extended on request, and its region where it is only a part."""
    if len(patches) > 1:
        for patch in patches:
            check_regular(patch.surface)
        joined = PlanSurface(patches, rim)
        return joined, FaceRegion(joined, patches, extend)
    patch = patches[0]
    check_regular(patch.surface)
    surface: Surface = patch.surface
    if extend:
        surface = _extended(surface, extend)
    return surface, FaceRegion(surface, patches, extend) if patch.loops else None


def _extended(surface: Surface, extend: float) -> Surface:
    """The surface continued, once it is regular there, too."""
    try:
        wide = extended(surface, extend)
        check_regular(wide)
    except SurfaceError as error:
        raise SurfaceError(
            f"A surface must stay regular where surface.extend = {extend:g} continues it; this one "
            f"does not. Extend it by less. ({error})"
        ) from None
    return wide


def _own_outline(
    outline: PlanOutline | None,
    patches: tuple[Patch, ...],
    region: FaceRegion | None,
    *,
    is_alone: bool,
) -> tuple[PlanOutline | None, tuple[str, ...]]:
    """The outline to cut by: the one given, the rim of trimmed faces, or both for a face alone."""
    if region is None and not is_alone:
        return outline, ()
    if outline is not None and not is_alone:
        return outline, ()
    if outline is None and region is None:
        return None, ()
    rims = plan_rims(patches)
    if rims is None:
        note = (
            "the rim of the faces has no simple outline in plan: panels reach over it as whole "
            "panels"
        )
        return outline, (note,)
    if outline is None:
        if len(rims) > 1:
            return None, ("the faces lie apart in plan: panels reach over their rims",)
        return PlanOutline(*rims[0]), ("no outline given: panels are cut at the rim of the faces",)
    common = plan_rims(patches, outline)
    if not common:
        raise SpecError(
            f"The outline must lie over each face; it misses {patches[0].name!r}. Select the "
            f"faces under it."
        )
    return PlanOutline(*common[0]), ("the face is cut by its own rim and by the outline",)


def _outline(design: Design, folder: Path, origin: Floats) -> PlanOutline | None:
    """The outline about the origin, from the design or from its file."""
    spec = design.outline
    if spec is None:
        return None
    if spec.file is not None:
        return read_outline(folder / spec.file, spec.select, units=design.units, origin=origin)
    rings = [np.array(ring) for ring in (spec.polygon or [], *spec.holes)]
    largest = max(float(np.abs(ring).max(initial=0.0)) for ring in rings)
    if largest > LARGEST_LENGTH:
        raise SpecError(
            f"An outline must stay below {LARGEST_LENGTH:g}; found a coordinate of "
            f"{largest:g}. Check the units."
        )
    first, *holes = (ring - origin[:2] if ring.ndim == 2 else ring for ring in rings)
    return PlanOutline(first, tuple(holes))


def _given(spec: CurvesSpec | None, folder: Path, units: str, origin: Floats) -> Given | None:
    """The given family about the origin."""
    if spec is None:
        return None
    curves: tuple[Floats, ...] = ()
    if spec.file is not None:
        curves = read_curves(folder / spec.file, spec.select, units=units, origin=origin)
    for number, rows in enumerate(spec.points or []):
        if len({len(row) for row in rows}) != 1 or len(rows[0]) not in (2, 3):
            raise SpecError(
                f"panels.curves.points must be lists of points [x, y] or [x, y, z]; curve "
                f"{number} is not. Mend it."
            )
        points = np.array(rows, dtype=np.float64)
        curves += (points - origin[: points.shape[1]],)
    through = None
    if spec.through is not None:
        through = (spec.through[0] - float(origin[0]), spec.through[1] - float(origin[1]))
    direction = None if spec.direction_deg is None else float(np.radians(spec.direction_deg))
    return Given(direction, curves, through)
