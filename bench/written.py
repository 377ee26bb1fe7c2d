"""A drawn session on disk, as the simulated bench writes it: JPEG images and a compressed file of their truth."""

import tempfile
import zlib
from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np

from tipforce.simulation.rendering.camera import ImageTruth


class Packed(NamedTuple):
    """One frame, ready to be written."""

    image: bytes
    mask: bytes
    centreline_px: np.ndarray
    visible: float


def pack(image: np.ndarray, truth: ImageTruth, quality: int) -> Packed:
    """Encode a grey or RGB image and its mask."""
    ordered = image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_RGB2BGR)
    data = cv2.imencode(".jpg", ordered, [cv2.IMWRITE_JPEG_QUALITY, quality])[1]
    mask = zlib.compress(np.packbits(truth.mask).tobytes(), 1)
    return Packed(data.tobytes(), mask, truth.centreline_px, truth.visible_share)


def write(frames: Iterable[Packed]) -> int:
    """Write all of them to a folder that is removed again; returns how many bytes that were."""
    kept = []
    with tempfile.TemporaryDirectory() as folder:
        images, truth = Path(folder) / "images.bin", Path(folder) / "truth.npz"
        with images.open("wb") as file:
            for frame in frames:
                file.write(frame.image)
                kept.append(frame)
        np.savez_compressed(
            truth,
            mask=np.frombuffer(b"".join(f.mask for f in kept), np.uint8),
            ends=np.cumsum([len(f.mask) for f in kept]),
            centreline_px=np.array([f.centreline_px for f in kept]),
            visible=np.array([f.visible for f in kept]),
        )
        return images.stat().st_size + truth.stat().st_size
