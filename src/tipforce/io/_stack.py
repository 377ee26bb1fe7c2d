"""Reads a TIFF file of several pages as images."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from ..errors import FileFormatError
from ..types import Frame
from ._image_size import check_encoded, tiff_pages
from ._images import bits_in_use, eight_bits, file_bytes
from .tables import STILL_STEP_NS


class ImageStack:
    """All pages of a TIFF file in their order, without thumbnails and masks. Their times are not stated.

    Raises FileFormatError where the file is damaged or too large, or its pages differ in size.
    """

    def __init__(self, path: Path) -> None:
        """Reads number and size of the pages, which must be the same for all."""
        self.path = path
        data = file_bytes(path)
        check_encoded(data, str(path))
        pages = tiff_pages(data)
        self._numbers = tuple(pages)
        self._bits: int | None = None
        page_of_size = {size: number for number, size in pages.items()}
        if len(page_of_size) > 1:
            listed = " and ".join(f"{size[0]} x {size[1]} pixels (page {n + 1})" for size, n in page_of_size.items())
            raise FileFormatError(f"{path}: its pages differ in size: {listed}; save those of one camera in a file")

    @property
    def frame_count(self) -> int:
        """Number of pages."""
        return len(self._numbers)

    @property
    def file_names(self) -> tuple[str, ...]:
        """Name of the file with the number of the page, for each page."""
        return tuple(f"{self.path.name} page {number + 1}" for number in self._numbers)

    @property
    def stamp_ns(self) -> tuple[int, ...]:
        """Stamp of each page: they are one second apart."""
        return tuple(range(0, self.frame_count * STILL_STEP_NS, STILL_STEP_NS))

    def frames(self, view: str = "camera") -> Iterator[Frame]:
        """Yields the pages as `read_image` reads a file; all have the same bits in use."""
        for stamp_ns, page in zip(self.stamp_ns, self._pages(), strict=True):
            yield Frame(stamp_ns, eight_bits(page, str(self.path), self._depth), view)

    def _depth(self) -> int:
        if self._bits is None:
            self._bits = bits_in_use(self._pages())
        return self._bits

    def _pages(self) -> Iterator[npt.NDArray[Any]]:
        """Yields the decoded pages."""
        data = np.frombuffer(file_bytes(self.path), np.uint8)
        for number in self._numbers:
            decoded, pages = cv2.imdecodemulti(
                data, cv2.IMREAD_ANYCOLOR | cv2.IMREAD_ANYDEPTH, None, (number, number + 1)
            )
            if not decoded or not pages:
                raise FileFormatError(f"{self.path}: page {number + 1} is damaged; copy the file again")
            yield pages[0]
