"""A trained network as an ONNX graph that can be called."""

import os
from collections.abc import Generator
from contextlib import contextmanager
from typing import Any

import numpy.typing as npt

from ..._system.cores import cores
from ...errors import InputError, ModelError
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

    Attributes:
        inputs: name -> (shape, None where any length is allowed; dtype).
        outputs: their names.

    Raises:
        ModelError: ``data`` is no graph, or one that `check_graph_file` refuses.
    """

    def __init__(self, data: bytes, where: str, *, threads: int = 0) -> None:
        self._where = where
        check_graph_file(data, where)
        with _as_model_error(where):
            self._session = _session(data, threads or _default_threads())
        given = {each.name: each for each in self._session.get_inputs()}
        self._stored = {current_graph_name(name): name for name in given}
        self.inputs: dict[str, tuple[_Shape, str]] = {
            name: (
                tuple(length if isinstance(length, int) else None for length in given[stored].shape),
                _KINDS.get(given[stored].type, str(given[stored].type)),
            )
            for name, stored in self._stored.items()
        }
        self.outputs = tuple(current_graph_name(each.name) for each in self._session.get_outputs())

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
        found = self._session.run(None, {self._stored[name]: array for name, array in inputs.items()})
        return dict(zip(self.outputs, found, strict=True))


@contextmanager
def _as_model_error(where: str) -> Generator[None]:
    """Turns an error of the runtime while it loads a graph into a ModelError: it has several error types."""
    try:
        yield
    except Exception as error:
        message = str(error).strip() or type(error).__name__
        raise ModelError(
            f"{where}: is damaged or no network's graph ({message.splitlines()[0][:200]}); copy the whole model folder "
            "again, or train the model again"
        ) from None


def _session(data: bytes, threads: int) -> Any:
    import onnxruntime

    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = threads
    options.inter_op_num_threads = 1
    options.log_severity_level = 3
    return onnxruntime.InferenceSession(data, options, providers=["CPUExecutionProvider"])


def _default_threads() -> int:
    stated = os.environ.get("OMP_NUM_THREADS", "")
    if stated.isdigit() and int(stated) > 0:
        return int(stated)
    return cores()


def _shape_text(shape: _Shape) -> str:
    return ", ".join("n" if length is None else str(length) for length in shape)
