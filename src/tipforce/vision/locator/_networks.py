"""The two trained networks as ONNX graphs, loaded when first used: those of tipforce or of a fine-tuned detector."""

from functools import cache
from importlib import resources
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np
import numpy.typing as npt
from scipy.special import expit, softmax

from ...errors import FileFormatError
from ...types import Box, FloatArray
from ._peaks import STRIDE, course, shares_of
from ._prompts import CHANNELS, SIZES, Prompts, channels
from ._strip import Strip, strip_input

POINTS = 16
"""Number of points that the first network returns, evenly from base to tip."""
OUTSIDE = 0
"""State of a point outside the image; the others are hidden and seen."""
_MULTIPLE_PX = 32
"""The sides of the network's image are multiples of this."""
DETECTOR_GRAPHS = ("detector.onnx", "line.onnx")
"""Files of the first and the second network in the folder of a fine-tuned detector."""
DETECTOR_FACTS = "detector.json"
"""File in this folder that says how the detector was made."""
_SHIPPED = Path(str(resources.files(__name__.rpartition(".")[0])))
CAMERA_GRAPHS = (_SHIPPED / "locator.int8.onnx", _SHIPPED / "refine.onnx")
"""Both networks that come with tipforce for camera images; the second one reads X-ray images, too."""
XRAY_DETECTOR = _SHIPPED / "xray"
"""Folder of the detector that comes with tipforce for X-ray images; it has a first network of its own."""
FULL_PRECISION = "locator.onnx"
"""File of a first network that comes with tipforce, before it was rounded to 8 bit: fine-tuning begins with it."""


class RoughPoints(NamedTuple):
    """Result of the first network for one image.

    Attributes:
        points: (`POINTS`, 2) u, v in px of the network's image, base to tip; the base is in a stated region.
        mass: (`POINTS`,) probability that the point is within a cell of its peak.
        states: (`POINTS`, 3) probabilities of outside the image, hidden and seen.
        present: probability that a catheter is in the image.
        in_region: probability that the base is in the stated region, by the image; 1 where none is stated.
    """

    points: FloatArray
    mass: FloatArray
    states: FloatArray
    present: float
    in_region: float


class Offsets(NamedTuple):
    """Result of the second network for a strip; each (ALONG,) but the last."""

    offset: FloatArray
    """Distance of the axis along the normal, in diameters."""
    spread: FloatArray
    """Scale of the offset's error (Laplace), in diameters."""
    base: FloatArray
    """Probability that the base is at this station."""
    tip: FloatArray
    """Probability that the tip is at this station."""
    seen: FloatArray
    """Probability that the catheter is visible at this station."""
    right: FloatArray
    """Logit by the image near this station that the strip is the catheter's; their mean is the strip's logit."""
    width: float
    """True diameter over the one that the strip was made with."""


def _graph(folder: Path | None, number: int) -> Any:
    """Returns the graph of the first network (0) or the second (1); a file that has changed is read again."""
    if folder is None or (folder == XRAY_DETECTOR and number == 1):
        return _session(CAMERA_GRAPHS[number])
    path = folder / DETECTOR_GRAPHS[number]
    return _session(path, path.stat().st_mtime_ns)


@cache
def _session(path: Path, _changed_ns: int = 0) -> Any:
    import onnxruntime

    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    options.log_severity_level = 3
    return onnxruntime.InferenceSession(path.read_bytes(), options, providers=["CPUExecutionProvider"])


def rough_points(image: npt.NDArray[np.uint8], prompts: Prompts, network: Path | None = None) -> RoughPoints:
    """Returns the catheter's points in ``image``.

    Args:
        image: (h, w, 3) RGB, in which the catheter should be some 110 px long.
        prompts: in px of ``image``.
        network: folder of a detector; None: the networks that come with tipforce for camera images.
    """
    rows, columns = image.shape[:2]
    bottom, right = -rows % _MULTIPLE_PX, -columns % _MULTIPLE_PX
    padded = cv2.copyMakeBorder(image, 0, bottom, 0, right, cv2.BORDER_REPLICATE)
    values = np.zeros((1, 3 + CHANNELS, *padded.shape[:2]), np.float32)
    values[0, :3] = (padded.transpose(2, 0, 1).astype(np.float32) - 127.0) / 128.0
    planes = channels(prompts, rows, columns)
    values[0, 3:, :rows, :columns] = planes
    sizes = 3 + SIZES[0]
    values[0, sizes:] = planes[SIZES[0] :, :1, :1]  # a size is stated beyond the image's border, too
    heat, states, present = _graph(network, 0).run(None, {"image": values})
    shares = shares_of(heat[0].astype(np.float64))
    in_region = 1.0
    if prompts.region is not None:
        all_of_it = max(float(shares[0].sum()), 1e-12)
        shares[0] *= _cells_in(prompts.region, *shares[0].shape)
        in_region = float(shares[0].sum()) / all_of_it
    points, mass = course(shares)
    likely = softmax(states[0].astype(np.float64), axis=1)
    return RoughPoints(points, mass, likely, float(expit(float(present[0]))), in_region)


def _cells_in(region: Box, rows: int, columns: int) -> npt.NDArray[np.bool_]:
    """Returns (rows, columns): the cells of a heat map that touch ``region``, or the next one."""
    u0, v0, u1, v1 = (edge / STRIDE for edge in region)
    u, v = np.arange(columns), np.arange(rows)
    return ((v > v0 - 2.0) & (v < v1 + 1.0))[:, None] & ((u > u0 - 2.0) & (u < u1 + 1.0))


def refine(strip: Strip, network: Path | None = None) -> Offsets:
    """Reads a strip.

    Args:
        strip: the strip.
        network: folder of a detector; None: the networks that come with tipforce for camera images.

    Raises:
        FileFormatError: an earlier version of tipforce fine-tuned the network.
    """
    values = strip_input(strip.values, strip.inside)[None]
    offset, log_spread, base, tip, seen, right, log_width = _graph(network, 1).run(None, {"strip": values})
    if right.ndim < 2:
        raise FileFormatError(
            f"{network}: an earlier version of tipforce trained this detector; train it again with tipforce annotate"
        )
    return Offsets(
        offset[0].astype(np.float64),
        np.exp(log_spread[0].astype(np.float64)),
        softmax(base[0].astype(np.float64)),
        softmax(tip[0].astype(np.float64)),
        expit(seen[0].astype(np.float64)),
        right[0].astype(np.float64),
        float(np.exp(log_width[0])),
    )
