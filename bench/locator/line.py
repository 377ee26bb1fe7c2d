"""The line network: the axis, its visibility, the base and the tip in the image straightened along a rough line.

    python -m bench.locator.line -o DIR [--steps N] [--seed S] [--resume]

Its strips come from the compositor (a third) and from the presets' renderers at their own resolution, along the true
line with errors like those of the locator, or along another line. DIR/line.pt holds weights and optimiser every 250
steps; ``--resume`` continues. DIR/refine.onnx goes to src/tipforce/vision/locator.
"""

import argparse
import json
import math
import time
from collections.abc import Iterator
from dataclasses import dataclass, fields
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt
import onnx
import torch
import torch.nn.functional as F
from bench.locator import scene
from bench.locator.feed import labelled_images
from bench.locator.light import lit_otherwise
from bench.locator.tubes import Drawer
from torch import Tensor, nn

from tipforce.training import store_in_half_precision
from tipforce.training.locator import SEEN, WINDOW_PX
from tipforce.vision.locator import ACROSS, ALONG, evenly, straightened, strip_input

Float = npt.NDArray[np.float64]

LINE_POINTS = 160
MAX_OFFSET_DIAMETERS = 1.4
"""The axis of a station further off is not learnt."""
TARGET_SIGMA_STATIONS = 0.7
"""Standard deviation of the target of an end, in stations."""
WRONG_SHARE, SCENE_SHARE = 0.25, 0.35
"""Shares of the strips along other lines than the catheter's, and of the strips from the compositor."""
RATE, BATCH, STEPS, WORKERS = 2e-3, 32, 3500, 2
STRIPS_PER_IMAGE, RESERVOIR_IMAGES = 40, 300
CHECKS, CHECKS_SEED = 512, 900_000
OUTPUTS = ["offset", "log_spread", "base", "tip", "seen", "right"]


def _conv(inputs: int, outputs: int, stride: tuple[int, int] = (1, 1)) -> nn.Sequential:
    conv = nn.Conv2d(inputs, outputs, 3, stride, 1, bias=False)
    return nn.Sequential(conv, nn.BatchNorm2d(outputs), nn.ReLU(inplace=True))


class _Residual(nn.Module):
    def __init__(self, width: int, dilation: int) -> None:
        super().__init__()
        self.way = nn.Sequential(
            nn.Conv2d(width, width, (1, 3), 1, (0, dilation), dilation=(1, dilation), bias=False),
            nn.BatchNorm2d(width),
            nn.ReLU(inplace=True),
            nn.Conv2d(width, width, (1, 3), 1, (0, 1), bias=False),
            nn.BatchNorm2d(width),
        )

    def forward(self, x: Tensor) -> Tensor:
        return F.relu(x + self.way(x))


class LineNetwork(nn.Module):
    """(b, 3, ACROSS, ALONG) -> six tensors, (b, ALONG) but the last.

    Offset of the axis in diameters, logarithm of its scale of error, logits of base and tip, logit that the station is
    seen, and (b,) the logit that the strip is the catheter's.
    """

    def __init__(self, first: int = 24, second: int = 32, width: int = 96) -> None:
        super().__init__()
        self.front = nn.Sequential(
            _conv(3, first, (2, 1)), _conv(first, second, (2, 1)), _conv(second, second), _conv(second, second)
        )
        self.across = nn.Sequential(
            nn.Conv2d(second, width, (ACROSS // 4, 3), 1, (0, 1), bias=False),
            nn.BatchNorm2d(width),
            nn.ReLU(inplace=True),
        )
        self.along = nn.Sequential(*[_Residual(width, dilation) for dilation in (1, 2, 4, 8, 16)])
        self.head = nn.Conv2d(width, 6, 1)

    def forward(self, strip: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor, Tensor, Tensor]:
        y = self.head(self.along(self.across(self.front(strip))))[:, :, 0]
        return y[:, 0], y[:, 1].clamp(-6.0, 3.0), y[:, 2], y[:, 3], y[:, 5], y[:, 4].mean(-1)


@dataclass(frozen=True, slots=True, eq=False)
class Source:
    """``image`` (h, w, 3) uint8 with the true ``line`` (n, 2) px, base to tip, and the ``state`` (n,) of its points."""

    image: npt.NDArray[np.uint8]
    line: Float
    state: npt.NDArray[np.uint8]
    diameter_px: float


@dataclass(frozen=True, slots=True, eq=False)
class Target:
    """``strip`` (3, ACROSS, ALONG), and the line, visibility and ends that the network learns.

    ``offset`` (ALONG,) of the true axis where ``asked``; ``seen`` (ALONG,) where ``judged``; ``ends`` (2,): stations of
    base and tip, -1 where they are not asked for; ``right``: 1 where the strip is the catheter's.
    """

    strip: npt.NDArray[np.float32]
    offset: npt.NDArray[np.float32]
    asked: npt.NDArray[np.bool_]
    seen: npt.NDArray[np.float32]
    judged: npt.NDArray[np.bool_]
    ends: npt.NDArray[np.float32]
    right: np.float32


FIELDS = tuple(field.name for field in fields(Target))


def target(source: Source, rng: np.random.Generator) -> Target:
    """A strip of ``source`` along a line near the true one, or along another."""
    diameter_px = source.diameter_px * math.exp(rng.normal(0.0, 0.05))
    line = evenly(source.line, LINE_POINTS)
    state = source.state[np.linspace(0, len(source.state) - 1, LINE_POINTS).round().astype(int)]
    wrong = rng.random() < WRONG_SHARE
    hidden_from = int(np.flatnonzero(state == SEEN).max(initial=0)) / (LINE_POINTS - 1.0)
    guess = (
        _elsewhere(line, diameter_px, source.image.shape, rng)
        if wrong
        else _disturbed(line, diameter_px, hidden_from, rng)
    )
    strip = straightened(source.image, guess, diameter_px)
    offset, near, at = _offsets(line, strip.points, strip.normals, diameter_px)
    (base, base_off), (tip, tip_off) = (_station(strip.points, end) for end in (line[0], line[-1]))
    right = not wrong or bool(
        near.sum() > 0.72 * ALONG
        and 0.0 <= base < 0.3 * ALONG
        and 0.7 * ALONG < tip <= ALONG - 1
        and max(base_off, tip_off) < 1.5 * diameter_px
    )
    station = np.arange(ALONG)
    seen = (state[at] == SEEN) & near & (station > base - 0.5) & (station < tip + 0.5)
    lit = lit_otherwise(strip.values, rng)
    if rng.random() < 0.3:  # an object across the strip
        first, wide = int(rng.integers(0, ALONG - 4)), int(rng.integers(2, 14))
        lit = lit.copy()
        lit[:, first : first + wide] = rng.uniform(0.0, 255.0, 3)
        seen[first : first + wide] = False
    values = strip_input(np.clip(lit, 0.0, 255.0), strip.inside)
    if rng.random() < 0.5:
        values, offset = np.ascontiguousarray(values[:, ::-1]), -offset
    in_view = bool(strip.inside_view[int(np.clip(round(base), 0, ALONG - 1))])
    ends = np.array([base if right and in_view else -1.0, tip if right else -1.0], np.float32)
    inside = strip.inside_view
    judged = inside if right else np.zeros(ALONG, bool)
    return Target(
        values, offset.astype(np.float32), near & inside & right, seen.astype(np.float32), judged, ends,
        np.float32(right),
    )  # fmt: skip


def _disturbed(line: Float, diameter_px: float, hidden_from: float, rng: np.random.Generator) -> Float:
    """Returns ``line`` with errors like those of the locator or an earlier round: beside the line, and at both ends.

    ``hidden_from``: share of the line at which its end is hidden; the guess may leave the line from there on.
    """
    count, share = len(line), np.linspace(0.0, 1.0, len(line))
    modes = rng.integers(2, 7)
    weights = 1.2 * rng.normal(size=modes) / math.sqrt(modes) * diameter_px * rng.choice([0.6, 0.3, 0.12, 0.04])
    beside = weights @ np.cos(math.pi * np.arange(modes)[:, None] * share)
    beyond = np.maximum(share - hidden_from, 0.0) / max(1.0 - hidden_from, 1e-6)
    beside = beside + beyond**2 * rng.normal(0.0, 1.5) * diameter_px * (hidden_from < 0.97)
    tangent = np.gradient(line, axis=0)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    moved = line + beside[:, None] * np.column_stack([-tangent[:, 1], tangent[:, 0]])
    length = float(np.linalg.norm(np.diff(moved, axis=0), axis=1).sum())
    start, stop = np.clip(rng.normal(0.0, rng.choice([0.05, 0.02, 0.006]), 2), -0.1, 0.1) * length
    if start < 0.0:
        moved = np.vstack([moved[0] + start * tangent[0], moved])
    if stop > 0.0:
        moved = np.vstack([moved, moved[-1] + stop * tangent[-1]])
    arc = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(moved, axis=0), axis=1))])
    wanted = np.linspace(max(start, 0.0), arc[-1] + min(stop, 0.0), count)
    return np.column_stack([np.interp(wanted, arc, moved[:, k]) for k in (0, 1)])


def _elsewhere(line: Float, diameter_px: float, shape: tuple[int, ...], rng: np.random.Generator) -> Float:
    """A line like ``line`` that is not the catheter's: along the sheath, from the tip back, turned, anywhere."""
    kind = rng.random()
    if kind < 0.3:
        return line + (line[-1] - line[0]) * rng.uniform(0.25, 0.6) * rng.choice([-1.0, 1.0])
    if kind < 0.5:
        return line[::-1]
    turn = rng.normal(0.0, 0.5)
    matrix = np.array([[math.cos(turn), -math.sin(turn)], [math.sin(turn), math.cos(turn)]])
    if kind < 0.8:
        return (line - line[0]) @ matrix.T + line[0] + rng.normal(0.0, 0.3, 2) * diameter_px
    size = np.array([shape[1], shape[0]])
    return (line - line.mean(axis=0)) @ matrix.T + rng.uniform(0.1, 0.9, 2) * size


def _offsets(
    line: Float, points: Float, normals: Float, diameter_px: float
) -> tuple[Float, npt.NDArray[np.bool_], npt.NDArray[np.int64]]:
    """Where ``line`` crosses each station's normal, in diameters; whether it does so nearby; at which of its points."""
    way = line[None] - points[:, None]
    along = (way * np.column_stack([normals[:, 1], -normals[:, 0]])[:, None]).sum(axis=-1)
    across = (way * normals[:, None]).sum(axis=-1)
    far = np.where(np.abs(across) > 2.2 * diameter_px, np.inf, np.abs(along))
    at, station = np.clip(far.argmin(axis=1), 1, len(line) - 2), np.arange(len(points))
    other = np.where(along[station, at] > 0.0, at - 1, at + 1)
    gap = np.maximum(np.abs(along[station, at] - along[station, other]), 1e-9)
    share = np.clip(np.abs(along[station, at]) / gap, 0.0, 1.0)
    offset = (1.0 - share) * across[station, at] + share * across[station, other]
    near = far[station, at] < 0.75 * np.linalg.norm(points[1] - points[0])
    return offset / diameter_px, near & (np.abs(offset) < MAX_OFFSET_DIAMETERS * diameter_px), at


def _station(points: Float, end: Float) -> tuple[float, float]:
    """The station next to ``end`` (2,), as a fraction, and its distance in px."""
    apart = np.linalg.norm(points - end, axis=1)
    at = int(apart.argmin())
    low, high = max(at - 1, 0), min(at + 1, len(points) - 1)
    way = (points[high] - points[low]) / (high - low)
    return at + float((end - points[at]) @ way / (way @ way)), float(apart[at])


def loss(found: tuple[Tensor, ...], wanted: dict[str, Tensor]) -> Tensor:
    """Negative log-likelihood of the offsets (Laplace), and cross entropy of visibility, both ends, right or wrong."""
    offset, log_scale, base, tip, seen, right = found
    share = wanted["asked"].float()
    off = (offset - wanted["offset"]).abs() * torch.exp(-log_scale) + log_scale
    total = (off * share).sum() / share.sum().clamp_min(1.0)
    judged = wanted["judged"].float()
    visible = F.binary_cross_entropy_with_logits(seen, wanted["seen"], reduction="none")
    total = total + 0.7 * (visible * judged).sum() / judged.sum().clamp_min(1.0)
    total = total + 0.5 * F.binary_cross_entropy_with_logits(right, wanted["right"])
    grid = torch.arange(ALONG, dtype=torch.float32)
    for logits, end in ((base, wanted["ends"][:, 0]), (tip, wanted["ends"][:, 1])):
        peak = torch.exp(-0.5 * ((grid - end[:, None]) / TARGET_SIGMA_STATIONS) ** 2)
        peak = peak / peak.sum(1, keepdim=True).clamp_min(1e-6)
        use = ((end > 0.0) & (end < ALONG - 1)).float()
        total = total + 0.3 * (-(peak * F.log_softmax(logits, -1)).sum(1) * use).sum() / use.sum().clamp_min(1.0)
    return total


def _scenes(rng: np.random.Generator) -> Iterator[Source]:
    drawer = Drawer(WINDOW_PX, WINDOW_PX)
    while True:
        drawn = scene.draw(rng, drawer, WINDOW_PX)
        if drawn.present and (drawn.state == SEEN).mean() > 0.4:
            yield Source(drawn.image, drawn.line, drawn.state, drawn.diameter_px)


def _presets(rng: np.random.Generator, seed: int) -> Iterator[Source]:
    for drawn in labelled_images(rng, seed):
        yield Source(drawn.image, drawn.line_px, drawn.state, drawn.diameter_px)


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
        kept: tuple[list[Source], list[Source]] = ([], [])
        while True:
            drawn: list[Target] = []
            while len(drawn) < self._batch:
                which = int(rng.random() > SCENE_SHARE)
                own = kept[which]
                if len(own) < 12 or rng.random() < 1.0 / STRIPS_PER_IMAGE:
                    own.append(next(streams[which]))
                    if len(own) > RESERVOIR_IMAGES:
                        own.pop(int(rng.integers(RESERVOIR_IMAGES)))
                drawn.append(target(own[int(rng.integers(len(own)))], rng))
            yield {name: torch.from_numpy(np.stack([getattr(each, name) for each in drawn])) for name in FIELDS}


def figures(found: tuple[Tensor, ...], wanted: dict[str, Tensor]) -> dict[str, float]:
    """Errors on held-out strips: offsets in diameters, ends in stations, shares of right stations and strips."""
    offset, log_scale, base, tip, seen, right = found
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
        "right_right": float(((right > 0) == (wanted["right"] > 0.5)).float().mean()),
    }


def main() -> None:
    """Trains and exports the network."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-o", dest="out", type=Path, required=True)
    parser.add_argument("--steps", type=int, default=STEPS)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--resume", action="store_true")
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    torch.manual_seed(options.seed)
    network = LineNetwork()
    optimiser = torch.optim.AdamW(network.parameters(), lr=RATE, weight_decay=0.03)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimiser, RATE, options.steps, pct_start=0.06)
    path, step = options.out / "line.pt", 0
    if options.resume and path.exists():
        state = torch.load(path, weights_only=True)
        network.load_state_dict(state["network"])
        optimiser.load_state_dict(state["optimiser"])
        step = state["step"]
        for _ in range(step):
            schedule.step()
    checks = next(iter(_Strips(CHECKS_SEED, CHECKS)))
    strips = _Strips(options.seed + 10_000 * step, BATCH)
    loader = torch.utils.data.DataLoader(
        strips, batch_size=None, num_workers=WORKERS, prefetch_factor=4, in_order=False
    )
    feed = iter(loader)
    began, recent = time.time(), 0.0
    while step < options.steps:
        batch = next(feed)
        value = loss(network(batch["strip"]), batch)
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
                held = float(loss(found, checks))
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


if __name__ == "__main__":
    main()
