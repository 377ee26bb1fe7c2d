"""Windows of other benches that go along with a fine-tuning, so that the locator does not forget."""

from importlib import resources
from io import BytesIO

import cv2
import numpy as np
import numpy.typing as npt

from ._windows import WINDOW_FIELDS

REHEARSAL_FIELDS = tuple(name for name in WINDOW_FIELDS if name not in ("image", "kind"))
"""Fields of the stored windows, beside the images."""
_FILE = "rehearsal.npz"


def rehearsal_windows() -> dict[str, npt.NDArray[np.generic]]:
    """Returns the stored windows, (n, ...) each field of `Window` but the kinds of the cells.

    Half are composed scenes, half are from the presets' renderers (``python -m bench.locator.rehearsal``).
    """
    data = (resources.files(__name__.rpartition(".")[0]) / _FILE).read_bytes()
    with np.load(BytesIO(data)) as stored:
        fields = {name: stored[name] for name in REHEARSAL_FIELDS}
        files = np.split(stored["image_bytes"], np.cumsum(stored["image_sizes"])[:-1])
    images = [np.asarray(cv2.imdecode(each, cv2.IMREAD_COLOR), np.uint8)[..., ::-1] for each in files]
    return {"image": np.stack(images), **fields}
