"""Thesis figures 17a-d and 18, for any frame that thesis algorithm 1 was run on."""

import textwrap
from typing import TYPE_CHECKING, Any

import numpy as np

from ..types import BasePose
from ._classic import ClassicSteps

if TYPE_CHECKING:
    from matplotlib.figure import Figure

CURVE = "#c2185b"
X_AXIS, Y_AXIS = "#d32f2f", "#2e7d32"


def figure_17(steps: ClassicSteps) -> "Figure":
    """Returns (a) grey image, (b) binary, (c) single-pixel line with base points and L, (d) fitted curve.

    Panels that the algorithm did not reach say why.
    """
    figure, ((grey, binary), (pixels, fitted)) = _subplots(2, 2, (10.0, 8.0))
    grey.imshow(steps.grey, cmap="gray", vmin=0, vmax=255)
    grey.set_title("(a) grey image")
    # As in the thesis: catheter pixels are black.
    binary.imshow(~steps.binary, cmap="gray", vmin=0, vmax=1)
    binary.set_title(f"(b) binary, threshold c = {steps.threshold}")

    height, width = steps.grey.shape
    pixels.set(xlim=(-0.5, width - 0.5), ylim=(height - 0.5, -0.5), aspect="equal")
    pixels.set_title("(c) single-pixel line, base points, line L")
    if steps.base_px is not None:
        pixels.plot(*steps.base_px.T, ".", color="#90a4ae", markersize=2, label="base points BS")
    if steps.single_px is not None:
        pixels.plot(*steps.single_px.T, ".", color="black", markersize=2, label="single-pixel line")
    if steps.line_px is not None:
        pixels.axline(*steps.line_px, color=X_AXIS, linewidth=0.8, label="L")
    if steps.base is not None:
        pixels.plot(*steps.base.origin_px, "o", color=X_AXIS, markersize=5, label="O")
    if pixels.get_legend_handles_labels()[0]:
        pixels.legend(loc="best", fontsize=8)

    fitted.set_title("(d) base frame, fourth-degree polynomial")
    fitted.set(xlabel="x' (px)", ylabel="y' (px)")
    if steps.single_local is not None and steps.coefficients is not None:
        x = np.linspace(steps.single_local[:, 0].min(), steps.single_local[:, 0].max(), 200)
        fitted.plot(*steps.single_local.T, ".", color="black", markersize=3, label="catheter pixels")
        fitted.plot(x, np.polyval(steps.coefficients, x), color=CURVE, label="C(x')")
        terms = "\n".join(f"A{k + 1} = {value:.4g}" for k, value in enumerate(steps.coefficients))
        fitted.text(
            0.98, 0.04, terms, transform=fitted.transAxes, fontsize=8, family="monospace", ha="right", va="bottom"
        )
        fitted.set_aspect("equal", adjustable="datalim")
        fitted.grid(alpha=0.3)
        fitted.legend(loc="upper left", fontsize=8)
    else:
        fitted.set(xticks=[], yticks=[])
        _say_why(fitted, steps)
    return figure


def figure_18(steps: ClassicSteps) -> "Figure":
    """Returns the image frame beside the local frame of the catheter: thesis eq. (1), with R and T as numbers."""
    figure, ((panel,),) = _subplots(1, 1, (8.0, 6.4))
    panel.imshow(steps.grey, cmap="gray", vmin=0, vmax=255, alpha=0.6)
    panel.set_title("from the image frame to the catheter's local frame")
    height, width = steps.grey.shape
    length = 0.2 * min(height, width)
    _axes(panel, BasePose(np.array([0.0, 0.0]), 0.0), length, ("#1565c0", "#1565c0"), ("u", "v"), down=True)
    if steps.base is None:
        _say_why(panel, steps)
        return figure
    if steps.line_px is not None:
        panel.axline(*steps.line_px, color=X_AXIS, linewidth=0.8, linestyle="--", label="L, the base tangent")
    if steps.single_px is not None:
        panel.plot(*steps.single_px.T, color="#ffb300", linewidth=1.5, label="single-pixel line")
    _axes(panel, steps.base, length, (X_AXIS, Y_AXIS), ("x'", "y'"))
    panel.plot(*steps.base.origin_px, "o", color="black", markersize=5)
    rotation, shift = steps.base.axes_px, -steps.base.axes_px @ steps.base.origin_px
    rows = [f"{r[0]:+.3f} {r[1]:+.3f} | {t:+8.2f}" for r, t in zip(rotation, shift, strict=True)]
    box = {"boxstyle": "round", "facecolor": "white", "alpha": 0.85}
    text = (
        "[R | T]\n" + "\n".join(rows) + "\n" + f"O = ({steps.base.origin_px[0]:.1f}, {steps.base.origin_px[1]:.1f}) px"
    )
    panel.text(
        0.98, 0.97, text, transform=panel.transAxes, family="monospace", fontsize=9, ha="right", va="top", bbox=box
    )
    panel.legend(loc="lower right", fontsize=8)
    return figure


def _subplots(rows: int, columns: int, size: tuple[float, float]) -> tuple["Figure", Any]:
    # Figure, not pyplot: no window system, nothing global.
    from matplotlib.figure import Figure

    figure = Figure(figsize=size, layout="constrained", dpi=110)
    return figure, figure.subplots(rows, columns, squeeze=False)


def _axes(
    axes: Any, frame: BasePose, length: float, colours: tuple[str, str], names: tuple[str, str], down: bool = False
) -> None:
    for k, (colour, name) in enumerate(zip(colours, names, strict=True)):
        sign = -1.0 if down and k == 1 else 1.0
        head = frame.origin_px + sign * length * frame.axes_px[k]
        style = {"arrowstyle": "-|>", "color": colour, "linewidth": 2.0}
        axes.annotate("", xy=head, xytext=frame.origin_px, arrowprops=style, annotation_clip=False)
        beyond = frame.origin_px + sign * 1.15 * length * frame.axes_px[k]
        axes.text(*beyond, name, color=colour, fontsize=12, ha="center", va="center")


def _say_why(axes: Any, steps: ClassicSteps) -> None:
    text = textwrap.fill(f"{steps.status.replace('_', ' ')}: {steps.detail}", 44)
    box = {"boxstyle": "round", "facecolor": "#ffebee", "edgecolor": X_AXIS}
    axes.text(0.5, 0.5, text, transform=axes.transAxes, ha="center", va="center", fontsize=9, bbox=box)
