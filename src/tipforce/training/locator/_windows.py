"""Training windows: an image, the true catheter in it, and properties of the catheter as a user states them."""

import math
from dataclasses import dataclass, fields

import cv2
import numpy as np
import numpy.typing as npt

from ...types import FloatArray, Image
from ._camera import camera_image, motion_blur
from ._inputs import NOMINAL_DIAMETER_PX
from ._labels import CATHETER, HIDDEN, LABEL_POINTS, NOT_CATHETER, OUTSIDE, UNLABELLED, LabelledImage, Scene
from ._network import STRIDE_PX

Float32 = npt.NDArray[np.float32]

WINDOW_PX = 256
"""Side of a training window."""
CELLS = WINDOW_PX // STRIDE_PX
"""Cells along the side of a window."""
CLICKS = 5
"""Largest number of clicks on the shaft."""
MIN_LENGTH_SHARE, MAX_LENGTH_SHARE = 0.24, 0.72
"""Length of the catheter in a window, as a share of the window's side."""
PROMPT_FIELDS = ("base", "region", "side", "tip", "clicks", "track", "sizes")
"""Prompts of a window, in the order of the arguments of `prompt_channels`."""


@dataclass(frozen=True, slots=True, eq=False)
class Window:
    """One training example; values that are not stated are NaN.

    Attributes:
        image: (WINDOW_PX, WINDOW_PX, 3) RGB.
        line: (LABEL_POINTS, 2) u, v px, base to tip.
        state: (LABEL_POINTS,) OUTSIDE, HIDDEN or SEEN.
        kind: (CELLS, CELLS) kinds of the cells.
        facts: (4,) present (0 or 1), diameter px, length px, source (0 compositor, 1 camera, 2 X-ray).
        base: (2,) prompt: u, v px of the base, or of the point where the catheter enters the image.
        region: (4,) prompt: u0, v0, u1, v1 px of a box that holds this point.
        side: (1,) prompt: index in SIDES.
        tip: (2,) prompt: u, v px.
        clicks: (CLICKS, 2) prompt: u, v px on the shaft.
        track: (LABEL_POINTS, 2) prompt: u, v px, the line of the frame before.
        sizes: (2,) prompt: length and diameter in px.
    """

    image: Image
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


WINDOW_FIELDS = tuple(field.name for field in fields(Window))


def window_shapes() -> dict[str, tuple[tuple[int, ...], type]]:
    """Returns shape and type of each field of a window."""
    return {
        "image": ((WINDOW_PX, WINDOW_PX, 3), np.uint8),
        "line": ((LABEL_POINTS, 2), np.float32),
        "state": ((LABEL_POINTS,), np.uint8),
        "kind": ((CELLS, CELLS), np.uint8),
        "facts": ((4,), np.float32),
        "base": ((2,), np.float32),
        "region": ((4,), np.float32),
        "side": ((1,), np.float32),
        "tip": ((2,), np.float32),
        "clicks": ((CLICKS, 2), np.float32),
        "track": ((LABEL_POINTS, 2), np.float32),
        "sizes": ((2,), np.float32),
    }


def window(scene: Scene, rng: np.random.Generator, source: int = 0) -> Window:
    """Returns the training example of a scene with random prompts.

    Args:
        scene: an image of side WINDOW_PX.
        rng: source of the prompts.
        source: 0 compositor, 1 camera, 2 X-ray.
    """
    length = float(np.linalg.norm(np.diff(scene.line, axis=0), axis=1).sum())
    half = STRIDE_PX // 2
    facts = np.array([scene.present, scene.diameter_px, length, source], np.float32)
    return Window(
        scene.image, scene.line.astype(np.float32), scene.state,
        np.ascontiguousarray(scene.kind[half::STRIDE_PX, half::STRIDE_PX]), facts, **_prompts(scene, length, rng),
    )  # fmt: skip


def _prompts(scene: Scene, length: float, rng: np.random.Generator) -> dict[str, Float32]:
    """Returns prompts of a user or of earlier frames, with small errors; in scenes with decoys one of them decides."""
    found = {
        name: np.full(shape, np.nan, np.float32)
        for name, (shape, _) in window_shapes().items()
        if name in PROMPT_FIELDS
    }
    line, state = scene.line, scene.state
    diameter = scene.diameter_px if math.isfinite(scene.diameter_px) else NOMINAL_DIAMETER_PX
    if not scene.present:  # a prompt in an image without a catheter points at nothing
        line = line + rng.normal(0.0, 0.2 * WINDOW_PX, 2)
        state = np.where(((line > 0) & (line < WINDOW_PX - 1)).all(axis=1), HIDDEN, OUTSIDE)
    ambiguous = scene.ambiguous or bool(scene.decoys)
    bare = rng.random() < 0.35 and not ambiguous
    if bare:
        return found
    inside = np.flatnonzero(state != OUTSIDE)
    if rng.random() < 0.55:
        loose = 0.03 if rng.random() < 0.85 else 0.12
        factors = np.exp(rng.normal(0.0, loose, 2) * (1.0, 2.0))
        found["sizes"][:] = np.array([length, scene.diameter_px]) * factors
        if rng.random() < 0.2:
            found["sizes"][rng.integers(2)] = np.nan
    if scene.side >= 0 and rng.random() < 0.35:
        found["side"][0] = scene.side
    deciding = ["base", "region", "tip", "clicks", "track"]
    weights = np.array([0.4, 0.15, 0.1, 0.15, 0.2])
    chosen = [name for name, share in zip(deciding, (0.35, 0.12, 0.1, 0.12, 0.18), strict=True) if rng.random() < share]
    if ambiguous and not chosen:
        chosen = [str(rng.choice(deciding, p=weights))]
    off = max(1.5, 0.3 * diameter) * (1.0 if rng.random() < 0.85 else 2.0)
    for name in chosen:
        if name == "base" and len(inside):
            found["base"][:] = line[inside[0]] + rng.normal(0.0, off, 2)
        elif name == "region" and len(inside):
            low = line[inside[0]] - rng.uniform(1.0, 8.0, 2) * diameter
            high = line[inside[0]] + rng.uniform(1.0, 8.0, 2) * diameter
            found["region"][:] = np.clip(np.concatenate([low, high]), 0.0, WINDOW_PX - 1.0)
        elif name == "tip" and state[-1] != OUTSIDE:
            found["tip"][:] = line[-1] + rng.normal(0.0, off, 2)
        elif name == "clicks" and len(inside):
            count = int(rng.integers(1, CLICKS + 1))
            found["clicks"][:count] = line[rng.choice(inside, count)] + rng.normal(0.0, 0.7 * off, (count, 2))
        elif name == "track":
            found["track"][:] = _frame_before(line, length, rng)
    return found


def _frame_before(line: FloatArray, length: float, rng: np.random.Generator) -> FloatArray:
    """Returns the line (n, 2) as it may have been in the frame before: bent otherwise, found a little wrong."""
    share = np.linspace(0.0, 1.0, len(line))[:, None]
    reach = rng.choice([0.01, 0.03, 0.08]) * length
    moved = line + share**2 * rng.normal(0.0, reach, 2) + share * rng.normal(0.0, 0.4 * reach, 2)
    wave = np.sin(math.pi * share * rng.uniform(1.0, 3.0)) * rng.normal(0.0, 0.005 * length, 2)
    return moved + wave + rng.normal(0.0, 0.7, 2)


def random_scene(sample: LabelledImage, rng: np.random.Generator) -> Scene:
    """Returns a window of an image: turned, scaled, mirrored, in another light.

    Args:
        sample: the image.
        rng: source of randomness.
    """
    length = float(np.linalg.norm(np.diff(sample.line_px, axis=0), axis=1).sum())
    scale = math.exp(rng.uniform(math.log(MIN_LENGTH_SHARE), math.log(MAX_LENGTH_SHARE))) * WINDOW_PX / length
    turn = 0.5 * math.pi * rng.integers(4) + rng.normal(0.0, 0.12)
    c, s = math.cos(turn), math.sin(turn)
    matrix = scale * np.array([[c, -s], [s, c]]) @ np.diag([1.0, rng.choice([-1.0, 1.0])])
    image = sample.image
    if scale < 0.6:  # a smaller image first, so that nothing aliases
        image = cv2.GaussianBlur(image, (0, 0), 0.45 / scale)
    middle = np.array([0.5 * (image.shape[1] - 1), 0.5 * (image.shape[0] - 1)])
    corner = np.abs(matrix) @ (middle + 0.5)
    line = (sample.line_px - middle) @ matrix.T
    low, high = 6.0 - line.min(axis=0), WINDOW_PX - 6.0 - line.max(axis=0)
    shift = np.where(low < high, rng.uniform(np.minimum(low, high), np.maximum(low, high)), 0.5 * (low + high))
    if rng.random() < 0.85:  # the window shows as little as possible beyond the image
        first, last = WINDOW_PX - corner, corner
        shift = np.clip(shift, np.minimum(first, last), np.maximum(first, last))
    affine = np.column_stack([matrix, shift - matrix @ middle])
    border = tuple(np.median(image.reshape(-1, 3)[::97], axis=0).tolist())
    drawn = cv2.warpAffine(
        image,
        affine,
        (WINDOW_PX, WINDOW_PX),
        flags=cv2.INTER_LINEAR,
        borderMode=cv2.BORDER_CONSTANT,
        borderValue=border,
    )
    if sample.mask is None:
        kind = np.full((WINDOW_PX, WINDOW_PX), UNLABELLED, np.uint8)
    else:
        mask = sample.mask.astype(np.uint8) * 255
        covered = cv2.warpAffine(mask, affine, (WINDOW_PX, WINDOW_PX), flags=cv2.INTER_LINEAR) > 127
        kind = np.where(covered, CATHETER, NOT_CATHETER).astype(np.uint8)
    line = line + shift
    inside = ((line > -0.5) & (line < WINDOW_PX - 0.5)).all(axis=1)
    values = drawn.astype(np.float32)
    if rng.random() < 0.4:
        values = 255.0 * (values / 255.0) ** np.float32(math.exp(rng.normal(0.0, 0.3)))
    if rng.random() < 0.4:
        values = values * np.exp(rng.normal(0.0, 0.1, 3)).astype(np.float32)
    if rng.random() < 0.15:
        values = motion_blur(values, rng, 5.0)
    lit = camera_image(values, rng) if rng.random() < 0.7 else np.clip(values, 0.0, 255.0).astype(np.uint8)
    outward = np.array([(-1.0, 0.0), (1.0, 0.0), (0.0, -1.0), (0.0, 1.0)])
    side = -1 if sample.side < 0 else int(np.argmax(outward @ (matrix @ outward[sample.side])))
    state = np.where(inside, sample.state, OUTSIDE).astype(np.uint8)
    return Scene(lit, line, state, kind, sample.present, (), side, sample.diameter_px * scale, sample.ambiguous)
