"""The images of a session on which its detection is resolved."""

import numpy as np

from ..io import spread_rows
from ..types import ADVANCE, Image
from ._dataset import Dataset


def calibration_images(dataset: Dataset, session: str, view: str) -> tuple[Image, ...]:
    """Returns images from all over ``session`` of ``dataset``, or of what it is a part of; their labels play no part.

    None where the clamp is advanced in that session, for then they show the catheter from different places.

    Args:
        dataset: with images.
        session: the name of one of its sessions.
        view: of the images.
    """
    whole = dataset.whole or dataset
    rows = np.flatnonzero(whole.session == session)
    if np.any(whole.actuation.get(ADVANCE, np.zeros(len(whole)))[rows]):
        return ()
    found = (each.views.get(view) for each in whole.subset(rows[spread_rows(len(rows))]).observations())
    return tuple(image for image in found if isinstance(image, np.ndarray))
