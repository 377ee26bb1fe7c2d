"""``tipforce simulate --as dataset``: labelled images as an import of the session's recording would give them."""

import json
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from tipforce._system.executor import LocalExecutor
from tipforce.alignment import labels
from tipforce.cli import app
from tipforce.datasets import open_dataset
from tipforce.errors import FileFormatError, InputError
from tipforce.io import RecordingReader
from tipforce.pipelines import record, write_samples
from tipforce.simulation import PRESETS, read_truth, sample_set
from tipforce.types import SimulatedClock

SMALL = PRESETS["bench-2021"].model_copy(update={"width": 320, "height": 240})
SMALL = SMALL.model_copy(update={"world": SMALL.world.model_copy(update={"tare_s": 2.0})})
WANTED = sample_set(SMALL, seed=3, samples=30, per_session=11, seconds=8.0)
write = partial(write_samples, say=print, progress=lambda what, share: None, lossless=False)


def run(verb, *arguments):
    return CliRunner().invoke(app, [verb, *map(str, arguments)], catch_exceptions=True)


def content(folder: Path) -> dict[str, bytes]:
    return {str(p.relative_to(folder)): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()}


@pytest.fixture(scope="module")
def made(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("samples") / "set"
    write(folder, WANTED, shards=False, masks=True, executor=LocalExecutor(1))
    return folder


def test_as_many_samples_as_asked_for_from_sessions_that_differ(made):
    data = open_dataset(made)
    assert len(data) == 30
    assert [int((data.session == name).sum()) for name in data.sessions] == [11, 11, 8]
    assert len({info.view("camera").metres_per_px for info in data.session_info.values()}) == 3
    assert all(name.startswith("bench-2021-samples-3-0000") for name in data.sessions)
    assert {tuple(each.views["camera"].shape) for each in data.observations()} == {(240, 320, 3)}
    before = data.stamp_ns < 3.5e9
    assert 0 < before.sum() < 30
    assert np.abs(data.force_n[before]).max() < 0.03 < np.abs(data.force_n[~before]).max()


def test_a_sample_is_what_importing_the_recording_would_give(made, tmp_path):
    data = open_dataset(made)
    bench = WANTED.bench(1)
    path = tmp_path / "run.mcap"
    record(
        bench, path, tare=(0.0, 2.0), clock=SimulatedClock(),
        offset_ms=WANTED.offset_ms(bench, 1), jpeg_quality=bench.imaging.jpeg_quality,
    )  # fmt: skip
    own = data.subset(data.session == bench.name)
    with RecordingReader(path) as reader:
        rows = WANTED.frames(bench, 1)
        found = labels(reader)
        assert np.array_equal(found.stamp_ns[rows], own.stamp_ns)
        assert np.array_equal(found.force_n[rows], own.force_n)
        assert np.array_equal(reader.actuation_at(own.stamp_ns)["knob_deg"], own.actuation["knob_deg"])
        assert replace(reader.session_info) == own.session_info[bench.name]
        for row, sample in zip(rows.tolist(), own.observations(), strict=True):
            assert np.array_equal(reader.frame_at(row).image, sample.views["camera"])


def test_the_truth_lies_apart_and_fits_images_and_masks(made):
    data = open_dataset(made)
    assert sorted(path.name for path in made.iterdir()) == [
        "dataset.json", "images", "masks", "metadata.csv", "simulated.json", "truth",
    ]  # fmt: skip
    for name in data.sessions:
        truth = read_truth(made / "truth" / name)
        own = data.subset(data.session == name)
        assert truth.session == name
        assert np.array_equal(truth.stamp_ns, own.stamp_ns)
        miss = own.force_n - truth.force_n
        assert np.sqrt((miss**2).mean()) < 8e-3
        assert np.abs(miss).mean() > 1e-4
        for k, each in enumerate(own.observations()):
            mask = truth.mask(k)
            grey = each.views["camera"].mean(axis=2)
            assert grey[mask].mean() < grey[~mask].mean() - 10
    stated = (made / "metadata.csv").read_text() + (made / "dataset.json").read_text()
    for key in ("flexible_length_m", "stiffness_nm2", "friction", "contact_angle_deg"):
        assert f"{truth.values[key]:.5g}" not in stated, key


@pytest.fixture(scope="module")
def sharded(tmp_path_factory) -> Path:
    pytest.importorskip("pyarrow")
    folder = tmp_path_factory.mktemp("shards") / "set"
    write(folder, WANTED, shards=True, masks=False, executor=LocalExecutor(1))
    return folder


@pytest.mark.parametrize("content", ["{", "[" * 100_000, "[]"])
def test_a_folder_whose_note_is_damaged_is_not_gone_on_with(tmp_path, content):
    (tmp_path / "simulated.json").write_text(content)
    with pytest.raises(FileFormatError, match=r"simulated\.json: .*; choose another folder with -o"):
        write(tmp_path, WANTED, shards=False, masks=False, executor=LocalExecutor(1))


def test_shards_hold_the_same_samples(made, sharded):
    images, shards = open_dataset(made), open_dataset(sharded)
    assert shards.fingerprint() == images.fingerprint()
    assert dict(shards.session_info) == dict(images.session_info)
    assert shards.names.tolist() == images.names.tolist()
    for one, other in zip(images.observations(), shards.observations(), strict=True):
        assert np.array_equal(one.views["camera"], other.views["camera"])


def test_inspect_train_and_evaluate_take_shards_like_any_dataset(sharded, tmp_path, no_figures):
    figures = tmp_path / "figures.json"
    result = run("inspect", sharded, "-o", tmp_path / "sheet.png", "--json", figures)
    assert result.exit_code == 0, result.output
    found = json.loads(figures.read_text())
    assert (found["samples"], found["sessions"], found["frames"]) == (30, 3, 30)
    assert found["share_found"] > 0.9
    assert found["forces"]["magnitude_n"]["max"] > 0.03
    svr = ["--set", "vision.base_side=left", "--set", "folds=3", "--set", "c=[1]"]
    result = run("train", sharded, "-o", tmp_path / "svr", *svr, "--json", figures)
    assert result.exit_code == 0, result.output
    report = tmp_path / "report"
    result = run("evaluate", "svr", "--data", sharded, "--truth", sharded, "--protocol", "random", "-o", report, *svr)
    assert result.exit_code == 0, result.output
    assert "truth" in (report / "metrics.json").read_text()


@pytest.mark.slow
def test_two_processes_write_the_same_bytes_and_a_whole_set_is_kept(made, tmp_path, monkeypatch):
    monkeypatch.setenv("TIPFORCE_CORES", "2")
    options = ["--as", "dataset", "--samples", 30, "--samples-per-session", 11, "--seconds", 8, "--seed", 3, "--masks"]
    options += ["--set", "width=320", "--set", "height=240", "--set", "world.tare_s=2"]
    for _ in range(2):
        result = run("simulate", "-o", tmp_path / "set", "--json", tmp_path / "figures.json", *options)
        assert result.exit_code == 0, result.output
    assert json.loads((tmp_path / "figures.json").read_text())["wall_time_s"] < 5  # nothing was done again
    by_two, by_one = content(tmp_path / "set"), content(made)
    renamed = {name.replace("bench-2021-changed", "bench-2021"): data for name, data in by_two.items()}
    assert renamed.keys() == by_one.keys()  # a changed preset says so in its name
    assert all(renamed[name] == by_one[name] for name in renamed if name.startswith(("images", "masks")))


def test_a_set_of_something_else_is_not_mixed_with_it(made, tmp_path):
    other = WANTED.model_copy(update={"seed": 4})
    with pytest.raises(InputError, match="was simulated with seed = 3, not 4"):
        write(made, other, shards=False, masks=True, executor=LocalExecutor(1))
    (tmp_path / "notes.txt").write_text("precious")
    with pytest.raises(InputError, match="is there already and no set of simulated samples"):
        write(tmp_path, WANTED, shards=False, masks=True, executor=LocalExecutor(1))


def test_a_set_that_does_not_fit_the_disk_is_refused_before_the_work(tmp_path):
    with pytest.raises(InputError, match=r"GB are needed and .* GB are free"):
        write(tmp_path / "set", WANTED.model_copy(update={"samples": 10**13}), shards=False, masks=False)
    assert not (tmp_path / "set").exists()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--samples", 5], "--samples: goes with --as dataset or --as parquet only"),
        (["--masks"], "--masks: goes with --as dataset or --as parquet only"),
        (["--as", "dataset", "--sessions", 5], "--sessions: does not go with --as dataset"),
        (["--as", "parquet", "--masks"], "--masks does not go with --as parquet: its files hold no masks"),
        (["--set", "world.seconds.x=3"], "--set world.seconds.x=3: seconds is a value (60.0) and holds no settings"),
        (["--set", "world.wall.angle=3"], "world.wall.angle: there is no such setting; there are contact_angle_deg"),
        (["--as", "dataset", "--seconds", 6], "a session needs 5 s of tare (world.tare_s), 1.5 s of approach and 1 s"),
        (["--seconds", 8, "--set", "world.tare_s=6"], "world.seconds=8: a session needs 6 s of tare"),
        (["--as", "dataset", "--samples-per-session", 5000], "has images enough for 278; state seconds"),
    ],
)
def test_options_that_would_do_nothing_or_cannot_be_had_are_refused(tmp_path, options, message):
    result = run("simulate", "-o", tmp_path / "set", *options)
    assert isinstance(result.exception, InputError)
    assert message in str(result.exception)
    assert not (tmp_path / "set").exists()
