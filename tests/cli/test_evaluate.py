"""The verb evaluate, from a folder of rows to a report."""

import json
import pickle
import sys

import numpy as np
import pytest
from typer.testing import CliRunner

from tipforce._system.executor import LocalExecutor
from tipforce.cli import app
from tipforce.errors import TipforceError
from tipforce.pipelines import evaluate

QUICK = ["--set", "c=[10]", "--set", "epsilon=[0.01]", "--set", "sigma=[1]"]


def write_folder(folder, sessions=3, frames=60):
    """A dataset folder of ready-made coefficients: the force bends the curve, each session a little differently."""
    draw = np.random.default_rng(0)
    folder.mkdir()
    lines = ["session,stamp_ns,shape_A1,shape_A2,shape_A3,shape_A4,knob_deg,fx_n,fy_n"]
    for session in range(sessions):
        stiff = draw.uniform(0.95, 1.05)
        for frame in range(frames):
            force = 0.2 + 0.1 * np.sin(frame / 3 + session)
            bend = force / stiff + draw.normal(0, 0.002)
            cells = [0.1 * bend, 0.2 * bend, 0.4 + 0.5 * bend, 0.02, 10, 0.2 * force, force]
            lines.append(f"s{session},{frame * 100_000_000}," + ",".join(f"{cell:.6f}" for cell in cells))
    (folder / "metadata.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    return folder


@pytest.fixture
def rows(tmp_path):
    return write_folder(tmp_path / "rows")


def run(*words):
    return CliRunner().invoke(app, ["evaluate", *map(str, words)])


def refusal(*words):
    """The one sentence a user would see."""
    result = run(*words)
    assert isinstance(result.exception, TipforceError), result.exception
    assert "\n" not in str(result.exception)
    return str(result.exception)


def test_a_method_is_judged_and_the_report_written(rows, tmp_path, monkeypatch):
    monkeypatch.setattr(sys, "argv", ["tipforce", "evaluate", "svr", "--data", "rows"])
    result = run("svr", "--data", rows, "-o", tmp_path / "report", *QUICK, "--json", "-")
    assert result.exception is None, result.exception
    figures = json.loads(result.stdout)
    assert {(row["method"], row["protocol"]) for row in figures["results"]} == {
        (method, protocol) for method in ("svr", "constant") for protocol in ("random", "blocked", "session")
    }
    svr, constant = (
        next(r for r in figures["results"] if (r["method"], r["protocol"]) == (name, "session"))["against_sensor"]
        for name in ("svr", "constant")
    )
    assert svr["quantities"]["magnitude"]["mae_n"] < 0.3 * constant["quantities"]["magnitude"]["mae_n"]
    assert figures["methods"]["svr"]["settings"]["c"] == [10]
    assert json.loads((tmp_path / "report" / "metrics.json").read_text(encoding="utf-8")) == figures
    page = (tmp_path / "report" / "report.html").read_text(encoding="utf-8")
    assert "tipforce evaluate svr --data rows" in page
    assert "thesis table 3" in page
    assert page.count('aria-label="shape of') > 0


def test_one_protocol_with_drawn_samples(rows, tmp_path, no_figures):
    result = run("svr", "--data", rows, "-o", tmp_path / "r", *QUICK, "--protocol", "random", "--samples", 80)
    assert result.exception is None, result.exception
    figures = json.loads((tmp_path / "r" / "metrics.json").read_text(encoding="utf-8"))
    assert {row["protocol"] for row in figures["results"]} == {"random"}
    assert figures["results"][0]["splits"][0]["train"] == 60


def test_a_saved_model_is_also_scored_as_saved_on_new_sessions(rows, tmp_path, no_figures):
    from tipforce.datasets import open_dataset
    from tipforce.estimators import create, save_model

    data = open_dataset(rows)
    seen = data.subset(data.session != "s2")
    quick = {"c": [10], "epsilon": [0.01], "sigma": [1]}
    save_model(create("svr", quick).fit(seen), tmp_path / "model", seen)
    result = run(tmp_path / "model", "--data", rows, "-o", tmp_path / "r", "--protocol", "random")
    assert result.exception is None, result.exception
    figures = json.loads((tmp_path / "r" / "metrics.json").read_text(encoding="utf-8"))
    saved = next(row for row in figures["results"] if row["protocol"] == "as saved")
    assert list(saved["against_sensor"]["by_session"]) == ["s2"]
    assert figures["methods"]["model"]["settings"]["c"] == [10]
    assert any("s0, s1" in note for note in figures["notes"])
    result = run(tmp_path / "model", "--data", rows, "-o", tmp_path / "r", "--protocol", "saved")
    assert result.exception is None, result.exception
    alone = json.loads((tmp_path / "r" / "metrics.json").read_text(encoding="utf-8"))
    assert [row["protocol"] for row in alone["results"]] == ["as saved", "as saved"]
    assert alone["results"][0]["against_sensor"] | {"mae_filled_n": 0, "mae_filled_g": 0} == saved["against_sensor"] | {
        "mae_filled_n": 0, "mae_filled_g": 0,
    }  # fmt: skip


def test_one_session_cannot_be_held_out(tmp_path):
    rows = write_folder(tmp_path / "single", sessions=1)
    said = refusal("svr", "--data", rows, "-o", tmp_path / "r", *QUICK, "--protocol", "session")
    assert "single" in said
    assert "at least two sessions" in said
    assert not (tmp_path / "r").exists()


def test_what_is_no_model_is_said_to_be_none(rows, tmp_path):
    said = refusal("models/nothing", "--data", rows, "-o", tmp_path / "r")
    assert "neither the folder of a saved model nor a method" in said
    assert "svr" in said


def test_a_folder_in_use_is_refused_before_anything_is_trained(rows, monkeypatch):
    monkeypatch.setattr("tipforce.evaluation.evaluate", lambda *_args, **_more: pytest.fail("training began"))
    said = refusal("svr", "--data", rows, "-o", rows)
    assert "metadata.csv" in said
    assert (rows / "metadata.csv").exists()


def test_data_that_are_not_there(tmp_path):
    assert "nowhere" in refusal("svr", "--data", tmp_path / "nowhere", "-o", tmp_path / "r")


def test_settings_need_a_method_that_is_named(rows, tmp_path):
    (tmp_path / "model").mkdir()
    said = refusal(tmp_path / "model", "--data", rows, "-o", tmp_path / "r", "--set", "c=[1]")
    assert said.startswith("--set")


def test_truth_of_nothing_is_refused(rows, tmp_path):
    (tmp_path / "bench").mkdir()
    said = refusal("svr", "--data", rows, "-o", tmp_path / "r", "--truth", tmp_path / "bench")
    assert "truth" in said


def test_the_truth_of_the_simulated_bench_is_scored_beside_the_sensor(rows, tmp_path, no_figures):
    from tipforce.datasets import open_dataset
    from tipforce.geometry import Pose
    from tipforce.simulation import Truth, truth_path, write_truth

    data = open_dataset(rows)
    for name in ("s0", "s2"):
        one = data.subset(data.session == name)
        frames, pose = len(one), Pose(np.eye(3), np.zeros(3))
        truth = Truth(
            session=name,
            stamp_ns=one.stamp_ns,
            force_n=np.nan_to_num(one.force_n) - [0.0, 0.03, 0.0],
            touch_m=np.zeros((frames, 3)),
            touching=np.ones(frames, np.bool_),
            slipping=np.zeros(frames, np.bool_),
            centreline_m=np.zeros((frames, 2, 3)),
            centreline_px=np.zeros((frames, 2, 2)),
            visible=np.ones(frames),
            mask_bytes=np.zeros(0, np.uint8),
            mask_ends=np.zeros(frames, np.int64),
            curvature_per_m=np.zeros(frames),
            knob_deg=np.zeros(frames),
            camera_from_base=pose,
            sensor_from_base=pose,
            image_size=(64, 48),
            clock_offset_s=0.0,
            clock_drift=0.0,
            values={},
            settings={},
        )
        (tmp_path / "bench").mkdir(exist_ok=True)
        write_truth(truth, truth_path(tmp_path / "bench" / name))
    result = run(
        "svr", "--data", rows, "-o", tmp_path / "r", *QUICK, "--set", "force=components", "--protocol", "session",
        "--truth", tmp_path / "bench",
    )  # fmt: skip
    assert result.exception is None, result.exception
    figures = json.loads((tmp_path / "r" / "metrics.json").read_text(encoding="utf-8"))
    row = next(row for row in figures["results"] if row["method"] == "svr")
    sensor, true = row["against_sensor"], row["against_truth"]
    assert list(true["by_session"]) == ["s0", "s2"]
    for session in ("s0", "s2"):
        biases = (scores["by_session"][session]["quantities"]["y"]["bias_n"] for scores in (true, sensor))
        assert next(biases) - next(biases) == pytest.approx(0.03, abs=1e-9)
    assert figures["cramer_rao_bound"] is None
    assert [note for note in figures["notes"] if note.startswith("No bound for 2 sessions: the error of")]
    assert "Against the truth" in (tmp_path / "r" / "report.html").read_text(encoding="utf-8")


@pytest.mark.slow
def test_errors_on_the_simulated_bench_are_held_against_the_smallest_possible(tmp_path, monkeypatch, no_method_figures):
    from tipforce.simulation import PRESETS, SimulatedBench, collect_truth, truth_path, write_truth

    preset = PRESETS["bench-2021"]
    world = preset.world.model_copy(update={"seconds": 9.0})
    lines = ["session,stamp_ns,shape_A1,shape_A2,shape_A3,shape_A4,knob_deg,fx_n,fy_n"]
    (tmp_path / "runs").mkdir()
    bench = SimulatedBench(preset.model_copy(update={"preset": "bench-2021 changed", "world": world}), 5, 0)
    truth = collect_truth(bench, np.arange(0, len(bench.frame_s), 3))
    write_truth(truth, truth_path(tmp_path / "runs" / f"{bench.name}.mcap"))
    for stamp, (fx, fy, _) in zip(truth.stamp_ns, truth.force_n, strict=True):
        lines.append(f"{bench.name},{stamp},{0.1 * fx:.6f},{0.2 * fy:.6f},{fx:.6f},0.02,10,{fx:.6f},{fy:.6f}")
    (tmp_path / "rows").mkdir()
    (tmp_path / "rows" / "metadata.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    words = ("svr", "--data", tmp_path / "rows", "--truth", tmp_path / "runs", "--protocol", "random", *QUICK)
    result = run(*words, "-o", tmp_path / "r")
    assert result.exception is None, result.exception
    figures = json.loads((tmp_path / "r" / "metrics.json").read_text(encoding="utf-8"))
    held = figures["results"][0]["against_bound"]
    each, along = (held[way]["magnitude"]["all"] for way in ("one_frame", "all_frames"))
    assert each["n"] == along["n"] > 2
    assert 0 < each["ratio"] < along["ratio"]
    assert "stiffness EI" in figures["cramer_rao_bound"]["nuisances"][0]
    assert (tmp_path / "r" / "figures" / "bound.svg").exists()


def test_ready_made_shape_numbers_cannot_be_perturbed(rows, tmp_path):
    said = refusal("svr", "--data", rows, "-o", tmp_path / "r", *QUICK, "--perturb", 20)
    assert "only images can be perturbed" in said


def test_weights_to_begin_with_are_for_networks_that_are_named(rows, tmp_path):
    common = ("--data", rows, "-o", tmp_path / "r", "--from", "pretrained/compact")
    assert "init_from is for networks; svr always learns from nothing" in refusal("svr", *common)
    (tmp_path / "model").mkdir()
    assert "init_from is for a method that is named" in refusal(tmp_path / "model", *common)


def test_an_evaluation_that_was_cut_off_goes_on_where_it_stopped(rows, tmp_path, monkeypatch, no_figures):
    from tipforce.estimators import Svr

    words = ["svr", "--data", rows, *QUICK, "--protocol", "session"]
    assert run(*words, "-o", tmp_path / "whole").exception is None
    fit, fitted = Svr.fit, []

    def cut_off(self, dataset, progress=None):
        if len(fitted) == 2:
            raise KeyboardInterrupt
        fitted.append(dataset.sessions)
        return fit(self, dataset, progress)

    monkeypatch.setattr(Svr, "fit", cut_off)
    with pytest.warns(UserWarning, match="keeps the trained models"):
        assert run(*words, "-o", tmp_path / "report").exit_code != 0
    assert len(list((tmp_path / "report.evaluating").iterdir())) == 2
    fitted.clear()
    monkeypatch.setattr(Svr, "fit", lambda self, data, progress=None: fitted.append(1) or fit(self, data, progress))
    assert run(*words, "-o", tmp_path / "report").exception is None
    assert len(fitted) == 1
    assert not (tmp_path / "report.evaluating").exists()
    whole, resumed = (
        json.loads((tmp_path / name / "metrics.json").read_text(encoding="utf-8"))["results"]
        for name in ("whole", "report")
    )
    assert [row["against_sensor"] for row in whole] == [row["against_sensor"] for row in resumed]
    assert whole[0]["splits"][0].keys() == resumed[0]["splits"][0].keys()


class Elsewhere:
    """Another executor than the local one, as a cluster is."""

    def __init__(self) -> None:
        self.items = 0

    def run(self, task, items, *, steps=1, alone=False, shared=None, progress=None):
        assert shared.is_dir()
        assert not alone  # it is for networks
        self.items += len(items)
        return LocalExecutor(workers=1).run(task, pickle.loads(pickle.dumps(items)), steps=steps, progress=progress)


def test_fits_that_were_made_elsewhere_give_the_same_figures(rows, tmp_path, no_figures):
    found, elsewhere = [], Elsewhere()
    for name, executor in (("here", "local"), ("there", elsewhere)):
        settings = {"c": [10.0], "epsilon": [0.01], "sigma": [1.0]}
        done = evaluate("svr", rows, tmp_path / name, protocol="session", settings=settings, executor=executor)
        found.append([row["against_sensor"] for row in done.metrics["results"]])
        assert not (tmp_path / f"{name}.evaluating").exists()
    assert elsewhere.items == 3
    assert found[0] == found[1]
