"""A drawing of the report: as a file of its own and for the inside of the page."""

import base64
from dataclasses import dataclass

import cv2
import numpy as np
from matplotlib.figure import Figure

from ..types import Image
from ._style import page_svg, standalone_svg, to_svg

__all__ = ["Picture", "jpeg_uri", "of_figure", "of_image"]


@dataclass(frozen=True, slots=True)
class Picture:
    """``slug``: the SVG file's name without ending; ``page``: SVG for the inside of the page; ``file``: on its own."""

    slug: str
    caption: str
    page: str
    file: str


def of_figure(slug: str, caption: str, figure: Figure) -> Picture:
    """A drawing of numbers."""
    svg = to_svg(figure)
    return Picture(slug, caption, page_svg(svg, caption), standalone_svg(svg))


def of_image(slug: str, caption: str, image: Image) -> Picture:
    """A picture (h, w, 3) as it is."""
    height, width = image.shape[:2]
    svg = (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}">'
        f'<image width="{width}" height="{height}" href="{jpeg_uri(image)}"/></svg>'
    )
    return Picture(slug, caption, page_svg(svg, caption), standalone_svg(svg))


def jpeg_uri(image: Image) -> str:
    """An RGB or grey picture as a JPEG in a data URI."""
    bgr = image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_RGB2BGR)
    _, data = cv2.imencode(".jpg", np.ascontiguousarray(bgr), [cv2.IMWRITE_JPEG_QUALITY, 88])
    return "data:image/jpeg;base64," + base64.b64encode(data.tobytes()).decode("ascii")
