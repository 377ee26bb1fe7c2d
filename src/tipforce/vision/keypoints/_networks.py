"""The two trained networks as ONNX graphs, loaded when first used."""

from functools import cache
from importlib import resources
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from ...types import FloatArray
from ._strip import Strip, strip_input

_Float32 = npt.NDArray[np.float32]


class Offsets(NamedTuple):
    """Result of the second network for a strip; each (ALONG,) but ``right``."""

    offset: FloatArray
    """Distance of the axis along the normal, in diameters."""
    spread: FloatArray
    """Scale of the offset's error (Laplace), in diameters."""
    base: FloatArray
    """Probability that the base is at this station."""
    tip: FloatArray
    right: float
    """Logit: the strip is the catheter's."""


@cache
def _graph(name: str) -> Any:
    import onnxruntime

    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    options.log_severity_level = 3
    data = (resources.files(__name__.rpartition(".")[0]) / f"{name}.onnx").read_bytes()
    return onnxruntime.InferenceSession(data, options, providers=["CPUExecutionProvider"])


def coarse(image: _Float32) -> FloatArray:
    """(3, h, w) as `normalised` makes it -> (k, h / 4, w / 4): logits of the k points, evenly from base to tip.

    A logit of 0 is as likely as that the point is not in the image.
    """
    return _graph("coarse").run(None, {"image": image[None]})[0][0].astype(np.float64)


def refine(strip: Strip) -> Offsets:
    """Reads ``strip``."""
    values = strip_input(strip.values, strip.inside)[None]
    offset, log_spread, base, tip, right = _graph("refine").run(None, {"strip": values})
    return Offsets(
        offset[0].astype(np.float64),
        np.exp(log_spread[0].astype(np.float64)),
        _softmax(base[0].astype(np.float64)),
        _softmax(tip[0].astype(np.float64)),
        float(right[0]),
    )


def _softmax(logits: FloatArray) -> FloatArray:
    weights = np.exp(logits - logits.max())
    return weights / weights.sum()
