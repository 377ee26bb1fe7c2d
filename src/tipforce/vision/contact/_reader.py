"""Reads the geometry of the contact with the network that comes with tipforce."""

import math
from functools import cache
from importlib import resources
from typing import Any

import numpy as np

from ...types import DetectedShape, FloatArray, Image
from ._crop import crop_tip
from ._reading import ContactReading

_AXIS_M = 4e-3
"""Length of the end of the line whose chord is the tip's axis."""
_LARGEST_TIP_STD_M = 1e-3
"""A tip that is known less exactly is not read: readings at hidden tips made wrong intervals narrower (docs/log.md)."""


def tip_axis(points_px: FloatArray, metres_per_px: float) -> float:
    """Returns the direction of the tip's axis, from u towards v, rad.

    Args:
        points_px: (n, 2) centreline from base to tip.
        metres_per_px: scale of the points: 1 if they are in m.
    """
    apart = points_px[-1] - points_px
    far = np.flatnonzero(np.hypot(apart[:, 0], apart[:, 1]) * metres_per_px > _AXIS_M)
    u, v = apart[far[-1] if len(far) else 0].tolist()
    return math.atan2(v, u)


class ContactReader:
    """Reads images one by one."""

    def __init__(self) -> None:
        self._graph = _graph()

    def read(self, image: Image, shape: DetectedShape, metres_per_px: float) -> ContactReading | None:
        """Returns the geometry at the tip of a detected catheter; None where the position of the tip is not known.

        Args:
            image: (h, w) or (h, w, 3) uint8.
            shape: the catheter in it.
            metres_per_px: scale of the image.
        """
        if shape.centreline is None or shape.tip_std_px * metres_per_px > _LARGEST_TIP_STD_M:
            return None
        points = shape.centreline.points
        crop = crop_tip(image, points[-1], tip_axis(points, metres_per_px), metres_per_px)
        (outputs,) = self._graph.run(None, {"image": crop[None, None].astype(np.float32) / 255.0})
        return ContactReading.of(outputs[0])


@cache
def _graph() -> Any:
    import onnxruntime

    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    options.log_severity_level = 3
    data = resources.files(__name__.rpartition(".")[0]).joinpath("contact.onnx").read_bytes()
    return onnxruntime.InferenceSession(data, options, providers=["CPUExecutionProvider"])
