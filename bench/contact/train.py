"""Trains the network that reads the geometry of the contact, and stores it for `tipforce.vision.contact`.

    python -m bench.contact.train SCENES --epochs 16 --out contact.onnx [--resume]

The graph that comes with tipforce had 14 epochs, then 6, 8 and 8 more with ``--begin`` at ``--rate 1e-3``; the
first 20 knew contact or none in place of the three classes.

Every tenth session is left out; after each epoch its figures are printed, and a checkpoint is written beside the graph.
"""

import argparse
import math
import time
from pathlib import Path

import cv2
import numpy as np
import torch
from bench.contact.network import ContactNetwork, losses
from bench.contact.scenes import PIXEL_M as SCENE_PIXEL_M
from bench.contact.scenes import SIDE_PX as SCENE_SIDE_PX

from tipforce.training import export_graph
from tipforce.vision.contact import BEHIND_M, DEPTH_M, PIXEL_M, SIDE_PX

BATCH = 64
CLEAR_N, SURE, SEEN = 0.02, 30.0, 0.9
"""Least force, N, of the images that are judged; concentration from which a direction is called sure; probability from
which the tissue is called visible."""
WIDE, WIDE_SHARE = 4.0, 0.3
"""Errors of a tip that is hidden, in those of one that is seen; its share of the images."""
_TIP = np.array([BEHIND_M / SCENE_PIXEL_M + 0.5 * (SCENE_SIDE_PX - SIDE_PX * PIXEL_M / SCENE_PIXEL_M), 83.5])


class Scenes:
    """All images of a folder, in memory. ``apart``: whether these are the sessions that are left out."""

    def __init__(self, folder: Path, *, apart: bool) -> None:
        places = [each for k, each in enumerate(sorted(folder.glob("*.npz"))) if (k % 10 == 0) == apart]
        parts = [np.load(each) for each in places]
        self.images = np.concatenate([part["images"] for part in parts])
        self.preset = np.concatenate(
            [
                np.full(len(part["contact"]), place.name.rsplit("-", 2)[0])
                for part, place in zip(parts, places, strict=True)
            ]
        )
        self.force_n = np.concatenate([part["force_n"] for part in parts])
        self.truth = np.stack(
            [
                np.concatenate([part["contact"] for part in parts]).astype(float),
                np.arcsinh(np.concatenate([part["depth_m"] for part in parts]) / DEPTH_M),
                np.concatenate([part["angle_rad"] for part in parts]),
                np.concatenate([np.full(len(part["contact"]), float(part["visible"])) for part in parts]),
            ],
            axis=1,
        )

    def batch(self, rows: np.ndarray, rng: np.random.Generator, *, strong: bool) -> tuple[torch.Tensor, torch.Tensor]:
        """Returns images (n, 1, 112, 112) and truths (n, 4), moved as a detection errs; ``strong``: disturbed too."""
        made = np.empty((len(rows), 1, SIDE_PX, SIDE_PX), np.float32)
        truth = self.truth[rows].copy()
        for k, row in enumerate(rows.tolist()):
            wide = WIDE if rng.random() < WIDE_SHARE else 1.0
            turn = math.radians(2.0) * rng.standard_normal() * wide
            shift_m = np.array([0.25e-3, 0.1e-3]) * rng.standard_normal(2) * wide
            step = PIXEL_M / SCENE_PIXEL_M * (1.0 + 0.02 * rng.standard_normal())
            mirrored = -1.0 if rng.random() < 0.5 else 1.0
            cos, sin = math.cos(turn), math.sin(turn)
            matrix = np.array([[cos, -sin * mirrored], [sin, cos * mirrored]]) * step
            centre = np.array([BEHIND_M / PIXEL_M, 0.5 * (SIDE_PX - 1)])
            offset = _TIP + shift_m / SCENE_PIXEL_M - matrix @ centre
            image = cv2.warpAffine(
                self.images[row], np.column_stack([matrix, offset]), (SIDE_PX, SIDE_PX),
                flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP, borderMode=cv2.BORDER_REPLICATE,
            )  # fmt: skip
            truth[k, 2] = mirrored * (truth[k, 2] - turn)
            made[k, 0] = _disturbed(image, rng) if strong else image.astype(np.float32) / 255.0
        return torch.from_numpy(made), torch.from_numpy(truth.astype(np.float32))


def _disturbed(image: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Returns the image with another light, contrast, sharpness, noise and, at times, covered parts."""
    if rng.random() < 0.2:
        image = cv2.GaussianBlur(image, (0, 0), rng.uniform(0.4, 1.6))
    out = image.astype(np.float32) / 255.0
    if rng.random() < 0.3:
        out = 1.0 - out
    out = out ** np.float32(math.exp(0.35 * rng.standard_normal()))
    if rng.random() < 0.3:
        ramp = np.linspace(-1.0, 1.0, out.shape[0], dtype=np.float32)
        out = out * (1.0 + rng.uniform(-0.4, 0.4) * ramp[:, None]) * (1.0 + rng.uniform(-0.4, 0.4) * ramp)
    if rng.random() < 0.4:
        out += np.float32(rng.uniform(0.0, 0.06)) * rng.standard_normal(out.shape, np.float32)
    if rng.random() < 0.15:
        top, left = rng.integers(0, out.shape[0] - 20, 2)
        high, wide = rng.integers(6, 40, 2)
        out[top : top + high, left : left + wide] = rng.random()
    return out


def calibrate(network: ContactNetwork, scenes: Scenes) -> tuple[float, float, float]:
    """Scales the outputs so that they are as sure as they are right on sessions that were left out.

    Returns:
        Factors on the logits, the standard deviation of the depth, and the concentration of the direction.
    """
    found, truth = outputs(network, scenes)
    touching = truth[:, 0] > 0.5
    factors = torch.tensor(np.geomspace(0.1, 2.0, 61), dtype=torch.float32)
    means = []
    for kept, scale in (
        (np.ones(len(truth), bool), lambda f, x: torch.cat([f[:, :3] * x, f[:, 3:]], 1)),
        (touching, lambda f, x: torch.cat([f[:, :4], f[:, 4:5] - torch.log(x), f[:, 5:]], 1)),
        (touching, lambda f, x: torch.cat([f[:, :5], f[:, 5:] * x], 1)),
    ):
        f, t = torch.from_numpy(found[kept]), torch.from_numpy(truth[kept])
        part = torch.stack([losses(scale(f, x), t)[len(means)] for x in factors])
        means.append(float(factors[int(part.argmin())]))
    logit, depth, direction = means
    last = network.head[-1]
    with torch.no_grad():
        last.weight[:3] *= logit
        last.bias[:3] *= logit
        last.bias[4] -= math.log(depth)
        last.weight[5:] *= direction
        last.bias[5:] *= direction
    return logit, 1.0 / depth, direction


def outputs(network: ContactNetwork, scenes: Scenes) -> tuple[np.ndarray, np.ndarray]:
    """Returns outputs (n, `OUTPUTS`) and truths (n, 4) of all scenes, moved as a detection errs."""
    network.eval()
    rng, found, truth = np.random.default_rng(0), [], []
    with torch.inference_mode():
        for start in range(0, len(scenes.truth), 256):
            images, true = scenes.batch(np.arange(start, min(start + 256, len(scenes.truth))), rng, strong=False)
            found.append(network(images).numpy())
            truth.append(true.numpy())
    return np.concatenate(found), np.concatenate(truth)


def judge(network: ContactNetwork, scenes: Scenes) -> str:
    """Returns the figures on the scenes, by preset."""
    f, t = outputs(network, scenes)
    said = 1.0 / (1.0 + np.exp(f[:, 1] - f[:, 0]))
    shares = np.exp(f[:, :3] - f[:, :3].max(axis=1, keepdims=True))
    seen = 1.0 - shares[:, 2] / shares.sum(axis=1)
    depth_mm, true_mm = (1e3 * DEPTH_M * np.sinh(values) for values in (f[:, 3], t[:, 1]))
    error_mm = np.abs(depth_mm - true_mm)
    normalised = np.abs(f[:, 3] - t[:, 1]) / np.exp(np.clip(f[:, 4], -4.0, 3.0))
    turn = np.arctan2(f[:, 6], f[:, 5]) - t[:, 2]
    off_deg, strength = np.degrees(np.abs(np.angle(np.exp(1j * turn)))), np.hypot(f[:, 5], f[:, 6])
    lines: list[str] = []
    for preset in np.unique(scenes.preset):
        own = scenes.preset == preset
        clear = own & (t[:, 0] > 0.5) & (scenes.force_n > CLEAR_N)
        sure, visible = clear & (strength > SURE), own & (t[:, 3] > 0.5)
        touching = [
            100 * t[own & (seen > SEEN) & kept, 0].mean() if (own & (seen > SEEN) & kept).any() else np.nan
            for kept in (said < 0.05, said > 0.95)
        ]
        right = 100 * ((said > 0.5) == (t[:, 0] > 0.5))[visible].mean()
        as_seen = [100 * (seen > SEEN)[kept].mean() if kept.any() else np.nan for kept in (visible, own & ~visible)]
        within = [100 * (normalised[clear] < stds).mean() for stds in (1.0, 2.0)]
        depth, direction, of_sure = (
            f"{np.median(off):.2f}, 90 % {np.quantile(off, 0.9):.2f}" if len(off) else "-"
            for off in (error_mm[clear], off_deg[clear], off_deg[sure])
        )
        share = 100 * sure.sum() / max(1, clear.sum())
        lines.append(
            f"  {preset}, {own.sum()} frames: tissue called visible (probability above {SEEN}) in {as_seen[0]:.1f} % "
            f"where it is visible, {as_seen[1]:.1f} % elsewhere; contact right {right:.1f} % where it is visible; "
            f"where called visible and the probability of contact is below 0.05 {touching[0]:.1f} % touch, above 0.95 "
            f"{touching[1]:.1f} %\n"
            f"    depth off by {depth} mm; within one and two stated deviations {within[0]:.0f}, {within[1]:.0f} %\n"
            f"    direction off by {direction} degrees; the surer {share:.0f} %: {of_sure}"
        )
    return "\n".join(lines)


def main() -> None:
    """Trains."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenes", type=Path)
    parser.add_argument("--epochs", type=int, default=16)
    parser.add_argument("--rate", type=float, default=2e-3)
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--bfloat16", action="store_true", help="half the time on processors that have it")
    parser.add_argument("--begin", type=Path, help="checkpoint to begin with; layers of other sizes begin anew")
    parser.add_argument("--resume", action="store_true")
    parser.add_argument("--out", type=Path, required=True)
    options = parser.parse_args()
    torch.manual_seed(0)
    torch.set_num_threads(options.threads)
    torch.set_flush_denormal(True)
    cv2.setNumThreads(1)
    train, apart = Scenes(options.scenes, apart=False), Scenes(options.scenes, apart=True)
    network = ContactNetwork().to(memory_format=torch.channels_last)
    optimiser = torch.optim.AdamW(network.parameters(), options.rate, weight_decay=0.02)
    steps = len(train.truth) // BATCH
    plan = torch.optim.lr_scheduler.OneCycleLR(optimiser, options.rate, total_steps=options.epochs * steps)
    average = torch.optim.swa_utils.AveragedModel(
        network, multi_avg_fn=torch.optim.swa_utils.get_ema_multi_avg_fn(0.999), use_buffers=True
    )
    checkpoint, first = options.out.with_suffix(".pt"), 0
    if options.resume and checkpoint.exists():
        stored = torch.load(checkpoint, weights_only=True)
        for part, name in ((network, "network"), (optimiser, "optimiser"), (plan, "plan"), (average, "average")):
            part.load_state_dict(stored[name])
        first = stored["epoch"] + 1
    elif options.begin:
        stored = torch.load(options.begin, weights_only=True)["average"]
        begun = {name.removeprefix("module."): each for name, each in stored.items() if name.startswith("module.")}
        own = network.state_dict()
        begun = own | {name: each for name, each in begun.items() if each.shape == own[name].shape}
        network.load_state_dict(begun)
        average.module.load_state_dict(begun)
    touching, visible = (train.truth[:, k] > 0.5 for k in (0, 3))
    depth, turn = train.truth[touching, 1], train.truth[touching, 2]
    each = [(visible & touching).mean(), (visible & ~touching).mean(), (~visible).mean()]
    print(
        f"shares of the classes {each[0]:.3f}, {each[1]:.3f}, {each[2]:.3f}; depth, transformed: mean "
        f"{depth.mean():.2f}, standard deviation {depth.std():.2f}; mean cosine of the direction "
        f"{np.cos(turn).mean():.3f}"
    )
    print(f"{len(train.truth)} images to train on, {len(apart.truth)} apart, {steps} steps an epoch", flush=True)
    for epoch in range(first, options.epochs):
        rng = np.random.default_rng([7, epoch])
        order, start, total = rng.permutation(len(train.truth)), time.perf_counter(), torch.zeros(3)
        network.train()
        for k in range(steps):
            images, truth = train.batch(order[k * BATCH : (k + 1) * BATCH], rng, strong=True)
            with torch.autocast("cpu", torch.bfloat16, enabled=options.bfloat16):
                found = network(images.to(memory_format=torch.channels_last))
            each = losses(found.float(), truth)
            optimiser.zero_grad(set_to_none=True)
            each.sum().backward()
            torch.nn.utils.clip_grad_norm_(network.parameters(), 5.0)
            optimiser.step()
            plan.step()
            average.update_parameters(network)
            total += each.detach()
        rate = steps * BATCH / (time.perf_counter() - start)
        parts = ", ".join(f"{value:.3f}" for value in (total / steps).tolist())
        print(f"epoch {epoch}: contact, depth, direction {parts}; {rate:.0f} images/s", flush=True)
        print(judge(average.module, apart), flush=True)
        torch.save(
            {"network": network.state_dict(), "optimiser": optimiser.state_dict(), "plan": plan.state_dict(),
             "average": average.state_dict(), "epoch": epoch},
            checkpoint,
        )  # fmt: skip
    if options.epochs > first:
        print(
            f"factors of logit, depth and direction: {calibrate(average.module, apart)}\n{judge(average.module, apart)}"
        )
    spec = {"image": ((1, SIDE_PX, SIDE_PX), "float32")}
    options.out.write_bytes(export_graph(average.module.eval(), spec, ("geometry",), {}, half_precision=True))


if __name__ == "__main__":
    main()
