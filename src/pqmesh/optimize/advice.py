"""An outlook in sentences for a designer: what must hold, what was found, what to do."""

from __future__ import annotations

import numpy as np

from pqmesh.mesh.conjugacy import FAR
from pqmesh.optimize.outlook import Outlook
from pqmesh.vectors import Floats

# Moves up to this many mean edges keep the look of the net; those below the second are none.
SLIDE, STILL = 1.0, 0.1
# Families of a net along curvature lines meet under at least this angle, radians, in the median.
UPRIGHT = np.radians(85.0)

REMESH = "panel the surface anew along its lines of curvature (pqmesh panelize --network principal)"


def advice(found: Outlook, origin: Floats | float = 0.0) -> tuple[str, ...]:
    """Sentences for a designer; none when the net is fit for its kind and nothing is broken.

    Parameters
    ----------
    found : Outlook
    origin : (3,) or 0
        Added to the places that are named.

    Examples
    --------
    >>> from pqmesh.mesh.solids import cube
    >>> from pqmesh.optimize.outlook import outlook
    >>> advice(outlook("planar", cube()))
    ()
    """
    return (*_starts(found, origin), *_nets(found), *_regions(found, origin))


def _starts(found: Outlook, origin: Floats | float) -> list[str]:
    """What is broken before anything moves."""
    said = []
    for what, must, are, noun in (
        ("not convex", "Faces should be convex at the start", "not convex", "face"),
        ("turned over", "Faces should look the way their neighbours do", "turned over", "face"),
        ("short", "Edges should be about as long as those opposite", "much shorter", "edge"),
    ):
        listed = [entry for entry in found.broken if entry.what == what]
        if listed:
            name = "-".join(map(str, listed[0].where))
            said.append(
                f"{must}; {len(listed)} {'is' if len(listed) == 1 else 'are'} {are}, the first is "
                f"{noun} {name} at {place(listed[0].at + origin)}. Mend the start there: the "
                f"optimiser keeps whole what is whole, and may leave these as they are."
            )
    return said


def _nets(found: Outlook) -> list[str]:
    """What the lines of the net are good for."""
    judged = found.conjugacy
    turn = np.degrees(judged.turn_median or 0.0)
    share = 100 * (judged.far_share or 0.0)
    if found.verdict == "asymptotic":
        return [
            f"The lines are asymptotic: both families lie near asymptotic directions of the "
            f"surface, which faces cannot follow and be flat; the lines must turn by {turn:.3g} "
            f"deg in the median.{_slide(found)} Better {REMESH}."
        ]
    if found.verdict == "far from conjugate":
        return [
            f"The two families of lines must be conjugate for flat faces (II(a, b) = 0); they "
            f"must turn by {turn:.3g} deg in the median, and by more than "
            f"{np.degrees(FAR):.0f} deg in {share:.3g} % of the faces.{_slide(found)} Better "
            f"{REMESH}."
        ]
    if found.verdict != "conjugate" and (found.move_edges or np.inf) < STILL:
        # It is flat nearly where it is, whatever its lines.
        return []
    if found.verdict == "nearly conjugate":
        return [
            f"The two families of lines must be conjugate for flat faces (II(a, b) = 0); they "
            f"must turn by {turn:.3g} deg in the median.{_slide(found)} If that is too much, "
            f"{REMESH}."
        ]
    if found.verdict == "undecided":
        return [_undecided(found)]
    return _turned(found)


def _undecided(found: Outlook) -> str:
    """Why the lines could not be judged."""
    judged = found.conjugacy
    if judged.is_coarse or judged.turn_median is None:
        return (
            "Lines can be judged where at least four inner vertices of valence 4 lie, and bend "
            "there by less than a radian; this mesh is too coarse or too small for that."
            + _slide(found)
        )
    return (
        f"Neighbouring faces must be twisted alike for the lines to be judged; here the twist "
        f"changes from face to face (planarity of 2 x 2 faces {judged.ratio_median:.2g} times that "
        f"of one): the mesh is rough.{_slide(found)} Smooth it first if it should be smooth."
    )


def _turned(found: Outlook) -> list[str]:
    """A conjugate net that is not one of curvature lines, where such a one is wanted."""
    angles = found.conjugacy.family_angle
    middle = float(np.median(angles)) if len(angles) else np.pi / 2
    far = found.move_edges is not None and found.move_edges > SLIDE
    if found.kind == "planar" or not far or middle >= UPRIGHT:
        return []
    return [
        f"The lines of a {found.kind} mesh must follow the lines of curvature, which meet under 90 "
        f"deg; these are conjugate, but meet under {np.degrees(middle):.3g} deg in the median."
        f"{_slide(found)} Choose kind planar, or {REMESH}."
    ]


def _slide(found: Outlook) -> str:
    """How far vertices must move, as a sentence with a space before it."""
    if found.move_max is None or found.move_edges is None:
        return ""
    return (
        f" The farthest vertices must move by about {found.move_edges:.2g} edges "
        f"({found.move_max:.3g})."
    )


def _regions(found: Outlook, origin: Floats | float) -> list[str]:
    """The worst region, and how many more."""
    if not found.regions or found.verdict == "undecided":
        return []
    worst = found.regions[0]
    where = f"face {worst.worst} at {place(worst.at + origin)}, by {np.degrees(worst.turn):.3g} deg"
    if found.verdict == "conjugate":
        count = int(found.conjugacy.is_far.sum())
        return [
            f"The lines are conjugate but for {_counted(count, 'face')} in "
            f"{_counted(len(found.regions), 'region')}; they must turn most in {where}."
        ]
    lean = f", {100 * worst.asymptotic:.3g} % of them asymptotic" if worst.asymptotic else ""
    more = len(found.regions) - 1
    rest = f"; {_counted(more, 'region')} more in the report" if more else ""
    return [
        f"The worst region has {_counted(len(worst.faces), 'face')}{lean}; the lines must turn "
        f"most in {where}{rest}."
    ]


def _counted(number: int, noun: str) -> str:
    """A number with its noun."""
    return f"{number} {noun}{'' if number == 1 else 's'}"


def place(point: Floats) -> str:
    """A place in space in words."""
    return "(" + ", ".join(f"{x:.6g}" for x in np.asarray(point) + 0.0) + ")"
