"""`compact`: a window around the catheter, its own uncertainty, and abstention from what it was not trained on."""

import math
from collections.abc import Iterator
from dataclasses import replace

import cv2
import numpy as np
import pytest

from tipforce.datasets import Dataset
from tipforce.estimators import Compact, CompactSettings, load_model, save_model
from tipforce.estimators.networks import _calibration, _network
from tipforce.estimators.networks._calibration import quantise_checked
from tipforce.types import (
    ActuationInfo,
    Catheter,
    ForceEstimate,
    Observation,
    SessionInfo,
    Status,
    TissueInfo,
    ViewInfo,
)

pytest.importorskip("torch", reason="training needs the extra [train]")
pytest.importorskip("onnxscript", reason="training needs the extra [train]")

HEIGHT, WIDTH = 60, 80
CATHETER = Catheter("7F", 2.33e-3, 40e-3, 8e-3, 4.3e-4)
GAIN = ActuationInfo(0.533)
QUICK = CompactSettings(size=64, epochs=10, batch=16, precision="fp32", validation=0.2)


def bench(force: np.ndarray, draw: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """A dark whip from the left border, bent by ``force``, on a rough light ground; and where it is."""
    x = np.linspace(-3.0, 45.0 + 40.0 * force[0], 30)
    y = 30.0 - 80.0 * force[1] * (x / 45.0) ** 2
    line = np.rint(np.column_stack([x, y]) * 16).astype(np.int32)[None]
    mask = np.zeros((HEIGHT, WIDTH), np.uint8)
    cv2.polylines(mask, line, isClosed=False, color=255, thickness=3, lineType=cv2.LINE_AA, shift=4)
    ground = draw.integers(150, 170, (HEIGHT, WIDTH)).astype(np.float64)
    return (ground - mask * 0.5).clip(0, 255).astype(np.uint8), mask


def session(name: str, metres_per_px: float = 48e-3 / 50.0) -> SessionInfo:
    view, tissue = ViewInfo(metres_per_px, "left"), TissueInfo(60.0 if name in ("s0", "s3") else 240.0)
    return SessionInfo(name, CATHETER, {"camera": view}, actuation=GAIN, tissue=tissue)


class Whips:
    """A store in memory that knows where the whip is."""

    def __init__(self, force: np.ndarray, seed: int, masks: bool) -> None:
        draw = np.random.default_rng(seed)
        self.made, self.drawn = [bench(each, draw) for each in force], masks

    def read(self, rows: np.ndarray) -> Iterator[Observation]:
        for row in rows.tolist():
            yield Observation(row, {"camera": self.made[row][0]}, {"knob_deg": 10.0})

    def has_masks(self, rows: np.ndarray, view: str) -> bool:
        return self.drawn

    def masks(self, rows: np.ndarray, view: str) -> Iterator[np.ndarray | None]:
        return iter([self.made[row][1] if self.drawn else None for row in rows.tolist()])


def whips(seed: int = 0, sessions: int = 5, each: int = 30, masks: bool = True) -> Dataset:
    count = sessions * each
    force = np.full((count, 3), np.nan)
    force[:, :2] = np.random.default_rng(seed).uniform(-0.2, 0.2, (count, 2))
    return Dataset(
        store=Whips(force, seed, masks),
        session=np.repeat([f"s{k}" for k in range(sessions)], each),
        stamp_ns=np.arange(count),
        actuation={"knob_deg": np.full(count, 10.0)},
        force_n=force,
        known=np.array([True, True, False]),
        names=np.array([f"{k}.png" for k in range(count)]),
        session_info={f"s{k}": session(f"s{k}") for k in range(sessions)},
        rows=np.arange(count),
        title="whips",
    )


@pytest.fixture(scope="module")
def learnt() -> Compact:
    """Fitted once; not to be changed."""
    return Compact(QUICK).fit(whips())


def test_it_learns_and_its_intervals_follow_its_uncertainty(learnt):
    fresh = whips(seed=1)
    answers = learnt.predict(fresh)
    valid = np.array([each.valid for each in answers])
    assert valid.mean() > 0.8
    force = np.array([each.force_n[:2] for each in answers])[valid]
    assert np.abs(force - fresh.force_n[valid, :2]).mean() < 0.05  # 0.1 N by always answering the mean
    widths = np.array([each.interval_n[0, 1] - each.interval_n[0, 0] for each in answers])[valid]
    assert widths.std() > 0.02 * widths.mean() > 0
    assert all(np.isnan(each.force_n).all() for each in answers if not each.valid)


def test_calibration_on_other_sessions_makes_intervals_that_hold(learnt, tmp_path):
    other = load_model(save_model(learnt, tmp_path / "m", whips())).calibrate(whips(seed=2, sessions=10))
    fresh = whips(seed=3)
    answers = other.predict(fresh)
    held = [
        each.interval_n[0, 0] <= force <= each.interval_n[0, 1]
        for each, force in zip(answers, fresh.force_n[:, 0], strict=True)
        if each.valid
    ]
    assert np.mean(held) > 0.8
    assert other.describe().interval_basis == "whole sessions"


def test_a_model_folder_answers_the_same(learnt, tmp_path):
    data = whips(seed=4, sessions=1)
    again = load_model(save_model(learnt, tmp_path / "m", data))
    for a, b in zip(learnt.predict(data), again.predict(data), strict=True):
        assert a.status == b.status
        assert np.array_equal(a.interval_n, b.interval_n, equal_nan=True)


def empty(shape: tuple[int, ...] = (HEIGHT, WIDTH)) -> np.ndarray:
    return np.random.default_rng(0).integers(150, 170, shape).astype(np.uint8)


@pytest.mark.parametrize(
    "image",
    [
        empty(),
        np.zeros((HEIGHT, WIDTH), np.uint8),
        np.random.default_rng(1).integers(0, 256, (HEIGHT, WIDTH), np.uint8),
    ],
    ids=["ground alone", "black", "noise"],
)
def test_there_is_no_estimate_for_an_image_without_a_catheter(learnt, image):
    stream = learnt.start(whips().session_info["s0"])
    answer = stream.update(Observation(0, {"camera": image}, {"knob_deg": 10.0}))
    assert answer.status in (Status.NO_CATHETER, Status.OUT_OF_DISTRIBUTION, Status.UNOBSERVABLE)
    assert answer.detail


@pytest.mark.parametrize("level", [0, 128, 255])
def test_a_uniform_image_is_refused_whatever_the_network_makes_of_it(learnt, level: int):
    image = np.full((HEIGHT, WIDTH), level, np.uint8)
    image[::2, ::3] ^= 1  # the last bit of a digitised dark image
    stream = learnt.start(whips().session_info["s0"])
    stream._build = lambda *_: pytest.fail("the network was asked")
    answer = stream.update(Observation(0, {"camera": image}, {"knob_deg": 10.0}))
    assert answer.status is Status.NO_CATHETER
    assert "uniform" in answer.detail


def test_where_most_images_are_unlike_the_training_s_the_others_are_not_answered_either(learnt):
    data = whips(seed=4, sessions=1)
    known = next(each for each, answer in zip(data.observations(), learnt.predict(data), strict=True) if answer.valid)
    stream = learnt.start(data.session_info["s0"])
    build = stream._build
    refusing = replace(build, limits=replace(build.limits, min_heatmap_px=0.0, min_in_distribution_logit=math.inf))

    def at(second: float, *, strange: bool = False) -> ForceEstimate:
        stream._build = refusing if strange else build
        return stream.update(replace(known, stamp_ns=round(second * 1e9)))

    assert at(0.0).valid
    assert {at(0.1 * k, strange=True).status for k in range(1, 30)} == {Status.OUT_OF_DISTRIBUTION}
    among = at(3.0)
    assert among.status is Status.OUT_OF_DISTRIBUTION
    assert "of the last images" in among.detail
    assert [at(3.0 + 0.1 * k).valid for k in range(1, 40)][-1]


def test_an_estimate_that_is_too_unsure_carries_the_interval_apart(learnt):
    data = whips(seed=4, sessions=1)
    known = next(each for each, answer in zip(data.observations(), learnt.predict(data), strict=True) if answer.valid)
    answers = []
    for max_sigma_n in (math.inf, 0.0):
        stream = learnt.start(data.session_info["s0"])
        stream._build = replace(stream._build, limits=replace(stream._build.limits, max_sigma_n=max_sigma_n))
        answers.append(stream.update(known))
    sure, unsure = answers
    assert unsure.status is Status.UNOBSERVABLE
    assert np.isnan(unsure.magnitude_interval_n).all()
    assert np.allclose(unsure.abstained_interval_n, sure.magnitude_interval_n)


def test_an_absent_knob_is_asked_for(learnt):
    stream = learnt.start(whips().session_info["s0"])
    answer = stream.update(Observation(0, {"camera": empty()}))
    assert answer.status is Status.MISSING_INPUT
    assert "knob_deg" in answer.detail


def test_metadata_of_all_training_sessions_are_required(learnt):
    stated_info = whips().session_info["s0"]
    assert learnt.required_metadata
    silent = learnt.start(SessionInfo("s0")).update(Observation(0, {"camera": empty()}, {"knob_deg": 10.0}))
    assert silent.status is Status.MISSING_INPUT
    assert all(name in silent.detail for name in learnt.required_metadata)
    stated = learnt.start(SessionInfo("s0").updated(stated_info)).update(
        Observation(0, {"camera": empty()}, {"knob_deg": 10.0})
    )
    assert stated.status is not Status.MISSING_INPUT


def test_metadata_unknown_in_training_change_no_estimate(learnt):
    data = whips(seed=4, sessions=1)
    stated_info = data.session_info["s0"]
    silent = learnt.unfitted()
    only = {"required_metadata": (), "known_metadata": ("views.camera.base_side",)}
    facts = learnt.fitted_.facts.model_copy(update=only)
    silent.fitted_ = learnt.fitted_.model_copy(update={"facts": facts})
    for observation in list(data.observations())[:5]:
        answers = [
            silent.start(info).update(observation)
            for info in (
                SessionInfo("s0", views={"camera": ViewInfo(base_side="left")}, tissue=stated_info.tissue),
                stated_info,
                stated_info.updated(SessionInfo("s0", views={"camera": ViewInfo(1e-4)})),
            )
        ]
        assert len({each.force_n.tobytes() for each in answers}) == 1


def test_the_knob_is_required_where_its_gain_is_known(learnt):
    assert learnt.required_actuation == ("knob_deg",)
    stream = learnt.start(whips().session_info["s0"])
    answer = stream.update(Observation(0, {"camera": empty()}, {"knob_deg": float("nan")}))
    assert answer.status is Status.MISSING_INPUT


def test_a_window_is_cut_before_anything_was_learnt():
    info, observation = whips().session_info["s0"], next(whips().observations())
    row = Compact(QUICK).reader(info, training=False)(observation)
    assert row["image"].shape == (64, 64)


def test_a_model_that_an_earlier_version_made_is_to_be_trained_again(learnt):
    values, arrays = learnt.state()
    old = {name: value for name, value in arrays.items() if name != "rate_compensation_s"}
    with pytest.raises(KeyError):
        Compact.from_state(learnt.settings.model_dump(), values, old, learnt.files())


def test_an_earlier_frame_compensates_the_rate(learnt):
    assert not learnt.fitted_.arrays["rate_compensation_s"].any()  # no two samples so shortly after each other
    data = whips(seed=5, sessions=1)
    seconds = np.array([[0.02, 0.0], [0.01, 0.03]])
    leading = learnt.unfitted()
    arrays = {**learnt.fitted_.arrays, "rate_compensation_s": seconds, "sigma_factor_without_history": np.array(2.0)}
    leading.fitted_ = learnt.fitted_.model_copy(update={"arrays": arrays})
    still, stream = learnt.start(data.session_info["s0"]), leading.start(data.session_info["s0"])
    shown = [replace(each, stamp_ns=42_000_000 * k) for k, each in enumerate(data.observations())][:8]
    alone, led = [still.update(each) for each in shown], [stream.update(each) for each in shown]
    valid = [k for k, each in enumerate(alone) if each.valid and k and alone[k - 1].valid]
    for k in valid:
        rate = (alone[k].force_n[:2] - alone[k - 1].force_n[:2]) / 0.042
        assert np.allclose(led[k].force_n[:2], alone[k].force_n[:2] + rate @ seconds)
        assert np.allclose(led[k].covariance_n2[:2, :2], alone[k].covariance_n2[:2, :2])
    assert np.allclose(led[0].covariance_n2[:2, :2], 4.0 * alone[0].covariance_n2[:2, :2])
    assert valid


def test_without_metadata_the_base_s_border_is_detected():
    data = whips(masks=False)
    bare = Dataset(
        **{**vars(data), "session_info": {name: SessionInfo(name) for name in data.session_info}, "_memo": {}}
    )
    resolved = Compact(QUICK)
    resolved.resolve_settings(bare)
    assert resolved._detected_base_sides == ("left",)
    other = {
        **data.session_info,
        "s0": SessionInfo("s0", CATHETER, {"camera": ViewInfo(8e-4, "top")}),
        "s1": SessionInfo("s1"),
    }
    resolved = Compact(QUICK)
    resolved.resolve_settings(Dataset(**{**vars(data), "session_info": other, "_memo": {}}))
    assert resolved._detected_base_sides == ("left",)  # for s1 alone: what a session states stands
    assert resolved.settings.base_side == "auto"


def test_without_a_catheter_in_view_whole_images_are_used():
    class Grey:
        def read(self, rows: np.ndarray) -> Iterator[Observation]:
            return iter([Observation(row, {"camera": np.full((32, 32), 100, np.uint8)}) for row in rows.tolist()])

    data = whips(masks=False)
    bare = Dataset(
        **{**vars(data), "session_info": {n: SessionInfo(n) for n in data.session_info}, "store": Grey(), "_memo": {}}
    )
    resolved = Compact(QUICK)
    resolved.resolve_settings(bare)
    assert resolved._detected_base_sides == ("none",)


def test_the_window_of_another_scale_shows_the_same(learnt):
    data = whips(seed=5, sessions=1, each=1)
    image = next(data.observations()).views["camera"]
    near = cv2.resize(image, None, fx=2, fy=2, interpolation=cv2.INTER_AREA)
    info = data.session_info["s0"]
    twice = session("near", info.view("camera").metres_per_px / 2)
    one = learnt.start(info).update(Observation(0, {"camera": image}, {"knob_deg": 10.0}))
    other = learnt.start(twice).update(Observation(0, {"camera": near}, {"knob_deg": 10.0}))
    assert one.valid
    assert other.valid
    assert np.abs(one.force_n - other.force_n)[:2].max() < 0.03


@pytest.mark.slow
def test_in_eight_bits_it_estimates_nearly_the_same_and_from_its_folder_too(learnt, tmp_path, monkeypatch):
    calls = []
    monkeypatch.setattr(_network, "quantise_checked", lambda *given: calls.append(given) or quantise_checked(*given))
    monkeypatch.setattr(_calibration, "MAX_ERROR_GROWTH", 1.0)  # so quick a training is still coarse
    settings = QUICK.model_copy(update={"bits": 8, "epochs": 1, "rate": 1e-6, "average": 0.0})
    data = whips()
    quick = Compact(settings).fine_tuned_from(learnt)
    quick.settings = settings
    quick.fit(data)
    assert quick.describe().bits == 8
    assert "model.int8.onnx" in quick.files()
    assert quick.describe().trained_on == 2 * learnt.describe().trained_on
    data = whips(seed=4, sessions=1)
    pairs = [
        (a.force_n, b.force_n)
        for a, b in zip(learnt.predict(data), quick.predict(data), strict=True)
        if a.valid and b.valid
    ]
    assert len(pairs) > 15
    assert np.mean([np.abs(a - b)[:2].max() for a, b in pairs]) < 0.03
    again = load_model(save_model(quick, tmp_path / "m", data))
    for a, b in zip(quick.predict(data), again.predict(data), strict=True):
        assert np.array_equal(a.force_n, b.force_n, equal_nan=True)
    assert again.files()["model.onnx"] == quick.files()["model.onnx"]
    monkeypatch.setattr(_calibration, "MAX_ERROR_GROWTH", -1.0)
    with pytest.warns(UserWarning, match="the model runs in 32 bits"):
        assert quantise_checked(*calls[0])[0] is None
