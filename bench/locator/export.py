"""Exports a checkpoint of the locator to an ONNX graph, and says how far its outputs are from the network's.

    python -m bench.locator.export DIR/locator.pt OUT.onnx [--mean-with BEGUN.onnx]
        [--eight-bit OUT8.onnx --checks DIR/checks.npz [--xray]]

The running mean of the weights in DIR/locator.pt, the state of a training, is exported; with ``--mean-with`` the mean
of these and of the weights that the training began with (Wortsman et al., Robust fine-tuning of zero-shot models, CVPR
2022). Large weights are stored in half precision: the graph is compared with the network that has the stored ones.
Input and outputs of the graph: see ``tipforce.training.locator.export_locator``. The graph in 8 bits is calibrated on
drawn windows, with ``--xray`` only X-ray images, and is written only where it finds at most 1 % fewer lines in the
windows of DIR/checks.npz (``python -m bench.locator.feed``).
"""

import argparse
import tempfile
import time
from collections.abc import Iterable
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import onnxruntime
import torch
from bench.locator import feed
from bench.locator.scene import XRAY_SHARE
from bench.locator.train import figures, read_weights

from tipforce.training._quantisation import fold_batch_norms, quantise_nodes
from tipforce.training.locator import (
    GRAPH_OUTPUTS,
    PROMPT_CHANNELS,
    PROMPT_FIELDS,
    WINDOW_FIELDS,
    Locator,
    export_locator,
    network_input,
    prompt_channels,
)

MAX_DEVIATION = 1e-3
"""Largest difference between the outputs of graph and network, in logits."""
MAX_LOST_LINES = 0.01
"""Largest share of the lines that the graph in 8 bits may lose."""
CALIBRATION_WINDOWS = 96
CALIBRATION_SEED = 1
QUANTISED = ("Conv", "Add", "Clip", "Relu", "Concat", "Resize", "AveragePool")
"""Operators of the graph that are computed in 8 bits."""
FIRST_CONVOLUTIONS = 6
"""The first convolutions stay in single precision, as the last one does: their large images take as long to round as to
convolve, and in photographs of real catheters the rounding lost small ones."""


def mean_network(one: Locator, other: Locator) -> Locator:
    """Returns the network with the mean of the weights of two networks."""
    mean, first, second = Locator(), one.state_dict(), other.state_dict()
    mean.load_state_dict(
        {name: 0.5 * (value + second[name]) if value.is_floating_point() else value for name, value in first.items()}
    )
    return mean.eval()


def deviation(graph: bytes, network: Locator) -> float:
    """Returns the largest difference between the outputs of ``graph`` and ``network``, over images of two sizes."""
    session = onnxruntime.InferenceSession(graph, providers=["CPUExecutionProvider"])
    generator, largest = torch.Generator().manual_seed(0), 0.0
    for size in ((256, 320), (192, 96)):
        image = torch.randn((1, 3 + PROMPT_CHANNELS, *size), generator=generator)
        with torch.inference_mode():
            outputs = network(image)
        for name, values in zip(GRAPH_OUTPUTS, session.run(list(GRAPH_OUTPUTS), {"image": image.numpy()}), strict=True):
            largest = max(largest, float(np.abs(values - getattr(outputs, name).numpy()).max()))
    return largest


def quantise_locator(graph: bytes, batches: Iterable[npt.NDArray[Any]]) -> bytes:
    """Returns a graph of `export_locator` in 8 bits, but for its first convolutions and its last one.

    Args:
        graph: the graph in single precision.
        batches: calibration batches (n, 3 + PROMPT_CHANNELS, h, w) float32, typical inputs; some 64 images.

    Raises:
        MissingExtraError: onnx is not installed.
    """
    model = fold_batch_norms(graph)
    nodes = list(model.graph.node)
    convolutions = [k for k, node in enumerate(nodes) if node.op_type == "Conv"]
    excluded = [node.name for node in (*nodes[: convolutions[FIRST_CONVOLUTIONS]], *nodes[convolutions[-1] :])]
    inputs = ({"image": batch} for batch in batches)
    return quantise_nodes(model, inputs, excluded, kinds=QUANTISED, cut_outliers=True).SerializeToString()


def calibration_inputs(count: int, *, xray: bool = False) -> list[npt.NDArray[np.float32]]:
    """Returns inputs (1, 3 + PROMPT_CHANNELS, WINDOW_PX, WINDOW_PX) of windows, half of them of the presets.

    Args:
        count: number of windows.
        xray: whether all of them are X-ray images.
    """
    rng = np.random.default_rng(CALIBRATION_SEED)
    scenes = feed.scene_windows(rng, 1.0 if xray else XRAY_SHARE)
    both = scenes, feed.preset_windows(rng, CALIBRATION_SEED, feed.image_shares(1.0 if xray else None))
    windows = [
        one for source, every in zip(both, (1, 8), strict=True) for one in islice(source, 0, every * count // 2, every)
    ]
    return [_inputs({name: getattr(window, name)[None] for name in WINDOW_FIELDS}) for window in windows]


def share_of_lines(graph: bytes, checks: Path) -> tuple[float, float]:
    """Returns the share of lines that ``graph`` finds in the windows of ``checks``, and its median CPU time in ms."""
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = 1
    session = onnxruntime.InferenceSession(graph, options, providers=["CPUExecutionProvider"])
    with np.load(checks) as held:
        values = {name: held[name] for name in WINDOW_FIELDS}
    rows, times_ms = [], []
    for k in range(len(values["facts"])):
        one = {name: each[k : k + 1] for name, each in values.items()}
        image, began = _inputs(one), time.process_time()
        heat, states, present = (torch.from_numpy(each) for each in session.run(list(GRAPH_OUTPUTS), {"image": image}))
        times_ms.append(1e3 * (time.process_time() - began))
        found = figures(
            (heat, None, None, states, present), {name: torch.from_numpy(each) for name, each in one.items()}
        )
        if one["facts"][0, 0] > 0.5:
            rows.append(float(found["lines"][0]))
    return float(np.nanmean(rows)), float(np.median(times_ms))


def _inputs(batch: dict[str, npt.NDArray[np.float32]]) -> npt.NDArray[np.float32]:
    tensors = {name: torch.from_numpy(np.ascontiguousarray(values)) for name, values in batch.items()}
    channels = prompt_channels(tensors["image"].shape[1:3], *(tensors[name] for name in PROMPT_FIELDS))
    return network_input(tensors["image"], channels).numpy()


def main() -> None:
    """Exports the checkpoint."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("checkpoint", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--mean-with", type=Path, help="graph or state of the network whose weights count half")
    parser.add_argument("--eight-bit", type=Path, help="also write the graph in 8 bits to this file")
    parser.add_argument("--checks", type=Path, help="windows that judge the graph in 8 bits")
    parser.add_argument("--xray", action="store_true", help="calibrate the graph in 8 bits on X-ray images")
    options = parser.parse_args()
    if (options.eight_bit is None) != (options.checks is None):
        parser.error("--eight-bit and --checks belong together")
    network = read_weights(options.checkpoint)
    if options.mean_with is not None:
        network = mean_network(network, read_weights(options.mean_with))
    graph = export_locator(network)
    with tempfile.TemporaryDirectory(prefix="tipforce-") as folder:
        stored = Path(folder) / "stored.onnx"
        stored.write_bytes(graph)
        largest = deviation(graph, read_weights(stored))
    if not largest < MAX_DEVIATION:
        raise SystemExit(f"the graph differs from the network by {largest:.2g}; allowed is {MAX_DEVIATION}")
    options.out.write_bytes(graph)
    print(f"{options.out}: {len(graph) / 1e6:.1f} MB, outputs within {largest:.1g} of the network's")
    if options.eight_bit:
        quantised = quantise_locator(graph, calibration_inputs(CALIBRATION_WINDOWS, xray=options.xray))
        (single, single_ms), (eight, eight_ms) = (share_of_lines(each, options.checks) for each in (graph, quantised))
        print(
            f"single precision: {single:.2%} of the lines, {single_ms:.1f} ms; 8 bits: {eight:.2%}, {eight_ms:.1f} ms"
        )
        if not single - eight <= MAX_LOST_LINES:
            raise SystemExit(f"8 bits lose {single - eight:.2%} of the lines; allowed are {MAX_LOST_LINES:.0%}")
        options.eight_bit.write_bytes(quantised)
        print(f"{options.eight_bit}: {len(quantised) / 1e6:.1f} MB")


if __name__ == "__main__":
    main()
