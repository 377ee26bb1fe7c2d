"""The verb train, from a folder of rows to a model folder."""

import json
import sys
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from tipforce.cli import app, main
from tipforce.datasets import open_dataset
from tipforce.errors import InputError
from tipforce.estimators import load_model, read_manifest
from tipforce.evaluation import methods_from

QUICK = ["--set", "c=[10]", "--set", "epsilon=[0.01]", "--set", "sigma=[1]"]


@pytest.fixture
def rows(tmp_path: Path) -> Path:
    """Three sessions of ready-made shape numbers, whose force bends the curve."""
    draw = np.random.default_rng(0)
    folder = tmp_path / "rows"
    folder.mkdir()
    lines = ["session,stamp_ns,shape_A1,shape_A2,knob_deg,fx_n,fy_n"]
    for place in range(90):
        force = 0.2 + 0.1 * np.sin(place / 3)
        bend = force + draw.normal(0, 0.002)
        lines.append(f"s{place // 30},{place},{bend:.6f},{bend**2:.6f},10,{0.2 * force:.6f},{force:.6f}")
    (folder / "metadata.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    return folder


def run(*words: object) -> object:
    return CliRunner().invoke(app, ["train", *map(str, words)], catch_exceptions=False)


def test_a_model_folder_comes_out(rows: Path, tmp_path: Path) -> None:
    result = run(rows, "-o", tmp_path / "svr", "--set", "force=components", *QUICK, "--json", tmp_path / "f.json")
    assert result.exit_code == 0, result.output
    for said in ("fx: C 10", "interval from: frames of held-out sessions (3 sessions", "Saved: "):
        assert said in result.output
    figures = json.loads((tmp_path / "f.json").read_text())
    assert figures["facts"] == read_manifest(tmp_path / "svr")["facts"]
    assert figures["facts"]["samples"] == 90
    assert load_model(tmp_path / "svr").describe().model_dump(mode="json") == figures["facts"]


def test_intervals_from_sessions_apart(rows: Path, tmp_path: Path) -> None:
    noisy = (rows / "metadata.csv").read_text(encoding="utf-8").splitlines()
    apart = tmp_path / "apart"
    apart.mkdir()
    lines = [
        line.replace("s2,", "t2,").replace(",10,0.", ",10,0.9") for line in noisy if not line.startswith(("s0", "s1"))
    ]
    (apart / "metadata.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    widths = []
    for more in ([], ["--calibrate", apart]):
        run(rows, "-o", tmp_path / "svr", *QUICK, *more, "--overwrite")
        facts = read_manifest(tmp_path / "svr")["facts"]
        widths.append(facts["magnitude_interval_half_width_n"])
    assert widths[1] > widths[0] + 0.3
    assert "1 session" in facts["interval_basis"]
    calibration = read_manifest(tmp_path / "svr")["training"]["calibration"]
    assert (calibration["sessions"], calibration["samples"]) == (["t2"], 30)
    known = open_dataset(rows).session_fingerprints | open_dataset(apart).session_fingerprints
    assert methods_from([str(tmp_path / "svr")])[0].trained_sessions == set(known.values())
    assert "1 session of apart." in (tmp_path / "svr" / "README.md").read_text(encoding="utf-8")


def test_intervals_are_not_found_on_what_was_learnt(rows: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"s0 is in the training data.*without=s0"):
        run(rows, "-o", tmp_path / "svr", *QUICK, "--calibrate", rows)
    apart = tmp_path / "apart"
    apart.mkdir()
    (apart / "metadata.csv").write_text("session,stamp_ns,shape_A1,shape_A2,knob_deg,fx_n\nt,1,0.1,0.1,10,0.1\n")
    with pytest.raises(InputError, match=r"apart: lacks force components that rows has"):
        run(rows, "-o", tmp_path / "svr", *QUICK, "--calibrate", apart)
    (apart / "metadata.csv").write_text(
        "session,stamp_ns,shape_A1,shape_A2,knob_deg,fx_n,fy_n\nt,1,0.1,0.1,10,0.1,0.1\n"
    )
    (apart / "dataset.json").write_text('{"force_frame": "sensor"}')
    with pytest.raises(InputError, match=r"its forces are in the frame sensor, those of rows in base"):
        run(rows, "-o", tmp_path / "svr", *QUICK, "--calibrate", apart)


def test_the_thesis_s_samples_and_share(rows: Path, tmp_path: Path) -> None:
    result = run(rows, "-o", tmp_path / "svr", "--samples", 80, "--holdout", 0.25, "--set", "seed=7", *QUICK)
    assert "held out, magnitude: RMSE" in result.output
    manifest = read_manifest(tmp_path / "svr")
    assert manifest["training"]["samples"] == 60
    assert manifest["metrics"]["held_out_samples"] == 20
    assert manifest["metrics"]["magnitude_rmse_n"] < 0.02
    assert manifest["seed"] == 7


def test_the_graph_for_other_programs(rows: Path, tmp_path: Path) -> None:
    result = run(rows, "-o", tmp_path / "svr", *QUICK, "--onnx", tmp_path / "svr.onnx")
    assert result.exit_code == 0
    assert (tmp_path / "svr.onnx").stat().st_size > 500


def test_an_existing_model_is_kept_before_any_work_is_done(rows: Path, tmp_path: Path) -> None:
    (tmp_path / "svr").mkdir()
    (tmp_path / "svr" / "notes.txt").write_text("mine")
    with pytest.raises(InputError, match="exists already"):
        run("nowhere", "-o", tmp_path / "svr")
    with pytest.raises(InputError, match="is no model folder"):
        run("nowhere", "-o", tmp_path / "svr", "--overwrite")


def test_three_rows_are_one_sentence_and_exit_code_2(
    rows: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    table = rows / "metadata.csv"
    table.write_text("\n".join(table.read_text().splitlines()[:4]) + "\n")
    monkeypatch.setattr(sys, "argv", ["tipforce", "train", str(rows), "-o", str(tmp_path / "svr")])
    with pytest.raises(SystemExit) as caught:
        main()
    assert caught.value.code == 2
    said = capsys.readouterr().err
    assert "rows: has 3 samples; training svr needs at least 20" in " ".join(said.split())
    assert "Traceback" not in said
    assert [path.name for path in tmp_path.iterdir()] == ["rows"]


def test_wrong_settings_and_methods_are_named(rows: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="there is no such setting"):
        run(rows, "-o", tmp_path / "svr", "--set", "kernel=rbf")
    with pytest.raises(InputError, match="there is no estimator 'forest'"):
        run(rows, "-o", tmp_path / "svr", "--estimator", "forest")
