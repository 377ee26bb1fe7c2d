"""Images without a catheter, by kind: an empty bench, cables, a ruler, a hand, a tube without its catheter, and others.

Each kind draws its objects at ``sway``, an offset in px from their rest: with the same random numbers and several
offsets the images are those of one session.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt
from bench.locator.curves import curve, lead
from bench.locator.ground import clouds, colour, ground, photographs, pixels, uneven_light
from bench.locator.photometry import photograph
from bench.locator.scene import (
    Face,
    absorbing,
    placed,
    plain_surface,
    random_lights,
    shadow,
    xray_ground,
    xray_image,
)
from bench.locator.tubes import Drawer, Lights, SceneCanvas, Surface

from tipforce.training.locator import FRONT, INSTRUMENT, LABEL_POINTS, OUTSIDE, SHEATH, Scene

Float = npt.NDArray[np.float64]
Float32 = npt.NDArray[np.float32]
Tint = Float32 | tuple[float, ...]

MIN_TUBE_SHARE = 0.045
"""A tube is at least this wide, in shares of the image's side: its open mouth can be seen."""
DARK = (0.015, 0.015, 0.015)
FONT = cv2.FONT_HERSHEY_SIMPLEX


@dataclass(frozen=True, slots=True, eq=False)
class _Sheet:
    """A ground, with the tools that draw objects on it.

    Attributes:
        rng: source of randomness.
        drawer: draws tubes.
        canvas: the image so far.
        lights: the lamps.
        size: side of the image, px.
        diameter: diameter of the catheters of such benches, px.
        sway: (2,) offset of the objects that move, px.
    """

    rng: np.random.Generator
    drawer: Drawer
    canvas: SceneCanvas
    lights: Lights
    size: int
    diameter: float
    sway: Float

    def tube(self, axis: Float, radius: Float | float, surface: Surface, kind: int = INSTRUMENT) -> None:
        """Draws a tube with the axis (n, 2) px."""
        self.drawer.tube(self.canvas, axis + self.sway, radius, surface, self.lights, kind)

    def shadow(self, parts: list[tuple[Float, float]]) -> None:
        """Draws the shadow of tubes, (axis, width) each, in two of three images."""
        if self.rng.random() < 0.67:
            fall = self.rng.normal(0.0, 0.03 * self.size, 2)
            shadow(self.rng, self.canvas, [(axis + self.sway, width) for axis, width in parts], fall)

    def polygon(self, corners: Float, tint: Tint, kind: int = FRONT) -> None:
        """Fills a polygon (n, 2) px with a colour."""
        points = np.round((corners + self.sway) * 16.0).astype(np.int32)
        cv2.fillPoly(self.canvas.light, [points], tuple(float(x) for x in tint), cv2.LINE_AA, 4)
        mask = np.zeros(self.canvas.kind.shape, np.uint8)
        cv2.fillPoly(mask, [points], 1, cv2.LINE_8, 4)
        self.canvas.kind[mask > 0] = kind

    def line(self, start: Float, end: Float, tint: Tint, thick: float) -> None:
        """Draws a straight line."""
        ends = [tuple(np.round((each + self.sway) * 16.0).astype(int).tolist()) for each in (start, end)]
        width = max(1, round(thick))
        cv2.line(self.canvas.light, ends[0], ends[1], tuple(float(x) for x in tint), width, cv2.LINE_AA, 4)

    def text(self, written: str, at: Float, height: float, tint: Tint) -> None:
        """Writes ``written`` with its lower left corner ``at`` (2,), px."""
        corner = tuple(np.round(at + self.sway).astype(int).tolist())
        ink = tuple(float(x) for x in tint)
        cv2.putText(self.canvas.light, written, corner, FONT, height / 22.0, ink, 1, cv2.LINE_AA)

    def disc(self, middle: Float, axes: tuple[float, float], turn_deg: float, tint: Tint) -> None:
        """Fills an ellipse with the half axes ``axes`` px."""
        at = tuple(np.round((middle + self.sway) * 16.0).astype(int).tolist())
        half = tuple(max(16, round(16.0 * axis)) for axis in axes)
        ink = tuple(float(x) for x in tint)
        cv2.ellipse(self.canvas.light, at, half, turn_deg, 0.0, 360.0, ink, -1, cv2.LINE_AA, 4)

    def inside(self, margin: float = 0.2) -> Float:
        """A random point (2,) at least ``margin`` * size from each border."""
        return self.rng.uniform(margin, 1.0 - margin, 2) * self.size

    def border(self) -> tuple[Float, float, int]:
        """A random point on a border, the direction into the image in rad, and the index of the border in SIDES."""
        side, along = int(self.rng.integers(4)), self.rng.uniform(0.2, 0.8) * self.size
        far = self.size - 1.0
        start = np.array(((0.0, along), (far, along), (along, 0.0), (along, far))[side])
        inward = (0.0, math.pi, 0.5 * math.pi, -0.5 * math.pi)[side]
        return start, inward + self.rng.normal(0.0, 0.25), side


def _direction(angle: float) -> Float:
    return np.array([math.cos(angle), math.sin(angle)])


def _across(angle: float) -> Float:
    return np.array([-math.sin(angle), math.cos(angle)])


def _bar(start: Float, angle: float, length: float, width: float) -> Float:
    """The corners (4, 2) of a bar whose axis leaves ``start`` toward ``angle``."""
    end, half = start + length * _direction(angle), 0.5 * width * _across(angle)
    return np.array([start - half, end - half, end + half, start + half])


def _empty_bench(sheet: _Sheet) -> None:
    """The ground alone."""
    del sheet


def _photograph(sheet: _Sheet) -> None:
    """A photograph of other things, sharp."""
    stored, rng = photographs(), sheet.rng
    photo = stored[rng.integers(len(stored))]
    scale = rng.uniform(1.0, 1.6) * sheet.size / min(photo.shape[:2])
    big = cv2.resize(photo, None, fx=scale, fy=scale, interpolation=cv2.INTER_LINEAR)
    top, left = (int(rng.integers(0, n - sheet.size + 1)) for n in big.shape[:2])
    crop = big[top : top + sheet.size, left : left + sheet.size, ::-1].astype(np.float32) / 255.0
    moved = np.array([[1.0, 0.0, sheet.sway[0]], [0.0, 1.0, sheet.sway[1]]])
    sheet.canvas.light[:] = cv2.warpAffine(crop, moved, (sheet.size, sheet.size), borderMode=cv2.BORDER_REFLECT) ** 2.2


def _cable(sheet: _Sheet) -> None:
    """A cable from border to border."""
    start, angle, _ = sheet.border()
    axis = lead(sheet.rng, start - 20.0 * _direction(angle), angle, 2.0 * sheet.size, sheet.rng.uniform(0.2, 1.2))
    width = sheet.diameter * sheet.rng.uniform(0.5, 1.8)
    sheet.shadow([(axis, 2.0 * width)])
    sheet.tube(axis, 0.5 * width, plain_surface(sheet.rng, blunt=False))


def _coil(sheet: _Sheet) -> None:
    """A cable that is coiled several times and leaves the image."""
    rng, turns = sheet.rng, int(sheet.rng.integers(2, 6))
    at = np.linspace(0.0, 2.0 * math.pi * turns, 60 * turns) + rng.uniform(0.0, 2.0 * math.pi)
    radius = sheet.size * rng.uniform(0.15, 0.3) * (1.0 + 0.06 * np.sin(at * rng.uniform(0.3, 0.9)))
    middle = sheet.inside(0.35)
    wobble = 0.03 * sheet.size * np.column_stack([np.sin(at * 0.37), np.cos(at * 0.23)])
    ring = middle + wobble + radius[:, None] * np.column_stack([np.cos(at), rng.uniform(0.7, 1.0) * np.sin(at)])
    ends = []
    for first, second in ((ring[0], ring[1]), (ring[-1], ring[-2])):
        way = first - second
        ends.append(lead(rng, first, math.atan2(way[1], way[0]), 1.6 * sheet.size, 0.3))
    axis = np.vstack([ends[0][::-1], ring[1:-1], ends[1]])
    width = sheet.diameter * rng.uniform(0.4, 1.2)
    sheet.shadow([(axis, 2.0 * width)])
    sheet.tube(axis, 0.5 * width, plain_surface(rng, blunt=False))


def _wires(sheet: _Sheet) -> None:
    """Thin wires of several colours that run together through the image, then apart."""
    start, angle, _ = sheet.border()
    for _ in range(int(sheet.rng.integers(3, 9))):
        first = start - 10.0 * _direction(angle) + sheet.rng.normal(0.0, 5.0) * _across(angle)
        axis = lead(sheet.rng, first, angle + sheet.rng.normal(0.0, 0.08), 2.0 * sheet.size, 0.7)
        sheet.tube(axis, max(1.0, 0.15 * sheet.diameter), plain_surface(sheet.rng, blunt=False))


def _ruler(sheet: _Sheet) -> None:
    """A ruler with its divisions and numbers."""
    rng = sheet.rng
    angle, width = rng.uniform(0.0, 2.0 * math.pi), sheet.size * rng.uniform(0.06, 0.16)
    length = sheet.size * rng.uniform(0.6, 1.6)
    start = sheet.inside(0.3) - 0.5 * length * _direction(angle)
    body = colour(rng, 0.4)
    ink = np.full(3, 0.02 if body.mean() > 0.2 else 0.85, np.float32)
    corners = _bar(start, angle, length, width)
    sheet.shadow([(corners[:2] + 0.5 * (corners[3] - corners[0]), width)])
    sheet.polygon(corners, body)
    step = sheet.size * rng.uniform(0.012, 0.025)
    for k in range(1, int(length / step)):
        at = corners[0] + k * step * _direction(angle)
        long = width * (0.45 if k % 10 == 0 else 0.33 if k % 5 == 0 else 0.22)
        sheet.line(at, at + long * _across(angle), ink, 1.0)
        if k % 10 == 0:
            sheet.text(str(k // 10), at + 0.75 * width * _across(angle) + (-4.0, 4.0), 0.2 * width + 5.0, ink)


def _hand(sheet: _Sheet) -> None:
    """A hand with its fingers spread or together, in skin or in a glove, that comes from a border."""
    rng = sheet.rng
    start, angle, _ = sheet.border()
    red = rng.uniform(0.25, 0.8)
    skin = np.array([red, red * rng.uniform(0.6, 0.8), red * rng.uniform(0.4, 0.65)], np.float32)
    if rng.random() < 0.3:
        skin = colour(rng)  # a glove
    surface = plain_surface(rng, skin, blunt=False)
    surface.colour[:] = skin
    wide = sheet.size * rng.uniform(0.2, 0.32)
    palm = start + sheet.size * rng.uniform(0.05, 0.25) * _direction(angle)
    spread = rng.uniform(0.05, 0.3)
    fingers = []
    for k in range(4):
        side = (k - 1.5) / 1.5
        root = palm + 0.36 * wide * side * _across(angle) + 0.3 * wide * _direction(angle)
        long = wide * (1.0 - 0.12 * abs(side + 0.2)) * rng.uniform(0.85, 1.1)
        fingers.append((lead(rng, root, angle + spread * side, long, 0.3), 0.115 * wide))
    hand = rng.choice([-1.0, 1.0])
    thumb = palm + 0.42 * wide * hand * _across(angle) - 0.1 * wide * _direction(angle)
    fingers.append((lead(rng, thumb, angle + 0.8 * hand, 0.75 * wide, 0.3), 0.13 * wide))
    arm = np.linspace(start - 0.5 * sheet.size * _direction(angle), palm - 0.3 * wide * _direction(angle), 8)
    sheet.shadow([(axis, 2.0 * radius) for axis, radius in fingers] + [(arm, 0.8 * wide)])
    sheet.tube(arm, 0.36 * wide, surface, FRONT)
    back = np.linspace(palm - 0.3 * wide * _direction(angle), palm + 0.15 * wide * _direction(angle), 4)
    sheet.tube(back, 0.48 * wide, surface, FRONT)
    for axis, radius in fingers:
        sheet.tube(axis, radius * np.linspace(1.1, 0.9, len(axis)), surface, FRONT)
        nail = axis[-2] + 0.3 * radius * (axis[-1] - axis[-2]) / np.linalg.norm(axis[-1] - axis[-2])
        way = axis[-1] - axis[-3]
        turn = math.degrees(math.atan2(way[1], way[0]))
        sheet.disc(nail, (0.6 * radius, 0.45 * radius), turn, np.minimum(1.15 * skin + 0.03, 1.0))


def _tube(sheet: _Sheet, *, with_bands: bool = False) -> tuple[Float, float, int]:
    """Draws a tube from a border that ends in the image; returns its mouth, its direction there and its border."""
    rng = sheet.rng
    start, angle, side = sheet.border()
    wide = max(sheet.diameter * rng.uniform(1.3, 3.2), MIN_TUBE_SHARE * sheet.size)
    axis = lead(rng, start - 20.0 * _direction(angle), angle, 20.0 + sheet.size * rng.uniform(0.12, 0.5), 0.25)
    way = axis[-1] - axis[-2]
    heading = math.atan2(way[1], way[0])
    surface = plain_surface(rng)
    sheet.shadow([(axis, 1.6 * wide)])
    sheet.tube(axis, 0.5 * wide, surface, SHEATH)
    if with_bands:
        at = 0.0
        for _ in range(int(rng.integers(1, 4))):
            long, thick = wide * rng.uniform(0.4, 1.6), wide * rng.uniform(1.0, 1.8)
            end = axis[-1] - at * _direction(heading)
            sheet.tube(np.linspace(end - long * _direction(heading), end, 6), 0.5 * thick, plain_surface(rng), SHEATH)
            at += long * rng.uniform(0.8, 1.8)
    squint, turn = rng.uniform(0.15, 0.4), math.degrees(heading)
    sheet.disc(axis[-1], (0.5 * squint * wide, 0.5 * wide), turn, np.minimum(1.2 * surface.colour[-1], 1.0))
    sheet.disc(axis[-1], (0.36 * squint * wide, 0.36 * wide), turn, DARK)
    return axis[-1], heading, side


def _empty_tube(sheet: _Sheet) -> None:
    """A tube that ends in the image with an open mouth: the catheter is not in it."""
    _tube(sheet)


def _coupling(sheet: _Sheet) -> None:
    """A tube with bands or a coupling at its end, without a catheter."""
    _tube(sheet, with_bands=True)


def _tissue(sheet: _Sheet, tip: Float | None = None, heading: float | None = None) -> None:
    """Tissue alone, as the tip would meet it."""
    tip = sheet.inside(0.3) if tip is None else tip
    heading = sheet.rng.uniform(0.0, 2.0 * math.pi) if heading is None else heading
    line = (tip + sheet.sway)[None] + np.linspace(-30.0, 0.0, 8)[:, None] * _direction(heading)
    Face(sheet.rng, line, sheet.diameter, sheet.size).behind(sheet.canvas)


def _tube_and_tissue(sheet: _Sheet) -> None:
    """A whole bench before the catheter is in: a tube, and the tissue in front of it."""
    mouth, heading, _ = _tube(sheet, with_bands=sheet.rng.random() < 0.5)
    _tissue(sheet, mouth + sheet.size * sheet.rng.uniform(0.25, 0.45) * _direction(heading), heading)


def _clamp(sheet: _Sheet) -> None:
    """A post with a clamp and screws."""
    rng = sheet.rng
    start, angle, _ = sheet.border()
    metal = np.full(3, rng.uniform(0.2, 0.8), np.float32)
    wide = sheet.size * rng.uniform(0.04, 0.1)
    length = sheet.size * rng.uniform(0.4, 0.7)
    post = np.linspace(start - 30.0 * _direction(angle), start + length * _direction(angle), 8)
    sheet.shadow([(post, wide)])
    sheet.tube(post, 0.5 * wide, plain_surface(rng, metal), FRONT)
    at = start + (length - wide * rng.uniform(0.5, 2.0)) * _direction(angle)
    block = wide * rng.uniform(2.0, 3.5)
    side = at - 0.5 * block * _direction(angle)
    sheet.polygon(_bar(side, angle, block, wide * rng.uniform(1.8, 2.6)), colour(rng))
    for sign in (-1.0, 1.0):  # jaws, and the screw between them
        jaw = at + 0.25 * block * sign * _direction(angle)
        turned = angle + 0.5 * math.pi
        sheet.polygon(_bar(jaw, turned, 1.4 * block, 0.28 * block), metal * np.float32(rng.uniform(0.6, 1.2)))
    screw = at + rng.uniform(-0.3, 0.3) * block * _direction(angle)
    sheet.disc(screw, (0.2 * block, 0.2 * block), 0.0, metal * 0.7)
    cross = 0.14 * block * _direction(angle + rng.uniform(0.0, math.pi))
    sheet.line(screw - cross, screw + cross, DARK, 2.0)


def _pen(sheet: _Sheet) -> None:
    """A pen or a screwdriver on the bench: straight, thick, with a grip and a point."""
    rng = sheet.rng
    angle, wide = rng.uniform(0.0, 2.0 * math.pi), sheet.size * rng.uniform(0.04, 0.09)
    length = wide * rng.uniform(6.0, 9.0)
    middle = sheet.inside(0.35)
    start = middle - 0.5 * length * _direction(angle)
    body, grip = colour(rng), colour(rng)
    sheet.shadow([(np.linspace(start, start + length * _direction(angle), 4), wide)])
    if rng.random() < 0.5:  # a pen: cap, body, cone, point
        parts = ((0.0, 0.25, 1.1, 1.1, grip), (0.25, 0.85, 1.0, 1.0, body), (0.85, 0.97, 0.95, 0.3, grip),
                 (0.97, 1.0, 0.2, 0.1, np.full(3, 0.6, np.float32)))  # fmt: skip
    else:  # a screwdriver: grip, collar, blade
        steel = np.full(3, rng.uniform(0.35, 0.8), np.float32)
        parts = ((0.0, 0.45, 1.5, 1.7, body), (0.45, 0.5, 1.1, 0.9, grip), (0.5, 0.93, 0.45, 0.45, steel),
                 (0.93, 1.0, 0.45, 0.7, steel))  # fmt: skip
    for first, last, thick, thin, tint in parts:
        axis = start + np.linspace(first, last, 6)[:, None] * length * _direction(angle)
        surface = plain_surface(rng, tint)
        surface.colour[:] = tint
        sheet.tube(axis, 0.5 * wide * np.linspace(thick, thin, 6), surface, FRONT)


def _forceps(sheet: _Sheet) -> None:
    """Forceps or scissors: two legs that meet."""
    rng = sheet.rng
    start, angle, _ = sheet.border()
    steel = np.full(3, rng.uniform(0.3, 0.8), np.float32)
    joint = start + sheet.size * rng.uniform(0.2, 0.35) * _direction(angle)
    wide = sheet.size * rng.uniform(0.02, 0.04)
    opening = rng.uniform(0.1, 0.3)
    legs = []
    for sign in (-1.0, 1.0):
        back = joint - sheet.size * 0.6 * _direction(angle + 0.7 * sign * opening)
        front = joint + sheet.size * rng.uniform(0.2, 0.3) * _direction(angle + 0.6 * sign * opening)
        legs += [(np.linspace(back, joint, 8), 1.0, 1.0), (np.linspace(joint, front, 8), 1.0, 0.35)]
    sheet.shadow([(axis, wide) for axis, _, _ in legs])
    for axis, first, last in legs:
        surface = plain_surface(rng, steel)
        surface.colour[:] = steel
        sheet.tube(axis, wide * np.linspace(first, last, len(axis)), surface, FRONT)
    sheet.disc(joint, (1.1 * wide, 1.1 * wide), 0.0, steel * 0.8)
    sheet.disc(joint, (0.5 * wide, 0.5 * wide), 0.0, DARK)


def _corner(sheet: _Sheet) -> None:
    """The inside of a box: three planes that meet in bright or dark seams."""
    rng, size = sheet.rng, sheet.size
    middle = sheet.inside(0.3)
    tint, first = colour(rng), rng.uniform(0.0, 2.0 * math.pi)
    angles = first + np.array([0.0, rng.uniform(1.7, 2.4), rng.uniform(3.6, 4.6)])
    for k in range(3):
        one, other = angles[k], angles[(k + 1) % 3] + (2.0 * math.pi if k == 2 else 0.0)
        fan = [middle + 2.0 * size * _direction(a) for a in np.linspace(one, other, 8)]
        sheet.polygon(np.array([middle, *fan]), tint * np.float32(rng.uniform(0.45, 1.1)), 0)
    seam, thick = tint * np.float32(rng.choice([0.3, 1.6])), rng.uniform(1.0, 4.0)
    for angle in angles:
        sheet.line(middle, middle + 2.0 * size * _direction(angle), np.minimum(seam, 1.0), thick)


def _printed(sheet: _Sheet) -> None:
    """Graph paper or a calibration board with writing on it."""
    rng, size = sheet.rng, sheet.size
    paper = np.full(3, rng.uniform(0.6, 0.95), np.float32)
    corners = _bar(sheet.inside(0.05) * 0.2, rng.normal(0.0, 0.08), 1.5 * size, 3.0 * size)
    sheet.polygon(corners, paper, 0)
    ink = colour(rng) * np.float32(0.5)
    step = size * rng.uniform(0.02, 0.09)
    if rng.random() < 0.6:
        for k in range(int(size / step) + 1):
            thick = 2.0 if k % 5 == 0 else 1.0
            sheet.line(np.array([k * step, -20.0]), np.array([k * step, size + 20.0]), ink, thick)
            sheet.line(np.array([-20.0, k * step]), np.array([size + 20.0, k * step]), ink, thick)
    else:
        for row in range(int(size / step) + 1):
            for column in range(int(size / step) + 1):
                if rng.random() < 0.02:
                    continue
                sheet.disc(step * np.array([column + 0.5, row + 0.5]), (0.25 * step, 0.25 * step), 0.0, ink)
    for _ in range(int(rng.integers(1, 5))):
        words = ("bench 2", "F = k x", "12.5 mm", "do not move", "left", "A4 100 g")
        sheet.text(str(rng.choice(words)), sheet.inside(0.1), size * rng.uniform(0.03, 0.07), DARK)


def _water(sheet: _Sheet) -> None:
    """Water with waves, bubbles and reflections of the lamps."""
    rng, size = sheet.rng, sheet.size
    waves = clouds(rng, size, size, int(rng.integers(4, 16)), 4)
    sheet.canvas.light *= np.exp(rng.uniform(0.1, 0.4) * waves)[..., None]
    v, u = pixels(size, size)
    for _ in range(int(rng.integers(1, 5))):  # reflections of lamps, drawn out by the waves
        middle, reach = sheet.inside(0.1) + sheet.sway, size * rng.uniform(0.03, 0.2)
        turn = rng.uniform(0.0, math.pi)
        along = (u - middle[0]) * math.cos(turn) + (v - middle[1]) * math.sin(turn)
        beside = -(u - middle[0]) * math.sin(turn) + (v - middle[1]) * math.cos(turn) + 3.0 * waves
        gleam = np.exp(-((along / reach) ** 2) - (beside / (reach * rng.uniform(0.05, 0.4))) ** 2)
        sheet.canvas.light += (rng.uniform(0.3, 1.0) * gleam)[..., None].astype(np.float32)
    for _ in range(int(rng.integers(4, 40))):
        middle, radius = sheet.inside(0.0), size * rng.uniform(0.005, 0.025)
        rim = colour(rng, 0.2)
        at = tuple(np.round(middle + sheet.sway).astype(int).tolist())
        cv2.circle(sheet.canvas.light, at, max(2, round(radius)), tuple(float(x) for x in rim), 1, cv2.LINE_AA)
        sheet.disc(middle - 0.3 * radius, (0.25 * radius, 0.25 * radius), 0.0, (0.9, 0.9, 0.9))


def _chest(sheet: _Sheet) -> None:
    """An X-ray image of ribs, spine and vessels."""
    rng, size = sheet.rng, sheet.size
    for k in range(int(rng.integers(3, 7))):
        at = size * np.array([-0.1, -0.1 + 0.22 * k + rng.normal(0.0, 0.02)])
        axis = lead(rng, at, rng.normal(0.1, 0.1), 1.3 * size, 0.5)
        sheet.tube(axis, size * rng.uniform(0.02, 0.035), absorbing(rng, rng.uniform(0.1, 0.35)), 0)
    middle = size * rng.uniform(0.2, 0.8)
    for k in range(int(rng.integers(0, 8))):  # vertebrae
        at = np.array([middle, size * 0.16 * k])
        axis = np.linspace(at, at + np.array([0.0, 0.12 * size]), 4)
        sheet.tube(axis, 0.09 * size, absorbing(rng, rng.uniform(0.15, 0.4)), 0)


def _leads(sheet: _Sheet) -> None:
    """An X-ray image with leads of an electrocardiogram, sternal wires and clips over the ribs."""
    rng, size = sheet.rng, sheet.size
    _chest(sheet)
    for _ in range(int(rng.integers(1, 4))):
        start, angle, _ = sheet.border()
        axis = lead(rng, start - 10.0 * _direction(angle), angle, size * rng.uniform(1.6, 2.2), 0.6)
        sheet.tube(axis, rng.uniform(0.8, 2.0), absorbing(rng, rng.uniform(0.2, 0.8)))
    for _ in range(int(rng.integers(0, 4))):  # wires around the sternum
        ring = curve(rng, size * 0.12, LABEL_POINTS) + sheet.inside(0.2)
        sheet.tube(np.vstack([ring, ring[::-1] + np.array([0.0, 0.02 * size])]), 1.0, absorbing(rng, 1.2))
    for _ in range(int(rng.integers(0, 8))):  # clips
        at, way = sheet.inside(0.1), _direction(rng.uniform(0.0, 2.0 * math.pi))
        sheet.tube(np.linspace(at, at + 0.02 * size * way, 4), 1.2, absorbing(rng, 1.5))


KINDS: dict[str, Callable[[_Sheet], None]] = {
    "empty bench": _empty_bench,
    "photograph": _photograph,
    "cable": _cable,
    "coil of cable": _coil,
    "wires": _wires,
    "ruler": _ruler,
    "hand": _hand,
    "empty tube": _empty_tube,
    "coupling": _coupling,
    "tissue": _tissue,
    "tube and tissue": _tube_and_tissue,
    "clamp": _clamp,
    "pen": _pen,
    "forceps": _forceps,
    "corner": _corner,
    "printed paper": _printed,
    "water": _water,
    "chest X-ray": _chest,
    "X-ray leads": _leads,
}
XRAY_KINDS = ("chest X-ray", "X-ray leads")


def draw(
    kind: str, rng: np.random.Generator, drawer: Drawer, size: int, sway: tuple[float, float] = (0.0, 0.0)
) -> Scene:
    """Draws an image without a catheter.

    Args:
        kind: one of `KINDS`.
        rng: source of randomness; ``sway`` changes nothing that is drawn from it.
        drawer: of images of this size.
        size: side of the image, px.
        sway: offset of the objects from their rest, px.

    Returns:
        The scene; its line is that of no object, `Scene.present` is False.
    """
    length = math.exp(rng.uniform(math.log(0.24), math.log(0.72))) * size
    diameter = max(length / math.exp(rng.uniform(math.log(8.0), math.log(30.0))), 2.2)
    line, side = placed(rng, curve(rng, length), size, from_border=rng.random() < 0.3)
    xray = kind in XRAY_KINDS
    canvas = xray_ground(rng, size) if xray else SceneCanvas.empty(ground(rng, size, size))
    lights = random_lights(rng)
    KINDS[kind](_Sheet(rng, drawer, canvas, lights, size, diameter, np.array(sway)))
    if xray:
        image = xray_image(rng, canvas)
    else:
        canvas.light *= uneven_light(rng, size, size)[..., None]
        image = photograph(canvas.light, rng)
    state = np.full(LABEL_POINTS, OUTSIDE, np.uint8)
    return Scene(image, line, state, canvas.kind, False, (), side, diameter)
