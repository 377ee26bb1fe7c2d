"""Trains one of the two networks and writes it as a graph.

    python -m bench.keypoints.train coarse V G B F -o DIR [--steps N] [--seed S]
    python -m bench.keypoints.train refine V G B F -o DIR

On two cores 6000 steps of `coarse` take 50 minutes, and 4500 of `refine` 30. DIR/NAME.onnx goes to
src/tipforce/vision/keypoints; DIR/NAME.pt are the weights, DIR/NAME.json the settings.
"""

import argparse
import dataclasses
import json
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import onnx
import torch
from bench.keypoints import coarse, refine
from bench.keypoints.samples import SHARES, Sample, load, split
from torch import Tensor, nn

from tipforce.training import store_in_half_precision

STEPS = {"coarse": 6000, "refine": 4500}
BATCH = {"coarse": 16, "refine": 32}
RATE = 2e-3
INPUT = {"coarse": ("image", (1, 3, 160, 192)), "refine": ("strip", (1, 3, 32, 96))}
OUTPUTS = {"coarse": ["points"], "refine": ["offset", "log_spread", "base", "tip", "right"]}
WORKERS = 2


class _Batches(torch.utils.data.IterableDataset[tuple[Tensor, ...]]):
    """Endless batches of samples that ``draw`` has varied."""

    def __init__(self, samples: list[Sample], draw: Callable[..., Any], batch: int, seed: int) -> None:
        self._by_preset = [[s for s in samples if s.preset == preset] for preset in SHARES]
        self._draw, self._batch, self._seed = draw, batch, seed

    def __iter__(self) -> Iterator[tuple[Tensor, ...]]:
        worker = torch.utils.data.get_worker_info()
        torch.set_num_threads(1)
        rng = np.random.default_rng([self._seed, worker.id if worker else 0])
        shares = np.array(list(SHARES.values())) * [bool(own) for own in self._by_preset]
        while True:
            drawn = []
            for preset in rng.choice(len(SHARES), self._batch, p=shares / shares.sum()):
                own = self._by_preset[preset]
                made = self._draw(own[rng.integers(len(own))], rng)
                drawn.append([getattr(made, field.name) for field in dataclasses.fields(made)])
            yield tuple(torch.from_numpy(np.stack(values)) for values in zip(*drawn, strict=True))


class _Points(nn.Module):
    """The network without the outputs that only its training needs."""

    def __init__(self, network: nn.Module) -> None:
        super().__init__()
        self.network = network

    def forward(self, image: Tensor) -> Tensor:
        return self.network(image)[:, : coarse.POINTS]


def main() -> None:
    """Train and write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("network", choices=list(STEPS))
    parser.add_argument("datasets", nargs="+", type=Path)
    parser.add_argument("-o", dest="out", type=Path, required=True)
    parser.add_argument("--steps", type=int)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    cv2.setNumThreads(1)  # threads of its own would hang in the workers
    name, steps = options.network, options.steps or STEPS[options.network]
    samples = [sample for folder in options.datasets for sample in load(folder)]
    trained, held = split(samples)
    print(f"{len(trained)} images to train on, {len(held)} of other sessions held out", flush=True)
    torch.manual_seed(options.seed)
    network: nn.Module = coarse.Coarse() if name == "coarse" else refine.Refine()
    draw = coarse.window if name == "coarse" else refine.target
    rng = np.random.default_rng(options.seed + 1)
    checks = [draw(sample, rng) for sample in held]
    fields = [field.name for field in dataclasses.fields(checks[0])]
    check = tuple(torch.from_numpy(np.stack([getattr(c, field) for c in checks])) for field in fields)
    began, losses = time.time(), []
    optimizer = torch.optim.AdamW(network.parameters(), lr=RATE, weight_decay=0.03)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimizer, RATE, steps, pct_start=0.08)
    batches = _Batches(trained, draw, BATCH[name], options.seed)
    feed = iter(torch.utils.data.DataLoader(batches, batch_size=None, num_workers=WORKERS, prefetch_factor=4))
    options.out.mkdir(parents=True, exist_ok=True)
    for step in range(1, steps + 1):
        value = _loss(name, network, next(feed))
        optimizer.zero_grad()
        value.backward()
        nn.utils.clip_grad_norm_(network.parameters(), 5.0)
        optimizer.step()
        schedule.step()
        losses.append(value.item())
        if step % 500 == 0 or step == steps:
            network.eval()
            with torch.no_grad():
                few = [tuple(values[k : k + 64] for values in check) for k in range(0, len(held), 64)]
                parts = [_loss(name, network, batch).item() for batch in few]
            network.train()
            took = time.time() - began
            print(f"{step}: {np.mean(losses[-500:]):.3f}, held out {np.mean(parts):.3f}; {took:.0f} s", flush=True)
            torch.save(network.state_dict(), options.out / f"{name}.pt")
    export(name, network, options.out / f"{name}.onnx")
    facts = {"network": name, "steps": steps, "seed": options.seed, "torch": torch.__version__, "samples": len(trained)}
    (options.out / f"{name}.json").write_text(json.dumps(facts, indent=2) + "\n")


def _loss(name: str, network: nn.Module, batch: tuple[Tensor, ...]) -> Tensor:
    found = network(batch[0])
    return coarse.loss(found, *batch[1:]) if name == "coarse" else refine.loss(found, batch[1:])


def export(name: str, network: nn.Module, path: Path) -> None:
    """Writes ``network`` as an ONNX graph of batch 1; sides of an image are free, but divisible by 16."""
    network.eval()
    argument, shape = INPUT[name]
    free = {2: 16 * torch.export.Dim("rows"), 3: 16 * torch.export.Dim("columns")} if name == "coarse" else None
    program = torch.onnx.export(
        _Points(network) if name == "coarse" else network,
        kwargs={argument: torch.zeros(shape)},
        dynamo=True,
        input_names=[argument],
        output_names=OUTPUTS[name],
        dynamic_shapes={argument: free},
        external_data=False,
        verbose=False,
    )
    assert program is not None
    model = program.model_proto
    store_in_half_precision(onnx, model)
    onnx.save(model, str(path))


if __name__ == "__main__":
    main()
