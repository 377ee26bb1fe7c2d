"""A folder of masks, as of CathAction: one image a frame, in which all pixels but those of the instrument are 0."""

from pathlib import Path

import cv2
import numpy as np
from scipy import ndimage
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra

from ...errors import FileFormatError
from ...geometry import arc_length, resampled
from ...io import is_image, read_image
from ...types import BoolArray, FloatArray
from .._store import MarkedFrame
from ._tables import Marks

LINE_POINTS = 24
"""Points at which a line is read."""
MIN_SHARE = 0.8
"""The largest part of a mask holds at least this share of its pixels; else it is no single line."""
MIN_LENGTH_PX = 20.0
"""A shorter part of the instrument is not used."""


def read_masks(folder: Path) -> Marks:
    """Reads the line along the middle of each mask of a folder.

    A mask belongs to the image with the same name before the ending; ``mask12.png`` also to ``image12.jpg``. The line
    begins at the end that is nearer to the border of the image. Its ends are known to about half the width of the mask.

    Args:
        folder: folder of the masks.

    Returns:
        The frames; images are named without their ending.

    Raises:
        FileFormatError: there is no image in the folder.
    """
    files = sorted(each for each in folder.iterdir() if is_image(each))
    if not files:
        raise FileFormatError(f"{folder}: holds no masks; expected one image a frame (.png), 0 outside of the catheter")
    marks = Marks([])
    for file in files:
        name = "image" + file.stem.removeprefix("mask") if file.stem.startswith("mask") else file.stem
        pixels = read_image(file)
        mask = np.asarray(pixels > 0 if pixels.ndim == 2 else (pixels > 0).any(axis=2), np.bool_)
        line, reason = mask_line(mask)
        if line is None:
            marks.left_out[name] = reason
        else:
            marks.frames.append(MarkedFrame(name, line, done=True))
            marks.sizes_px[name] = (mask.shape[1], mask.shape[0])
    return marks


def mask_line(mask: BoolArray) -> tuple[FloatArray | None, str]:
    """Returns the line along the middle of a mask.

    Its ends are the two pixels that are farthest from each other inside the mask. The line between them is the cheapest
    way where pixels near the middle, far from the border of the mask, cost least.

    Args:
        mask: (h, w) pixels of the instrument.

    Returns:
        (`LINE_POINTS`, 2) points u, v, and ""; or None and the reason why there is no line.
    """
    count, labels, sizes, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8), connectivity=8)
    if count < 2:
        return None, "the mask is empty"
    areas = sizes[1:, cv2.CC_STAT_AREA]
    if areas.max() < MIN_SHARE * areas.sum():
        return None, "the mask is in several parts"
    part = np.asarray(labels == 1 + int(areas.argmax()), np.bool_)
    depth = np.asarray(ndimage.distance_transform_edt(np.pad(part, 1)), np.float64)[1:-1, 1:-1]  # px from the border
    rows, columns = np.nonzero(part)
    by_length, by_depth = (_graph(part, cost) for cost in (np.ones_like(depth), np.maximum(depth, 0.5) ** -3))
    # the pixel farthest from any pixel is one end; the pixel farthest from that is the other
    start = int(np.argmax(dijkstra(by_length, indices=0)))
    end = int(np.argmax(dijkstra(by_length, indices=start)))
    _, predecessors = dijkstra(by_depth, indices=start, return_predecessors=True)
    path = [end]
    while path[-1] != start:
        path.append(int(predecessors[path[-1]]))
    points = np.column_stack([columns[path], rows[path]]).astype(np.float64)
    # a mean over the width of the instrument removes the steps of the pixels
    width = max(3, 2 * round(float(depth[rows[path], columns[path]].max())) + 1)
    smooth = ndimage.uniform_filter1d(points, width, axis=0, mode="nearest")
    if arc_length(smooth)[-1] < MIN_LENGTH_PX:
        return None, f"the instrument is shorter than {MIN_LENGTH_PX:g} px"
    line = resampled(smooth, LINE_POINTS)
    corner = np.array(mask.shape[::-1]) - 1.0
    first_px, last_px = (float(np.minimum(point, corner - point).min()) for point in (line[0], line[-1]))
    return (line[::-1].copy() if last_px < first_px else line), ""  # the base is nearer to the border


def _graph(part: BoolArray, cost: FloatArray) -> csr_array:
    """Returns the graph of a mask's pixels, of which each is joined with its eight neighbours.

    Args:
        part: (h, w) mask with n pixels.
        cost: (h, w) cost of each pixel; a step costs its length times the mean cost of its two pixels.

    Returns:
        (n, n) costs of the steps; pixels are in the order of `numpy.nonzero`.
    """
    numbers = np.full(part.shape, -1)
    numbers[part] = np.arange(int(part.sum()))
    height, width = part.shape
    rows: list[FloatArray] = []
    for down, right in ((0, 1), (1, 0), (1, 1), (1, -1)):  # the other four neighbours are these, from the other side
        pixel = (slice(0, height - down), slice(max(0, -right), width - max(0, right)))
        neighbour = (slice(down, height), slice(max(0, right), width + min(0, right)))
        both = part[pixel] & part[neighbour]
        step = float(np.hypot(down, right)) * 0.5 * (cost[pixel] + cost[neighbour])
        rows.append(np.stack([numbers[pixel][both], numbers[neighbour][both], step[both]]))
    first, second, costs = np.concatenate(rows, axis=1)
    pairs = np.concatenate([first, second]).astype(int), np.concatenate([second, first]).astype(int)
    total = int(part.sum())
    return csr_array((np.concatenate([costs, costs]), pairs), shape=(total, total))
