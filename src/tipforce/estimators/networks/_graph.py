"""A trained network as an ONNX graph that can be called."""

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

from ..._system.cores import cores
from ...errors import InputError, MissingExtraError, ModelError
from ._graph_file import check_graph_file
from ._stored_names import current_graph_name

_Arrays = dict[str, npt.NDArray[Any]]
_Shape = tuple[int | None, ...]
_KINDS: dict[str, str] = {"tensor(uint8)": "uint8", "tensor(float)": "float32"}


class Graph:
    """An ONNX graph behind a call: ``graph(image=...)["force_n"]``. It may be called from several threads.

    Args:
        data: the bytes of the graph.
        where: its name in error messages, such as that of the file.
        threads: number of threads; 0: the value of OMP_NUM_THREADS, or one for each core of this process.
        on: the runtime; OpenVINO needs the extra ``[openvino]``.

    Attributes:
        runtime: name and version of the runtime.
        metadata: facts that were stored in the graph at its export.
        inputs: name -> (shape, None where any length is allowed; dtype).
        outputs: their names.

    Raises:
        ModelError: ``data`` is no graph, or one that `check_graph_file` refuses.
        MissingExtraError: OpenVINO is not installed.
    """

    def __init__(
        self, data: bytes, where: str, *, threads: int = 0, on: Literal["onnxruntime", "openvino"] = "onnxruntime"
    ) -> None:
        if on == "openvino" and importlib.util.find_spec("openvino") is None:
            raise MissingExtraError("openvino", extra="openvino")
        runtime = _OpenVino if on == "openvino" else _OnnxRuntime
        self._where = where
        check_graph_file(data, where)
        threads = threads or _default_threads()
        with _as_model_error(where):
            loaded = runtime.load(data, threads)
        self._session = runtime(loaded)
        self.runtime: str = self._session.name
        self.metadata: dict[str, str] = self._session.metadata
        self._stored = {current_graph_name(name): name for name in self._session.inputs}
        self.inputs: dict[str, tuple[_Shape, str]] = {
            name: self._session.inputs[stored] for name, stored in self._stored.items()
        }

        self.outputs = tuple(current_graph_name(name) for name in self._session.outputs)

    def __call__(self, **inputs: npt.NDArray[Any]) -> _Arrays:
        """Returns the outputs by name.

        Raises:
            InputError: an input is missing, unknown, or of the wrong shape or dtype.
        """
        if inputs.keys() != self.inputs.keys():
            missing, unknown = self.inputs.keys() - inputs.keys(), inputs.keys() - self.inputs.keys()
            wrong = [f"lacks the input {name}" for name in sorted(missing)]
            wrong += [f"has no input {name}" for name in sorted(unknown)]
            raise InputError(f"{self._where}: {', '.join(wrong)}; it takes {', '.join(self.inputs)}")
        for name, (shape, kind) in self.inputs.items():
            array = inputs[name]
            fits = len(array.shape) == len(shape) and all(
                expected in (None, got) for expected, got in zip(shape, array.shape, strict=True)
            )
            if not fits or array.dtype != kind:
                raise InputError(
                    f"{self._where}: the input {name} must be {kind} of the shape ({_shape_text(shape)}), "
                    f"got {array.dtype} of the shape ({_shape_text(array.shape)})"
                )
        if len({len(array) for array in inputs.values()}) > 1:
            counts = ", ".join(f"{name} {len(inputs[name])}" for name in self.inputs)
            raise InputError(f"{self._where}: needs as many samples in each input, got {counts}")
        outputs = self._session({self._stored[name]: array for name, array in inputs.items()})
        return {current_graph_name(name): array for name, array in outputs.items()}


@contextmanager
def _as_model_error(where: str) -> Generator[None]:
    """Turns an error of a runtime while it loads a graph into a ModelError: each runtime has its own error types."""
    try:
        yield
    except Exception as error:
        message = str(error).strip() or type(error).__name__
        raise ModelError(
            f"{where}: is damaged or no network's graph ({message.splitlines()[0][:200]}); copy the whole model folder "
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
        self.metadata = dict(session.get_modelmeta().custom_metadata_map)
        self.inputs: dict[str, tuple[_Shape, str]] = {
            each.name: (
                tuple(length if isinstance(length, int) else None for length in each.shape),
                _KINDS.get(each.type, str(each.type)),
            )
            for each in session.get_inputs()
        }
        self.outputs = [each.name for each in session.get_outputs()]

    def __call__(self, inputs: Mapping[str, npt.NDArray[Any]]) -> _Arrays:
        return dict(zip(self.outputs, self._session.run(None, inputs), strict=True))


class _OpenVino:
    @staticmethod
    def load(data: bytes, threads: int) -> Any:
        openvino: Any = importlib.import_module("openvino")
        core = openvino.Core()
        # without the first hint it would compute in bf16 where the processor can, with other results
        exact = {"INFERENCE_PRECISION_HINT": "f32", "PERFORMANCE_HINT": "LATENCY", "INFERENCE_NUM_THREADS": threads}
        model = core.read_model(data)
        return model, core.compile_model(model, "CPU", exact)

    def __init__(self, loaded: Any) -> None:
        model, compiled = loaded
        self._request: Any = compiled.create_infer_request()
        self._lock = threading.Lock()
        self.name = f"OpenVINO {version('openvino')}"
        self.metadata = _openvino_metadata(model)
        self.inputs: dict[str, tuple[_Shape, str]] = {
            each.any_name: (
                tuple(None if length.is_dynamic else length.get_length() for length in each.partial_shape),
                np.dtype(each.element_type.to_dtype()).name,
            )
            for each in model.inputs
        }
        self.outputs: list[str] = [each.any_name for each in model.outputs]

    def __call__(self, inputs: Mapping[str, npt.NDArray[Any]]) -> _Arrays:
        # contiguous and kept alive: it reads them in place
        taken = {name: np.ascontiguousarray(array) for name, array in inputs.items()}
        with self._lock:
            found = self._request.infer(taken)
            return {name: np.array(found[name]) for name in self.outputs}


def _openvino_metadata(model: Any) -> dict[str, str]:
    """Returns the metadata of the graph, which OpenVINO keeps under "framework"."""
    info: Any = model.get_rt_info()
    stored: Any = info["framework"] if "framework" in info else {}  # noqa: SIM401 (it is no dict)
    return {name: str(getattr(value, "value", value)) for name, value in stored.items()}


def _default_threads() -> int:
    stated = os.environ.get("OMP_NUM_THREADS", "")
    if stated.isdigit() and int(stated) > 0:
        return int(stated)
    return cores()


def _shape_text(shape: _Shape) -> str:
    return ", ".join("n" if length is None else str(length) for length in shape)
