"""One look for all figures: sizes, colours, and how they become SVG for a page in light or dark."""

import io
import re
from collections.abc import Callable
from typing import Any

import matplotlib
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ..units import grams_to_newtons, newtons_to_grams

__all__ = [
    "COLOURS",
    "GREY",
    "INK",
    "METHOD_COLOURS",
    "grams_axis",
    "legend_above",
    "make_figure",
    "mark_line",
    "page_svg",
    "standalone_svg",
    "to_svg",
]

INK = "#15202b"
"""Text, axes and reference lines; the page replaces it by its own text colour."""
GREY = "#8a939c"
"""The constant predictor, and whatever is context rather than result."""
COLOURS = {
    "reference": INK,
    "estimate": "#0072b2",
    "band": "#56b4e9",
    "line": "#d55e00",
    "refused": "#e69f00",
    "second": "#009e73",
}
METHOD_COLOURS = ("#0072b2", "#e69f00", "#009e73", "#cc79a7", "#d55e00", "#56b4e9")
"""Okabe and Ito's palette, told apart with any kind of colour vision."""

_RC: dict[Any, Any] = {
    "font.family": "DejaVu Sans",
    "font.size": 10.5,
    "axes.titlesize": 11,
    "axes.titleweight": "normal",
    "axes.titlelocation": "left",
    "axes.titlepad": 10,
    "axes.labelsize": 10.5,
    "axes.edgecolor": INK,
    "axes.labelcolor": INK,
    "axes.titlecolor": INK,
    "axes.facecolor": "none",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.linewidth": 0.8,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": INK,
    "grid.alpha": 0.12,
    "grid.linewidth": 0.8,
    "text.color": INK,
    "xtick.color": INK,
    "ytick.color": INK,
    "legend.frameon": False,
    "legend.fontsize": 9.5,
    "lines.linewidth": 1.6,
    "figure.facecolor": "none",
    "savefig.facecolor": "none",
    "svg.fonttype": "none",
    "svg.hashsalt": "tipforce",
    "mathtext.default": "regular",
}


def make_figure(draw: Callable[[Figure], None], title: str, width_in: float = 6.6, height_in: float = 3.9) -> Figure:
    """A figure of the house's look under its ``title``, filled by ``draw``; no state of pyplot is touched."""
    with matplotlib.rc_context(_RC):
        figure = Figure(figsize=(width_in, height_in), layout="constrained")
        figure.suptitle(title, x=0.012, ha="left", fontsize=11.5, fontweight="bold")
        draw(figure)
    return figure


def to_svg(figure: Figure) -> str:
    """The figure as an SVG document whose bytes depend on its content only."""
    buffer = io.StringIO()
    with matplotlib.rc_context(_RC):
        figure.savefig(buffer, format="svg", dpi=170, metadata={"Date": None, "Creator": None})
    return re.sub(r"\A.*?(?=<svg)", "", buffer.getvalue(), flags=re.S)


def page_svg(svg: str, title: str) -> str:
    """``svg`` for the inside of a page: takes its width from the page and its ink from the page's text."""
    body = re.sub(r' (width|height)="[\d.]+pt"', "", svg, count=2)
    body = re.sub(r"<metadata>.*?</metadata>", "", body, flags=re.S).replace(INK, "currentColor")
    return body.replace("<svg ", f'<svg role="img" aria-label="{_escaped(title)}" ', 1)


def standalone_svg(svg: str) -> str:
    """``svg`` as a file of its own, on white."""
    head = '<?xml version="1.0" encoding="utf-8"?>\n'
    return head + svg.replace("<svg ", '<svg style="background:#fff" ', 1)


def grams_axis(axes: Axes, which: str = "y") -> None:
    """A second scale in gram-force opposite the one in newtons."""
    pair: Any = (newtons_to_grams, grams_to_newtons)
    if which == "y":
        side = axes.secondary_yaxis("right", functions=pair)
        side.set_ylabel("g")
    else:
        side = axes.secondary_xaxis("top", functions=pair)
        side.set_xlabel("g")
    side.spines[:].set_visible(True)
    side.spines[:].set_linewidth(0.8)


def legend_above(axes: Axes, columns: int = 4) -> None:
    """The legend above the plot, where it hides nothing."""
    axes.legend(loc="lower left", bbox_to_anchor=(0, 1.0), ncols=columns, borderaxespad=0.2, columnspacing=1.2)


def mark_line(axes: Axes, value: float, text: str, vertical: bool = False) -> None:
    """A dashed reference line with its name at the end."""
    if vertical:
        axes.axvline(value, color=COLOURS["line"], linestyle=(0, (4, 3)), linewidth=1.2, label=text)
    else:
        axes.axhline(value, color=COLOURS["line"], linestyle=(0, (4, 3)), linewidth=1.2, label=text)


def _escaped(text: str) -> str:
    return text.replace("&", "&amp;").replace('"', "&quot;").replace("<", "&lt;")
