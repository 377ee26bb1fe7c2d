"""From attenuation to the light that the detector expects: layers that move, exponential, scatter and glare."""

import math
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt
from numba import njit

from ...._system.compilation import STEADY
from ....types import FloatArray
from ._patient_variety import moved_contrast
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
    down = -rhythm.breath_m * breath * layers.head_px
    size = 1.0 - rhythm.beat * beating
    # By itself, its base comes down toward the apex as it empties.
    du, dv = -0.08 * rhythm.beat * beating * layers.head_px if wall_px is None else wall_px
    du, dv = du + 0.3 * down[0] + shift_px[0], dv + 0.3 * down[1] + shift_px[1]
    heart = _moved(layers.heart, layers, size, du, dv, (h, w))
    heart += _moved(layers.liver, layers, 1.0, down[0] + shift_px[0], down[1] + shift_px[1], (h, w))
    soft = np.asarray(cv2.resize(heart, layers.still.shape[::-1], interpolation=cv2.INTER_LINEAR), np.float32)
    if contrast and layers.varied and layers.varied.injected is not None:
        at = np.array([du, dv])
        filled = moved_contrast(layers.varied.injected, layers.margin, size, layers.heart_px, at, soft.shape)
        soft += np.float32(contrast) * filled
    return soft


def _moved(
    layer: FloatImage, layers: StaticLayers, size: float, du: float, dv: float, shape: tuple[int, int]
) -> FloatImage:
    """Scales ``layer`` by ``size`` about the heart's middle and moves it by (du, dv) px of the image."""
    middle = (layers.heart_px - 0.5 * (COARSE - 1)) / COARSE
    back = 1.0 / size
    u = middle[0] * (1.0 - back) - back * du / COARSE + layers.coarse_margin
    v = middle[1] * (1.0 - back) - back * dv / COARSE + layers.coarse_margin
    way = np.array([[back, 0.0, u], [0.0, back, v]])
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    return np.asarray(cv2.warpAffine(layer, way, shape[::-1], flags=flags, borderMode=cv2.BORDER_REPLICATE), np.float32)


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
        a, b = chest[v + i, j : j + w], chest[v + i, j + 1 : j + w + 1]
        c, d = chest[v + i + 1, j : j + w], chest[v + i + 1, j + 1 : j + w + 1]
        base, veil, tube, out = still[v], soft[v], taken[v], light[v]
        for u in range(w):
            out[u] = w00 * a[u] + w01 * b[u] + w10 * c[u] + w11 * d[u]
        for u in range(w):
            x = min(max((out[u] + base[u] + veil[u]) * over, -half), half)
            out[u] = transmittance(x) * (one - tube[u])
        row = blocks[v // BLOCK]
        for k in range(row.size):
            total = none
            for u in range(k * BLOCK, (k + 1) * BLOCK):
                total += out[u]
            row[k] += total * mean


@njit(cache=True, error_model="numpy", fastmath=STEADY, nogil=True)
def _mix(light: FloatImage, direct: float, veil: FloatImage) -> None:
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
        near, far = (sigma * px_per_m / BLOCK for sigma in (detector.scatter_m, detector.glare_m))
        rows, columns = shape
        return cls(
            (_spread(rows, near), _spread(columns, near)),
            (_spread(rows, far), _spread(columns, far)),
            detector.scatter,
            detector.glare,
        )

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
    """Returns the matrix (count, count) of a Gaussian over a row of blocks; beyond the border it goes on as there."""
    reach = math.ceil(4.0 * sigma)
    at = np.arange(-reach, reach + 1)
    weights = np.exp(-0.5 * (at / sigma) ** 2)
    weights /= weights.sum()
    matrix = np.zeros((count, count))
    for k in range(count):
        np.add.at(matrix[k], np.clip(k + at, 0, count - 1), weights)
    return matrix.astype(np.float32)
