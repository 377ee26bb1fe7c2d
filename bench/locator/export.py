"""Exports a checkpoint of the locator to an ONNX graph, and says how far its outputs are from the network's.

    python -m bench.locator.export CHECKPOINT.pt OUT.onnx

CHECKPOINT.pt is bench/locator/checkpoint.pt or the DIR/locator.pt of a training, of which the running mean of the
weights is exported. Input and outputs of the graph: see ``tipforce.training.locator.export_locator``.
"""

import argparse
from pathlib import Path

import numpy as np
import onnxruntime
import torch

from tipforce.training.locator import GRAPH_OUTPUTS, PROMPT_CHANNELS, Locator, export_locator, read_checkpoint

MAX_DEVIATION = 1e-3
"""Largest difference between the outputs of graph and network, in logits."""


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


def main() -> None:
    """Exports the checkpoint."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("checkpoint", type=Path)
    parser.add_argument("out", type=Path)
    options = parser.parse_args()
    network = read_checkpoint(options.checkpoint)
    graph = export_locator(network)
    largest = deviation(graph, network)
    if not largest < MAX_DEVIATION:
        raise SystemExit(f"the graph differs from the network by {largest:.2g}; allowed is {MAX_DEVIATION}")
    options.out.write_bytes(graph)
    print(f"{options.out}: {len(graph) / 1e6:.1f} MB, outputs within {largest:.1g} of the network's")


if __name__ == "__main__":
    main()
