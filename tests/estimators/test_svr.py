"""Method 1: the thesis's method, what goes beyond it, and how it refuses."""

import pickle
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from scipy.optimize import minimize
from sklearn.svm import SVR

from tipforce.datasets import Dataset, open_dataset, random_split, random_subset
from tipforce.errors import InputError, NotFittedError
from tipforce.estimators import Svr, create
from tipforce.geometry import curve_from_angle
from tipforce.types import BasePose, Observation, SessionInfo, ShapeFeatures, Status

World = Callable[..., Dataset]
QUICK: dict[str, Any] = {"c": (10.0, 100.0), "epsilon": (0.01,), "sigma": (0.3, 1.0)}


def fitted(data: Dataset, **settings: Any) -> Svr:
    svr = create("svr", {**QUICK, **settings}).fit(data)
    assert isinstance(svr, Svr)
    return svr


def table(data: Dataset) -> np.ndarray:
    shapes = [o.views["camera"].values for o in data.observations()]  # type: ignore[union-attr]
    return np.column_stack([shapes, data.actuation["knob_deg"]])


def test_it_learns_a_smooth_law(world: World) -> None:
    data = world()
    split = random_split(data, 0.25)
    answers = fitted(data.subset(split.train), force="components").predict(data.subset(split.test))
    error = np.array([answer.force_n[:2] for answer in answers]) - data.force_n[split.test, :2]
    assert np.sqrt(np.mean(error**2)) < 0.012
    assert answers[0].known.tolist() == [True, True, False]
    assert np.isnan(answers[0].force_n[2])


@dataclass
class Blind:
    """A store of which some rows have no shape."""

    store: Any
    lost: np.ndarray

    def read(self, rows: np.ndarray) -> Iterator[Observation]:
        for row, seen in zip(rows.tolist(), self.store.read(rows), strict=True):
            shape = seen.views["camera"]
            yield (
                replace(seen, views={"camera": replace(shape, values=shape.values * np.nan)})
                if self.lost[row]
                else seen
            )


def test_training_stops_where_a_whole_session_would_be_left_out(world: World) -> None:
    data = world(sessions=2, frames=60)
    first, lost = data.sessions
    whole = np.array([name == lost for name in data.session])
    blind = replace(data, store=Blind(data.store, whole))
    with pytest.raises(InputError, match=f"of 120 samples training would leave out 60: all 60 of {lost}"):
        fitted(blind)
    assert fitted(blind, max_left_out=1.0).describe().left_out == {lost: [60, 60]}
    other = world(sessions=2, frames=60, seed=1)
    some = replace(other, store=Blind(other.store, np.arange(120) % 8 == 0))
    with pytest.raises(InputError, match="of 120 samples training would leave out 15: 8 of 60 of"):
        fitted(some)
    assert fitted(some, max_left_out=0.2).describe().left_out == {first: [8, 60], lost: [7, 60]}


def test_the_default_is_the_thesis_s_method_done_by_hand(world: World) -> None:
    data = world(sessions=1, frames=60)
    svr = fitted(data)
    constants = svr.describe().targets["magnitude"]
    x, y = table(data), data.magnitude_n
    size = np.abs(x).max(axis=0)
    assert size[4] == 0  # the constant of this world's polynomials is zero, and stays so
    x, unit = x / np.where(size > 0, size, 1), y.max()
    by_hand = SVR(kernel="rbf", gamma=1 / constants.sigma**2, C=constants.c, epsilon=constants.epsilon)
    expected = by_hand.fit(x, y / unit).predict(x) * unit
    answers = svr.predict(data)
    assert np.max(np.abs([a.magnitude_n for a in answers] - np.maximum(expected, 0))) < 1e-9
    assert all(np.isnan(a.force_n).all() and not a.known.any() for a in answers)


def test_estimates_are_equations_13_to_15_with_the_dual_solved_by_hand(world: World) -> None:
    data = world(sessions=1, frames=24)
    svr = fitted(data, c=(1.0,), epsilon=(0.03,), sigma=(0.3,))
    x, y = table(data), data.magnitude_n
    size = np.abs(x).max(axis=0)
    x, unit = x / np.where(size > 0, size, 1), y.max()
    y = y / unit
    kernel = np.exp(-((x[:, None] - x[None]) ** 2).sum(axis=2) / 0.3**2)  # eq. (15)

    def objective(alphas: np.ndarray) -> tuple[float, np.ndarray]:
        """Eq. (11) and its gradient, by alpha and alpha*."""
        alpha, star = np.split(alphas, 2)
        pull = kernel @ (star - alpha)
        value = 0.5 * (star - alpha) @ pull + 0.03 * (star + alpha).sum() - y @ (star - alpha)
        return value, np.concatenate([-pull + 0.03 + y, pull + 0.03 - y])

    equal = {"type": "eq", "fun": lambda a: a[:24].sum() - a[24:].sum(), "jac": lambda _: np.repeat([1.0, -1.0], 24)}
    solved = minimize(
        objective, np.zeros(48), jac=True, method="SLSQP", bounds=[(0.0, 1.0)] * 48, constraints=[equal],
        options={"maxiter": 500, "ftol": 1e-12},
    )  # fmt: skip
    assert solved.success, solved.message
    alpha, star = np.split(solved.x, 2)
    dual = star - alpha
    free = np.flatnonzero((np.abs(dual) > 1e-4) & (np.abs(dual) < 1 - 1e-4))
    assert len(free) >= 2
    intercept = np.mean(y[free] - kernel[free] @ dual - 0.03 * np.sign(dual[free]))  # eq. (14)
    expected = (kernel @ dual + intercept) * unit  # eq. (13)
    answers = np.array([each.magnitude_n for each in svr.predict(data)])
    assert answers == pytest.approx(expected, abs=2e-3 * unit), "scikit-learn stops at a tolerance of 1e-3"


def test_epsilon_leaves_the_estimate_without_contact_at_zero(world: World) -> None:
    data = world()
    push = -data.force_n[:, 0]
    free = push < 0.12
    share = np.where(np.random.default_rng(0).random(len(data)) < 0.4, 1.0, 0.3)  # of the force: no shape tells which
    data.force_n[:, 0], data.force_n[:, 1] = np.where(free, 0.0, share * (0.12 - push)), 0.0
    flat = {"c": (1.0,), "sigma": (1.0,)}

    def without_contact(**settings: Any) -> tuple[float, float]:
        """Chosen epsilon and mean estimate without contact, both in shares of the largest force."""
        svr = create("svr", {**flat, **settings}).fit(data)
        found = np.mean([answer.magnitude_n for answer in svr.predict(data.subset(free))])
        return svr.describe().targets["magnitude"].epsilon, float(found / data.magnitude_n.max())

    wide, high = without_contact(epsilon=(0.003, 0.01, 0.03, 0.1))
    assert wide == 0.1  # the squared error chooses it
    assert high > 0.05
    assert without_contact()[1] < 0.02


def test_constants_are_chosen_on_the_training_part_alone(world: World) -> None:
    data = world()
    part = data.subset(np.arange(80))
    first = fitted(part)
    data.force_n[80:] = 99.0  # what is not in the part must not matter
    again = fitted(data.subset(np.arange(80)))
    assert first.describe() == again.describe()
    assert [a.magnitude_n for a in first.predict(part)] == [a.magnitude_n for a in again.predict(part)]


def test_the_same_seed_gives_the_same_model(world: World) -> None:
    data = world(sessions=2)
    assert fitted(data, seed=1).describe() == fitted(data, seed=1).describe()


@pytest.mark.parametrize(
    "settings",
    [
        pytest.param({"scaling": "standard"}, marks=pytest.mark.slow),
        pytest.param({"linear": 0.5, "scaling": "standard"}, marks=pytest.mark.slow),
        {"angles": {"degree": 2, "length": 1.0}, "linear": 0.5, "scaling": "standard"},
        {"window": {"lags_ms": [0, 100], "average_ms": 70}, "scaling": "standard"},
        {"label_average_ms": 100},
        {"training_samples": 100, "tuning_samples": 60},
        {"hold_out": "sample"},
    ],
    ids=lambda settings: "+".join(settings),
)
def test_what_goes_beyond_the_thesis_still_learns(world: World, settings: dict[str, Any]) -> None:
    data = world()
    svr = fitted(data, force="components", **settings)
    error = np.array([a.force_n[:2] for a in svr.predict(data)]) - data.force_n[:, :2]
    assert np.sqrt(np.mean(error**2)) < 0.015
    assert svr.describe().parity_with_scikit_learn_n < 1e-9


def test_a_straight_line_in_the_kernel_goes_on_beyond_the_data(world: World) -> None:
    data = world(noise_n=0.0)
    inside = np.abs(data.force_n[:, 0]) < 0.18
    wrong = []
    for linear in (0.0, 1.0):
        svr = fitted(data.subset(inside), force="components", linear=linear, scaling="standard")
        far = data.subset(~inside)
        wrong.append(np.abs([a.force_n[0] for a in svr.predict(far)] - far.force_n[:, 0]).max())
    assert wrong[1] < 0.6 * wrong[0]


def test_a_window_sees_the_past_of_its_own_session_alone(world: World) -> None:
    data = world()
    svr = fitted(data, window={"lags_ms": [0, 200]})
    assert svr.uses_history
    whole = [a.magnitude_n for a in svr.predict(data)]
    alone = [a.magnitude_n for a in svr.predict(data.subset(data.session == "s2"))]
    assert alone == whole[80:120]
    cut = [a.magnitude_n for a in svr.predict(replace(data.subset(np.arange(90, 120)), whole=None))]
    assert cut[:6] != whole[90:96]
    assert cut[7:] == whole[97:120]


def test_a_window_learns_from_the_frames_between_drawn_samples(world: World) -> None:
    data = world()
    some = random_subset(data, 60, seed=0)
    svr = fitted(some, window={"lags_ms": [0, 200]})
    by_row = [a.magnitude_n for a in svr.predict(data)]
    error = np.array(by_row)[some.rows] - some.magnitude_n
    assert np.sqrt(np.mean(error**2)) < 0.012


def test_missing_actuation_is_answered_with_its_name(world: World) -> None:
    data = world()
    stream = fitted(data).start(SessionInfo())
    seen = next(data.observations())
    for actuation in ({}, {"knob_deg": float("nan")}):
        answer = stream.update(replace(seen, actuation=actuation))
        assert answer.status is Status.MISSING_INPUT
        assert "knob_deg" in answer.detail
        assert np.isnan(answer.magnitude_n)


def test_other_shape_numbers_or_views_are_refused(world: World) -> None:
    data = world()
    stream = fitted(data).start(SessionInfo())
    seen = next(data.observations())
    other = replace(seen, views={"camera": ShapeFeatures(("B1",), np.zeros(1))})
    assert "B1" in stream.update(other).detail
    elsewhere = stream.update(replace(seen, views={"side": seen.views["camera"]}))
    assert elsewhere.status is Status.MISSING_INPUT
    assert "'camera'" in elsewhere.detail
    broken = replace(seen, views={"camera": ShapeFeatures(("A1", "A2", "A3", "A4", "A5"), np.full(5, np.nan))})
    assert stream.update(broken).status is Status.NO_CATHETER
    assert stream.update(seen).valid  # and goes on afterwards


def test_answers_share_nothing_that_can_be_changed(world: World) -> None:
    data = world(sessions=1)
    for force in ("magnitude", "components"):
        answer = fitted(data, force=force).predict(data)[0]
        for array in (
            answer.force_n,
            answer.known,
            answer.covariance_n2,
            answer.interval_n,
            answer.magnitude_interval_n,
        ):
            assert not array.flags.writeable
        checked = replace(pickle.loads(pickle.dumps(answer)))  # runs every check of the type itself
        assert checked.valid
        assert 0 <= answer.magnitude_interval_n[0] <= answer.magnitude_n <= answer.magnitude_interval_n[1]


def test_too_little_or_wrong_data_say_what_is_needed(world: World) -> None:
    data = world()
    with pytest.raises(InputError, match="has 3 samples; training svr needs at least 20"):
        create("svr").fit(data.subset(np.arange(3)))
    with pytest.raises(InputError, match="has no actuation 'wire0_mm'; it has knob_deg"):
        create("svr", {"actuation": ("wire0_mm",)}).fit(data)
    with pytest.raises(InputError, match=r"needs the setting angles\.length"):
        create("svr", {"angles": {}}).fit(data)
    with pytest.raises(InputError, match="describe 4: set them as the numbers were made"):
        create("svr", {"angles": {"length": 1.0}, "features": {"constant": False}}).fit(data)
    with pytest.raises(InputError, match="at least two sessions"):
        create("svr", {"hold_out": "session"}).fit(data.subset(data.session == "s0"))
    with pytest.raises(NotFittedError, match="tipforce train"):
        create("svr").start(SessionInfo())
    with pytest.raises(InputError, match="there is no estimator 'svm'; there are svr"):
        create("svm")


def test_an_observation_of_the_wrong_kind_never_raises(world: World) -> None:
    stream = fitted(world()).start(SessionInfo())
    assert not stream.update(Observation(0, {})).valid


@pytest.mark.slow
def test_images_are_learnt_from_and_what_they_hide_is_said(tmp_path: Path) -> None:
    """From image files to forces; vision calibrated on the way; an image without a catheter gets its reason."""
    write_images(tmp_path / "data")
    data = open_dataset(tmp_path / "data")
    svr = fitted(data, force="components", features={"kind": "legendre", "degree": 3})
    assert svr.fitted_.vision.polarity == "dark"
    assert svr.fitted_.vision.base_side == "left"
    assert "found by `auto`, not the thesis's algorithm 1" in svr.describe().summary().inputs
    error = np.array([a.force_n[1] for a in svr.predict(data)]) - data.force_n[:, 1]
    assert np.sqrt(np.mean(error**2)) < 0.01
    stream = svr.start(SessionInfo())
    empty = stream.update(Observation(0, {"camera": np.full((240, 320), 215, np.uint8)}, {"knob_deg": 10.0}))
    assert empty.status is Status.NO_CATHETER
    assert empty.detail
    colour = next(data.observations())
    grey = colour.views["camera"]
    assert isinstance(grey, np.ndarray)
    again = stream.update(replace(colour, views={"camera": np.repeat(grey[:, :, None], 3, axis=2)}))
    assert abs(again.force_n[1] - stream.update(colour).force_n[1]) < 1e-3


def test_the_same_images_by_the_thesis_s_own_vision_with_a_polynomial(tmp_path: Path) -> None:
    write_images(tmp_path / "data")
    data = open_dataset(tmp_path / "data")
    svr = fitted(data, vision={"method": "classic"})
    assert "found by `classic`, the thesis's algorithm 1" in svr.describe().summary().inputs
    assert svr.describe().features == ("A1", "A2", "A3", "A4", "A5", "knob_deg")
    error = np.array([a.magnitude_n for a in svr.predict(data)]) - data.magnitude_n
    assert np.sqrt(np.mean(error**2)) < 0.02


def test_images_of_different_size_are_warned_of(tmp_path: Path) -> None:
    write_images(tmp_path / "data")
    table = tmp_path / "data" / "metadata.csv"
    head, *rows = table.read_text().splitlines()
    name = head.split(",").index("session")
    cells = [row.split(",") for row in rows]
    for place, row in enumerate(cells):
        row[name] = "near" if place < 15 else "far"
    table.write_text("\n".join([head, *(",".join(row) for row in cells)]) + "\n")
    for row in cells[15:]:
        path = str(tmp_path / "data" / row[0])
        cv2.imwrite(path, cv2.copyMakeBorder(cv2.imread(path), 0, 40, 0, 40, cv2.BORDER_REPLICATE))
    with pytest.warns(UserWarning, match=r"differ in size \(320x240 in near, 360x280 in far\)"):
        fitted(open_dataset(tmp_path / "data"), vision={"method": "classic"})


def test_images_without_a_catheter_cannot_be_learnt_from(tmp_path: Path) -> None:
    write_images(tmp_path / "data", blank=True)
    with pytest.raises(InputError, match=r"data: .* known in 0 of 30 samples, .* no catheter was found"):
        create("svr").fit(open_dataset(tmp_path / "data"))


def write_images(folder: Path, count: int = 30, blank: bool = False) -> None:
    (folder / "images").mkdir(parents=True)
    lines = ["file_name,session,stamp_ns,knob_deg,fx_n,fy_n"]
    base = BasePose(np.array([-20.0, 150.0]), -0.02)
    for k in range(count):
        bend = 0.8 + 0.5 * np.sin(0.55 * k)
        image = np.full((240, 320), 215, np.uint8)
        if not blank:
            axis = base.to_image(curve_from_angle(np.array([0.4, 0.5, 0.1]) * bend, 220.0, 200))
            cv2.polylines(image, [np.round(axis * 16).astype(np.int32)], False, 45, 9, cv2.LINE_AA, 4)
            image = cv2.GaussianBlur(image, (0, 0), 0.8)  # type: ignore[assignment]
        (folder / "images" / f"{k}.png").write_bytes(cv2.imencode(".png", image)[1].tobytes())
        lines.append(f"images/{k}.png,s,{k * 40_000_000},10,0,{0.2 * bend}")
    (folder / "metadata.csv").write_text("\n".join(lines) + "\n")
