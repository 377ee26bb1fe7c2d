"""Judges the networks of two views on whole sessions that are held out, beside simpler methods, on equal splits.

    python -m bench.studies.two_views DATA --methods constant pca-svr stereo one-view hnet --held-out NAME --json FILE

Each ``--held-out`` states the sessions of one test part, separated by commas; ``--random`` adds a random split of
75/25, which leaks: the neighbours of a test image are in the training part. Each fit is kept in the JSON file as soon
as it is done, and a fit in that file is not repeated.

``pca-svr``: 40 principal components of both images, RBF support vectors for each component of the force. ``one-view``:
the network of `stereo` with the first view in place of both. ``hnet``: after the abstract of H-Net (Fekri, Zadeh and
Dargahi, IEEE RA-L 2024): two encoder-decoders with shared weights and skip connections give two masks, and a dense head
on both bottlenecks gives the force; below 0.5 M weights.
"""

import argparse
import json
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import nn
from torch.nn.functional import binary_cross_entropy_with_logits, interpolate

from tipforce.cli._settings import settings_from
from tipforce.datasets import Dataset, open_dataset, random_split
from tipforce.estimators import Estimator, NetworkEstimator, Stereo, StereoSettings
from tipforce.estimators.networks._preparation import Arrays
from tipforce.evaluation import Constant
from tipforce.training import COMPACT_UNIT_N, StereoTask
from tipforce.types import Image, IntArray, Observation

COMPONENTS, SVR_C, SVR_EPSILON = 40, 10.0, 0.05
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


def judged(
    force: np.ndarray, test: Dataset, ends: np.ndarray | None = None, magnitude_ends: np.ndarray | None = None
) -> dict[str, Any]:
    """Returns the errors of the estimates (n, 3) in N, and the share of the truths within the intervals."""
    valid = np.isfinite(force).all(axis=1)
    error = (force - test.force_n)[valid]
    size = np.linalg.norm(force[valid], axis=1) - test.magnitude_n[valid]
    found = {
        "n": len(test),
        "abstained": float(1.0 - valid.mean()),
        "rmse_n": np.sqrt((error**2).mean(axis=0)).tolist(),
        "mae_n": np.abs(error).mean(axis=0).tolist(),
        "magnitude_mae_n": float(np.abs(size).mean()),
        "magnitude_rmse_n": float(np.sqrt((size**2).mean())),
    }
    if ends is not None and magnitude_ends is not None:
        truth, magnitude = test.force_n[valid], test.magnitude_n[valid]
        inside = (ends[valid, :, 0] <= truth) & (truth <= ends[valid, :, 1])
        held = (magnitude_ends[valid, 0] <= magnitude) & (magnitude <= magnitude_ends[valid, 1])
        found |= {"coverage": inside.mean(axis=0).tolist(), "magnitude_coverage": float(held.mean())}
    return found


def fitted(name: str, train: Dataset, test: Dataset, settings: StereoSettings) -> dict[str, Any]:
    """Trains one method and returns its errors on the test part, with its size and time."""
    started = time.perf_counter()
    if name == "pca-svr":
        found = judged(pca_svr(train, test, settings.views), test)
        return found | {"seconds": time.perf_counter() - started}
    if name == "one-view":
        train, test = (
            replace(part, store=FirstViewTwice(part.store, settings.views), whole=None) for part in (train, test)
        )
    makers: dict[str, Any] = {"constant": Constant, "hnet": lambda: HNetEstimator(settings)}
    model: Estimator = makers.get(name, lambda: Stereo(settings))()
    model.fit(train)
    seconds = time.perf_counter() - started
    answers = model.predict(test)
    keys = ("force_n", "interval_n", "magnitude_interval_n")
    force, ends, magnitude_ends = (np.array([getattr(each, key) for each in answers]) for key in keys)
    found = judged(force, test, ends, magnitude_ends) | {"seconds": seconds}
    if isinstance(model, Stereo):
        some = test.subset(np.arange(min(TIMED_PAIRS, len(test))))
        stream, times = model.start(next(iter(some.session_info.values()))), []
        for observation in some.observations():
            before = time.perf_counter()
            stream.update(observation)
            times.append(1e3 * (time.perf_counter() - before))
        found |= {"parameters": model.describe().parameters, "ms": float(np.median(times)), "least_ms": min(times)}
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("data", type=Path)
    parser.add_argument("--methods", nargs="+", default=["constant", "pca-svr", "stereo", "one-view"])
    parser.add_argument("--held-out", action="append", default=[])
    parser.add_argument("--random", action="store_true")
    parser.add_argument("--set", action="append")
    parser.add_argument("--json", type=Path, required=True)
    options = parser.parse_args()
    settings = settings_from(StereoSettings, options.set)
    data = open_dataset(options.data)
    held: dict[str, Any] = json.loads(options.json.read_text()) if options.json.is_file() else {}
    parts = {"random, leaks": random_split(data, TEST_SHARE, 0).test} if options.random else {}
    parts |= {each: np.flatnonzero(np.isin(data.session, each.split(","))) for each in options.held_out}
    for part, test in parts.items():
        train = np.setdiff1d(np.arange(len(data)), test)
        for name in options.methods:
            key = f"{name}; {part}"
            if key not in held:
                held[key] = fitted(name, data.subset(train), data.subset(test), settings)
                options.json.write_text(json.dumps(held, indent=1) + "\n")
            cell = held[key]
            rmse = ", ".join(f"{1e3 * value:.0f}" for value in cell["rmse_n"])
            print(f"{key}: RMSE {rmse} mN, magnitude MAE {1e3 * cell['magnitude_mae_n']:.0f} mN; {cell}", flush=True)


if __name__ == "__main__":
    main()
