"""Each model gives back the force of its own forward model; drawn rods give theirs; metadata are needed."""

import math
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from tests.oracles.planar_rod import solve_static

from tipforce.datasets import Dataset
from tipforce.errors import InputError
from tipforce.estimators import ESTIMATORS, Estimator, create, load_model, save_model
from tipforce.estimators.rod_models import STATIONS, RodModelEstimator, StationNoise, fit_force, model_stations
from tipforce.mechanics import PlanarRod
from tipforce.types import ActuationInfo, BasePose, Catheter, Observation, SessionInfo, Status, ViewInfo

MODELS = [name for name, kind in ESTIMATORS.items() if issubclass(kind, RodModelEstimator)]
ONE_DEGREE_OF_FREEDOM = ("arcs", "pseudo-rigid")
"""Their shape tells one component of the force: the other is the prior's."""
every_model = pytest.mark.parametrize("name", MODELS)
BENT = PlanarRod(0.04, 4.3e-4, 0.008, precurvature_per_m=15.0)


def kind_of(name: str) -> type[RodModelEstimator]:
    kind = ESTIMATORS[name]
    assert issubclass(kind, RodModelEstimator)
    return kind


def fine(stations: int, force_std_n: float = 10.0, station_std_m: float = 1e-6) -> StationNoise:
    return StationNoise.of(station_std_m**2 * np.eye(2 * stations), force_std_n)


@every_model
@pytest.mark.parametrize("force", [(-0.1, 0.05), (-0.15, -0.1), (0.05, 0.2), (0.0, 0.0)])
def test_a_model_gives_back_the_force_of_its_own_forward_model(name: str, force: tuple[float, float]) -> None:
    kind = kind_of(name)
    model = kind.model(BENT)
    found = fit_force(model, model_stations(model, np.array(force), kind.stations), fine(kind.stations))
    assert found.converged
    again = model_stations(model, found.force_n, kind.stations)
    assert again == pytest.approx(model_stations(model, np.array(force), kind.stations), abs=1e-6)
    if name not in ONE_DEGREE_OF_FREEDOM:
        assert found.force_n == pytest.approx(force, abs=5e-4)


@every_model
def test_an_axial_force_on_a_straight_shaft_is_left_to_the_prior(name: str) -> None:
    kind = kind_of(name)
    model = kind.model(PlanarRod(0.04, 4.3e-4, 0.008))
    noise = fine(kind.stations, force_std_n=0.2, station_std_m=1e-4)
    found = fit_force(model, model_stations(model, np.array([-0.05, 0.0]), kind.stations), noise)
    assert abs(found.force_n[0]) < 0.01
    assert math.sqrt(found.covariance_n2[0, 0]) == pytest.approx(0.2, rel=0.05)
    assert math.sqrt(found.covariance_n2[1, 1]) < 0.02


def test_the_covariance_is_that_of_estimates_from_noisy_stations() -> None:
    model, noise, draws = kind_of("beam").model(BENT), fine(STATIONS, station_std_m=1e-4), np.random.default_rng(0)
    exact = model_stations(model, np.array([-0.1, 0.1]))
    fits = [fit_force(model, exact + draws.normal(0, 1e-4, exact.shape), noise) for _ in range(300)]
    spread = np.std([fit.force_n for fit in fits], axis=0)
    assert spread == pytest.approx(np.sqrt(np.diag(fits[0].covariance_n2)), rel=0.12)
    assert np.mean([fit.misfit for fit in fits]) == pytest.approx(2 * STATIONS - 2, rel=0.1), "two numbers were fitted"


SCALE = 2e-4
INFO = SessionInfo(
    catheter=Catheter(flexible_length_m=0.04, rigid_length_m=0.008, bending_stiffness_nm2=4.3e-4),
    views={"camera": ViewInfo(metres_per_px=SCALE, base_side="left", polarity="dark")},
    actuation=ActuationInfo(knob_gain_per_m_deg=0.5),
)
VISION = {"polarity": "dark", "base_side": "left"}


def drawn(force: np.ndarray, factor: float) -> np.ndarray:
    """(240, 320) grey: the rod with the knob at 20 degrees, from the left border, under ``force`` (2,)."""
    line = solve_static(PlanarRod(0.04, 4.3e-4 * factor, 0.008, precurvature_per_m=10.0), force).centreline_m(200)
    points = BasePose(np.array([0.0, 150.0]), 0.0).to_image(np.vstack([[-0.01, 0.0], line]) / SCALE)
    image = np.full((240, 320), 215, np.uint8)
    cv2.polylines(image, [np.round(points * 16).astype(np.int32)], False, 45, 9, cv2.LINE_AA, 4)
    rough = cv2.GaussianBlur(image, (0, 0), 0.8) + np.random.default_rng(0).normal(0, 2, image.shape)
    return np.clip(np.rint(rough), 0, 255).astype(np.uint8)


class Drawn:
    """Images in memory."""

    def __init__(self, images: list[np.ndarray]) -> None:
        self.images = images

    def read(self, rows: np.ndarray) -> Iterator[Observation]:
        for row in rows.tolist():
            yield Observation(row * 40_000_000, {"camera": self.images[row]}, {"knob_deg": 20.0})


def rods(factor: float, info: SessionInfo = INFO, count: int = 24) -> Dataset:
    """Two sessions; their catheter is ``factor`` times as stiff as stated."""
    phase = 0.7 * np.arange(count)
    force = np.full((count, 3), np.nan)
    force[:, 0], force[:, 1] = -0.06 - 0.05 * np.sin(phase), -0.05 - 0.08 * np.cos(1.3 * phase)
    return Dataset(
        store=Drawn([drawn(each, factor) for each in force[:, :2]]),
        session=np.repeat(["a", "b"], count // 2),
        stamp_ns=np.arange(count) * 40_000_000,
        actuation={"knob_deg": np.full(count, 20.0)},
        force_n=force,
        known=np.array([True, True, False]),
        names=np.arange(count).astype(str),
        session_info={"a": info, "b": info},
        rows=np.arange(count),
    )


@pytest.fixture(scope="module")
def stated() -> Dataset:
    return rods(1.0)


@pytest.fixture(scope="module")
def stiffer() -> Dataset:
    return rods(1.4)


def errors_n(method: Estimator, data: Dataset) -> np.ndarray:
    found = method.predict(data)
    assert all(each.valid for each in found), {each.detail for each in found}
    return np.array([each.force_n[:2] for each in found]) - data.force_n[:, :2]


@every_model
def test_without_a_fit_a_stated_stiffness_gives_the_lateral_force(name: str, stated: Dataset) -> None:
    error = np.abs(errors_n(create(name, {"vision": VISION}), stated)).mean(axis=0)
    assert error[1] < 0.025, "an arc and a linear beam are worse than the rest"
    found = create(name, {"vision": VISION}).predict(stated.subset(np.arange(1)))[0]
    assert found.known.tolist() == [True, True, False]
    assert found.interval_n[1, 0] < found.force_n[1] < found.interval_n[1, 1]
    assert found.shape is not None


def test_fit_learns_the_stiffness_and_saves_it(stiffer: Dataset, tmp_path: Path) -> None:
    before = np.abs(errors_n(create("links", {"vision": VISION}), stiffer)[:, 1]).mean()
    fitted = create("links", {"vision": VISION}).fit(stiffer)
    assert fitted.describe().stiffness_factor == pytest.approx(1.4, rel=0.08)
    after = np.abs(errors_n(fitted, stiffer)[:, 1]).mean()
    assert after < 0.5 * before
    calibrated = fitted.calibrate(stiffer)
    assert "held-out" in calibrated.describe().interval_basis
    save_model(calibrated, tmp_path / "links", stiffer)
    again = load_model(tmp_path / "links")
    one = stiffer.subset(np.arange(3))
    for old, new in zip(calibrated.predict(one), again.predict(one), strict=True):
        np.testing.assert_array_equal(old.interval_n, new.interval_n)
        np.testing.assert_array_equal(old.force_n, new.force_n)


def test_a_stiffness_that_nobody_stated_is_learnt(stiffer: Dataset) -> None:
    bare = replace(INFO, catheter=replace(INFO.catheter, bending_stiffness_nm2=None))
    data = replace(stiffer, session_info={"a": bare, "b": bare})
    fresh = create("elastica", {"vision": VISION})
    assert "catheter.bending_stiffness_nm2" in fresh.required_metadata
    refused = fresh.predict(data.subset(np.arange(1)))[0]
    assert refused.status is Status.MISSING_INPUT
    assert "catheter.bending_stiffness_nm2" in refused.detail
    fitted = fresh.fit(data)
    assert "catheter.bending_stiffness_nm2" not in fitted.required_metadata
    assert np.abs(errors_n(fitted, data)[:, 1]).mean() < 0.015


@pytest.mark.parametrize(
    ("observation", "status"),
    [
        (Observation(0, {"camera": np.full((240, 320), 215, np.uint8)}, {"knob_deg": 20.0}), Status.NO_CATHETER),
        (Observation(0, {}, {"knob_deg": 20.0}), Status.MISSING_INPUT),
        (
            Observation(0, {"camera": np.full((240, 320), 215, np.uint8)}, {"knob_deg": 200.0}),
            Status.OUT_OF_DISTRIBUTION,
        ),
        (Observation(0, {"camera": np.full((240, 320), 215, np.uint8)}, {"knob_deg": 1e3}), Status.OUT_OF_DISTRIBUTION),
        (Observation(0, {"camera": np.full((240, 320), 215, np.uint8)}, {}), Status.MISSING_INPUT),
    ],
)
def test_what_cannot_be_read_is_told(observation: Observation, status: Status) -> None:
    found = create("beam", {"vision": VISION}).start(INFO).update(observation)
    assert found.status is status
    assert math.isnan(found.magnitude_n)
    assert found.detail


def test_a_line_that_no_force_explains_is_refused(stated: Dataset) -> None:
    turned = Drawn([np.ascontiguousarray(np.flipud(image)) for image in stated.store.images[:2]])  # type: ignore[attr-defined]
    data = replace(stated.subset(np.arange(2)), store=turned, whole=None, _memo={})
    found = create("links", {"vision": VISION, "force_std_n": 0.1}).fit(stated).predict(data)
    assert {each.status for each in found} == {Status.OUT_OF_DISTRIBUTION}, [each.magnitude_n for each in found]


def test_too_few_samples_are_refused(stated: Dataset) -> None:
    with pytest.raises(InputError, match="needs 20"):
        create("arcs", {"vision": VISION}).fit(stated.subset(np.arange(10)))
