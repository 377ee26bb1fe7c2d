"""The images of a session on which its detection settings are resolved."""

import numpy as np

from ..io import spread_rows
from ..types import ADVANCE, Image
from ._dataset import Dataset


def calibration_images(dataset: Dataset, session: str, view: str) -> tuple[Image, ...]:
    """Returns images that are spread over a session; their labels are not used.

    Args:
        dataset: a dataset with images; where it is a part of another dataset, the images come from the whole.
        session: name of one of its sessions.
        view: view of the images.

    Returns:
        The images; empty if the clamp is advanced in that session, because the base then moves in the images.
    """
    all_samples = dataset.whole or dataset
    rows = np.flatnonzero(all_samples.session == session)
    if np.any(all_samples.actuation.get(ADVANCE, np.zeros(len(all_samples)))[rows]):
        return ()
    chosen = all_samples.subset(rows[spread_rows(len(rows))])
    images = (observation.views.get(view) for observation in chosen.observations())
    return tuple(image for image in images if isinstance(image, np.ndarray))
