"""A small bench of numbers: sessions whose force depends on one drive reading, and a ridge that learns it."""

from collections.abc import Iterator
from typing import Any, Self

import numpy as np
import pytest
from pydantic import BaseModel

from tipforce.datasets import Dataset
from tipforce.estimators import Estimator, ModelFacts
from tipforce.types import ForceEstimate, Observation, SessionInfo, Status


class Rows:
    """A store of nothing but drive readings."""

    def __init__(self, stamps, actuation, views=None):
        self.stamps, self.actuation, self.views = stamps, actuation, views

    def read(self, rows) -> Iterator[Observation]:
        for row in rows.tolist():
            yield Observation(
                int(self.stamps[row]),
                {} if self.views is None else {"camera": self.views[row]},
                {name: float(values[row]) for name, values in self.actuation.items()},
            )


def bench(sessions=4, frames=40, seed=0, noise_n=0.005, shift_n=0.02, views=None) -> Dataset:
    """Planar forces 0.05-0.35 N along x plus a little y; every session has its own offset."""
    draw = np.random.default_rng(seed)
    count = sessions * frames
    session = np.repeat([f"s{i}" for i in range(sessions)], frames)
    stamps = np.tile(np.arange(frames) * 100_000_000, sessions)
    phase = np.tile(np.linspace(0, 6 * np.pi, frames), sessions) + np.repeat(draw.uniform(0, 6, sessions), frames)
    size = 0.2 + 0.15 * np.sin(phase)
    offset = np.repeat(draw.normal(0, shift_n, sessions), frames)
    actuation = {"bend_deg": 100 * size + draw.normal(0, 0.5, count)}
    force = np.full((count, 3), np.nan)
    force[:, 0] = size + offset + draw.normal(0, noise_n, count)
    force[:, 1] = 0.3 * size + draw.normal(0, noise_n, count)
    return Dataset(
        store=Rows(stamps, actuation, views),
        session=session,
        stamp_ns=stamps,
        actuation=actuation,
        force_n=force,
        known=np.array([True, True, False]),
        names=np.array([f"{name}/{i:04d}.png" for name, i in zip(session, range(count), strict=True)]),
        session_info={f"s{i}": SessionInfo(name=f"s{i}") for i in range(sessions)},
        rows=np.arange(count),
        title="bench of numbers",
    )


class RidgeSettings(BaseModel):
    alpha: float = 1e-6
    refuse_above_deg: float = np.inf
    uses_history: bool = False
    unbounded: bool = False


class RidgeFacts(ModelFacts, frozen=True):
    alpha: float


class Ridge(Estimator):
    """Force from one drive reading; refuses readings above a limit; counts the frames its stream saw."""

    name = "ridge"
    settings_type = RidgeSettings

    def __init__(self, settings: RidgeSettings | None = None) -> None:
        self.settings = settings or RidgeSettings()
        self.weights_ = None

    @property
    def uses_history(self) -> bool:
        return self.settings.uses_history

    def fit(self, dataset, progress=None) -> Self:
        x = np.column_stack([dataset.actuation["bend_deg"], np.ones(len(dataset))])
        known = dataset.force_n[:, :2]
        self.weights_ = np.linalg.solve(x.T @ x + self.settings.alpha * np.eye(2), x.T @ known)
        residual = known - x @ self.weights_
        self.sigma_ = residual.std(axis=0)
        self.trained_rows_ = dataset.rows
        if progress is not None:
            progress("ridge", 1.0)
        return self

    def calibrate(self, dataset, progress=None) -> Self:
        x = np.column_stack([dataset.actuation["bend_deg"], np.ones(len(dataset))])
        self.sigma_ = (dataset.force_n[:, :2] - x @ self.weights_).std(axis=0)
        self.calibrated_rows_ = dataset.rows
        return self

    def start(self, info):
        return RidgeStream(self)

    def unfitted(self) -> Self:
        return type(self)(self.settings)

    def state(self) -> tuple[dict[str, Any], dict[str, Any]]:
        return {}, {"weights": self.weights_, "sigma": self.sigma_}

    @classmethod
    def from_state(cls, settings, values, arrays, files=None) -> Self:
        made = cls(RidgeSettings.model_validate(settings))
        made.weights_, made.sigma_ = arrays["weights"], arrays["sigma"]
        return made

    def describe(self) -> RidgeFacts:
        return RidgeFacts(alpha=self.settings.alpha)


class RidgeStream:
    def __init__(self, model: Ridge) -> None:
        self.model, self.seen = model, 0

    def update(self, observation: Observation) -> ForceEstimate:
        self.seen += 1
        bend = observation.actuation["bend_deg"]
        if bend > self.model.settings.refuse_above_deg:
            return ForceEstimate.invalid(observation.stamp_ns, Status.OUT_OF_DISTRIBUTION, f"bend {bend:.1f} deg")
        xy = np.array([bend, 1.0]) @ self.model.weights_
        half = 1.645 * self.model.sigma_ if not self.model.settings.unbounded else np.full(2, np.inf)
        force = np.array([*xy, np.nan])
        size = float(np.hypot(*xy))
        return ForceEstimate(
            stamp_ns=observation.stamp_ns,
            force_n=force,
            known=np.array([True, True, False]),
            covariance_n2=np.full((3, 3), np.nan),
            interval_n=np.array([[xy[0] - half[0], xy[0] + half[0]], [xy[1] - half[1], xy[1] + half[1]], [np.nan] * 2]),
            magnitude_n=size,
            magnitude_interval_n=np.array([max(0.0, size - half.max()), size + half.max()]),
            detail=f"frame {self.seen} of its stream" if self.model.settings.uses_history else "",
        )


@pytest.fixture(scope="session")
def make_bench():
    return bench


@pytest.fixture(scope="session")
def ridge_class():
    return Ridge


@pytest.fixture(scope="session")
def make_ridge():
    def make(**settings) -> Ridge:
        return Ridge(RidgeSettings(**settings))

    return make
