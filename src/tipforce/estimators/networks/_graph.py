"""A trained network as a graph that can be called."""

import importlib
import importlib.util
import os
import threading
from collections.abc import Generator, Mapping
from contextlib import contextmanager
from importlib.metadata import version
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from ...errors import InputError, MissingExtraError, ModelError

__all__ = ["Graph"]

_Arrays = dict[str, npt.NDArray[Any]]
_Shape = tuple[int | None, ...]
_KINDS: dict[str, str] = {"tensor(uint8)": "uint8", "tensor(float)": "float32"}


class Graph:
    """An ONNX graph behind a call: ``graph(picture=...)["force_n"]``.

    ``data``: the graph's bytes. ``where``: what messages call it, such as the file's name. ``threads``: on how many it
    runs; 0: one for each core that this process may use. ``on``: what runs it; OpenVINO needs the extra
    ``[openvino]``. ``runtime`` names that and its version. ``facts``: what was noted in the graph when it was exported.
    It may be called from several threads. Raises ModelError where ``data`` is no graph, MissingExtraError where
    OpenVINO is wanted and not there.
    """

    def __init__(
        self, data: bytes, where: str, *, threads: int = 0, on: Literal["onnxruntime", "openvino"] = "onnxruntime"
    ) -> None:
        if on == "openvino" and importlib.util.find_spec("openvino") is None:
            raise MissingExtraError("openvino", extra="openvino")
        runs = _OpenVino if on == "openvino" else _OnnxRuntime
        self._where = where
        threads = threads or _cores()
        with _naming(where):
            loaded = runs.load(data, threads)
        self._runs = runs(loaded)
        self.runtime: str = self._runs.name
        self.facts: dict[str, str] = self._runs.facts
        self.inputs: dict[str, tuple[_Shape, str]] = self._runs.inputs
        """Name -> (shape, None where any length goes; dtype)."""

    def __call__(self, **inputs: npt.NDArray[Any]) -> _Arrays:
        """Name -> array of each output. Raises InputError where an input is missing, unknown, or of the wrong form."""
        if inputs.keys() != self.inputs.keys():
            missing, unknown = self.inputs.keys() - inputs.keys(), inputs.keys() - self.inputs.keys()
            wrong = [f"lacks the input {name}" for name in sorted(missing)]
            wrong += [f"has no input {name}" for name in sorted(unknown)]
            raise InputError(f"{self._where}: {', '.join(wrong)}; it takes {', '.join(self.inputs)}")
        for name, (shape, kind) in self.inputs.items():
            array = inputs[name]
            fits = len(array.shape) == len(shape) and all(
                wanted in (None, got) for wanted, got in zip(shape, array.shape, strict=True)
            )
            if not fits or array.dtype != kind:
                raise InputError(
                    f"{self._where}: the input {name} must be {kind} of the shape ({_told(shape)}), "
                    f"got {array.dtype} of the shape ({_told(array.shape)})"
                )
        if len({len(array) for array in inputs.values()}) > 1:
            counts = ", ".join(f"{name} {len(inputs[name])}" for name in self.inputs)
            raise InputError(f"{self._where}: needs as many samples in each input, got {counts}")
        return self._runs(inputs)


@contextmanager
def _naming(where: str) -> Generator[None]:
    """Makes a ModelError of what a runtime raises while it loads a graph: each has types of its own."""
    try:
        yield
    except Exception as error:
        said = str(error).strip() or type(error).__name__
        raise ModelError(
            f"{where}: is damaged or no network's graph ({said.splitlines()[0][:200]}); copy the whole model folder "
            "again, or train the model again"
        ) from None


class _OnnxRuntime:
    @staticmethod
    def load(data: bytes, threads: int) -> Any:
        import onnxruntime

        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = threads
        options.inter_op_num_threads = 1
        options.log_severity_level = 3
        return onnxruntime.InferenceSession(data, options, providers=["CPUExecutionProvider"])

    def __init__(self, session: Any) -> None:
        self._session = session
        self.name = f"onnxruntime {version('onnxruntime')}"
        self.facts = dict(session.get_modelmeta().custom_metadata_map)
        self.inputs: dict[str, tuple[_Shape, str]] = {
            each.name: (
                tuple(length if isinstance(length, int) else None for length in each.shape),
                _KINDS.get(each.type, str(each.type)),
            )
            for each in session.get_inputs()
        }
        self._outputs = [each.name for each in session.get_outputs()]

    def __call__(self, inputs: Mapping[str, npt.NDArray[Any]]) -> _Arrays:
        return dict(zip(self._outputs, self._session.run(None, inputs), strict=True))


class _OpenVino:
    @staticmethod
    def load(data: bytes, threads: int) -> Any:
        openvino: Any = importlib.import_module("openvino")
        core = openvino.Core()
        # without the first hint it would calculate in bf16 where the processor can, and answer otherwise
        exact = {"INFERENCE_PRECISION_HINT": "f32", "PERFORMANCE_HINT": "LATENCY", "INFERENCE_NUM_THREADS": threads}
        model = core.read_model(data)
        return model, core.compile_model(model, "CPU", exact)

    def __init__(self, loaded: Any) -> None:
        model, compiled = loaded
        self._request: Any = compiled.create_infer_request()
        self._one_at_a_time = threading.Lock()
        self.name = f"OpenVINO {version('openvino')}"
        self.facts = _facts(model)
        self.inputs: dict[str, tuple[_Shape, str]] = {
            each.any_name: (
                tuple(None if length.is_dynamic else length.get_length() for length in each.partial_shape),
                np.dtype(each.element_type.to_dtype()).name,
            )
            for each in model.inputs
        }
        self._outputs: list[str] = [each.any_name for each in model.outputs]

    def __call__(self, inputs: Mapping[str, npt.NDArray[Any]]) -> _Arrays:
        # contiguous and kept: it would read them where they lie
        taken = {name: np.ascontiguousarray(array) for name, array in inputs.items()}
        with self._one_at_a_time:
            found = self._request.infer(taken)
            return {name: np.array(found[name]) for name in self._outputs}


def _facts(model: Any) -> dict[str, str]:
    """What was noted in the graph, which OpenVINO keeps under "framework"."""
    info: Any = model.get_rt_info()
    noted: Any = info["framework"] if "framework" in info else {}  # noqa: SIM401 (it is no dict)
    return {name: str(getattr(value, "value", value)) for name, value in noted.items()}


def _cores() -> int:
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def _told(shape: _Shape) -> str:
    return ", ".join("n" if length is None else str(length) for length in shape)
