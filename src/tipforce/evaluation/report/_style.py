"""The style of all figures, and how they become SVG: inside the page and as files of their own."""

import base64
import io
import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import cv2
import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ...clinical import LIMIT_N, WINDOW_N
from ...types import Image
from ...units import grams_to_newtons, newtons_to_grams
from .._thesis import THESIS_FIGURES

TEXT_PX = 12.0
"""Smallest type. One unit of a figure's SVG is never shown smaller than one pixel of the page."""
WIDTH_IN, WIDE_IN, HEIGHT_IN = 6.8, 14.2, 3.7
"""Widths of a figure in one of two columns and across both, and height of either: four fit on a printed page."""
MANY_POINTS = 1500
"""A scatter with more points is stored as pixels."""
INK = "#15202b"
"""Text, axes and reference lines."""
GREY = "#8a939c"
"""Colour of the constant predictor and of all context."""
COLOURS = {
    "reference": INK,
    "estimate": "#0072b2",
    "band": "#56b4e9",
    "line": "#d55e00",
    "abstained": "#e69f00",
    "second": "#009e73",
}
METHOD_COLOURS = ("#0072b2", "#e69f00", "#009e73", "#cc79a7", "#d55e00", "#56b4e9")
"""Okabe and Ito's palette, which people with any colour vision can distinguish."""

_SIZES = ("font.size", "axes.labelsize", "legend.fontsize", "xtick.labelsize", "ytick.labelsize")
_INKED = ("axes.edgecolor", "axes.labelcolor", "axes.titlecolor", "grid.color", "text.color", "xtick.color")
_RC: dict[Any, Any] = {
    **dict.fromkeys(_SIZES, TEXT_PX),
    **dict.fromkeys((*_INKED, "ytick.color"), INK),
    **dict.fromkeys(("axes.facecolor", "figure.facecolor", "savefig.facecolor", "svg.fonttype"), "none"),
    **dict.fromkeys(("axes.spines.top", "axes.spines.right", "legend.frameon"), False),
    **dict.fromkeys(("axes.grid", "axes.axisbelow"), True),
    **dict.fromkeys(("axes.linewidth", "grid.linewidth"), 0.8),
    "font.family": "DejaVu Sans",
    "axes.titlesize": 12.5,
    "axes.titleweight": "normal",
    "axes.titlelocation": "left",
    "axes.titlepad": 10,
    "grid.alpha": 0.12,
    "lines.linewidth": 1.6,
    "svg.hashsalt": "tipforce",
    "mathtext.default": "regular",
}
"""Settings of Matplotlib for all figures."""


@dataclass(frozen=True, slots=True)
class Drawing:
    """A figure of the report.

    Attributes:
        slug: Name of its SVG file without ending.
        caption: Sentences beneath it.
        page: SVG for the inside of the page.
        file: SVG as a file of its own.
        width_px: Width below which the page does not show it, so that its type stays legible.
        wide: Whether it goes across both columns of the page.
    """

    slug: str
    caption: str
    page: str
    file: str
    width_px: int = 0
    wide: bool = False


_TITLE_PER_IN = 8.6
"""Letters of a title that fit an inch."""


def make_figure(
    draw: Callable[[Figure], None], title: str, width_in: float = WIDTH_IN, height_in: float = HEIGHT_IN
) -> Figure:
    """Makes a figure in the common style, without touching the state of pyplot.

    Args:
        draw: Fills the figure.
        title: Title in bold above it; an empty one takes no space.
        width_in: Width in inches; an inch is 72 pixels of the page.
        height_in: Height in inches.
    """
    with matplotlib.rc_context(_RC):
        figure = Figure(figsize=(width_in, height_in), layout="constrained")
        if title:
            max_letters = int(width_in * _TITLE_PER_IN)
            title = title if len(title) <= max_letters else title[: max_letters - 1] + "…"
            figure.suptitle(title, x=0.012, ha="left", fontsize=13, fontweight="bold")
        draw(figure)
    return figure


def to_svg(figure: Figure) -> str:
    """Returns the figure as an SVG document whose bytes depend on its content only."""
    buffer = io.StringIO()
    with matplotlib.rc_context(_RC):
        figure.savefig(buffer, format="svg", dpi=170, metadata={"Date": None, "Creator": None})
    return re.sub(r"\A.*?(?=<svg)", "", buffer.getvalue(), flags=re.S)


def page_svg(svg: str, title: str) -> str:
    """Returns an SVG for the inside of a page, which gives it its width.

    Args:
        svg: The SVG document.
        title: Text that screen readers read out.
    """
    body = re.sub(r' (width|height)="[\d.]+pt"', "", svg, count=2)
    body = re.sub(r"<metadata>.*?</metadata>", "", body, flags=re.S)
    return body.replace("<svg ", f'<svg role="img" aria-label="{_escaped(title)}" ', 1)


def standalone_svg(svg: str) -> str:
    """Returns ``svg`` as a file of its own, on white."""
    head = '<?xml version="1.0" encoding="utf-8"?>\n'
    return head + svg.replace("<svg ", '<svg style="background:#fff" ', 1)


def drawing_of(slug: str, caption: str, figure: Figure) -> Drawing:
    """Makes a drawing of a figure.

    Args:
        slug: Name of its file, without the ending.
        caption: Text below it.
        figure: The figure.
    """
    svg = to_svg(figure)
    width_in = float(figure.get_figwidth())
    drawn = page_svg(svg, caption), standalone_svg(svg)
    return Drawing(slug, caption, *drawn, round(72 * width_in), width_in >= WIDE_IN)


def image_drawing(slug: str, caption: str, image: Image) -> Drawing:
    """Makes a drawing of an image.

    Args:
        slug: Name of its file, without the ending.
        caption: Text below it.
        image: (h, w, 3), not changed.
    """
    height, width = image.shape[:2]
    svg = (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}">'
        f'<image width="{width}" height="{height}" href="{jpeg_uri(image)}"/></svg>'
    )
    return Drawing(slug, caption, page_svg(svg, caption), standalone_svg(svg))


def jpeg_uri(image: Image) -> str:
    """Returns an RGB or grey image as a JPEG in a data URI."""
    bgr = image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_RGB2BGR)
    _, data = cv2.imencode(".jpg", np.ascontiguousarray(bgr), [cv2.IMWRITE_JPEG_QUALITY, 88])
    return "data:image/jpeg;base64," + base64.b64encode(data.tobytes()).decode("ascii")


def grams_axis(axes: Axes, which: str = "y") -> None:
    """Adds a second scale in gram-force opposite the one in newtons.

    Args:
        axes: The plot.
        which: "y" or "x", the axis in newtons.
    """
    pair: Any = (newtons_to_grams, grams_to_newtons)
    if which == "y":
        side = axes.secondary_yaxis("right", functions=pair)
        side.set_ylabel("g")
    else:
        side = axes.secondary_xaxis("top", functions=pair)
        side.set_xlabel("g")
    side.spines[:].set_visible(True)
    side.spines[:].set_linewidth(0.8)


def draw_window(axes: Axes, *, vertical: bool = False, label: bool = True) -> None:
    """Marks forces below the window `WINDOW_N` and above `LIMIT_N`: a band for each, with a line at its end.

    Args:
        axes: The plot, with its final limits in newtons.
        vertical: Marks the window on the x axis instead of the y axis.
        label: Names the bands in the legend.
    """
    low, high = WINDOW_N[0], LIMIT_N
    bottom, top = axes.get_xlim() if vertical else axes.get_ylim()
    span, line = (axes.axvspan, axes.axvline) if vertical else (axes.axhspan, axes.axhline)
    for start, end, colour, name in (
        (bottom, min(low, top), _BELOW, f"< {low:g} N"),
        (max(high, bottom), top, _ABOVE, f"> {high:g} N"),
    ):
        if end > start:
            span(start, end, color=colour, alpha=0.16, linewidth=0, zorder=0.5, label=name if label else None)
    for force in (low, high):
        if bottom < force < top:
            line(force, color=INK, linewidth=0.8, linestyle=(0, (1, 2)), alpha=0.7, zorder=0.6)


def window_words() -> str:
    """Returns the effect of forces below the window and above the limit.

    >>> window_words()
    'Below 0.1 N (10 g) an ablation fails, above 0.4 N (41 g) the wall may be pierced (the thesis: above 0.3 N)'
    """
    low, high = (f"{force:g} N ({newtons_to_grams(force):.0f} g)" for force in (WINDOW_N[0], LIMIT_N))
    thesis = THESIS_FIGURES["safe_limit_n"]
    return f"Below {low} an ablation fails, above {high} the wall may be pierced (the thesis: above {thesis:g} N)"


_BELOW, _ABOVE = "#e69f00", "#cc3311"


def legend_above(axes: Axes, columns: int = 4) -> None:
    """Puts the legend above the plot, where it hides nothing.

    Args:
        axes: The plot.
        columns: Number of its columns.
    """
    axes.legend(
        loc="lower left", bbox_to_anchor=(0, 1.0), ncols=columns, borderaxespad=0.2, columnspacing=1.2,
        handlelength=1.5, handletextpad=0.5,
    )  # fmt: skip


def mark_line(axes: Axes, value: float, text: str, vertical: bool = False) -> None:
    """Draws a dashed reference line with its name in the legend.

    Args:
        axes: The plot.
        value: Position of the line, in the unit of its axis.
        text: Name of the line.
        vertical: Whether the line is vertical.
    """
    line = axes.axvline if vertical else axes.axhline
    line(value, color=COLOURS["line"], linestyle=(0, (4, 3)), linewidth=1.2, label=text)


def _escaped(text: str) -> str:
    return text.replace("&", "&amp;").replace('"', "&quot;").replace("<", "&lt;")
