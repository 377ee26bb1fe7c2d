"""Writes the windows that a fine-tuning of the locator trains with those of the user, so that it does not forget.

    python -m bench.locator.rehearsal src/tipforce/training/locator/rehearsal.npz

Half of the windows are composed, half are of the presets' renderers. No training and no check uses their seeds.
"""

import sys
from itertools import islice
from pathlib import Path

import cv2
import numpy as np
from bench.locator.feed import labelled_images, scene_windows

from tipforce.training.locator import REHEARSAL_FIELDS, random_scene, window

WINDOWS = 192
IMAGE_STEP = 2
"""Every second image of the presets is used: two of a session."""
SEED = 500_000
WEBP_QUALITY = 80


def main() -> None:
    """Draws and writes the windows."""
    rng = np.random.default_rng(SEED)
    drawn = list(islice(scene_windows(rng), WINDOWS // 2))
    for image in islice(labelled_images(rng, SEED), 0, IMAGE_STEP * WINDOWS // 2, IMAGE_STEP):
        drawn.append(window(random_scene(image, rng), rng, 2 if image.xray else 1))
        print(f"{len(drawn)} of {WINDOWS}", flush=True)
    quality = [cv2.IMWRITE_WEBP_QUALITY, WEBP_QUALITY]
    files = [cv2.imencode(".webp", one.image[..., ::-1], quality)[1] for one in drawn]
    fields = {name: np.array([getattr(one, name) for one in drawn]) for name in REHEARSAL_FIELDS}
    path = Path(sys.argv[1])
    np.savez_compressed(path, image_bytes=np.concatenate(files), image_sizes=[len(each) for each in files], **fields)
    print(f"{path}: {len(drawn)} windows, {path.stat().st_size / 1e6:.1f} MB")


if __name__ == "__main__":
    main()
