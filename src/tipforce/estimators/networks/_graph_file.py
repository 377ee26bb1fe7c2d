"""Checks the file of a graph before a runtime loads it: operators, initialisers, external data.

An ONNX file is a protocol buffer (``onnx.proto``: ModelProto, GraphProto, NodeProto, AttributeProto, TensorProto). The
few fields that matter here are read from its bytes, because the package onnx is needed for export only.
"""

from collections.abc import Iterator

from ...errors import ModelError

MAX_GRAPH_BYTES = 1 << 29
"""Largest file of a graph; that of `dcfe` has 22 MB."""
MAX_FIELDS = 1_000_000
"""Largest number of fields of the protocol buffer; that of `dcfe` has 2000."""

# fmt: off
OPERATORS = frozenset((
    "Abs", "Add", "AveragePool", "BatchNormalization", "Cast", "CastLike", "Ceil", "Clip", "Concat", "Constant",
    "Conv", "DequantizeLinear", "Div", "Dropout", "Elu", "Equal", "Erf", "Exp", "Expand", "Flatten", "Floor",
    "Gather", "Gelu", "Gemm", "GlobalAveragePool", "GlobalMaxPool", "GreaterOrEqual", "Greater",
    "GroupNormalization", "HardSigmoid", "HardSwish", "Identity", "InstanceNormalization", "LayerNormalization",
    "LeakyRelu", "Less", "LessOrEqual", "Log", "LogSoftmax", "MatMul", "Max", "MaxPool", "Mean", "Min", "Mish",
    "Mul", "Neg", "Not", "PRelu", "Pad", "Pow", "QLinearConv", "QLinearMatMul", "QuantizeLinear", "Reciprocal",
    "ReduceMax", "ReduceMean", "ReduceMin", "ReduceSum", "Relu", "Reshape", "Resize", "Round", "Selu", "Shape",
    "Sigmoid", "Sign", "Slice", "Softmax", "Softplus", "Split", "Sqrt", "Squeeze", "Sub", "Sum", "Tanh",
    "Transpose", "Unsqueeze", "Where",
))
# fmt: on
"""Permitted operators: neither loops nor branches, nothing random, and no operators of other domains."""

_MAX_DIMENSIONS = 16


def check_graph_file(data: bytes, where: str) -> None:
    """Checks the bytes of a graph.

    Args:
        data: the bytes.
        where: its name in error messages.

    Raises:
        ModelError: it is too long, no graph, has operators that are not among `OPERATORS`, functions of its own, more
            than one graph, data in other files, or tensors that claim more values than are in the file.
    """
    if len(data) > MAX_GRAPH_BYTES:
        raise ModelError(f"{where}: has {len(data)} bytes, more than {MAX_GRAPH_BYTES}, which no model here needs")
    try:
        _Check(where).model(memoryview(data))
    except (IndexError, ValueError) as error:
        raise ModelError(
            f"{where}: is damaged or no network's graph ({error}); copy the whole model folder again, or train the "
            "model again"
        ) from None


class _Check:
    """Walks through the messages of one file, each a memoryview. Raises IndexError or ValueError for damage.

    The numbers are those of the fields in ``onnx.proto``.
    """

    def __init__(self, where: str) -> None:
        self._where = where
        self._fields_left = MAX_FIELDS

    def model(self, model: memoryview) -> None:
        """Checks a ModelProto: one graph (field 7), neither training steps (20) nor functions (25)."""
        graphs = 0
        for number, value in self._fields(model):
            if number in (20, 25):
                raise self._refused("has functions or training steps of its own")
            if number == 7:
                graphs += 1
                self._graph(_message(value))
        if graphs != 1:
            raise ValueError("no graph, or several that would be merged")

    def _graph(self, graph: memoryview) -> None:
        """Checks a GraphProto: its nodes (field 1) and initialisers (5); sparse ones (15) are refused."""
        for number, value in self._fields(graph):
            if number == 1:
                self._node(_message(value))
            elif number == 5:
                self._tensor(_message(value))
            elif number == 15:
                raise self._refused("has sparse tensors")

    def _node(self, node: memoryview) -> None:
        """Checks a NodeProto: operator (field 4) and domain (7) are permitted, and its attributes (5) pass."""
        kind = domain = b""
        for number, value in self._fields(node):
            if number == 4:
                kind = bytes(_message(value))
            elif number == 7:
                domain = bytes(_message(value))
            elif number == 5:
                self._attribute(_message(value))
        name = kind.decode("ascii", "backslashreplace")
        if domain not in (b"", b"ai.onnx") or name not in OPERATORS:
            full = f"{domain.decode('ascii', 'backslashreplace')}.{name}" if domain else name
            raise self._refused(f"has the operator {full[:100]!r}")

    def _attribute(self, attribute: memoryview) -> None:
        for number, value in self._fields(attribute):
            if number in (5, 10):
                self._tensor(_message(value))
            elif number in (6, 11, 22, 23):
                raise self._refused("has graphs or sparse tensors within its operators")

    def _tensor(self, tensor: memoryview) -> None:
        """Checks a TensorProto: its dimensions (field 1), and no data in other files (13, 14).

        A value takes at least a byte, so a tensor cannot have more values than its message has bytes.
        """
        lengths: list[int] = []
        for number, value in self._fields(tensor):
            if number == 1:
                lengths += [value] if isinstance(value, int) else _first_numbers(value)
            elif number == 13 or (number == 14 and value != 0):
                raise self._refused("keeps data in other files")
        values = 1
        for length in lengths:
            values = min(values * length, 1 << 63)
        if values > len(tensor) or len(lengths) > _MAX_DIMENSIONS:
            claimed = " x ".join(str(length) for length in lengths[:_MAX_DIMENSIONS])
            raise ModelError(
                f"{self._where}: a tensor claims {claimed} values, but has {len(tensor)} bytes; copy the whole model "
                "folder again"
            )

    def _fields(self, message: memoryview) -> Iterator[tuple[int, memoryview | int]]:
        """Yields number and value of each field of a message: an integer, or bytes.

        A field begins with a key: its number, and in the last three bits the wire type, which gives the length of the
        value.
        """
        position = 0
        while position < len(message):
            self._fields_left -= 1
            if self._fields_left < 0:
                raise ModelError(f"{self._where}: has more than {MAX_FIELDS} fields, which no model here needs")
            key, position = _varint(message, position)
            number, wire_type = key >> 3, key & 7
            if wire_type == 0:
                value, position = _varint(message, position)
                yield number, value
                continue
            if wire_type == 2:  # bytes, after their length
                length, position = _varint(message, position)
            elif wire_type in (1, 5):  # 64 and 32 bits
                length = 8 if wire_type == 1 else 4
            else:
                raise ValueError(f"wire type {wire_type}")
            if position + length > len(message):
                raise ValueError("cut off")
            yield number, message[position : position + length]
            position += length

    def _refused(self, finding: str) -> ModelError:
        return ModelError(
            f"{self._where}: {finding}; graphs that `tipforce train` writes have none: train the model again"
        )


def _message(value: memoryview | int) -> memoryview:
    if isinstance(value, int):
        raise ValueError("a number where a message belongs")
    return value


def _first_numbers(packed: memoryview) -> list[int]:
    """Returns the first of the packed numbers, one more than the largest number of dimensions."""
    numbers: list[int] = []
    position = 0
    while position < len(packed) and len(numbers) <= _MAX_DIMENSIONS:
        value, position = _varint(packed, position)
        numbers.append(value)
    return numbers


def _varint(message: memoryview, position: int) -> tuple[int, int]:
    """Returns the integer at a position, and the position behind it: 7 bits a byte, the last byte below 128."""
    value = 0
    for shift in range(0, 70, 7):
        byte = message[position]
        position += 1
        value |= (byte & 0x7F) << shift
        if byte < 0x80:
            return value, position
    raise ValueError("a number of more than ten bytes")
