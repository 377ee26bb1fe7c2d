"""Checks cameras whose even and odd rows are taken at two instants (interlaced): refused, or read by even rows."""

import numpy as np

from ..errors import DeviceError
from ..io import FieldEvidence
from ..types import Image


def even_rows(image: Image) -> Image:
    """Returns ``image`` with its odd rows replaced by the mean of the even rows above and below: one instant.

    >>> even_rows(np.array([[10], [99], [20], [99]], np.uint8)).ravel().tolist()
    [10, 15, 20, 20]
    """
    filled = image.copy()
    below = image[2::2].astype(np.uint16)
    filled[1:-1:2] = (image[:-2:2] + below) // 2
    if len(image) % 2 == 0:
        filled[-1] = image[-2]
    return filled


class FieldCheck:
    """Checks the images of one connection to a camera until they show whether their rows are of one instant.

    Args:
        view: the camera's name in ``bench.toml``.
        where: the camera, for the message.
        deinterlace: whether each image is made of its even rows alone; then nothing is checked.
    """

    def __init__(self, view: str, where: str, *, deinterlace: bool) -> None:
        self._view, self._where, self._deinterlace = view, where, deinterlace
        self._evidence: FieldEvidence | None = None if deinterlace else FieldEvidence()

    def one_instant(self, image: Image) -> Image:
        """Returns the image (h, w) or (h, w, 3) whose rows are of one instant.

        Raises DeviceError where the images show that even and odd rows are taken at two instants.
        """
        if self._deinterlace:
            return even_rows(image)
        if self._evidence is None:
            return image
        self._evidence.add(image if image.ndim == 2 else image[..., 1])  # green is closest to brightness
        two_instants = self._evidence.two_instants
        if two_instants:
            raise DeviceError(
                f"{self._where}: its even and odd rows are taken at two instants (interlaced); choose a progressive "
                f"mode of the camera, or state hardware.cameras.{self._view}.deinterlace = true: each image is then "
                "made of its even rows alone"
            )
        if two_instants is False:
            self._evidence = None
        return image
