"""The line network: the axis, its visibility, base, tip and diameter in the image straightened along a rough line.

    python -m bench.locator.line -o DIR [--steps N] [--seed S] [--resume] [--begin refine.onnx --rate R]

Its strips come from the compositor (four in ten) and from the presets' renderers at their own resolution. Half of them
are along the true line with errors like those of the locator, or along another line. The others are along a line that
the shipped locator finds with random prompts: so the network judges the lines that it will read, right and wrong ones.
DIR/line.pt holds weights and optimiser every 250 steps; ``--resume`` continues. DIR/refine.onnx goes to
src/tipforce/vision/locator. ``--begin`` starts from the weights of such a file, with a smaller ``--rate``; refine.onnx
then has the mean of the first and the trained weights, which is surer in images unlike those of the training (Wortsman
et al., Robust fine-tuning of zero-shot models, CVPR 2022).
"""

import argparse
import json
import math
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt
import onnx
import torch
from bench.locator import scene
from bench.locator.feed import labelled_images
from bench.locator.tubes import Drawer
from torch import Tensor, nn

from tipforce.geometry import arc_length
from tipforce.training import store_in_half_precision
from tipforce.training.locator import (
    SEEN,
    STRIP_FIELDS,
    WINDOW_PX,
    FoundLine,
    LineNetwork,
    StripSource,
    StripTarget,
    line_loss,
    line_network_from_graph,
    strip_target,
)
from tipforce.vision.locator import ACROSS, ALONG, Prompts, locate, read_points

PRESENT_SHARE = 0.5
"""Share of the scenes with a catheter that are used: one in seven is without, then."""
FOUND_POINTS = 160
"""Number of points of a line that the locator finds."""
ANYWHERE_LINES = 2
"""Number of lines of an image that begin at any point."""
LENGTH_ERROR, ANY_LENGTH_ERROR, ANY_LENGTH_SHARE = 0.1, 0.5, 0.3
"""Standard deviation of the logarithm of a stated length, and the larger one of this share of the lines."""
SCENE_SHARE = 0.4
"""Share of the strips from the compositor."""
RATE, BATCH, STEPS, WORKERS = 2e-3, 32, 9500, 2
STRIPS_PER_SCENE, STRIPS_PER_IMAGE, RESERVOIR_IMAGES = 15, 40, 300
CHECKS, CHECKS_SEED = 512, 900_000
OUTPUTS = ["offset", "log_spread", "base", "tip", "seen", "right", "log_width"]


def found_lines(image: npt.NDArray[np.uint8], length_px: float, rng: np.random.Generator) -> tuple[FoundLine, ...]:
    """Returns lines that the locator finds in ``image``: from the objects that it sees, and from any point.

    Args:
        image: (h, w, 3).
        length_px: length of the catheter; a prompt states it with an error, or another one.
        rng: source of the prompts.
    """
    rows, columns = image.shape[:2]
    seen = Prompts(length_px=_unsure(length_px, rng))
    rough = read_points(image, seen)
    tried = [replace(seen, base_px=rough.points[0]), replace(seen, near_px=rough.points[1])]
    anywhere = rng.uniform((0.0, 0.0), (columns - 1.0, rows - 1.0), (ANYWHERE_LINES, 2))
    tried += [Prompts(base_px=base, length_px=_unsure(length_px, rng)) for base in anywhere]
    lines = (locate(image, prompts, FOUND_POINTS) for prompts in tried)
    return tuple(FoundLine(line.points, line.diameter_px) for line in lines if line is not None)


def _unsure(length_px: float, rng: np.random.Generator) -> float:
    """Returns ``length_px`` with an error."""
    spread = ANY_LENGTH_ERROR if rng.random() < ANY_LENGTH_SHARE else LENGTH_ERROR
    return length_px * math.exp(rng.normal(0.0, spread))


def _scenes(rng: np.random.Generator) -> Iterator[StripSource]:
    drawer = Drawer(WINDOW_PX, WINDOW_PX)
    while True:
        drawn = scene.draw(rng, drawer, WINDOW_PX)
        if not drawn.present or (rng.random() < PRESENT_SHARE and (drawn.state == SEEN).mean() > 0.4):
            length = float(arc_length(drawn.line)[-1])
            found = found_lines(drawn.image, length, rng)
            yield StripSource(drawn.image, drawn.line, drawn.state, drawn.diameter_px, drawn.present, found)


def _presets(rng: np.random.Generator, seed: int) -> Iterator[StripSource]:
    for drawn in labelled_images(rng, seed):
        found = found_lines(drawn.image, float(arc_length(drawn.line_px)[-1]), rng)
        yield StripSource(drawn.image, drawn.line_px, drawn.state, drawn.diameter_px, found=found)


class _Strips(torch.utils.data.IterableDataset[dict[str, Tensor]]):
    """Endless batches of strips."""

    def __init__(self, seed: int, batch: int) -> None:
        self._seed, self._batch = seed, batch

    def __iter__(self) -> Iterator[dict[str, Tensor]]:
        worker = torch.utils.data.get_worker_info()
        torch.set_num_threads(1)
        cv2.setNumThreads(1)
        number = worker.id if worker else 0
        rng = np.random.default_rng([self._seed, number, 5])
        streams = _scenes(rng), _presets(rng, self._seed + 1000 * (number + 1))
        kept: tuple[list[StripSource], list[StripSource]] = ([], [])
        while True:
            drawn: list[StripTarget] = []
            while len(drawn) < self._batch:
                which = int(rng.random() > SCENE_SHARE)
                own = kept[which]
                if len(own) < 12 or rng.random() < 1.0 / (STRIPS_PER_IMAGE if which else STRIPS_PER_SCENE):
                    own.append(next(streams[which]))
                    if len(own) > RESERVOIR_IMAGES:
                        own.pop(int(rng.integers(RESERVOIR_IMAGES)))
                drawn.append(strip_target(own[int(rng.integers(len(own)))], rng))
            yield {name: torch.from_numpy(np.stack([getattr(each, name) for each in drawn])) for name in STRIP_FIELDS}


def figures(found: tuple[Tensor, ...], wanted: dict[str, Tensor]) -> dict[str, float]:
    """Errors on held-out strips: offsets in diameters, ends in stations, shares of right stations and strips."""
    offset, log_scale, base, tip, seen, right, log_width = found
    asked, visible = wanted["asked"], wanted["seen"] > 0.5
    off = (offset - wanted["offset"]).abs()
    use = asked & visible
    ends = {}
    for name, logits, end in (("base", base, wanted["ends"][:, 0]), ("tip", tip, wanted["ends"][:, 1])):
        known = (end > 0.0) & (end < ALONG - 1)
        ends[name] = float((logits.argmax(1) - end).abs()[known].median())
    judged = wanted["judged"]
    return {
        "offset_median": float(off[use].median()),
        "offset_normalised": float((off * torch.exp(-log_scale))[use].mean()),
        **ends,
        "seen_right": float(((seen > 0) == visible)[judged].float().mean()),
        "log_width": float((log_width - wanted["log_width"]).abs()[wanted["right"] > 0.5].median()),
        "right_right": float(((right.mean(1) > 0) == (wanted["right"] > 0.5)).float().mean()),
    }


def begun(path: Path, strips: Tensor) -> LineNetwork:
    """Returns the network of a graph, ready for training.

    Args:
        path: the graph, in which each normalisation is part of its kernels.
        strips: (b, 3, ACROSS, ALONG): with their statistics the normalisations change nothing at first.
    """
    network = line_network_from_graph(path)

    def keep(norm: nn.Module, given: tuple[Tensor, ...]) -> None:
        assert isinstance(norm, nn.BatchNorm2d)
        assert norm.running_mean is not None
        assert norm.running_var is not None
        mean, variance = given[0].mean((0, 2, 3)), given[0].var((0, 2, 3))
        norm.running_mean.copy_(mean)
        norm.running_var.copy_(variance)
        norm.weight.copy_((variance + norm.eps).sqrt())
        norm.bias.add_(mean)

    hooks = [each.register_forward_pre_hook(keep) for each in network.modules() if isinstance(each, nn.BatchNorm2d)]
    with torch.no_grad():
        network(strips)
    for hook in hooks:
        hook.remove()
    return network.train()


def main() -> None:
    """Trains and exports the network."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-o", dest="out", type=Path, required=True)
    parser.add_argument("--steps", type=int, default=STEPS)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--resume", action="store_true")
    parser.add_argument("--begin", type=Path)
    parser.add_argument("--rate", type=float, default=RATE)
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    torch.manual_seed(options.seed)
    checks = next(iter(_Strips(CHECKS_SEED, CHECKS)))
    network = LineNetwork() if options.begin is None else begun(options.begin, checks["strip"])
    optimiser = torch.optim.AdamW(network.parameters(), lr=options.rate, weight_decay=0.03)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimiser, options.rate, options.steps, pct_start=0.06)
    path, step = options.out / "line.pt", 0
    if options.resume and path.exists():
        state = torch.load(path, weights_only=True)
        network.load_state_dict(state["network"])
        optimiser.load_state_dict(state["optimiser"])
        step = state["step"]
        for _ in range(step):
            schedule.step()
    strips = _Strips(options.seed + 10_000 * step, BATCH)
    loader = torch.utils.data.DataLoader(
        strips, batch_size=None, num_workers=WORKERS, prefetch_factor=4, in_order=False
    )
    feed = iter(loader)
    began, recent = time.time(), 0.0
    while step < options.steps:
        batch = next(feed)
        value = line_loss(network(batch["strip"]), batch)
        optimiser.zero_grad()
        value.backward()
        nn.utils.clip_grad_norm_(network.parameters(), 5.0)
        optimiser.step()
        schedule.step()
        step += 1
        recent = value.item() if step == 1 else 0.98 * recent + 0.02 * value.item()
        if step % 250 == 0 or step == options.steps:
            network.eval()
            with torch.no_grad():
                found = network(checks["strip"])
                held = float(line_loss(found, checks))
            network.train()
            row = {"step": step, "seconds": round(time.time() - began)}
            row |= {"loss": round(recent, 4), "held": round(held, 4)}
            row |= {name: round(each, 4) for name, each in figures(found, checks).items()}
            print(json.dumps(row), flush=True)
            state = {"network": network.state_dict(), "optimiser": optimiser.state_dict(), "step": step}
            partial = path.with_suffix(".part")
            torch.save(state, partial)
            partial.replace(path)
            export(network, options.out / "refine.onnx")
            if options.begin is not None:
                average(options.begin, options.out / "refine.onnx")


def export(network: LineNetwork, path: Path) -> None:
    """Writes ``network`` as an ONNX graph of batch 1."""
    network.eval()
    program = torch.onnx.export(
        network, kwargs={"strip": torch.zeros((1, 3, ACROSS, ALONG))}, dynamo=True, input_names=["strip"],
        output_names=OUTPUTS, external_data=False, verbose=False,
    )  # fmt: skip
    assert program is not None
    model = program.model_proto
    store_in_half_precision(onnx, model)
    onnx.save(model, str(path))
    network.train()


def average(begin: Path, trained: Path) -> None:
    """Writes into the graph ``trained`` the mean of its weights and those of the graph ``begin``."""
    first = {each.name: onnx.numpy_helper.to_array(each) for each in onnx.load(begin).graph.initializer}
    model = onnx.load(trained)
    for each in model.graph.initializer:
        own = onnx.numpy_helper.to_array(each)
        if own.dtype.kind == "f":
            mean = 0.5 * (own.astype(np.float64) + first[each.name])
            each.CopyFrom(onnx.numpy_helper.from_array(mean.astype(own.dtype), each.name))
    onnx.save(model, str(trained))


if __name__ == "__main__":
    main()
