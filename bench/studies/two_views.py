"""Judges the networks of two views on whole sessions that are held out, beside simpler methods, on equal splits.

    python -m bench.studies.two_views DATA --methods constant pca-svr stereo one-view hnet --held-out NAME --json FILE
    python -m bench.studies.two_views TRAIN --test TEST --calibrate MORE --methods stereo hnet rod-3d --work DIR \
        --json FILE --set size=96

Each ``--held-out`` states the sessions of one test part, separated by commas; ``--random`` adds a random split of
75/25, which leaks: the neighbours of a test image are in the training part. With ``--test`` each method is fitted once,
on seven eighths of the images of TRAIN, and judged on TEST and on the last eighth, which was drawn at random and leaks.
``--calibrate``: the intervals are then found again on the whole sessions of MORE. Each fit is kept in the JSON file as
soon as it is done, and a fit in that file is not repeated; with ``--work`` a training that was stopped goes on.

"wrong": the magnitude is off by more than 50 mN, of the pairs in contact. "dice": estimated and true share p and q of
the catheter in each cell of 4 x 4 pixels, 2 sum(p q) / (sum(p^2) + sum(q^2)) (Milletari et al. 2016), mean over pairs
and views.

``pca-svr``: 40 principal components of both images, RBF support vectors for each component of the force. ``one-view``:
the network of `stereo` with the first view in place of both. ``hnet``: after the abstract of H-Net (Fekri, Zadeh and
Dargahi, IEEE RA-L 2024): two encoder-decoders with shared weights and skip connections give two masks, and a dense head
on both bottlenecks gives the force; below 0.5 M weights. ``rod-3d``, for sets that `tipforce simulate` made: the rod in
space on the true lines of the same pairs, with noise as in `space_sensitivity`.
"""

import argparse
import json
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import torch
from bench.studies.space_sensitivity import CASES, rows_of, session_of
from torch import nn
from torch.nn.functional import binary_cross_entropy_with_logits, interpolate

from tipforce.cli._settings import settings_from
from tipforce.clinical import CONTACT_N
from tipforce.datasets import Dataset, open_dataset, random_split
from tipforce.estimators import Estimator, NetworkEstimator, Stereo, StereoSettings
from tipforce.estimators.networks._preparation import Arrays, training_samples
from tipforce.evaluation import Constant
from tipforce.simulation import SampleSet
from tipforce.training import CHECKPOINT_FILE, COMPACT_UNIT_N, StereoTask, network_from_weights
from tipforce.types import Image, IntArray, Observation

COMPONENTS, SVR_C, SVR_EPSILON = 40, 10.0, 0.05
WRONG_N = 0.05
LEAKING_SHARE = 0.125
MASK_BATCH = 50
NEW, RANDOM = "new sessions", "random, leaks"
HNET_CHANNELS = (8, 16, 32, 64, 96)
HNET_FEATURES = 64
MASK_WEIGHT = 1.0
TEST_SHARE = 0.25
TIMED_PAIRS = 40


@dataclass(frozen=True)
class HNetTask(StereoTask):
    """The network of `hnet` on the images of `StereoTask`: squared error of the force, cross-entropy of the masks."""

    @property
    def name(self) -> str:
        return super().name.replace("stereo", "hnet", 1)

    @property
    def turns(self) -> bool:
        return False

    def build(self) -> nn.Module:
        return HNet(self.outputs, self.size)

    def loss(self, outputs: Any, batch: Mapping[str, torch.Tensor]) -> torch.Tensor:
        force, masks = outputs
        total = (((force - batch["force_n"]) / COMPACT_UNIT_N) ** 2).mean()
        known = ~torch.isnan(batch["heatmap"])
        if bool(known.any()):
            coarse = interpolate(masks, size=batch["heatmap"].shape[-2:], mode="area")
            total = total + MASK_WEIGHT * binary_cross_entropy_with_logits(coarse[known], batch["heatmap"][known])
        return total

    def error_n(self, outputs: Any, batch: Mapping[str, torch.Tensor]) -> torch.Tensor:
        return torch.linalg.vector_norm(outputs[0] - batch["force_n"], dim=1)


class HNet(nn.Module):
    """Two views (n, 2, size, size) to force (n, outputs) and logits of the masks (n, 2, size, size)."""

    def __init__(self, outputs: int, size: int) -> None:
        super().__init__()
        channels = (1, *HNET_CHANNELS)
        self.down = nn.ModuleList(_double(a, b) for a, b in pairwise(channels))
        self.up = nn.ModuleList(
            _double(deep + skip, skip) for deep, skip in zip(HNET_CHANNELS[:0:-1], HNET_CHANNELS[-2::-1], strict=True)
        )
        self.mask = nn.Conv2d(HNET_CHANNELS[0], 1, 1)
        last = size // 2 ** (len(HNET_CHANNELS) - 1)
        self.squeeze = nn.Conv2d(HNET_CHANNELS[-1], 16, 1)
        self.force = nn.Sequential(
            nn.Linear(2 * 16 * last * last, HNET_FEATURES), nn.ReLU(), nn.Linear(HNET_FEATURES, outputs)
        )

    def forward(self, image: torch.Tensor, metadata: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        x = image.float().flatten(0, 1).unsqueeze(1) / 255.0
        levels = []
        for number, block in enumerate(self.down):
            x = block(x if number == 0 else nn.functional.max_pool2d(x, 2))
            levels.append(x)
        pooled = self.squeeze(x).relu().flatten(1).unflatten(0, (-1, 2)).flatten(1)
        for block, skip in zip(self.up, levels[-2::-1], strict=True):
            x = block(torch.cat([interpolate(x, scale_factor=2.0), skip], 1))
        # the metadata are no input of this network; the product keeps them among the inputs of its graph
        force = self.force(pooled) * COMPACT_UNIT_N + 0.0 * metadata[:, :1]
        return force, self.mask(x).squeeze(1).unflatten(0, (-1, 2))


def _double(before: int, after: int) -> nn.Sequential:
    layers: list[nn.Module] = []
    for channels in (before, after):
        layers += [nn.Conv2d(channels, after, 3, padding=1, bias=False), nn.BatchNorm2d(after), nn.ReLU()]
    return nn.Sequential(*layers)


class HNetEstimator(Stereo):
    """`hnet` with the inputs of `stereo` and the conformal intervals of all networks."""

    @property
    def outputs(self) -> tuple[str, ...]:
        return ("force_n", "mask_logit")

    def task(self, *arguments: Any) -> HNetTask:
        made = super().task(*arguments)
        how = self.settings.augmentation.model_copy(update={"out_of_distribution": 0.0})
        return HNetTask(outputs=made.outputs, metadata=made.metadata, size=made.size, augmentation=how)

    def fit_arrays(self, calibration: Any) -> Arrays:
        del calibration
        return {"detected_base_side": np.array(self._detected_base_sides)}

    start = NetworkEstimator.start
    estimate_builder = NetworkEstimator.estimate_builder
    fit_interval = NetworkEstimator.fit_interval
    check_outputs = NetworkEstimator.check_outputs
    typical_half_n = NetworkEstimator.typical_half_n
    typical_unit_n = NetworkEstimator.typical_unit_n

    @property
    def uses_history(self) -> bool:
        return False


@dataclass(frozen=True)
class FirstViewTwice:
    """A store that shows the first of two views in place of both, with its masks."""

    store: Any
    views: tuple[str, str]

    def read(self, rows: IntArray) -> Iterator[Observation]:
        for observation in self.store.read(rows):
            yield replace(observation, views=dict.fromkeys(self.views, observation.views[self.views[0]]))

    def has_masks(self, rows: IntArray, view: str) -> bool:
        del view
        return hasattr(self.store, "has_masks") and self.store.has_masks(rows, self.views[0])

    def masks(self, rows: IntArray, view: str) -> Iterator[Image | None]:
        del view
        return self.store.masks(rows, self.views[0])


def pca_svr(train: Dataset, test: Dataset, views: Sequence[str]) -> np.ndarray:
    """Returns the forces (n, 3) of the test part."""
    from sklearn.decomposition import PCA
    from sklearn.multioutput import MultiOutputRegressor
    from sklearn.pipeline import make_pipeline
    from sklearn.preprocessing import StandardScaler
    from sklearn.svm import SVR

    inputs, others = (
        np.array([np.concatenate([small(each.views[view]).ravel() for view in views]) for each in part.observations()])
        for part in (train, test)
    )
    regressor = MultiOutputRegressor(SVR(C=SVR_C, epsilon=SVR_EPSILON))
    model = make_pipeline(PCA(COMPONENTS, random_state=0), StandardScaler(), regressor)
    mean, deviation = train.force_n.mean(axis=0), train.force_n.std(axis=0)
    return model.fit(inputs, (train.force_n - mean) / deviation).predict(others) * deviation + mean


def small(image: Image) -> np.ndarray:
    import cv2

    return cv2.resize(image, (64, 64), interpolation=cv2.INTER_AREA).astype(np.float32)


def rod_3d(folder: Path, test: Dataset) -> np.ndarray:
    """Returns the forces (n, 3) of `rod-3d` on the true lines of a simulated set, with noise."""
    made = json.loads((folder / "simulated.json").read_text())
    wanted = SampleSet.model_validate({name: made[name] for name in SampleSet.model_fields})
    force = np.full((len(test), 3), np.nan)
    for number in range(wanted.sessions):
        bench = wanted.bench(number)
        rows = rows_of(
            session_of(bench, wanted.frames(bench, number)), CASES["base"], (wanted.seed, number), all_frames=True
        )
        force[test.session == bench.name] = np.array(rows)[:, 3:6]
    return force


def judged(
    force: np.ndarray, test: Dataset, ends: np.ndarray | None = None, magnitude_ends: np.ndarray | None = None
) -> dict[str, Any]:
    """Returns the errors of the estimates (n, 3) in N, and the share of the truths within the intervals."""
    valid = np.isfinite(force).all(axis=1)
    error = (force - test.force_n)[valid]
    size = np.linalg.norm(force[valid], axis=1) - test.magnitude_n[valid]
    touching = test.magnitude_n[valid] > CONTACT_N
    found = {
        "n": len(test),
        "abstained": float(1.0 - valid.mean()),
        "rmse_n": np.sqrt((error**2).mean(axis=0)).tolist(),
        "mae_n": np.abs(error).mean(axis=0).tolist(),
        "magnitude_mae_n": float(np.abs(size).mean()),
        "magnitude_rmse_n": float(np.sqrt((size**2).mean())),
        "wrong": float((np.abs(size[touching]) > WRONG_N).mean()),
    }
    if ends is not None and magnitude_ends is not None:
        found |= held_shares(ends[valid], magnitude_ends[valid], test.subset(np.flatnonzero(valid)))
    return found


def held_shares(ends: np.ndarray, magnitude_ends: np.ndarray, test: Dataset) -> dict[str, Any]:
    """Returns the shares of truths within the intervals, and their mean widths in N."""
    truth, magnitude = test.force_n, test.magnitude_n
    inside = (ends[:, :, 0] <= truth) & (truth <= ends[:, :, 1])
    held = (magnitude_ends[:, 0] <= magnitude) & (magnitude <= magnitude_ends[:, 1])
    return {
        "coverage": inside.mean(axis=0).tolist(),
        "magnitude_coverage": float(held.mean()),
        "width_n": np.diff(ends, axis=2)[:, :, 0].mean(axis=0).tolist(),
        "magnitude_width_n": float(np.diff(magnitude_ends, axis=1).mean()),
    }


def estimated(model: Estimator, test: Dataset) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Returns forces (n, 3), the ends of their intervals (n, 3, 2) and of those of the magnitude (n, 2)."""
    answers = model.predict(test)
    force, ends, magnitude_ends = (
        np.array([getattr(each, key) for each in answers]) for key in ("force_n", "interval_n", "magnitude_interval_n")
    )
    return force, ends, magnitude_ends


def dice(model: Stereo, kept: Path, test: Dataset, folder: Path) -> float:
    """Returns the mean Dice coefficient of the masks of a trained network.

    Args:
        model: the estimator.
        kept: folder of its training, with the checkpoint.
        test: pairs with masks in both views.
        folder: an empty folder for their prepared images.
    """
    saved = torch.load(kept / CHECKPOINT_FILE, map_location="cpu", weights_only=True)
    task = model.task(test.known, test.force_frames == {"base"}, ())
    network: Any = network_from_weights(task, {name: each.numpy() for name, each in saved["loop"]["best"].items()})
    samples = training_samples(test, model._prepared(test, (), folder, silent), test.known)
    found: list[np.ndarray] = []
    for index in np.array_split(np.arange(len(samples)), -(-len(samples) // MASK_BATCH)):
        batch = task.batch(samples, index, None)
        image, true = torch.from_numpy(batch["image"]), batch["heatmap"]
        with torch.no_grad():
            if isinstance(network, HNet):
                logits = network(image, torch.from_numpy(batch["metadata"]))[1]
                shares = interpolate(logits.sigmoid(), size=true.shape[-2:], mode="area").numpy()
            else:
                shares = network.masks(network.encoded(image)[1:]).sigmoid().numpy()
        sums = [each.sum(axis=(2, 3)) for each in (shares * true, shares**2, true**2)]
        found.append((2.0 * sums[0] / (sums[1] + sums[2])).ravel())
    return float(np.concatenate(found).mean())


def silent(share: float) -> None:
    del share


class Epochs:
    """Prints each new text of a training's progress once."""

    def __init__(self) -> None:
        self._last = ""

    def __call__(self, text: str, share: float) -> None:
        if text != self._last:
            self._last = text
            print(f"{100.0 * share:.0f} %: {text}", flush=True)


def fitted(
    name: str,
    train: Dataset,
    tests: Mapping[str, Dataset],
    settings: StereoSettings,
    calibration: Dataset | None,
    work: Path | None,
) -> dict[str, dict[str, Any]]:
    """Trains one method and returns its errors on each test part, with its size and time."""
    started = time.perf_counter()
    if name == "pca-svr":
        cells = {part: judged(pca_svr(train, test, settings.views), test) for part, test in tests.items()}
        return {part: cell | {"seconds": time.perf_counter() - started} for part, cell in cells.items()}
    if name == "one-view":
        train, *others = (
            replace(part, store=FirstViewTwice(part.store, settings.views), whole=None)
            for part in (train, *tests.values())
        )
        tests = dict(zip(tests, others, strict=True))
    makers: dict[str, Any] = {"constant": Constant, "hnet": lambda: HNetEstimator(settings)}
    model: Estimator = makers.get(name, lambda: Stereo(settings))()
    if isinstance(model, Stereo) and work is not None:
        work.mkdir(parents=True, exist_ok=True)
        model.fit_resumable(train, Epochs(), folder=work, resume=True)
    else:
        model.fit(train)
    seconds = time.perf_counter() - started
    cells = {}
    for part, test in tests.items():
        answers = estimated(model, test)
        cells[part] = judged(answers[0], test, *answers[1:]) | {"seconds": seconds, "force_n": answers[0].tolist()}
        if isinstance(model, Stereo):
            cells[part] |= cost(model, test)
            if work is not None and all(test.has_masks(view) for view in settings.views):
                with tempfile.TemporaryDirectory() as folder:
                    cells[part]["dice"] = dice(model, work, test, Path(folder))
    if calibration is not None and isinstance(model, Stereo):
        model.calibrate(calibration)
        for part, test in tests.items():
            force, ends, magnitude_ends = estimated(model, test)
            valid = np.isfinite(force).all(axis=1)
            shares = held_shares(ends[valid], magnitude_ends[valid], test.subset(np.flatnonzero(valid)))
            cells[part]["calibrated"] = shares | {"basis": model.describe().interval_basis}
    return cells


def cost(model: Stereo, test: Dataset) -> dict[str, Any]:
    """Returns the number of weights and the time of a pair, from images to force, in ms."""
    some = test.subset(np.arange(min(TIMED_PAIRS, len(test))))
    stream, times = model.start(next(iter(some.session_info.values()))), []
    for observation in some.observations():
        before = time.perf_counter()
        stream.update(observation)
        times.append(1e3 * (time.perf_counter() - before))
    return {"parameters": model.describe().parameters, "ms": float(np.median(times)), "least_ms": min(times)}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("data", type=Path)
    parser.add_argument("--methods", nargs="+", default=["constant", "pca-svr", "stereo", "one-view"])
    parser.add_argument("--held-out", action="append", default=[])
    parser.add_argument("--random", action="store_true")
    parser.add_argument("--test", type=Path)
    parser.add_argument("--calibrate", type=Path)
    parser.add_argument("--work", type=Path)
    parser.add_argument("--set", action="append")
    parser.add_argument("--json", type=Path, required=True)
    options = parser.parse_args()
    settings = settings_from(StereoSettings, options.set)
    data = open_dataset(options.data)
    held: dict[str, Any] = json.loads(options.json.read_text()) if options.json.is_file() else {}
    calibration = None if options.calibrate is None else open_dataset(options.calibrate)
    for train, tests in splits(data, options):
        for name in options.methods:
            if not all(f"{name}; {part}" in held for part in tests):
                if name == "rod-3d":
                    # no network: its own set, where the simulation can be repeated
                    test = tests[NEW]
                    cells = {NEW: judged(rod_3d(options.test, test), test)}
                else:
                    work = None if options.work is None else options.work / f"{name}-{settings.seed}"
                    cells = fitted(name, train, tests, settings, calibration, work)
                held |= {f"{name}; {part}": cell for part, cell in cells.items()}
                options.json.write_text(json.dumps(held, indent=1) + "\n")
            for part in tests:
                if f"{name}; {part}" in held:
                    print(line(f"{name}; {part}", held[f"{name}; {part}"]), flush=True)


def splits(data: Dataset, options: argparse.Namespace) -> Iterator[tuple[Dataset, dict[str, Dataset]]]:
    """Yields the training part and the test parts by name of each fit."""
    if options.test is not None:
        split = random_split(data, LEAKING_SHARE, 0)
        yield data.subset(split.train), {NEW: open_dataset(options.test), RANDOM: data.subset(split.test)}
    parts = {RANDOM: random_split(data, TEST_SHARE, 0).test} if options.random else {}
    parts |= {each: np.flatnonzero(np.isin(data.session, each.split(","))) for each in options.held_out}
    for part, test in parts.items():
        yield data.subset(np.setdiff1d(np.arange(len(data)), test)), {part: data.subset(test)}


def line(title: str, cell: Mapping[str, Any]) -> str:
    """Returns the figures of one method on one part as text."""
    rmse, mae = (", ".join(f"{1e3 * value:.0f}" for value in cell[key]) for key in ("rmse_n", "mae_n"))
    others = {key: value for key, value in cell.items() if key not in ("rmse_n", "mae_n", "force_n")}
    return f"{title}: RMSE {rmse}, MAE {mae} mN, magnitude MAE {1e3 * cell['magnitude_mae_n']:.0f} mN; {others}"


if __name__ == "__main__":
    main()
