"""How a picture's bytes go into the first convolution of an 8-bit graph without becoming numbers in between."""

from typing import Any

import numpy as np

__all__ = ["gathered_in_groups", "pictures_as_bytes"]

_BYTE = np.float32(1.0 / 255.0)
_GROUP = 4
"""With eight the multiplications with the new kernel's zeros cost more than is gained, from three channels on."""


def gathered_in_groups(onnx: Any, model: Any) -> None:
    """Let a first convolution of stride 2 take pixels in groups of four along a row, in place; the answer stays.

    With one to three channels a pixel, gathering the pixels under a large kernel costs far more than multiplying them.
    So a row of w pixels is taken for w / 4 of four times the channels, and one place of the new kernel answers for two
    of the old one. Both are mere readings of the same bytes. Where the graph does not begin with bytes, a division by
    255 and such a convolution, it stays as it is.
    """
    graph = model.graph
    users, makers = _users(graph), _makers(graph)
    constants = {each.name: each for each in graph.initializer}
    for division in [node for node in graph.node if node.op_type == "Div"]:
        convolution, cast = _only(users, division.output[0], "Conv"), makers.get(division.input[0])
        if convolution is None or cast is None or cast.op_type != "Cast" or not _by_255(onnx, constants, division):
            continue
        facing = makers.get(cast.input[0])  # from the picture to (n, channels, h, w)
        if facing is None or facing.op_type not in ("Unsqueeze", "Transpose"):
            continue
        source = next((each for each in graph.input if each.name == facing.input[0]), None)
        options = {each.name: onnx.helper.get_attribute_value(each) for each in convolution.attribute}
        kernel = onnx.numpy_helper.to_array(constants[convolution.input[1]])
        if source is None or not _halves(options, kernel.shape[2:]):
            continue
        _, height, width, *channels = [each.dim_value for each in source.type.tensor_type.shape.dim]
        if height % 2 or width % _GROUP:
            continue
        new, pads = _on_groups(kernel, options.get("pads", [0, 0, 0, 0]))
        del convolution.attribute[:]
        for name, value in (("kernel_shape", new.shape[2:]), ("pads", pads), ("strides", (2, 1))):
            convolution.attribute.append(onnx.helper.make_attribute(name, value))

        def constant(name: str, array: Any) -> str:
            graph.initializer.append(onnx.numpy_helper.from_array(array, f"first/{name}"))
            return f"first/{name}"

        convolution.input[1] = constant("kernel", new)
        if len(convolution.input) > 2:
            bias = onnx.numpy_helper.to_array(constants[convolution.input[2]])
            convolution.input[2] = constant("bias", np.tile(bias, _GROUP // 2))
        node = onnx.helper.make_node
        shape = constant("group_shape", np.array([-1, height, width // _GROUP, _GROUP * (channels or [1])[0]]))
        _insert(
            graph,
            cast,
            node("Reshape", [source.name, shape], ["first/grouped"]),
            node("Transpose", ["first/grouped"], ["first/facing"], perm=[0, 3, 1, 2]),
        )
        cast.input[0] = "first/facing"
        last = _only(users, convolution.output[0], "Relu") or convolution
        apart, last.output[0] = last.output[0], "first/apart"
        shape = constant("pixel_shape", np.array([-1, height // 2, width // 2, kernel.shape[0]]))
        _insert(
            graph,
            users[apart][0],
            node("Transpose", ["first/apart"], ["first/behind"], perm=[0, 2, 3, 1]),
            node("Reshape", ["first/behind", shape], ["first/pixels"]),
            node("Transpose", ["first/pixels"], [apart], perm=[0, 3, 1, 2]),
        )
        if len(users[facing.output[0]]) == 1:
            graph.node.remove(facing)


def pictures_as_bytes(onnx: Any, model: Any) -> None:
    """Replace bytes -> numbers -> a share of 255 -> bytes by the bytes themselves, in place."""
    graph = model.graph
    users, makers = _users(graph), _makers(graph)
    constants = {each.name: each for each in graph.initializer}
    for division in [node for node in graph.node if node.op_type == "Div"]:
        cast, rounding = makers.get(division.input[0]), _only(users, division.output[0], "QuantizeLinear")
        if cast is None or cast.op_type != "Cast" or rounding is None or not _by_255(onnx, constants, division):
            continue
        back = _only(users, rounding.output[0], "DequantizeLinear")
        if back is None:
            continue
        scale, zero = "picture_scale", "picture_zero"
        graph.initializer.extend(
            [onnx.numpy_helper.from_array(np.array(_BYTE), scale), onnx.numpy_helper.from_array(np.uint8(0), zero)]
        )
        del back.input[:]
        back.input.extend([cast.input[0], scale, zero])
        for node in (cast, division, rounding):
            graph.node.remove(node)


def _on_groups(kernel: Any, pads: Any) -> tuple[Any, tuple[int, int, int, int]]:
    """Kernel (o, c, h, w) of stride 2 -> (2 o, 4 c, h, w') of stride (2, 1) on groups of four, and its padding."""
    out, channels, height, width = kernel.shape
    answers = _GROUP // 2
    # which group, and which pixel in it, lies under column j for the k-th answer of a group
    places = [[divmod(2 * k + j - pads[1], _GROUP) for j in range(width)] for k in range(answers)]
    first, last = places[0][0][0], places[-1][-1][0]
    new = np.zeros((answers, out, _GROUP, channels, height, last - first + 1), kernel.dtype)
    for k, row in enumerate(places):
        for j, (group, pixel) in enumerate(row):
            new[k, :, pixel, :, :, group - first] = kernel[:, :, :, j]
    return new.reshape(answers * out, _GROUP * channels, *new.shape[4:]), (pads[0], -first, pads[2], last)


def _halves(options: dict[str, Any], size: tuple[int, ...]) -> bool:
    """Stride 2 without groups and dilation, with padding that makes the answer exactly half as large."""
    pads = options.get("pads", [0, 0, 0, 0])
    return (
        list(options.get("strides", [1, 1])) == [2, 2]
        and options.get("group", 1) == 1
        and list(options.get("dilations", [1, 1])) == [1, 1]
        and options.get("auto_pad", b"NOTSET") == b"NOTSET"
        and all(size[axis] - 2 <= pads[axis] + pads[axis + 2] < size[axis] for axis in (0, 1))
    )


def _insert(graph: Any, before: Any, *nodes: Any) -> None:
    place = list(graph.node).index(before)
    for node in reversed(nodes):
        graph.node.insert(place, node)


def _by_255(onnx: Any, constants: dict[str, Any], division: Any) -> bool:
    by = constants.get(division.input[1])
    return by is not None and bool(np.all(onnx.numpy_helper.to_array(by) == 255.0))


def _users(graph: Any) -> dict[str, list[Any]]:
    found: dict[str, list[Any]] = {}
    for node in graph.node:
        for name in node.input:
            found.setdefault(name, []).append(node)
    return found


def _makers(graph: Any) -> dict[str, Any]:
    return {name: node for node in graph.node for name in node.output}


def _only(users: dict[str, list[Any]], name: str, kind: str) -> Any:
    """The one node that uses ``name``, where it is of this kind."""
    found = users.get(name, [])
    return found[0] if len(found) == 1 and found[0].op_type == kind else None
