"""From attenuation to the light that the detector expects: layers that move, exponential, scatter and glare."""

import math
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt
from numba import njit

from ...._system.compilation import STEADY
from ....types import FloatArray
from ._patient_variety import moved_contrast, warped
from ._scene import Detector, Rhythm
from ._static_layers import COARSE, StaticLayers
from ._tube_kernels import transmittance

FloatImage = npt.NDArray[np.float32]
BLOCK = 8
"""Side, in pixels, of the blocks on which widely spread light is computed."""


def soft_layers(
    layers: StaticLayers,
    rhythm: Rhythm,
    breath: float,
    beating: float,
    wall_px: tuple[float, float] | None,
    shift_px: FloatArray,
    contrast: float = 0.0,
) -> FloatImage:
    """Returns the attenuation by heart and diaphragm.

    Args:
        layers: static layers of the view.
        rhythm: relative change of the heart's size, and the way of the diaphragm.
        breath: 0 (breathed out) to 1, see `Rhythm`.
        beating: 0 (filled) to 1 (emptied), see `Rhythm`.
        wall_px: (2,) displacement of the heart's wall from rest; None: the heart moves by itself.
        shift_px: (2,) displacement of the patient in the image.
        contrast: amount of contrast agent, 0 to 1.

    Returns:
        (h, w) attenuation.
    """
    h, w = layers.still.shape[0] // COARSE, layers.still.shape[1] // COARSE
    diaphragm_px = -rhythm.breath_m * breath * layers.head_px
    size = 1.0 - rhythm.beat * beating
    # Without a wall its base comes down toward the apex as it empties; the breath moves the heart by 0.3 of its way.
    du, dv = -0.08 * rhythm.beat * beating * layers.head_px if wall_px is None else wall_px
    du, dv = du + 0.3 * diaphragm_px[0] + shift_px[0], dv + 0.3 * diaphragm_px[1] + shift_px[1]
    heart = _moved(layers.heart, layers, size, du, dv, (h, w))
    heart += _moved(layers.liver, layers, 1.0, diaphragm_px[0] + shift_px[0], diaphragm_px[1] + shift_px[1], (h, w))
    soft = np.asarray(cv2.resize(heart, layers.still.shape[::-1], interpolation=cv2.INTER_LINEAR), np.float32)
    if contrast and layers.varied and layers.varied.injected is not None:
        moved = np.array([du, dv])
        filled = moved_contrast(layers.varied.injected, layers.margin, size, layers.heart_px, moved, soft.shape)
        soft += np.float32(contrast) * filled
    return soft


def _moved(
    layer: FloatImage, layers: StaticLayers, size: float, du: float, dv: float, shape: tuple[int, int]
) -> FloatImage:
    """Scales ``layer`` by ``size`` about the heart's middle and moves it by (du, dv) px of the image.

    ``layer`` and ``shape`` (h, w) are coarse: one of their pixels is `COARSE` px of the image.
    """
    middle = (layers.heart_px - 0.5 * (COARSE - 1)) / COARSE
    shrink = 1.0 / size
    u = middle[0] * (1.0 - shrink) - shrink * du / COARSE + layers.coarse_margin
    v = middle[1] * (1.0 - shrink) - shrink * dv / COARSE + layers.coarse_margin
    mapping = np.array([[shrink, 0.0, u], [0.0, shrink, v]])
    return warped(layer, mapping, shape)


@njit(cache=True, error_model="numpy", fastmath=STEADY, nogil=True)
def direct_light(
    still: FloatImage,
    chest: FloatImage,
    left: float,
    top: float,
    soft: FloatImage,
    taken: FloatImage,
    light: FloatImage,
    blocks: FloatImage,
) -> None:
    """Computes the share of the rays that pass all layers.

    Args:
        still: (h, w) attenuation of the parts that do not move.
        chest: (h + 2 m, w + 2 m) attenuation of the parts that move with the breath, with margin m.
        left: column of ``chest`` at the image's first column; it may be between pixels.
        top: row of ``chest`` at the image's first row; it may be between pixels.
        soft: (h, w) attenuation by heart and diaphragm.
        taken: (h, w) share of the rays that tubes absorb.
        light: (h, w) share that passes, written.
        blocks: (h / `BLOCK`, w / `BLOCK`) means of ``light``, written.
    """
    h, w = still.shape
    i, j = math.floor(top), math.floor(left)
    fv, fu = np.float32(top - i), np.float32(left - j)
    one, half = np.float32(1.0), np.float32(0.5)
    over, none = np.float32(1.0 / 64.0), np.float32(0.0)
    w00, w01, w10, w11 = (one - fv) * (one - fu), (one - fv) * fu, fv * (one - fu), fv * fu
    blocks[:] = none
    mean = np.float32(1.0 / (BLOCK * BLOCK))
    for v in range(h):
        # Slices, and few of them in a loop: an index that might be negative keeps the compiler from vector code.
        at_00, at_01 = chest[v + i, j : j + w], chest[v + i, j + 1 : j + w + 1]
        at_10, at_11 = chest[v + i + 1, j : j + w], chest[v + i + 1, j + 1 : j + w + 1]
        base, veil, tube, out = still[v], soft[v], taken[v], light[v]
        for u in range(w):
            out[u] = w00 * at_00[u] + w01 * at_01[u] + w10 * at_10[u] + w11 * at_11[u]
        for u in range(w):
            x = min(max((out[u] + base[u] + veil[u]) * over, -half), half)  # attenuation / 64, see `transmittance`
            out[u] = transmittance(x) * (one - tube[u])
        row = blocks[v // BLOCK]
        for k in range(row.size):
            total = none
            for u in range(k * BLOCK, (k + 1) * BLOCK):
                total += out[u]
            row[k] += total * mean


@njit(cache=True, error_model="numpy", fastmath=STEADY, nogil=True)
def _mix(light: FloatImage, direct: float, veil: FloatImage) -> None:
    """Replaces ``light`` (h, w) by ``direct`` times itself plus ``veil`` (h, w)."""
    share = np.float32(direct)
    for v in range(light.shape[0]):
        out, more = light[v], veil[v]
        for u in range(out.size):
            out[u] = out[u] * share + more[u]


@dataclass(frozen=True, slots=True, eq=False)
class ScatterAndGlare:
    """Scatter and glare on the blocks of a image: each a pair of matrices (rows, columns), and a share."""

    scatter: tuple[FloatImage, FloatImage]
    glare: tuple[FloatImage, FloatImage]
    scattered: float
    glared: float

    @classmethod
    def of(cls, detector: Detector, px_per_m: float, shape: tuple[int, int]) -> "ScatterAndGlare":
        """Makes the matrices for an image.

        Args:
            detector: the detector, with its scatter and glare.
            px_per_m: scale of the image at the isocentre.
            shape: rows and columns of blocks.

        Returns:
            Scatter and glare.
        """
        scatter_blocks, glare_blocks = (sigma * px_per_m / BLOCK for sigma in (detector.scatter_m, detector.glare_m))
        rows, columns = shape
        scatter = _spread(rows, scatter_blocks), _spread(columns, scatter_blocks)
        glare = _spread(rows, glare_blocks), _spread(columns, glare_blocks)
        return cls(scatter, glare, detector.scatter, detector.glare)

    def add(self, light: FloatImage, blocks: FloatImage, exposure: float) -> None:
        """Converts light to photons, with scatter and glare.

        Args:
            light: (h, w) share of the rays that passes; it becomes photons.
            blocks: means of ``light``, see `direct_light`.
            exposure: photons of a pixel behind nothing.
        """
        scattered = self.scatter[0] @ blocks @ self.scatter[1].T * np.float32(self.scattered)
        spread = self.glare[0] @ (blocks + scattered) @ self.glare[1].T * np.float32(self.glared)
        veil = (scattered * np.float32(1.0 - self.glared) + spread) * np.float32(exposure)
        full = cv2.resize(veil, light.shape[::-1], interpolation=cv2.INTER_LINEAR)
        _mix(light, exposure * (1.0 - self.glared), np.asarray(full, np.float32))


def _spread(count: int, sigma: float) -> FloatImage:
    """Returns the (count, count) matrix that blurs a row of blocks by a Gaussian with ``sigma`` in blocks.

    Light that would leave the row is added to its end: beyond the border the image is taken as constant.
    """
    reach = math.ceil(4.0 * sigma)
    offsets = np.arange(-reach, reach + 1)
    weights = np.exp(-0.5 * (offsets / sigma) ** 2)
    weights /= weights.sum()
    matrix = np.zeros((count, count))
    for k in range(count):
        np.add.at(matrix[k], np.clip(k + offsets, 0, count - 1), weights)
    return matrix.astype(np.float32)
