"""The sheet a picture is drawn on: title, caption, scale bar, legend and colour bar, as PNG."""

from __future__ import annotations

import io
import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np

from pqmesh.errors import PqmeshError
from pqmesh.vectors import Floats
from pqmesh.view.camera import Box, View

SIZE = (1600, 1000)
DPI = 200
# Where the object itself goes: below the title, above scale and colour bar.
STAGE = Box(60, 125, 1540, 880)
INK, GREY, PALE = "#23272b", "#6a7178", "#c9ced2"
FONT = "DejaVu Sans"
TEXT = {"title": 10.5, "caption": 6.8, "label": 6.2}
# Settings that belong to the running program, not to a picture.
KEPT_SETTINGS = ("backend", "backend_fallback", "interactive", "toolbar", "timezone", "datapath")
MOST_DECADES = 6
SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def require_matplotlib() -> Any:
    """The matplotlib module.

    Raises
    ------
    PqmeshError
        When it is not installed.
    """
    try:
        import matplotlib
        import matplotlib.backends.backend_agg
        import matplotlib.collections
        import matplotlib.figure
        import matplotlib.patches
        import matplotlib.patheffects
    except ImportError as error:
        raise PqmeshError(
            "Pictures need matplotlib; it is not installed here. Install the extra: "
            "pip install 'pqmesh[viz]', or ask for no figures."
        ) from error
    return matplotlib


def number(value: float) -> str:
    r"""A number for people: three digits, thin spaces, powers of ten where they help.

    Examples
    --------
    >>> number(0.0123456), number(1234567.0), number(3.2e-9), number(0.0)
    ('0.0123', '1\u2009230\u2009000', '3.2×10⁻⁹', '0')
    """
    if value == 0 or not math.isfinite(value):
        return "0" if value == 0 else str(value)
    exponent = math.floor(math.log10(abs(value)) + 1e-12)
    if -4 < exponent < 7:
        rounded = round(value, 2 - exponent)
        shown = f"{rounded:,.{max(2 - exponent, 0)}f}".replace(",", "\u2009")
        shown = shown.rstrip("0").rstrip(".") if "." in shown else shown
        return shown.replace("-", "−")
    mantissa = f"{value / 10.0**exponent:.2g}"
    power = "10" + str(exponent).translate(SUPERSCRIPTS)
    return power if mantissa == "1" else f"{mantissa}×{power}".replace("-", "−")


@dataclass(frozen=True)
class ColorScale:
    """From values to colours of a perceptually uniform map.

    Attributes
    ----------
    low, high : float
        Values at the ends of the colour bar, in the unit it is labelled with.
    log : bool
    dark_is_low : bool
        By default large values are dark.
    clipped : bool
        Values below `low` exist and take its colour.
    depth : float
        Share of the map that is used: less leaves room for dark lines.
    """

    low: float
    high: float
    log: bool = False
    dark_is_low: bool = False
    clipped: bool = False
    depth: float = 0.74

    @classmethod
    def of(cls, values: Floats, *, log: bool = False, dark_is_low: bool = False) -> ColorScale:
        """Scale that spans the finite values; a logarithmic one at most six decades."""
        known = values[np.isfinite(values)]
        high = float(known.max()) if len(known) else 1.0
        low = float(known.min()) if len(known) else 0.0
        if log and len(known) and high > 0:
            # Ends at powers of the square root of ten: half decades.
            top = max(math.ceil(2.0 * math.log10(high) - 1e-9), -600)
            least = math.floor(2.0 * math.log10(float(known[known > 0].min())) + 1e-9)
            bottom = min(max(least, top - 2 * MOST_DECADES), top - 1)
            start = 10.0 ** (0.5 * bottom)
            return cls(start, 10.0 ** (0.5 * top), True, dark_is_low, low < start)
        if 0 <= low < 0.5 * high:
            low = 0.0
        if high - low <= 1e-12 * max(abs(high), abs(low), 1e-280):
            low, high = (0.0, high) if high > 1e-280 else (low, low + max(1.0, abs(low)))
        return cls(low, high, False, dark_is_low)

    def shares(self, values: Floats) -> Floats:
        """Place of values between low (0) and high (1); NaN stays."""
        if self.log:
            safe = np.log(np.maximum(values, self.low))
            return np.clip((safe - math.log(self.low)) / math.log(self.high / self.low), 0.0, 1.0)
        return np.clip((values - self.low) / (self.high - self.low), 0.0, 1.0)

    def colors(self, values: Floats) -> Floats:
        """Colours of values (n,) -> (n, 3); a neutral grey for NaN."""
        share = self.shares(values)
        known = np.isfinite(share)
        place = np.where(known, share, 0.0)
        place = 1.0 - place if self.dark_is_low else place
        # The ends of the map, near white and near black, would swallow background and edges.
        table = require_matplotlib().colormaps["magma_r"]
        rgb = np.asarray(table(0.06 + self.depth * place))[:, :3]
        return np.where(known[:, None], rgb, 0.90)

    def ticks(self) -> list[float]:
        """Round values along the bar."""
        if self.log:
            first, last = math.log10(self.low), math.log10(self.high)
            digits = (1.0,) if last - first > 1.6 else (1.0, 2.0, 5.0)
            decades = range(math.floor(first), math.ceil(last) + 1)
            marks = [d * 10.0**k for k in decades for d in digits]
            marks = [m for m in marks if self.low * 0.999 <= m <= self.high * 1.001]
            return marks[:: max(1, math.ceil(len(marks) / 8))]
        step = round_length((self.high - self.low) / 4.0)
        start = math.ceil(self.low / step - 1e-9)
        stop = math.floor(self.high / step + 1e-9)
        return [i * step for i in range(start, stop + 1)]


def count(amount: int, one: str = "", many: str = "") -> str:
    r"""A whole number with thin spaces, and its noun.

    Examples
    --------
    >>> count(1334, "panel"), count(1, "panel")
    ('1\u2009334 panels', '1 panel')
    """
    noun = one if amount == 1 else many or (one + "s" if one else "")
    return f"{amount:,} {noun}".strip().replace(",", "\u2009")


def round_length(value: float) -> float:
    """The largest of 1, 2, 5 times a power of ten that is not above a positive value.

    Examples
    --------
    >>> [round_length(x) for x in (7.3, 0.21, 1.0)]
    [5.0, 0.2, 1.0]
    """
    power = 10.0 ** math.floor(math.log10(value) + 1e-12)
    digit = max(d for d in (1.0, 2.0, 5.0) if d * power <= value * (1 + 1e-12))
    return float(f"{digit * power:.12g}")


class Sheet:
    """White sheet of 1600 x 1000 pixels; everything on it is placed in pixels."""

    def __init__(self, title: str, caption: str) -> None:
        self.mpl = require_matplotlib()
        size = (SIZE[0] / DPI, SIZE[1] / DPI)
        self.figure = self.mpl.figure.Figure(figsize=size, dpi=DPI, facecolor="white")
        self.canvas = self.mpl.backends.backend_agg.FigureCanvasAgg(self.figure)
        self.axes = self.figure.add_axes((0.0, 0.0, 1.0, 1.0), frameon=False)
        self.axes.set_axis_off()
        self.axes.set_xlim(0, SIZE[0])
        self.axes.set_ylim(0, SIZE[1])
        self.order = 1.0
        self.text(60, 946, title, "title", weight="bold")
        self.text(60, 906, caption, "caption", color=GREY)

    def png(self) -> bytes:
        """The sheet as a PNG file."""
        buffer = io.BytesIO()
        # No program name and no date: same picture, same bytes.
        self.canvas.print_png(buffer, metadata={"Software": None})
        return buffer.getvalue()

    def text(self, x: float, y: float, words: str, kind: str = "label", **style: Any) -> None:
        """Words at a pixel; `halo=True` keeps them readable on the object."""
        halo = style.pop("halo", False)
        style = {"color": INK, "ha": "left", "va": "baseline", **style}
        drawn = self.axes.text(
            x, y, words, fontsize=TEXT[kind], fontfamily=FONT, parse_math=False, zorder=1e6, **style
        )
        if halo:
            outline = self.mpl.patheffects.withStroke(linewidth=2.2, foreground="white", alpha=0.9)
            drawn.set_path_effects([outline])

    def polygons(
        self, pixels: Floats, fill: Floats, stroke: Floats, width: Floats, clip: Any = None
    ) -> None:
        """Polygons (n, k, 2) in their order; fills and strokes (n, 4), widths in pixels (n,)."""
        collection = self.mpl.collections.PolyCollection(
            pixels,
            facecolors=fill,
            edgecolors=stroke,
            linewidths=width * 72.0 / DPI,
            capstyle="round",
            joinstyle="round",
            antialiaseds=True,
        )
        collection.set_snap(False)
        self.order += 1.0
        collection.set_zorder(self.order)
        self.axes.add_collection(collection, autolim=False)
        if clip is not None:
            collection.set_clip_path(clip)

    def line(self, points: Floats, color: str, width: float, **style: Any) -> None:
        """Polyline through pixels (n, 2)."""
        self.order += 1.0
        order = style.pop("zorder", self.order)
        style = {"solid_capstyle": "round", "solid_joinstyle": "round", **style}
        self.axes.plot(
            points[:, 0], points[:, 1], color=color, lw=width * 72 / DPI, zorder=order, **style
        )

    def circle(self, center: Floats, radius: float, **style: Any) -> Any:
        """Circle patch around a pixel."""
        self.order += 1.0
        style = {"zorder": self.order, **style}
        style["linewidth"] = style.get("linewidth", 1.0) * 72 / DPI
        patch = self.mpl.patches.Circle((float(center[0]), float(center[1])), radius, **style)
        self.axes.add_patch(patch)
        return patch

    def rectangle(self, low: Floats, high: Floats, color: str) -> Any:
        """Filled rectangle patch between two pixels; others may be clipped by it."""
        self.order += 1.0
        width, height = (float(side) for side in high - low)
        patch = self.mpl.patches.Rectangle(
            (float(low[0]), float(low[1])), width, height, facecolor=color, zorder=self.order
        )
        self.axes.add_patch(patch)
        return patch

    def scale_bar(self, view: View, units: str, left: float = 60.0) -> None:
        """Bar of a round length, true for lengths that lie in the picture's plane."""
        length = round_length(230.0 / view.scale)
        half = 0.5 * length * view.scale
        for i, color in enumerate((INK, "white")):
            x = left + i * half
            box = np.array([[[x, 62], [x + half, 62], [x + half, 70], [x, 70]]])
            ink = np.array([self.mpl.colors.to_rgba(INK)])
            fill = np.array([self.mpl.colors.to_rgba(color)])
            self.polygons(box, fill, ink, np.array([1.2]))
        self.text(left, 80, "0", ha="center")
        self.text(left + 2 * half, 80, f"{number(length)} {units}".strip(), ha="center")

    def legend(self, entries: Sequence[tuple[str, str]], left: float = 1240.0) -> None:
        """Short coloured lines with their names, in a column at the lower right."""
        for row, (color, name) in enumerate(reversed(entries)):
            y = 40.0 + 30.0 * row
            self.text(left + 64, y, name)
            self.line(np.array([[left, y + 6], [left + 46, y + 6]]), color, 3.4)

    def color_bar(self, scale: ColorScale, label: str, unit: str) -> None:
        """Horizontal colour bar at the lower right with its unit."""
        left, right, low, high = 1080.0, 1540.0, 62.0, 78.0
        steps = np.linspace(left, right, 185)
        a, b = steps[:-1], np.minimum(steps[1:] + 0.6, right)
        base, top = np.full_like(a, low), np.full_like(a, high)
        boxes = np.stack([np.stack(p, -1) for p in ((a, base), (b, base), (b, top), (a, top))], 1)
        share = (np.arange(184) + 0.5) / 184
        if scale.log:
            values = scale.low * (scale.high / scale.low) ** share
        else:
            values = scale.low + share * (scale.high - scale.low)
        fill = np.column_stack([scale.colors(values), np.ones(184)])
        self.polygons(boxes, fill, np.zeros((184, 4)), np.zeros(184))
        frame = [[left, low], [right, low], [right, high], [left, high], [left, low]]
        self.line(np.array(frame), GREY, 1.0)
        for value in scale.ticks():
            x = left + (right - left) * float(scale.shares(np.array([value]))[0])
            self.line(np.array([[x, low], [x, low - 6]]), GREY, 1.0)
            self.text(x, 32, number(value), ha="center", color=GREY)
        name = f"{label} ({unit})" if unit else label
        self.text(right, 92, name, ha="right")
        if scale.clipped:
            self.text(left - 12, 64, f"≤ {number(scale.low)}", ha="right", color=GREY)


@contextmanager
def paper(title: str, caption: str) -> Iterator[Sheet]:
    """A sheet, with the user's matplotlib settings set aside until it is finished."""
    mpl = require_matplotlib()
    plain = {k: v for k, v in mpl.rcParamsDefault.items() if k not in KEPT_SETTINGS}
    with mpl.rc_context(plain):
        yield Sheet(title, caption)
