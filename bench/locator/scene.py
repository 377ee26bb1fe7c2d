"""Random scenes of a bench with one catheter or none, drawn for detection, without physics."""

import math
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt
from bench.locator.curves import curve, lead, turned
from bench.locator.ground import clouds, colour, ground, photographs, pixels, uneven_light
from bench.locator.photometry import photograph
from bench.locator.tubes import STATIONS, Drawer, Lights, SceneCanvas, Surface

from tipforce.training.locator import (
    CATHETER,
    FRONT,
    GROUND,
    HIDDEN,
    INSTRUMENT,
    LABEL_POINTS,
    OUTSIDE,
    SEEN,
    SHEATH,
    Scene,
    camera_image,
)

Float = npt.NDArray[np.float64]
Float32 = npt.NDArray[np.float32]


@dataclass(frozen=True, slots=True, eq=False)
class _Body:
    """A catheter that comes out of an object: its free line, radii and appearance, and the object."""

    line: Float
    radius: Float
    surface: Surface
    hidden_root: Float
    """(n, 2) px: its course before the mouth, covered by the sheath where there is one."""
    sheath: tuple[tuple[Float, float, Surface], ...]
    """Tubes (axis, radius, appearance) that are drawn over the root, in this order."""


LENGTH_SHARES = 0.24, 0.72
"""Least and largest length of the catheter, shares of the image's side."""
GROUND_SHEATH_SHARE = 0.25
"""Share of the sheaths in a colour of the ground, like cloth over a tube."""
FLANGE_SHARE, PIN_SHARE, SHORT_PIN_SHARE = 0.2, 0.35, 0.7
"""Share of the catheters with a tip that is wider or narrower, and with a pin or a wire that comes out of the tip; and
share of the pins that are at most about as long as the catheter is thick."""
CREASE_SHARE = 0.3
"""Share of the sheaths with a dark line at the mouth."""
XRAY_SHARE = 0.13
"""Share of X-ray images among the scenes."""
CROSSING_SHARE = 0.5
"""Share of the X-ray images with a catheter in which other instruments cross it."""


def draw(
    rng: np.random.Generator, drawer: Drawer, size: int, length_shares: tuple[float, float] = LENGTH_SHARES,
    xray_share: float = XRAY_SHARE,
) -> Scene:  # fmt: skip
    """Draws one scene of (size, size).

    Args:
        rng: source of randomness.
        drawer: draws tubes into images of this size.
        size: side of the image, px.
        length_shares: least and largest length of the catheter in a camera image, shares of ``size``.
        xray_share: probability of an X-ray image.
    """
    if rng.random() < xray_share:
        return _xray(rng, drawer, size)
    light = ground(rng, size, size)
    canvas = SceneCanvas.empty(light)
    lights = random_lights(rng)
    length = math.exp(rng.uniform(*np.log(length_shares))) * size
    diameter = length / math.exp(rng.uniform(math.log(5.5), math.log(42.0)))
    diameter = max(diameter, 2.2)
    level = light.reshape(-1, 3)[rng.integers(size * size)].copy() if rng.random() < GROUND_SHEATH_SHARE else None
    body, side = _body(rng, size, length, diameter, sheath_tint=level)
    present = rng.random() > 0.07
    decoys = []
    _distractors(rng, drawer, canvas, lights, size, diameter, behind=True)
    if present and rng.random() < 0.3:
        for _ in range(int(rng.integers(1, 3))):
            like = length * rng.uniform(0.6, 1.3), diameter * rng.uniform(0.7, 1.4)
            decoys.append(_body(rng, size, *like, like=body)[0])
    face = None
    if rng.random() < 0.6:
        face = Face(rng, body.line, diameter, size)
        face.behind(canvas)
    after = int(rng.integers(len(decoys) + 1))
    for decoy in decoys[:after]:
        _draw_body(rng, drawer, canvas, lights, decoy, INSTRUMENT, size)
    _draw_body(rng, drawer, canvas, lights, body, CATHETER, size, with_catheter=present)
    for decoy in decoys[after:]:
        _draw_body(rng, drawer, canvas, lights, decoy, INSTRUMENT, size)
    if face is not None and rng.random() < 0.55:
        before = canvas.light.copy(), canvas.own.copy(), canvas.kind.copy()
        face.in_front(canvas, rng)
        if (states(body.line, canvas.own, present) == SEEN).mean() < 0.5:
            canvas.light, canvas.own, canvas.kind = before  # too little of it would be left
    _distractors(rng, drawer, canvas, lights, size, diameter, behind=False)
    if rng.random() < 0.06:
        _patch(rng, canvas, body.line, size)
    canvas.light *= uneven_light(rng, size, size)[..., None]
    image = photograph(canvas.light, rng)
    return Scene(
        image, body.line, states(body.line, canvas.own, present), canvas.kind, present,
        tuple(decoy.line for decoy in decoys), side, diameter,
    )  # fmt: skip


def states(line: Float, own: Float32, present: bool) -> npt.NDArray[np.uint8]:
    """Whether each point of ``line`` is OUTSIDE of the image, HIDDEN or SEEN, from the catheter's cover ``own``."""
    if not present:
        return np.zeros(len(line), np.uint8)
    h, w = own.shape
    inside = ((line > -0.5) & (line < (w - 0.5, h - 0.5))).all(axis=1)
    at = np.clip(np.rint(line).astype(int), 0, (w - 1, h - 1))
    seen = own[at[:, 1], at[:, 0]] > 0.4
    # the two end points are on the outline: they count as visible where their neighbours are
    seen[0], seen[-1] = seen[0] or seen[1], seen[-1] or seen[-2]
    return np.where(inside, np.where(seen, SEEN, HIDDEN), OUTSIDE).astype(np.uint8)


def random_lights(rng: np.random.Generator) -> Lights:
    directions = rng.normal(size=(2, 3)) * (1.0, 1.0, 0.6)
    directions[:, 2] = np.abs(directions[:, 2]) + 0.25
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    return Lights(directions, np.array([1.0, rng.uniform(0.0, 0.8)]) * rng.uniform(0.4, 1.0), rng.uniform(0.15, 0.7))


def _catheter_surface(rng: np.random.Generator, aspect: float) -> Surface:
    """Returns the surface of a catheter ``aspect`` diameters long: shaft, distal part, rings, bands, tip electrode."""
    s = np.linspace(0.0, 1.0, STATIONS)
    tint = colour(rng)
    if rng.random() < 0.15:
        tint = np.array([0.02, 0.04, 0.16], np.float32) * rng.uniform(0.5, 3.0)  # dark blue, usual for catheters
    look = np.repeat(tint[None], STATIONS, axis=0)
    gloss = np.full(STATIONS, rng.choice([0.0, 0.1, 0.4]) * rng.uniform(0.5, 1.5), np.float32)
    diameter = 1.0 / aspect
    if rng.random() < 0.3:
        look[s > rng.uniform(0.2, 0.8)] = colour(rng)
    metal = np.full(3, rng.uniform(0.35, 0.9), np.float32) * (1.0, 0.97, rng.uniform(0.85, 1.0))
    rings = int(rng.integers(0, 7)) if rng.random() < 0.6 else 0
    at = 1.0 - rng.uniform(1.0, 5.0) * diameter
    for _ in range(rings):
        wide = rng.uniform(0.4, 1.4) * diameter
        on = (s < at) & (s > at - wide)
        look[on], gloss[on] = metal, 0.7
        at -= wide + rng.uniform(0.6, 2.5) * diameter
    if rng.random() < 0.65:  # tip electrode, soft tip, light end
        on = s > 1.0 - math.exp(rng.uniform(math.log(0.3), math.log(4.5))) * diameter
        end = metal if rng.random() < 0.6 else colour(rng)
        look[on], gloss[on] = end, rng.uniform(0.0, 0.9)
    if rng.random() < 0.12:  # depth marks
        on = (s / rng.uniform(0.06, 0.25)) % 1.0 < rng.uniform(0.08, 0.3)
        look[on] = colour(rng)
    if rng.random() < 0.12:  # segments of a tendon-driven arm
        on = (s / rng.uniform(0.05, 0.14)) % 1.0 < rng.uniform(0.06, 0.25)
        look[on] *= rng.uniform(0.1, 0.6)
    braid = (rng.uniform(0.05, 0.35), aspect * rng.uniform(0.4, 2.0)) if rng.random() < 0.25 else (0.0, 0.0)
    cover = 1.0 if rng.random() < 0.85 else rng.uniform(0.55, 1.0)
    return Surface(
        np.ascontiguousarray(look, np.float32), gloss, float(rng.choice([5.0, 20.0, 60.0])), cover, braid,
        blunt=rng.random() < 0.3,
    )  # fmt: skip


def plain_surface(rng: np.random.Generator, tint: Float32 | None = None, *, blunt: bool = True) -> Surface:
    tint = colour(rng) if tint is None else tint
    look = np.repeat(np.asarray(tint, np.float32)[None], STATIONS, axis=0)
    if rng.random() < 0.2:
        s = np.linspace(0.0, 1.0, STATIONS)
        look[(s / rng.uniform(0.08, 0.4)) % 1.0 < rng.uniform(0.1, 0.5)] = colour(rng)
    gloss = np.full(STATIONS, rng.choice([0.0, 0.15, 0.5]) * rng.uniform(0.5, 1.5), np.float32)
    cover = 1.0 if rng.random() < 0.9 else rng.uniform(0.3, 0.9)
    weave = (rng.uniform(0.05, 0.4), rng.uniform(4.0, 60.0)) if rng.random() < 0.25 else (0.0, 0.0)  # cloth, a thread
    shine = float(rng.choice([5.0, 20.0]))
    return Surface(np.ascontiguousarray(look, np.float32), gloss, shine, cover, weave, blunt=blunt)


def _body(
    rng: np.random.Generator, size: int, length: float, diameter: float, like: "_Body | None" = None,
    sheath_tint: Float32 | None = None,
) -> tuple[_Body, int]:  # fmt: skip
    """Returns a catheter in the image, with the object that it comes out of; and the border that it comes from."""
    shape = curve(rng, length)
    line, side = placed(rng, shape, size, from_border=rng.random() < 0.2)
    root_way = line[0] - line[1]
    back = math.atan2(root_way[1], root_way[0])
    taper = rng.uniform(0.75, 1.05) if rng.random() < 0.25 else 1.0
    radius = 0.5 * diameter * np.linspace(1.0, taper, LABEL_POINTS)
    if rng.random() < FLANGE_SHARE:
        long = rng.uniform(0.2, 1.5) * diameter / length
        radius[np.linspace(1.0, 0.0, LABEL_POINTS) < long] *= rng.uniform(0.75, 1.4)
    surface = like.surface if like is not None and rng.random() < 0.5 else _catheter_surface(rng, length / diameter)
    at_border = bool((line[0] < 1.0).any() or (line[0] > size - 2.0).any())
    root = lead(rng, line[0], back, 0.4 * size if at_border else max(3.0, 1.5 * diameter), 0.1)
    sheath: tuple[tuple[Float, float, Surface], ...] = ()
    if not at_border:
        sheath, side = _sheath(rng, line[0], back, diameter, size, side, sheath_tint)
    return _Body(line, radius, surface, root, sheath), side


def placed(rng: np.random.Generator, shape: Float, size: int, *, from_border: bool) -> tuple[Float, int]:
    """Turns and moves ``shape`` (n, 2) into the image; with ``from_border`` its base is on a border."""
    for _ in range(8):
        if from_border:
            side = int(rng.integers(4))
            inward = (0.0, math.pi, 0.5 * math.pi, -0.5 * math.pi)[side] + rng.normal(0.0, 0.3)
            line = turned(shape, inward)
            along = rng.uniform(0.1, 0.9) * size
            start = ((-0.5, along), (size - 0.5, along), (along, -0.5), (along, size - 0.5))[side]
            line = line + start
        else:
            line = turned(shape, rng.uniform(0.0, 2.0 * math.pi))
            low, high = 4.0 - line.min(axis=0), size - 4.0 - line.max(axis=0)
            side = -1
            if rng.random() < 0.12:  # a part of it is outside
                low, high = low - 0.5 * size * rng.random(), high + 0.5 * size * rng.random()
            line = line + np.where(low < high, rng.uniform(np.minimum(low, high), np.maximum(low, high)), 0.5 * low)
        inside = ((line[2:] > 0.0) & (line[2:] < size - 1.0)).all(axis=1).mean()
        if inside > (0.6 if rng.random() < 0.2 else 0.97):
            break
    return line, side


def _sheath(
    rng: np.random.Generator, mouth: Float, back: float, diameter: float, size: int, side: int,
    tint: Float32 | None = None,
) -> tuple[tuple[tuple[Float, float, Surface], ...], int]:  # fmt: skip
    """Object at ``mouth`` that the catheter comes out of: tube with or without band or coupling, clamp, hand or hole.

    Returns the tubes to draw over the root, and the border that they come from.
    """
    kind = rng.choice(["tube", "block", "fingers"], p=[0.78, 0.16, 0.06])
    tint = colour(rng) if tint is None else tint
    if kind == "fingers":
        skin = np.array([rng.uniform(0.25, 0.75), 0.0, 0.0], np.float32)
        skin[1], skin[2] = skin[0] * rng.uniform(0.6, 0.8), skin[0] * rng.uniform(0.4, 0.65)
        tubes = []
        for sign in (-1.0, 1.0):
            wide = diameter * rng.uniform(1.5, 4.0)
            start = mouth + 0.5 * wide * np.array([math.cos(back), math.sin(back)])
            start = start + sign * rng.uniform(0.2, 0.8) * wide * np.array([-math.sin(back), math.cos(back)])
            axis = lead(rng, start, back + sign * rng.uniform(0.1, 0.9), 0.8 * size, 0.4)
            tubes.append((axis, 0.5 * wide, plain_surface(rng, skin, blunt=False)))
        return tuple(tubes), -1
    wide = diameter * math.exp(rng.uniform(math.log(1.12), math.log(5.5)))
    if kind == "block":
        axis = lead(rng, mouth, back, diameter * rng.uniform(0.6, 6.0), 0.0)
        wide = diameter * rng.uniform(2.0, 9.0)
        return ((axis, 0.5 * wide, plain_surface(rng, tint)),), -1
    reach = 1.6 * size if rng.random() < 0.8 else rng.uniform(2.0, 8.0) * wide
    axis = lead(rng, mouth, back, reach, rng.choice([0.02, 0.15, 0.4]))
    tubes = [(axis, 0.5 * wide, plain_surface(rng, tint))]
    way = np.array([math.cos(back), math.sin(back)])
    if rng.random() < CREASE_SHARE:
        long, thick = diameter * rng.uniform(0.1, 0.4), diameter * rng.uniform(1.0, 1.8)
        dark = plain_surface(rng, tint * np.float32(rng.uniform(0.1, 0.6)))
        tubes.append((np.linspace(mouth, mouth + long * way, 4), 0.5 * thick, dark))
    if rng.random() < 0.5:  # bands, couplings, a stopper at or before the mouth
        at = 0.0
        for _ in range(int(rng.integers(1, 4))):
            long, thick = wide * rng.uniform(0.25, 1.6), wide * rng.uniform(0.9, 1.5)
            same = rng.random() < 0.35
            part = plain_surface(rng, tint * np.float32(rng.uniform(0.8, 1.25)) if same else None)
            start = mouth + at * way
            tubes.append((np.linspace(start, start + long * way, 6), 0.5 * thick, part))
            at += long * rng.uniform(0.8, 2.0)
    outside = ((axis < 0.0) | (axis > size - 1.0)).any(axis=1)
    if outside.any():
        u, v = axis[int(outside.argmax())]
        side = int(np.argmin([u, size - 1.0 - u, v, size - 1.0 - v]))
    else:
        side = -1
        if rng.random() < 0.6:  # a handle, a connector or a post at its rear
            rear = axis[-1] - axis[-2]
            rear = rear / np.linalg.norm(rear)
            start = axis[-1] - 2.0 * rear
            handle = np.linspace(start, start + rng.uniform(1.0, 5.0) * wide * rear, 6)
            tubes.append((handle, wide * rng.uniform(0.6, 1.6), plain_surface(rng)))
    return tuple(tubes), side


def _draw_body(
    rng: np.random.Generator, drawer: Drawer, canvas: SceneCanvas, lights: Lights, body: _Body, kind: int, size: int,
    *, with_catheter: bool = True,
) -> None:  # fmt: skip
    """Draws the shadow, the catheter, and over it the object that it comes out of."""
    if rng.random() < 0.6:
        fall = rng.normal(0.0, 0.04 * size, 2)
        parts = [(part[0], 2.0 * part[1]) for part in body.sheath]
        parts += [(body.line, 2.0 * float(body.radius.mean()))] if with_catheter else []
        shadow(rng, canvas, parts, fall)
    if with_catheter:
        own = kind == CATHETER
        joined = np.vstack([body.hidden_root[:0:-1], body.line])
        radius = np.concatenate([np.full(len(body.hidden_root) - 1, body.radius[0]), body.radius])
        surface = _extended(body.surface, len(body.hidden_root) - 1, len(joined))
        if rng.random() < PIN_SHARE:
            _pin(rng, drawer, canvas, lights, body.line, 2.0 * float(body.radius.mean()))
        drawer.tube(canvas, joined, radius, surface, lights, kind, is_catheter=own)
    for axis, radius, surface in body.sheath:
        drawer.tube(canvas, axis, radius, surface, lights, SHEATH if kind == CATHETER else INSTRUMENT)


def _pin(
    rng: np.random.Generator, drawer: Drawer, canvas: SceneCanvas, lights: Lights, line: Float, diameter: float
) -> None:
    """Draws a pin, a wire or a probe beyond the tip; it is no part of the catheter."""
    way = line[-1] - line[-4]
    turn = math.atan2(way[1], way[0]) + rng.normal(0.0, 0.15)
    long = rng.uniform(0.2, 1.2) if rng.random() < SHORT_PIN_SHARE else math.exp(rng.uniform(0.2, 2.5))
    axis = lead(rng, line[-1], turn, long * diameter, rng.choice([0.0, 0.3]))
    wide = max(diameter * rng.uniform(0.08, 0.45), 0.8)
    metal = np.full(3, rng.uniform(0.2, 0.95), np.float32)
    surface = plain_surface(rng, metal if rng.random() < 0.5 else None)
    drawer.tube(canvas, axis, 0.5 * wide, surface, lights, GROUND)


def _extended(surface: Surface, before: int, count: int) -> Surface:
    """The looks of a line of ``count`` points of which the first ``before`` were joined: these look like its base."""
    at = np.clip((np.linspace(0, count - 1, STATIONS) - before) / max(count - 1 - before, 1), 0.0, 1.0) * (STATIONS - 1)
    near = np.rint(at).astype(int)
    return Surface(
        np.ascontiguousarray(surface.colour[near]), np.ascontiguousarray(surface.gloss[near]), surface.shininess,
        surface.cover, surface.braid, np.ascontiguousarray(surface.attenuation[near]), surface.blunt,
    )  # fmt: skip


def shadow(rng: np.random.Generator, canvas: SceneCanvas, parts: list[tuple[Float, float]], fall: Float) -> None:
    h, w = canvas.kind.shape
    mask = np.zeros((h // 2, w // 2), np.uint8)
    for axis, wide in parts:
        points = np.round((axis + fall) * 8.0).astype(np.int32)
        cv2.polylines(mask, [points], False, 255, max(1, round(0.5 * wide)), cv2.LINE_AA, 4)
    soft = cv2.GaussianBlur(mask, (0, 0), rng.uniform(0.6, 5.0)).astype(np.float32) / 255.0
    canvas.light *= (1.0 - rng.uniform(0.1, 0.7) * cv2.resize(soft, (w, h)))[..., None]


class Face:
    """Tissue that the tip meets: a region with a curved face; a rim of it may hide the tip."""

    def __init__(self, rng: np.random.Generator, line: Float, diameter: float, size: int) -> None:
        way = line[-1] - line[-4]
        tilt = math.atan2(way[1], way[0]) + rng.uniform(-1.4, 1.4)
        v, u = pixels(size, size)
        depth = diameter * rng.uniform(-0.3, 0.8)
        at = line[-1] - depth * np.array([math.cos(tilt), math.sin(tilt)])
        x = (u - at[0]) * math.cos(tilt) + (v - at[1]) * math.sin(tilt)
        y = -(u - at[0]) * math.sin(tilt) + (v - at[1]) * math.cos(tilt)
        bow = rng.normal(0.0, 0.6) / size
        x = x + bow * y * y
        if rng.random() < 0.5:  # the indentation around the tip
            x = x - (depth + 0.5 * diameter) * np.exp(-((y / (diameter * rng.uniform(1.0, 3.0))) ** 2))
        if rng.random() < 0.4:
            x = x + rng.uniform(0.2, 1.5) * clouds(rng, size, size, 6, 2)
        self._depth = x
        wide = size * rng.uniform(0.1, 1.2)
        self._inside = (np.clip(x + 0.5, 0.0, 1.0) * np.clip(wide - np.abs(y) + 0.5, 0.0, 1.0)).astype(np.float32)
        if rng.random() < 0.5:
            self._inside *= np.clip(size * rng.uniform(0.05, 0.6) - x, 0.0, 1.0)
        red = rng.uniform(0.2, 0.8)
        pink = np.array([red, red * rng.uniform(0.4, 1.0), red * rng.uniform(0.4, 1.0)], np.float32)
        tint = pink if rng.random() < 0.6 else colour(rng)
        self._look = np.empty((size, size, 3), np.float32)
        self._look[:] = tint
        if rng.random() < 0.7:
            texture = clouds(rng, size, size, int(rng.integers(4, 50)))
            self._look *= np.exp(rng.uniform(0.03, 0.2) * texture)[..., None]
        if rng.random() < 0.5:
            edge = np.exp(-((x / rng.uniform(1.0, 8.0)) ** 2))[..., None]
            self._look *= 1.0 + rng.uniform(-0.5, 0.5) * edge
        self._cover = 1.0 if rng.random() < 0.75 else rng.uniform(0.4, 0.95)
        self._rim_px = rng.uniform(-0.5, 3.0) * diameter * (1.0 if rng.random() < 0.7 else 2.5)

    def behind(self, canvas: SceneCanvas) -> None:
        """Draws the tissue over the ground."""
        canvas.light += (self._cover * self._inside)[..., None] * (self._look - canvas.light)

    def in_front(self, canvas: SceneCanvas, rng: np.random.Generator) -> None:
        """Draws the tissue, or its rim that reaches toward the base, over the catheter."""
        near = np.clip(self._depth + self._rim_px, 0.0, 1.0)
        region = (near * (self._inside > 0.0) if self._rim_px < 0.0 else near).astype(np.float32)
        region *= np.clip(self._rim_px * 2.0 + rng.uniform(10.0, 60.0) - self._depth, 0.0, 1.0)
        cover = (self._cover * region).astype(np.float32)
        canvas.light += cover[..., None] * (self._look * np.float32(rng.uniform(0.8, 1.2)) - canvas.light)
        canvas.own *= 1.0 - cover
        canvas.kind[cover > 0.5] = FRONT


def _distractors(
    rng: np.random.Generator, drawer: Drawer, canvas: SceneCanvas, lights: Lights, size: int, diameter: float,
    *, behind: bool,
) -> None:  # fmt: skip
    """Cables, wires, posts, tubes and other instruments, behind the catheter or in front of it."""
    if rng.random() > (0.6 if behind else 0.16):
        return
    for _ in range(int(rng.integers(1, 4 if behind else 2))):
        kind = rng.random()
        start = rng.uniform(-0.15, 1.15, 2) * size
        toward = rng.uniform(0.2, 0.8, 2) * size - start
        turn = math.atan2(toward[1], toward[0])
        if kind < 0.45:  # a cable or wire right through the image
            axis = lead(rng, start - 0.3 * toward, turn, 2.2 * size, rng.uniform(0.0, 1.6))
            wide = diameter * rng.uniform(0.2, 1.8)
            drawer.tube(canvas, axis, 0.5 * max(wide, 1.0), plain_surface(rng), lights, INSTRUMENT)
        elif kind < 0.7:  # a post, rail or bar
            axis = lead(rng, start, turn, size * rng.uniform(0.2, 2.0), 0.0)
            wide = diameter * rng.uniform(1.5, 8.0) if behind else diameter * rng.uniform(0.4, 2.0)
            drawer.tube(canvas, axis, 0.5 * wide, plain_surface(rng), lights, FRONT if not behind else GROUND)
        elif kind < 0.85:  # a loop of cable
            axis = curve(rng, size * rng.uniform(0.5, 2.0)) + start
            surface = plain_surface(rng, blunt=False)
            drawer.tube(canvas, axis, 0.5 * diameter * rng.uniform(0.3, 1.5), surface, lights, INSTRUMENT)
        else:  # an empty tube that ends in the image
            axis = lead(rng, start, turn, size * rng.uniform(0.2, 0.8), 0.1)
            wide = diameter * rng.uniform(1.3, 3.0)
            drawer.tube(canvas, axis, 0.5 * wide, plain_surface(rng), lights, INSTRUMENT)


def _patch(rng: np.random.Generator, canvas: SceneCanvas, line: Float, size: int) -> None:
    """A card, a hand's edge or overlay text over a part of the catheter."""
    middle = line[rng.integers(len(line))] + rng.normal(0.0, 0.04 * size, 2)
    sides = rng.uniform(0.04, 0.25, 2) * size
    corners = cv2.boxPoints((tuple(middle.tolist()), tuple(sides.tolist()), float(rng.uniform(0.0, 180.0))))
    mask = np.zeros(canvas.kind.shape, np.uint8)
    cv2.fillPoly(mask, [np.round(corners * 16).astype(np.int32)], 255, cv2.LINE_AA, 4)
    cover = mask.astype(np.float32) / 255.0
    canvas.light += cover[..., None] * (colour(rng) - canvas.light)
    canvas.own *= 1.0 - cover
    canvas.kind[cover > 0.5] = FRONT


def xray_ground(rng: np.random.Generator, size: int) -> SceneCanvas:
    """An X-ray image with soft tissue only; its light is the transmitted share."""
    light = (
        np.ones((size, size, 1), np.float32)
        * np.exp(rng.uniform(0.1, 0.5) * clouds(rng, size, size, int(rng.integers(2, 6))))[..., None]
    )
    if photographs() and rng.random() < 0.3:
        photo = photographs()[rng.integers(len(photographs()))]
        soft = cv2.GaussianBlur(cv2.resize(photo, (size, size)), (0, 0), rng.uniform(3.0, 12.0))
        light *= np.exp(rng.uniform(0.3, 0.9) * (soft[..., 1:2].astype(np.float32) / 255.0 - 0.5))
    return SceneCanvas.empty(np.ascontiguousarray(np.repeat(light, 3, axis=2)))


def absorbing(
    rng: np.random.Generator, strength: float, rings: int = 0, tip: float = 0.0, aspect: float = 0.0
) -> Surface:
    """The attenuation of a tube in an X-ray image.

    Args:
        rng: source of randomness.
        strength: attenuation along a diameter.
        rings: number of ring electrodes.
        tip: length of the tip electrode, a share of the tube's.
        aspect: diameter of the tube, a share of its length.
    """
    s = np.linspace(0.0, 1.0, STATIONS)
    mu = np.full(STATIONS, strength)
    at = 1.0 - tip
    mu[s > at] = strength + rng.uniform(0.5, 2.5)
    for _ in range(rings):
        at -= rng.uniform(0.8, 3.0) * aspect
        wide = rng.uniform(0.4, 1.5) * aspect
        mu[(s < at) & (s > at - wide)] = strength + rng.uniform(0.5, 2.5)
        at -= wide
    none = np.zeros(STATIONS, np.float32)
    return Surface(np.zeros((STATIONS, 3), np.float32), none, attenuation=mu.astype(np.float32))


def xray_image(rng: np.random.Generator, canvas: SceneCanvas) -> npt.NDArray[np.uint8]:
    """The image (h, w, 3) that an X-ray detector makes of ``canvas``."""
    size = canvas.kind.shape[0]
    level = canvas.light / max(float(np.quantile(canvas.light[::8, ::8], 0.9)), 1e-3)
    image = 255.0 * np.clip(level * rng.uniform(0.5, 0.95), 0.0, 1.2) ** np.float32(rng.uniform(0.6, 1.3))
    image = cv2.GaussianBlur(image, (0, 0), rng.uniform(0.4, 1.6))
    noisy = image + rng.choice([2.0, 6.0, 14.0]) * rng.uniform(0.5, 1.5) * rng.normal(size=(size, size, 1)).astype(
        np.float32
    ) * np.sqrt(np.maximum(image, 4.0) / 128.0)
    if rng.random() < 0.5:  # collimator
        v, u = pixels(size, size)
        middle, reach = 0.5 * size + rng.normal(0.0, 6.0, 2), size * rng.uniform(0.46, 0.62)
        noisy = np.where((np.hypot(u - middle[0], v - middle[1]) < reach)[..., None], noisy, noisy * 0.1)
    if rng.random() < 0.1:
        noisy = 255.0 - noisy
    return camera_image(np.asarray(noisy, np.float32), rng)


def _crossing(
    rng: np.random.Generator, drawer: Drawer, canvas: SceneCanvas, lights: Lights, line: Float, diameter: float
) -> None:
    """Draws wires and other instruments that cross the catheter, most in its proximal half and at a small angle.

    There the catheter has no electrodes, so that only the course distinguishes the two.
    """
    size = canvas.kind.shape[0]
    for _ in range(int(rng.integers(1, 4))):
        at = int(rng.beta(1.0, 2.0) * (len(line) - 2))
        along = line[at + 1] - line[at]
        turn = math.atan2(along[1], along[0]) + rng.choice((-1.0, 1.0)) * math.exp(
            rng.uniform(math.log(0.08), math.log(1.6))
        )
        place = line[at] + rng.normal(0.0, 0.3 * diameter, 2)
        ahead, behind = (lead(rng, place, turn + back, 1.2 * size, rng.uniform(0.0, 1.2)) for back in (0.0, math.pi))
        thick = max(0.5 * diameter * math.exp(rng.uniform(math.log(0.2), math.log(1.2))), 0.6)
        surface = absorbing(rng, rng.uniform(0.1, 1.1))
        drawer.tube(canvas, np.vstack([behind[:0:-1], ahead]), thick, surface, lights, INSTRUMENT)


def _xray(rng: np.random.Generator, drawer: Drawer, size: int) -> Scene:
    """A catheter in an X-ray image: attenuation multiplies, nothing hides, electrodes are dark."""
    canvas, lights = xray_ground(rng, size), random_lights(rng)
    length = math.exp(rng.uniform(math.log(0.24), math.log(0.72))) * size
    diameter = max(length / math.exp(rng.uniform(math.log(10.0), math.log(42.0))), 2.2)
    present = rng.random() > 0.07
    for _ in range(int(rng.integers(0, 6))):  # ribs, spine, vessels
        axis = lead(rng, rng.uniform(-0.2, 1.2, 2) * size, rng.uniform(0.0, 6.28), 1.6 * size, 0.8)
        drawer.tube(canvas, axis, size * rng.uniform(0.01, 0.09), absorbing(rng, rng.uniform(0.05, 0.35)), lights, 0)
    for _ in range(int(rng.integers(0, 3))):  # wires and other instruments
        axis = lead(rng, rng.uniform(-0.2, 1.2, 2) * size, rng.uniform(0.0, 6.28), 1.8 * size, 1.2)
        surface = absorbing(rng, rng.uniform(0.1, 1.0))
        drawer.tube(canvas, axis, max(0.5 * diameter * rng.uniform(0.2, 1.0), 0.6), surface, lights, INSTRUMENT)
    line, side = placed(rng, curve(rng, length), size, from_border=rng.random() < 0.3)
    if present and rng.random() < CROSSING_SHARE:
        _crossing(rng, drawer, canvas, lights, line, diameter)
    if present:
        shaft = rng.uniform(0.12, 0.9)
        rings, tip = int(rng.integers(0, 7)), rng.uniform(1.0, 4.0) * diameter / length
        surface = absorbing(rng, shaft, rings, tip, diameter / length)
        way = line[0] - line[1]
        root = lead(rng, line[0], math.atan2(way[1], way[0]), 1.6 * size, 0.4)
        if not (line[0] < 1.0).any() and not (line[0] > size - 2.0).any():
            outside = ((root < 0.0) | (root > size - 1.0)).any(axis=1)
            end = root[int(outside.argmax())] if outside.any() else root[-1]
            side = int(np.argmin([end[0], size - 1 - end[0], end[1], size - 1 - end[1]])) if outside.any() else -1
            wide = 0.5 * diameter * rng.uniform(1.15, 2.0)
            drawer.tube(canvas, root, wide, absorbing(rng, rng.uniform(0.15, 0.9)), lights, SHEATH)
        else:
            drawer.tube(canvas, root, 0.5 * diameter, absorbing(rng, shaft), lights, SHEATH)
        drawer.tube(canvas, line, 0.5 * diameter, surface, lights, CATHETER, is_catheter=True)
    image = xray_image(rng, canvas)
    return Scene(image, line, states(line, canvas.own, present), canvas.kind, present, (), side, diameter)
