"""What an outlook means for a designer, in sentences: what must hold, what was found, what to do."""

from __future__ import annotations

import numpy as np

from pqmesh.mesh.conjugacy import ASYMPTOTIC, FAR
from pqmesh.optimize.outlook import Outlook, Region
from pqmesh.vectors import Floats

# Moves up to this many mean edges keep the look of the net.
SLIDE = 1.0
# Families of a net along curvature lines meet under at least this angle, radians, in the median.
UPRIGHT = np.radians(85.0)

REMESH = "Panel the surface anew along a network that fits: pqmesh panelize --network principal."


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
    for what, must in (
        ("not convex", "Faces should be convex at the start"),
        ("turned over", "Faces should look the same way as their neighbours"),
        ("short", "Edges should be about as long as those opposite to them"),
    ):
        listed = [entry for entry in found.broken if entry.what == what]
        if listed:
            first = listed[0]
            name = "edge" if what == "short" else "face"
            label = "-".join(map(str, first.where))
            are = "much shorter" if what == "short" else what
            said.append(
                f"{must}; {len(listed)} {'is' if len(listed) == 1 else 'are'} {are}, first {name} "
                f"{label} at {place(first.at + origin)}. Mend the start there: the optimiser keeps "
                f"whole what is whole, and may leave these as they are."
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
            f"deg in the median. {REMESH}"
        ]
    if found.verdict == "far from conjugate":
        return [
            f"The two families of lines must be conjugate for flat faces (II(a, b) = 0); they "
            f"must turn by {turn:.3g} deg in the median, and by more than "
            f"{np.degrees(FAR):.0f} deg in {share:.3g} % of the faces.{_slide(found)} {REMESH}"
        ]
    if found.verdict == "nearly conjugate":
        return [
            f"The two families of lines must be conjugate for flat faces (II(a, b) = 0); they "
            f"must turn by {turn:.3g} deg in the median.{_slide(found)} If that is too much: "
            f"{REMESH}"
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
        f"{_slide(found)} Choose kind planar, or: {REMESH}"
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
    more = len(found.regions) - 1
    rest = f" {more} more {'region' if more == 1 else 'regions'} in the report." if more else ""
    return [_region(found.regions[0], origin) + rest]


def _region(region: Region, origin: Floats | float) -> str:
    """A region in words."""
    count = len(region.faces)
    text = (
        f"Worst are {count} faces around" if count > 1 else "Worst is"
    ) + f" face {region.worst} at {place(region.at + origin)}: there the lines must turn by "
    text += f"{np.degrees(region.turn):.3g} deg"
    if region.turn > ASYMPTOTIC:
        text += f" (asymptotic in {100 * region.asymptotic:.3g} % of them)" if count > 1 else ""
    return text + "."


def place(point: Floats) -> str:
    """A place in space in words."""
    return "(" + ", ".join(f"{x:.6g}" for x in np.asarray(point) + 0.0) + ")"
