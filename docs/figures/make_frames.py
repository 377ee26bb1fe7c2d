"""Draws frames.svg: the frames of reference and the signs of forces, on a shape that the mechanics computed.

Run from the project's root: python -m docs.figures.make_frames
"""

import math
from pathlib import Path
from typing import Any

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Arc, FancyArrowPatch, Polygon, Rectangle
from tests.oracles.planar_rod import solve_static

from tipforce.mechanics import PlanarRod

INK, GREY, BLUE, RED, GREEN, SENSOR = "#1c2733", "#76828d", "#1f6fb4", "#c8322b", "#2b7a4b", "#8a5a00"
SILICONE, SILICONE_EDGE, STEEL = "#f3d3c9", "#c99a8b", "#dde2e7"
RADIUS = 1.5
"""Radius of the drawn shaft, mm: a little thicker than a real one."""
TURN = math.radians(5.0)
"""Turn of the base in the image, as on a real bench."""
WALL_DEG, SENSOR_DEG = 52.0, 52.0
FORCE_N = np.array([-0.197, -0.153])
"""Force of a wall at 52 degrees with some friction on the tip, base frame."""


def polar(angle: float, length: float = 1.0) -> np.ndarray:
    """Vector of ``length`` at ``angle`` (rad) from x."""
    return length * np.array([math.cos(angle), math.sin(angle)])


def shape() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Returns unloaded and loaded centreline (200, 2) in mm, and the force on the tip (2,) in N; base frame."""
    rod = PlanarRod(0.040, 4.3e-4, 0.008, 12.0)
    free, bent = (solve_static(rod, force).centreline_m(200) * 1e3 for force in (np.zeros(2), FORCE_N))
    return free, bent, FORCE_N


def turned(points: np.ndarray, angle: float = TURN) -> np.ndarray:
    """Base frame -> as displayed."""
    c, s = math.cos(angle), math.sin(angle)
    return points @ np.array([[c, s], [-s, c]])


def arrow(axes: Axes, start: Any, end: Any, colour: str, width: float = 2.0, size: float = 15, **options: Any) -> None:
    """An arrow with its head exactly at ``end``."""
    patch = FancyArrowPatch(tuple(start), tuple(end), arrowstyle="-|>", mutation_scale=size, lw=width, color=colour)
    patch.set(zorder=8, joinstyle="miter", **options)
    patch.shrinkA = patch.shrinkB = 0
    axes.add_patch(patch)


def label(axes: Axes, at: Any, text: str, colour: str, **options: Any) -> None:
    """Text at a point."""
    axes.text(*at, text, color=colour, zorder=9, **{"fontsize": 10, "ha": "center", "va": "center", **options})


def tube(axes: Axes, line: np.ndarray, face: str, edge: str, dashed: bool = False, dome: bool = True) -> None:
    """The shaft along ``line``, with a round tip."""
    tangent = np.gradient(line, axis=0)
    normal = np.stack([-tangent[:, 1], tangent[:, 0]], axis=1) / np.linalg.norm(tangent, axis=1)[:, None]
    outline = [line + RADIUS * normal, (line - RADIUS * normal)[::-1]]
    if dome:
        heading = math.atan2(tangent[-1, 1], tangent[-1, 0])
        turn = heading + np.linspace(math.pi / 2, -math.pi / 2, 30)
        centre = line[-1] - RADIUS * polar(heading)
        keep = (line - centre) @ polar(heading) < 0
        cap = centre + RADIUS * np.stack([np.cos(turn), np.sin(turn)], axis=1)
        outline = [outline[0][keep], cap, (line - RADIUS * normal)[keep][::-1]]
    style = {"fc": face, "ec": edge, "lw": 1.1, "ls": (0, (4, 3)) if dashed else "-", "zorder": 4}
    axes.add_patch(Polygon(np.concatenate(outline), closed=True, **style))


def catheter(axes: Axes, line: np.ndarray) -> None:
    """Dark shaft, metal electrode."""
    tube(axes, line, "#46525e", INK)
    tube(axes, line[166:], "#b9c2ca", INK)


def tissue(axes: Axes, touch: np.ndarray, d: np.ndarray, back: float, front: float, indentation: float) -> None:
    """Draws the pad: its surface through ``touch``, indented there, from ``back`` to ``front`` along t."""
    t = np.array([-d[1], d[0]])
    across = np.linspace(back, front, 160)
    depth = -indentation * (1 - np.exp(-((across / 4.0) ** 2)))
    surface = touch + across[:, None] * t + depth[:, None] * d
    block = np.concatenate([surface, [touch + front * t + 7 * d, touch + back * t + 7 * d]])
    axes.add_patch(Polygon(block, closed=True, fc=SILICONE, ec=SILICONE_EDGE, lw=1.2, zorder=2))


def panel(axes: Axes, title: str, box: tuple[float, float, float, float]) -> None:
    """Limits, no axes, a title."""
    axes.set_xlim(box[0], box[1])
    axes.set_ylim(box[2], box[3])
    axes.set_aspect("equal")
    axes.axis("off")
    axes.set_title(title, loc="left", fontsize=11.5, color=INK, fontweight="bold")


def draw_image(axes: Axes, free: np.ndarray, bent: np.ndarray, force: np.ndarray) -> None:
    """Draws the image with its base frame."""
    panel(axes, "1   Image and base frame", (-24, 67, -33, 40))
    axes.add_patch(Rectangle((-18, -31), 84, 66, fc="#f5f7f9", ec=GREY, lw=1.3, zorder=0))
    corner = np.array([-18.0, 35.0])
    arrow(axes, corner, corner + [15, 0], INK)
    arrow(axes, corner, corner + [0, -15], INK)
    label(axes, corner + [16.5, 2.4], "$u$ to the right", INK, ha="left")
    label(axes, corner + [-3.2, -14], "$v$ down", INK, rotation=90)
    label(axes, corner + [1.6, -3.2], "pixel (0, 0)", GREY, fontsize=9, ha="left")

    d = polar(math.radians(WALL_DEG) + TURN)
    free, bent = turned(free), turned(bent)
    heading = math.atan2(*(bent[-1] - bent[-10])[::-1])
    touch = bent[-1] - RADIUS * polar(heading) + RADIUS * d
    tissue(axes, touch, d, -14, 9, 2.2)
    label(axes, touch + 3.2 * d - 8 * np.array([-d[1], d[0]]), "tissue", "#96604f", style="italic")
    tube(axes, free, "none", GREY, dashed=True)
    catheter(axes, bent)
    label(axes, free[150] + [-8.5, 6.5], "without load,\nbent by the knob", GREY, fontsize=10)

    along, left = polar(TURN), polar(TURN + math.pi / 2)
    arrow(axes, [0, 0], 20 * along, BLUE, 2.6, 18)
    arrow(axes, [0, 0], 20 * left, BLUE, 2.6, 18)
    axes.plot(0, 0, "o", ms=12, mfc="white", mec=BLUE, mew=2.0, zorder=9)
    axes.plot(0, 0, "o", ms=4, color=BLUE, zorder=10)
    label(axes, 20 * along + [1.6, 2.6], "$x$", BLUE, fontsize=15)
    label(axes, 22.6 * left, "$y$", BLUE, fontsize=15)
    label(axes, [-9.5, -3.6], "$z$ to the\ncamera", BLUE, fontsize=9.5)
    text = "base frame: origin at the base,\n$x$ along the base tangent toward the tip,\n$y$ 90° counter-clockwise"
    label(axes, [-14, -19], text, BLUE, ha="left", va="center", fontsize=10.5)

    unit = turned(force[None])[0] / np.linalg.norm(force)
    arrow(axes, touch, touch + 17 * unit, RED, 3.4, 24)
    label(axes, touch + 17 * unit + [9.5, -5.6], "force $F$ of the\ntissue on the tip", RED, fontsize=11.5)


def draw_components(axes: Axes, bent: np.ndarray, force: np.ndarray) -> None:
    """The force, taken apart along the tip."""
    panel(axes, "2   Axial and lateral", (-19, 15, -13, 13))
    heading = math.atan2(*(bent[-1] - bent[-10])[::-1])
    line = turned(bent[100:] - bent[-1], 0.0)
    d = polar(math.radians(WALL_DEG))
    touch = -RADIUS * polar(heading) + RADIUS * d
    tissue(axes, touch, d, -10, 8, 1.8)
    catheter_part = line
    tube(axes, catheter_part, "#46525e", INK)
    tube(axes, catheter_part[66:], "#b9c2ca", INK)
    unit = force / np.linalg.norm(force)
    axial = (unit @ polar(heading)) * polar(heading)
    scale = 14.0
    end = touch + scale * unit
    arrow(axes, touch, end, RED, 3.2, 22)
    arrow(axes, touch, touch + scale * axial, "#e07b39", 2.2, 16)
    arrow(axes, touch + scale * axial, end, "#7a4fa3", 2.2, 16)
    axes.plot(
        *np.array([-13 * polar(heading), 12 * polar(heading)]).T, color=GREY, lw=0.9, ls=(0, (6, 2, 1, 2)), zorder=7
    )
    label(axes, 12 * polar(heading) + [1, -1.8], "tip's axis", GREY, fontsize=9)
    label(axes, end + [1.6, -1.2], "$F$", RED, fontsize=14)
    label(
        axes, [-19, 7.4], "axial: along\nthe tip's axis,\ncompression\nis positive", "#b85a1c", fontsize=9.5, ha="left"
    )
    label(axes, [-15.5, -8.0], "lateral:\nthe rest", "#7a4fa3", fontsize=9.5)


def draw_angle(axes: Axes, free: np.ndarray) -> None:
    """Draws the wall and the unloaded tip."""
    panel(axes, "3   Contact angle", (-17, 17, -12, 14))
    heading = math.atan2(*(free[-1] - free[-10])[::-1])
    line = free[100:] - free[-1]
    d = polar(math.radians(WALL_DEG))
    centre = -RADIUS * polar(heading)
    touch = centre + RADIUS * d
    tissue(axes, touch, d, -11, 8, 0.0)
    tube(axes, line, "none", GREY, dashed=True)
    axes.plot(*np.array([centre, centre + 15 * polar(heading)]).T, color=GREY, lw=1.2, ls=(0, (6, 2, 1, 2)), zorder=7)
    arrow(axes, centre, centre + 13.5 * d, GREEN, 2.2, 16)
    first, second = math.degrees(heading), WALL_DEG
    axes.add_patch(Arc(tuple(centre), 17, 17, theta1=first, theta2=second, color=GREEN, lw=2.0, zorder=8))
    label(axes, centre + polar(math.radians(0.5 * (first + second)), 10.6), r"$\varphi$", GREEN, fontsize=14)
    label(axes, centre + 13.5 * d + [-5.5, 1.6], "into the wall", GREEN, fontsize=9.5)
    label(axes, [12.6, 8.8], "axis of the\nunloaded tip", GREY, fontsize=9)
    label(axes, [-1, -10.6], r"$\varphi$ = 0: the tip points straight at the wall", GREEN, fontsize=9.5)


def draw_sensor(axes: Axes, force: np.ndarray) -> None:
    """Draws the reading of the sensor under the tissue."""
    panel(axes, "4   A sensor under the tissue", (-22, 44, -19.5, 22))
    angle = math.radians(SENSOR_DEG)
    d, t = polar(angle), polar(angle + math.pi / 2)
    touch = np.array([-6.0, -7.0])
    tissue(axes, touch, d, -13, 11, 1.8)
    puck = np.array([touch + a * t + b * d for a, b in ((9, 7), (9, 15), (-11, 15), (-11, 7))])
    axes.add_patch(Polygon(puck, closed=True, fc=STEEL, ec=GREY, lw=1.2, zorder=2))
    label(axes, touch + 11 * d - 7.6 * t, "sensor", GREY, style="italic", fontsize=9.5)
    heading = 0.1
    line = touch - RADIUS * d + np.linspace(-15, RADIUS, 100)[:, None] * polar(heading)
    tube(axes, line, "#46525e", INK)
    tube(axes, line[45:], "#b9c2ca", INK)
    unit = force / np.linalg.norm(force)
    arrow(axes, touch, touch + 11.5 * unit, RED, 3.0, 20)
    label(axes, touch + 11.5 * unit + [2.2, -2.2], "$F$", RED, fontsize=14)
    arrow(axes, touch, touch - 11.5 * unit, SENSOR, 3.0, 20)
    label(axes, touch - 7.5 * unit + [-2.6, 2.4], "$-F$", SENSOR, fontsize=14)

    origin = touch + 11 * d + 4.5 * t
    arrow(axes, origin, origin + 13 * d, SENSOR, 2.2, 16)
    arrow(axes, origin, origin + 13 * t, SENSOR, 2.2, 16)
    axes.plot(*origin, "o", ms=10, mfc="white", mec=SENSOR, mew=1.8, zorder=9)
    axes.plot(*origin, "o", ms=3.2, color=SENSOR, zorder=10)
    label(axes, origin + 13 * d + [2.6, 0.4], "$x_s$", SENSOR, fontsize=13)
    label(axes, origin + 13 * t + [-1.5, 2.2], "$y_s$", SENSOR, fontsize=13)
    axes.plot([origin[0], origin[0] + 13], [origin[1]] * 2, color=BLUE, lw=1.3, ls=(0, (4, 2)), zorder=7)
    label(axes, origin + [15.5, 0], "$x$", BLUE, fontsize=13)
    axes.add_patch(Arc(tuple(origin), 15, 15, theta1=0, theta2=SENSOR_DEG, color=SENSOR, lw=1.8, zorder=8))
    label(axes, origin + polar(angle / 2, 10.8), r"$\alpha$", SENSOR, fontsize=13)
    text = (
        "It reads tip on tissue:\nthe opposite of $F$, in its\nown frame, turned by $\\alpha$\n"
        "counter-clockwise from $x$;\n$z_s$ to the camera.\n\n$F = -R(\\alpha)\\,$(reading $-$ tare)"
    )
    label(axes, [17, -9.5], text, SENSOR, ha="left", fontsize=10.5)


def main() -> None:
    """Write frames.svg beside this script."""
    plt.rcParams.update({"font.family": "DejaVu Sans", "svg.hashsalt": "tipforce", "svg.fonttype": "path"})
    free, bent, force = shape()
    figure = plt.figure(figsize=(14.2, 6.9), facecolor="white")
    grid = figure.add_gridspec(
        2, 3, width_ratios=(1.72, 0.92, 0.92), wspace=0.04, hspace=0.12, left=0.01, right=0.99, top=0.94, bottom=0.02
    )
    draw_image(figure.add_subplot(grid[:, 0]), free, bent, force)
    draw_components(figure.add_subplot(grid[0, 1]), bent, force)
    draw_angle(figure.add_subplot(grid[0, 2]), free)
    draw_sensor(figure.add_subplot(grid[1, 1:]), force)
    figure.savefig(Path(__file__).with_name("frames.svg"), metadata={"Date": None})


if __name__ == "__main__":
    main()
