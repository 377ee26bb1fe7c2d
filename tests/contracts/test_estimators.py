"""What every method keeps to."""

from pathlib import Path

import numpy as np
import pytest

from tipforce.datasets import open_dataset
from tipforce.errors import InputError, NotFittedError
from tipforce.estimators import ESTIMATORS, Estimator, Svr, SvrSettings, create, load_model, save_model
from tipforce.types import ForceEstimate, Observation, SessionInfo, Status


class FromShape(Estimator):
    """A method without anything to learn: its whole code is what it does with a frame."""

    name = "unbending"
    settings_type = ESTIMATORS["svr"].settings_type
    needs_fit = False

    def start(self, info: SessionInfo, images=()):  # type: ignore[override]
        return self

    def update(self, observation) -> ForceEstimate:
        return ForceEstimate.invalid(observation.stamp_ns, Status.UNOBSERVABLE, "this method never tells")


@pytest.mark.parametrize("name", ESTIMATORS)
def test_settings_stay_what_the_user_said(name: str) -> None:
    fresh = create(name)
    assert fresh.unfitted().settings == fresh.settings == ESTIMATORS[name].settings_type()
    assert fresh.settings.model_config.get("frozen")
    if not fresh.needs_fit:
        assert fresh.start(SessionInfo()).update(Observation(0, {}, {})).status is Status.MISSING_INPUT
        return
    with pytest.raises(NotFittedError):
        fresh.start(SessionInfo())


def test_unfitted_is_the_fresh_method_after_a_fit_too(bench: Path, tmp_path: Path) -> None:
    data = open_dataset(bench / "runs")
    some = data.subset(np.arange(0, len(data), 3))
    method = Svr(SvrSettings(max_left_out=0.3))
    fitted = method.unfitted().fit(some)
    assert fitted.settings == method.settings, "nothing that was learnt is in the settings"
    assert fitted.unfitted().settings == method.settings
    assert fitted.unfitted().fitted_ is None
    save_model(fitted, tmp_path / "model", some)
    again = load_model(tmp_path / "model")
    assert again.unfitted().settings == method.settings
    last = data.subset(data.session == data.sessions[-1])
    before, after = (each.predict(last) for each in (fitted, again))
    assert [e.magnitude_n for e in before] == pytest.approx([e.magnitude_n for e in after], nan_ok=True)
    assert all(e.shape is not None and e.shape.found for e in before if e.valid), "the result carries what was detected"


def test_a_method_without_fit_fits_in(bench: Path) -> None:
    method = FromShape()
    data = open_dataset(bench / "runs" / "session_00.mcap")
    found = method.fit(data).predict(data)
    assert len(found) == len(data)
    assert not any(each.valid for each in found)
    assert method.views == ("camera",)
    assert method.required_actuation == method.required_metadata == ()
    with pytest.raises(InputError, match="no ONNX export"):
        method.to_onnx()
    with pytest.raises(InputError, match="no intervals to calibrate"):
        method.calibrate(data)


ALIKE = ("mass-spring", "pseudo-rigid", "strain", "links", "elastica", "arcs")
"""Rod models that share the code of `beam`: they differ in the rod alone."""
LONG = ("rod-3d",)
"""One view leaves it a grid of two directions in each image of both sessions."""


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=[pytest.mark.slow] if name in ALIKE + LONG else [])
        for name, kind in ESTIMATORS.items()
        if not kind.needs_fit
    ],
)
def test_a_method_that_needs_no_fit_estimates_learns_and_is_saved(name: str, bench: Path, tmp_path: Path) -> None:
    data = open_dataset(bench / "runs")
    some = data.subset(np.arange(0, len(data), 10))
    stated = load_model(name).predict(some)
    assert sum(each.valid for each in stated) > 0.6 * len(stated)
    fitted = create(name).fit(some).calibrate(some)
    save_model(fitted, tmp_path / "model", some)
    again = load_model(tmp_path / "model")
    few = some.subset(np.arange(8))
    before, after = (each.predict(few) for each in (fitted, again))
    assert [e.magnitude_n for e in before] == pytest.approx([e.magnitude_n for e in after], nan_ok=True)
    assert [e.magnitude_n for e in before] != pytest.approx([e.magnitude_n for e in stated[:8]], nan_ok=True)
    assert again.unfitted().describe() == create(name).describe(), "nothing learnt is left"


def test_a_late_frame_is_stale(bench: Path) -> None:
    data = open_dataset(bench / "runs" / "session_00.mcap")
    first, second = data.subset(np.arange(2)).observations()
    stream = create("rod-track").start(data.session_info[data.sessions[0]])
    stream.update(second)
    assert stream.update(first).status is Status.STALE
