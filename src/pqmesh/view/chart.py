"""Picture of a curve: what is reached against what is allowed."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pqmesh.vectors import Floats
from pqmesh.view.camera import Box
from pqmesh.view.sheet import GREY, INK, PALE, SUPERSCRIPTS, Sheet, number, paper

FRAME = Box(190.0, 215.0, 1530.0, 850.0)
LEGEND = 1300.0


@dataclass(frozen=True)
class Series:
    """Values at some of the places of a chart.

    Attributes
    ----------
    name : str
    color : '#rrggbb'
    values : mapping of place to value
    open_places : places whose value was not reached as asked; drawn hollow
    """

    name: str
    color: str
    values: dict[float, float]
    open_places: frozenset[float] = frozenset()


def chart_figure(
    series: Sequence[Series],
    *,
    across: str,
    up: str,
    least: float,
    title: str = "",
    caption: str = "",
    hollow: str = "not reached",
) -> bytes:
    """PNG of series over evenly spread places, with a logarithmic height.

    Parameters
    ----------
    series : sequence of Series
        All their places stand side by side in rising order.
    across, up : str
        What is shown, with its unit.
    least : float
        Smaller values, zero among them, are drawn at this height.
    hollow : str
        Meaning of hollow dots, for the legend.

    Raises
    ------
    PqmeshError
        When matplotlib is not installed.
    """
    places = sorted({place for one in series for place in one.values})
    largest = max([least * 10.0, *(v for one in series for v in one.values.values())])
    low, high = math.floor(math.log10(least)), math.ceil(math.log10(largest) - 1e-9)
    with paper(title or up, caption) as sheet:
        _axes(sheet, places, (low, high), across, up)
        for one in series:
            shown = sorted(one.values)
            points = np.array(
                [_point(places, (low, high), p, max(one.values[p], least)) for p in shown]
            )
            sheet.line(points, one.color, 4.0)
            for place, point in zip(shown, points, strict=True):
                face = "white" if place in one.open_places else one.color
                sheet.circle(point, 9.0, facecolor=face, edgecolor=one.color, linewidth=3.5)
                words = number(one.values[place])
                sheet.text(point[0] + 14, point[1] + 12, words, halo=True, color=one.color)
        sheet.legend([(one.color, one.name) for one in series], LEGEND)
        if any(one.open_places for one in series):
            y = 40.0 + 30.0 * len(series)
            sheet.circle(np.array([LEGEND + 23.0, y + 6]), 9.0, facecolor="white", edgecolor=GREY,
                         linewidth=3.5)  # fmt: skip
            sheet.text(LEGEND + 64.0, y, hollow)
        return sheet.png()


def _point(places: Sequence[float], decades: tuple[int, int], place: float, value: float) -> Floats:
    """Pixel of a value at a place."""
    share = (places.index(place) + 0.5) / len(places)
    rise = (math.log10(value) - decades[0]) / (decades[1] - decades[0])
    x = FRAME.left + share * (FRAME.right - FRAME.left)
    return np.array([x, FRAME.bottom + rise * (FRAME.top - FRAME.bottom)])


def _axes(
    sheet: Sheet, places: Sequence[float], decades: tuple[int, int], across: str, up: str
) -> None:
    """Frame, decades and places with their names."""
    for decade in range(decades[0], decades[1] + 1):
        y = float(_point(places, decades, places[0], 10.0**decade)[1])
        sheet.line(np.array([[FRAME.left, y], [FRAME.right, y]]), PALE, 1.2)
        words = (
            number(10.0**decade) if abs(decade) < 4 else "10" + str(decade).translate(SUPERSCRIPTS)
        )
        words = f"≤ {words}" if decade == decades[0] else words
        sheet.text(FRAME.left - 14, y - 7, words, ha="right", color=GREY)
    for place in places:
        x = float(_point(places, decades, place, 10.0 ** decades[0])[0])
        sheet.line(np.array([[x, FRAME.bottom], [x, FRAME.bottom - 9]]), GREY, 1.2)
        sheet.text(x, FRAME.bottom - 36, number(place), ha="center", color=GREY)
    frame = [[FRAME.left, FRAME.top], [FRAME.left, FRAME.bottom], [FRAME.right, FRAME.bottom]]
    sheet.line(np.array(frame), GREY, 1.6)
    sheet.text(FRAME.middle[0], FRAME.bottom - 78, across, "caption", ha="center", color=INK)
    sheet.text(FRAME.left - 104, FRAME.middle[1], up, "caption", ha="center", va="center",
               rotation=90, color=INK)  # fmt: skip
