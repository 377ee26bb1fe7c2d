"""``tipforce simulate`` under X-ray: DICOM of two views on one clock, and labelled images of them."""

from functools import partial
from pathlib import Path

import cv2
import numpy as np
import pytest
from typer.testing import CliRunner

from tipforce._system.executor import LocalExecutor
from tipforce.cli import app
from tipforce.datasets import open_dataset
from tipforce.errors import InputError
from tipforce.estimators import SvrSettings
from tipforce.estimators.shape import gather_rows
from tipforce.io import RecordingReader, open_source
from tipforce.pipelines import import_session, write_samples
from tipforce.pipelines._simulate_sessions import leave_dicom
from tipforce.simulation import PRESETS, FluoroSettings, SimulatedBench, read_truth, sample_set
from tipforce.types import Frame

SMALL = ["width=128", "height=128", "world.tare_s=2", "world.clock.fps=6", "world.motion.peak_within_n=0.005"]


def brief(preset: str, fps: float, side: int = 256) -> FluoroSettings:
    settings = PRESETS[preset]
    assert isinstance(settings, FluoroSettings)
    clock = settings.world.clock.model_copy(update={"fps": fps, "dropped_share": 0.1})
    motion = settings.world.motion.model_copy(update={"peak_within_n": 5e-3})
    world = settings.world.model_copy(update={"seconds": 8.0, "tare_s": 2.0, "clock": clock, "motion": motion})
    return settings.model_copy(update={"world": world, "width": side, "height": side})


def run(verb, *arguments):
    return CliRunner().invoke(app, [verb, *map(str, arguments)], catch_exceptions=True)


@pytest.fixture(scope="module")
def late() -> SimulatedBench:
    """Its very first image of view b was dropped."""
    benches = (SimulatedBench(brief("biplane", 3.0, 128), seed, 0) for seed in range(100))
    return next(bench for bench in benches if bench.arrived("a")[0] == 0 < bench.arrived("b")[0])


@pytest.mark.slow
def test_two_views_as_dicom_stay_on_one_clock_where_the_first_image_of_one_was_dropped(late, tmp_path):
    pytest.importorskip("pydicom")
    leave_dicom(late, tmp_path / "session", lambda: None)
    for view in late.views:
        path = tmp_path / "session" / f"run_{view}.dcm"
        with open_source(path) as source:
            stamps = [event.stamp_ns for event in source if isinstance(event, Frame)]
        assert stamps == late.stamp_ns[late.arrived(view)].tolist()
        target = tmp_path / f"{view}.mcap"
        knob_log = tmp_path / "session" / "knob.csv"
        import_session(path, [tmp_path / "session" / "force.csv", knob_log], target, offset_ms="none", tare="none")
        with RecordingReader(target) as reader:
            found_deg = reader.actuation_at(reader.stamps())["knob_deg"]
        true_deg = late.interpolator.at(late.trajectory.knob_deg, late.frame_s[late.arrived(view)])
        assert np.abs(found_deg - true_deg).max() < 0.02


@pytest.fixture(scope="module", params=["fluoro", "biplane"])
def wanted(request):
    return sample_set(brief(request.param, 15.0), seed=5, samples=2, per_session=1, seconds=8.0)


write = partial(write_samples, say=print, progress=lambda what, share: None, lossless=False, executor=LocalExecutor(1))


@pytest.fixture(scope="module")
def made(wanted, tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("samples") / "set"
    write(folder, wanted, shards=False, masks=True)
    return folder


def test_labelled_images_have_true_masks_of_every_view(wanted, made):
    data = open_dataset(made)
    assert len(data) == 2
    for name in data.sessions:
        truth = read_truth(made / "truth" / name)
        seen = {wanted.views[0]: truth, **truth.others}
        own = data.subset(data.session == name)
        for k, observation in enumerate(own.observations()):
            assert set(observation.views) == set(wanted.views)
            for view, image in observation.views.items():
                shown = image_path(made, own.names[k], view, wanted.views)
                np.testing.assert_array_equal(cv2.imread(str(shown), cv2.IMREAD_UNCHANGED), image)
                path = made / "masks" / name / f"{shown.stem}.png"
                mask = cv2.imread(str(path), cv2.IMREAD_UNCHANGED) > 0
                np.testing.assert_array_equal(mask, seen[view].mask(k))
                ring = cv2.dilate(mask.astype(np.uint8), np.ones((15, 15), np.uint8)) > 0
                assert image[mask].mean() < image[ring & ~mask].mean() - 5  # the catheter is dark there


def image_path(folder: Path, name: str, view: str, views) -> Path:
    return folder / (name if len(views) == 1 else name.replace(f"-{views[0]}.", f"-{view}."))


@pytest.mark.parametrize("wanted", ["biplane", pytest.param("fluoro", marks=pytest.mark.slow)], indirect=True)
def test_a_message_names_the_image_of_the_view_that_was_looked_at(wanted, made, tmp_path):
    view = wanted.views[-1]
    data = open_dataset(made)
    first = np.flatnonzero(data.session == data.sessions[-1])
    for path, observation in zip(data.names_of(view)[first], data.subset(first).observations(), strict=True):
        np.testing.assert_array_equal(cv2.imread(str(made / path), cv2.IMREAD_UNCHANGED), observation.views[view])
    rows = gather_rows(SvrSettings(vision={"view": view}), ["there_is_none_deg"], data, lambda share: None)
    assert rows.why_not.startswith(f"{data.names_of(view)[0]}: ")


@pytest.mark.parametrize("wanted", ["biplane", pytest.param("fluoro", marks=pytest.mark.slow)], indirect=True)
def test_shards_of_every_view_are_the_same_samples(wanted, made, tmp_path):
    pytest.importorskip("pyarrow")
    write(tmp_path / "shards", wanted, shards=True, masks=False)
    images, shards = open_dataset(made), open_dataset(tmp_path / "shards")
    assert shards.fingerprint() == images.fingerprint()
    for view in wanted.views:
        assert shards.names_of(view).tolist() == images.names_of(view).tolist()
    for one, other in zip(images.observations(), shards.observations(), strict=True):
        assert set(one.views) == set(other.views) == set(wanted.views)
        for view in one.views:
            np.testing.assert_array_equal(one.views[view], other.views[view])


def test_inspect_shows_the_first_view_where_none_is_stated_and_names_those_that_are_there(wanted, made, tmp_path):
    first, *_, last = wanted.views[0], wanted.views[-1]
    for view, options in ((first, []), (last, ["--set", f"vision.view={last}"])):
        result = run("inspect", made, "-o", tmp_path / "sheet.png", "--overwrite", *options)
        assert result.exit_code == 0, result.output
        assert (f"the view {view} of a, b" in result.output) == (len(wanted.views) > 1)
    wrong = run("inspect", made, "-o", tmp_path / "none.png", "--set", "vision.view=c")
    assert isinstance(wrong.exception, InputError)
    assert "there is no view 'c'; there" in str(wrong.exception)
    assert f"for example vision.view={first}" in str(wrong.exception)


def test_of_two_views_the_next_step_names_the_one_to_train_on(tmp_path):
    options = ["--as", "dataset", "--preset", "biplane", "--samples", 2, "--samples-per-session", 2, "--seconds", 8]
    result = run("simulate", "-o", tmp_path / "set", *options, *(word for each in SMALL for word in ("--set", each)))
    assert result.exit_code == 0, result.output
    assert "-o models/svr --set vision.view=a" in " ".join(result.output.split())


def test_the_next_step_imports_the_videos_of_both_views(tmp_path):
    options = ["--as", "files", "--preset", "biplane", "--sessions", 1, "--seconds", 8]
    result = run("simulate", "-o", tmp_path / "runs", *options, *(word for each in SMALL for word in ("--set", each)))
    assert result.exit_code == 0, result.output
    words = "".join(result.output.split())
    session = tmp_path / "runs" / "session_00"
    assert f"tipforceimport{session / 'video_a.mp4'}{session / 'video_b.mp4'}{session / 'force.csv'}" in words
