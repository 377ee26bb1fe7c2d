"""Training windows: an image, the true catheter in it, and the stated properties of the catheter (the prompts)."""

import math
from dataclasses import dataclass, fields

import numpy as np
import numpy.typing as npt
from bench.locator.curves import POINTS
from bench.locator.scene import HIDDEN, OUTSIDE, Scene

Float = npt.NDArray[np.float64]
Float32 = npt.NDArray[np.float32]

SIZE = 256
"""Side of a training window in px."""
STRIDE = 4
CELLS = SIZE // STRIDE
CLICKS = 5
"""Largest number of clicks on the shaft."""
UNKNOWN_KIND = 255
"""A cell of which only is known that it is not the catheter."""


@dataclass(frozen=True, slots=True, eq=False)
class Window:
    """One training example; values that are not stated are NaN.

    ``image`` (SIZE, SIZE, 3) uint8; ``line`` (POINTS, 2) px; ``state`` (POINTS,); ``kind`` (CELLS, CELLS);
    ``facts`` (4,): present (0 or 1), true diameter px, true length px, source (0 compositor, 1 camera preset, 2 X-ray
    preset). Prompts: ``base`` (2,) px; ``region`` (4,) u0, v0, u1, v1 px that hold the base; ``side`` (1,) index in
    SIDES; ``tip`` (2,) px; ``clicks`` (CLICKS, 2) px; ``track`` (POINTS, 2) px, the line of the frame before;
    ``sizes`` (2,): length and diameter in px as stated.
    """

    image: npt.NDArray[np.uint8]
    line: Float32
    state: npt.NDArray[np.uint8]
    kind: npt.NDArray[np.uint8]
    facts: Float32
    base: Float32
    region: Float32
    side: Float32
    tip: Float32
    clicks: Float32
    track: Float32
    sizes: Float32


FIELDS = tuple(field.name for field in fields(Window))


def shapes() -> dict[str, tuple[tuple[int, ...], type]]:
    """Shape and type of each field of a window."""
    return {
        "image": ((SIZE, SIZE, 3), np.uint8),
        "line": ((POINTS, 2), np.float32),
        "state": ((POINTS,), np.uint8),
        "kind": ((CELLS, CELLS), np.uint8),
        "facts": ((4,), np.float32),
        "base": ((2,), np.float32),
        "region": ((4,), np.float32),
        "side": ((1,), np.float32),
        "tip": ((2,), np.float32),
        "clicks": ((CLICKS, 2), np.float32),
        "track": ((POINTS, 2), np.float32),
        "sizes": ((2,), np.float32),
    }


def window(scene: Scene, rng: np.random.Generator, source: int = 0) -> Window:
    """The window of ``scene`` (SIZE, SIZE) with random prompts."""
    length = float(np.linalg.norm(np.diff(scene.line, axis=0), axis=1).sum())
    half = STRIDE // 2
    facts = np.array([scene.present, scene.diameter_px, length, source], np.float32)
    return Window(
        scene.image, scene.line.astype(np.float32), scene.state, np.ascontiguousarray(scene.kind[half::4, half::4]),
        facts, **_prompts(scene, length, rng),
    )  # fmt: skip


def _prompts(scene: Scene, length: float, rng: np.random.Generator) -> dict[str, Float32]:
    """Returns prompts of a user or of earlier frames, with small errors; in scenes with decoys one of them decides."""
    found = {
        name: np.full(shape, np.nan, np.float32)
        for name, (shape, _) in shapes().items()
        if name in ("base", "region", "side", "tip", "clicks", "track", "sizes")
    }
    line, state, diameter = scene.line, scene.state, scene.diameter_px
    if not scene.present:  # a prompt in an image without a catheter points at nothing
        line = line + rng.normal(0.0, 0.2 * SIZE, 2)
        state = np.where(((line > 0) & (line < SIZE - 1)).all(axis=1), HIDDEN, OUTSIDE)
    bare = rng.random() < 0.35 and not scene.decoys
    if bare:
        return found
    inside = np.flatnonzero(state != OUTSIDE)
    if rng.random() < 0.55:
        loose = 0.03 if rng.random() < 0.85 else 0.12
        factors = np.exp(rng.normal(0.0, loose, 2) * (1.0, 2.0))
        found["sizes"][:] = np.array([length, diameter]) * factors
        if rng.random() < 0.2:
            found["sizes"][rng.integers(2)] = np.nan
    if scene.side >= 0 and rng.random() < 0.35:
        found["side"][0] = scene.side
    deciding = ["base", "region", "tip", "clicks", "track"]
    weights = np.array([0.4, 0.15, 0.1, 0.15, 0.2])
    chosen = [name for name, share in zip(deciding, (0.35, 0.12, 0.1, 0.12, 0.18), strict=True) if rng.random() < share]
    if scene.decoys and not chosen:
        chosen = [str(rng.choice(deciding, p=weights))]
    if state[0] == OUTSIDE and scene.decoys and len(inside):
        chosen.append("clicks")
    off = max(1.5, 0.3 * diameter) * (1.0 if rng.random() < 0.85 else 2.0)
    for name in chosen:
        if name == "base" and state[0] != OUTSIDE:
            found["base"][:] = line[0] + rng.normal(0.0, off, 2)
        elif name == "region" and state[0] != OUTSIDE:
            low = line[0] - rng.uniform(1.0, 8.0, 2) * diameter
            high = line[0] + rng.uniform(1.0, 8.0, 2) * diameter
            found["region"][:] = np.clip(np.concatenate([low, high]), 0.0, SIZE - 1.0)
        elif name == "tip" and state[-1] != OUTSIDE:
            found["tip"][:] = line[-1] + rng.normal(0.0, off, 2)
        elif name == "clicks" and len(inside):
            count = int(rng.integers(1, CLICKS + 1))
            found["clicks"][:count] = line[rng.choice(inside, count)] + rng.normal(0.0, 0.7 * off, (count, 2))
        elif name == "track":
            found["track"][:] = _frame_before(line, length, rng)
    return found


def _frame_before(line: Float, length: float, rng: np.random.Generator) -> Float:
    """``line`` (n, 2) as it may have been in the frame before: bent otherwise, found a little wrong."""
    share = np.linspace(0.0, 1.0, len(line))[:, None]
    reach = rng.choice([0.01, 0.03, 0.08]) * length
    moved = line + share**2 * rng.normal(0.0, reach, 2) + share * rng.normal(0.0, 0.4 * reach, 2)
    wave = np.sin(math.pi * share * rng.uniform(1.0, 3.0)) * rng.normal(0.0, 0.005 * length, 2)
    return moved + wave + rng.normal(0.0, 0.7, 2)
