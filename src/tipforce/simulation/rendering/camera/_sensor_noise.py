"""Sensor noise: shot noise (Poisson) and read noise (Gauss), quantised to 8 bits; one random number a pixel.

The random numbers are a hash of (seed, frame, pixel): any frame can be drawn alone, in any order, on any thread, and
comes out the same. Two table entries make a Gaussian; a Cornish-Fisher expansion bends it to the cumulants of Poisson
plus Gauss.
"""

import numpy as np
import numpy.typing as npt
from numba import njit

from ...._system.compilation import STEADY
from ....types import Image
from .._random import gauss_row, hash_row

FloatImage = npt.NDArray[np.float32]


def frame_key(seed: int, frame: int) -> npt.NDArray[np.uint32]:
    """Returns the key from which the noise of a frame is drawn.

    Args:
        seed: seed of the scene.
        frame: number of the frame.

    Returns:
        (3,) words that another seed and frame have with a probability of 2^-96 only.
    """
    return np.random.SeedSequence([seed, frame]).generate_state(3, np.uint32).astype(np.uint32)


# Four short loops, not one long one: each of them is then turned into vector instructions, the long one was not.


@njit(cache=True, error_model="numpy", fastmath=STEADY, nogil=True)
def _bend_row(levels: FloatImage, gain: np.float32, read: np.float32, row: FloatImage) -> None:
    """Converts the Gaussian numbers in ``row`` (w,) to noise in grey levels, as shot and read noise have it.

    The Cornish-Fisher expansion gives it the third and fourth cumulants of Poisson noise, too. ``levels``: (w,) light
    before noise; ``gain``: grey levels for each electron; ``read``: standard deviation of the read noise.
    """
    one, three, five, zero = np.float32(1.0), np.float32(3.0), np.float32(5.0), np.float32(0.0)
    c3, c4, c5 = gain**2 / np.float32(6.0), gain**3 / np.float32(24.0), gain**4 / np.float32(36.0)
    for u in range(levels.size):
        z = row[u]
        level = max(levels[u], zero)
        variance = read * read + gain * level
        sigma = np.sqrt(variance)
        over = one / variance
        third = level * over
        fourth = third / sigma
        square = z * z
        row[u] = (
            sigma * z
            + c3 * third * (square - one)
            + c4 * fourth * z * (square - three)
            - c5 * third * fourth * z * (square + square - five)
        )


@njit(cache=True, error_model="numpy", fastmath=STEADY, nogil=True)
def add_noise(
    clean: FloatImage, key: npt.NDArray[np.uint32], table: FloatImage, gain: float, read: float, planes: Image
) -> None:
    """Adds noise to the light of an image, and rounds and clips it.

    All channels of a pixel of a colour image get the same noise, that of its grey level. So its conversion to grey has
    the noise of a grey camera, and the colour itself is as clean as cameras make it before they save.

    Args:
        clean: (c, h, w) light with c = 1 or 3, grey levels.
        key: (3,) key of the frame, see `frame_key`.
        table: `gauss_table`.
        gain: grey levels for each electron; the variance of the shot noise is this times the level.
        read: standard deviation of the read noise in grey levels.
        planes: (c, h, w) image that is written.
    """
    c, h, w = clean.shape
    words = np.empty(w, np.uint32)
    row = np.empty(w, np.float32)
    grey = np.empty(w, np.float32)
    low, top, half = np.float32(0.0), np.float32(255.0), np.float32(0.5)
    for v in range(h):
        hash_row(v * w, key, words)
        gauss_row(words, table, row)
        if c == 1:
            _bend_row(clean[0, v], np.float32(gain), np.float32(read), row)
        else:
            red, green, blue = clean[0, v], clean[1, v], clean[2, v]
            for u in range(w):
                grey[u] = np.float32(0.299) * red[u] + np.float32(0.587) * green[u] + np.float32(0.114) * blue[u]
            _bend_row(grey, np.float32(gain), np.float32(read), row)
        for k in range(c):
            levels, out = clean[k, v], planes[k, v]
            for u in range(w):
                out[u] = np.uint8(min(max(levels[u] + row[u] + half, low), top))
