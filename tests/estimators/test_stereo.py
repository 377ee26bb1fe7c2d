"""`stereo`: one force from the images of two views, and no force where one of them is missing."""

import math
import re
from collections.abc import Iterator
from dataclasses import replace

import cv2
import numpy as np
import pytest

from tipforce.datasets import Dataset
from tipforce.estimators import Stereo, StereoSettings, load_model, save_model
from tipforce.estimators.networks.stereo import angle_between
from tipforce.types import Catheter, ForceEstimate, Observation, SessionInfo, Status, ViewInfo

pytest.importorskip("torch", reason="training needs the extra [train]")
pytest.importorskip("onnxscript", reason="training needs the extra [train]")

HEIGHT, WIDTH = 60, 80
CATHETER = Catheter("7F", 2.33e-3, 40e-3, 8e-3, 4.3e-4)
QUICK = StereoSettings(size=64, epochs=8, batch=16, precision="fp32", validation=0.2)


def shown(bend: float, draw: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """A dark whip from the left border on a rough light ground, and its mask."""
    x = np.linspace(-3.0, 45.0, 30)
    line = np.rint(np.column_stack([x, 30.0 - 80.0 * bend * (x / 45.0) ** 2]) * 16).astype(np.int32)[None]
    mask = np.zeros((HEIGHT, WIDTH), np.uint8)
    cv2.polylines(mask, line, isClosed=False, color=255, thickness=3, lineType=cv2.LINE_AA, shift=4)
    ground = draw.integers(150, 170, (HEIGHT, WIDTH)).astype(np.float64)
    return (ground - mask * 0.5).clip(0, 255).astype(np.uint8), mask


class Pairs:
    """A store in memory: view "a" shows the bend by fy, view "b" that by fz."""

    def __init__(self, force: np.ndarray, seed: int) -> None:
        draw = np.random.default_rng(seed)
        self.made = [{"a": shown(each[1], draw), "b": shown(each[2], draw)} for each in force]

    def read(self, rows: np.ndarray) -> Iterator[Observation]:
        for row in rows.tolist():
            yield Observation(row, {view: image for view, (image, _) in self.made[row].items()}, {})

    def has_masks(self, rows: np.ndarray, view: str) -> bool:
        return True

    def masks(self, rows: np.ndarray, view: str) -> Iterator[np.ndarray | None]:
        return iter([self.made[row][view][1] for row in rows.tolist()])


def pairs(seed: int = 0, sessions: int = 4, each: int = 25) -> Dataset:
    count = sessions * each
    force = np.full((count, 3), np.nan)
    force[:, 1:] = np.random.default_rng(seed).uniform(-0.2, 0.2, (count, 2))
    views = {view: ViewInfo(48e-3 / 50.0, "left") for view in ("a", "b")}
    return Dataset(
        store=Pairs(force, seed),
        session=np.repeat([f"s{k}" for k in range(sessions)], each),
        stamp_ns=np.arange(count),
        actuation={},
        force_n=force,
        known=np.array([False, True, True]),
        names=np.array([f"{k}.png" for k in range(count)]),
        session_info={f"s{k}": SessionInfo(f"s{k}", CATHETER, views) for k in range(sessions)},
        rows=np.arange(count),
        title="pairs",
    )


@pytest.fixture(scope="module")
def learnt() -> Stereo:
    """Fitted once; not to be changed."""
    return Stereo(QUICK).fit(pairs())


def one(model: Stereo, observation: Observation) -> ForceEstimate:
    return model.start(pairs(sessions=1).session_info["s0"]).update(observation)


def test_each_component_comes_from_the_view_that_shows_it(learnt):
    fresh = pairs(seed=1)
    answers = learnt.predict(fresh)
    valid = np.array([each.valid for each in answers])
    assert valid.mean() > 0.8
    force = np.array([each.force_n for each in answers])[valid]
    error = np.abs(force - fresh.force_n[valid])
    assert np.isnan(error[:, 0]).all()
    assert (error[:, 1:].mean(axis=0) < 0.05).all()  # 0.1 N by always answering the mean
    ends = np.array([each.interval_n for each in answers])[valid, 1]
    assert np.mean((ends[:, 0] <= fresh.force_n[valid, 1]) & (fresh.force_n[valid, 1] <= ends[:, 1])) > 0.7


def test_a_saved_model_estimates_the_same_without_the_decoder_of_the_masks(learnt, tmp_path):
    fresh = pairs(seed=2, sessions=1, each=4)
    saved = load_model(save_model(learnt, tmp_path / "model", fresh))
    assert saved.views == ("a", "b")
    for before, after in zip(learnt.predict(fresh), saved.predict(fresh), strict=True):
        assert np.allclose(before.force_n, after.force_n, equal_nan=True)
    assert b"mask_" not in learnt.files()["model.onnx"]
    assert "two views" in (tmp_path / "model" / "README.md").read_text()


@pytest.mark.slow
def test_a_model_can_be_fine_tuned_from_the_exported_graph(learnt):
    tuned = Stereo(QUICK.model_copy(update={"epochs": 1})).fine_tuned_from(learnt)
    facts = tuned.fit(pairs(seed=3)).describe()
    assert facts.fine_tuned_from
    assert all(name.startswith("mask_") for name in facts.reinitialised_weights)


@pytest.mark.parametrize(
    ("there", "said"),
    [
        (("a",), r"view 'b' has no image of this instant \(there is a\); stereo needs the images of both its views"),
        (("b",), r"view 'a' has no image of this instant \(there is b\)"),
        ((), r"the views 'a' and 'b' have no image of this instant \(there is none\)"),
    ],
)
def test_a_missing_view_leaves_no_estimate_and_says_which(learnt, there, said):
    observation = next(pairs().observations())
    estimate = one(learnt, replace(observation, views={view: observation.views[view] for view in there}))
    assert estimate.status is Status.MISSING_INPUT
    assert np.isnan(estimate.force_n).all()
    assert re.search(said, estimate.detail)


def test_a_view_of_noise_leaves_no_estimate_and_says_which(learnt):
    observation = next(pairs().observations())
    noise = np.random.default_rng(0).integers(0, 256, (HEIGHT, WIDTH), np.uint8)
    estimate = one(learnt, replace(observation, views={**observation.views, "b": noise}))
    assert estimate.status is Status.NO_CATHETER
    assert "the image of view 'b' is noise" in estimate.detail


def test_two_views_have_two_names():
    with pytest.raises(ValueError, match="names the view 'a' twice"):
        StereoSettings(views=("a", "a"))


def orthographic(degrees: float) -> ViewInfo:
    """A view from far away whose base is on the left, turned about the base tangent x."""
    c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    rows = ((1e3, 0.0, 0.0, 0.0), (0.0, -1e3 * c, -1e3 * s, 0.0), (0.0, 0.0, 0.0, 1.0))
    return ViewInfo(base_side="left", projection=rows, projection_frame="base")


@pytest.mark.parametrize("degrees", [90.0, -90.0, 70.0, 15.0])
def test_the_angle_between_the_views_follows_from_their_projections(degrees):
    views = {"a": orthographic(0.0), "b": orthographic(degrees)}
    cosine, sine = angle_between(SessionInfo(views=views), ("a", "b"))
    assert math.degrees(math.atan2(sine, cosine)) == pytest.approx(degrees)
    unknown = {"a": views["a"], "b": ViewInfo(base_side="left")}
    assert angle_between(SessionInfo(views=unknown), ("a", "b")) == (0.0, 0.0)
