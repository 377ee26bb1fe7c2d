"""The verb train for a method that is a network: settings, cut off, gone on with."""

from pathlib import Path
from typing import Any

import cv2
import pytest
from typer.testing import CliRunner

from tipforce.cli import app
from tipforce.datasets import Dataset
from tipforce.errors import InputError, ModelError
from tipforce.estimators import Dcfe, NetworkEstimator, load_initial_model, load_model
from tipforce.estimators.networks._settings import DcfeSettings
from tipforce.estimators.store import run_directory
from tipforce.training import _loop

pytest.importorskip("torch", reason="training needs the extra [train]")
pytest.importorskip("onnxscript", reason="training needs the extra [train]")

OPTIONS = ["--estimator", "small", "--set", "batch=8", "--set", "rate=0.05", "--set", "precision=fp32"]


@pytest.fixture
def folder(shown: Any, tmp_path: Path) -> Path:
    """The images as a dataset folder."""
    data: Dataset = shown()
    made = tmp_path / "images"
    made.mkdir()
    lines = ["file_name,session,stamp_ns,knob_deg,fx_n,fy_n"]
    for place, observation in enumerate(data.observations()):
        name = f"{place:03d}.png"
        cv2.imwrite(str(made / name), observation.views["camera"])
        cells = [name, data.session[place], place, data.actuation["knob_deg"][place], *data.force_n[place, :2]]
        lines.append(",".join(str(cell) for cell in cells))
    (made / "metadata.csv").write_text("\n".join(lines) + "\n")
    return made


def run(*words: object) -> Any:
    return CliRunner().invoke(app, ["train", *map(str, words)], catch_exceptions=False)


def test_a_training_that_was_cut_off_is_gone_on_with(
    small: NetworkEstimator, folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    words = [folder, *OPTIONS, "--set", "epochs=4", "--set", "seed=3", "-o"]
    assert run(*words, tmp_path / "whole").exit_code == 0

    line = _loop.progress_text

    def stop(row: dict[str, Any], network: Any) -> str:
        if row["epoch"] == 2:
            raise KeyboardInterrupt
        return line(row, network)

    work = tmp_path / "cut.training"
    with monkeypatch.context() as patch:
        patch.setattr(_loop, "progress_text", stop)
        with pytest.warns(UserWarning, match="keeps the training so far; go on with it by resume=True"):
            assert run(*words, tmp_path / "cut").exit_code != 0
    assert {"checkpoint.pt", "training.jsonl", "image.npy", "prepared.json"} == {p.name for p in work.iterdir()}
    with pytest.raises(InputError, match="holds a training that was not finished"):
        run(*words, tmp_path / "cut")
    note = (work / "prepared.json").read_text()
    for damaged in ("[" * 100_000, note.replace('"index": [', '"index": [-1, ')):
        (work / "prepared.json").write_text(damaged)
        remedy = r"prepared\.json: .*; remove .*, which prepares the images anew"
        with pytest.raises(InputError, match=remedy), pytest.warns(UserWarning, match="keeps the training so far"):
            run(*words, tmp_path / "cut", "--resume")
    (work / "prepared.json").write_text(note)
    result = run(*words, tmp_path / "cut", "--resume")
    assert result.exit_code == 0
    assert "4 of 4 epochs" in " ".join(result.output.split())
    assert not work.exists()
    models = [(tmp_path / name / "model.onnx").read_bytes() for name in ("whole", "cut")]
    assert models[0] == models[1]
    with pytest.raises(InputError, match="there is nothing to resume"):
        run(*words, tmp_path / "other", "--resume")

    result = run(*words, tmp_path / "more", "--set", "epochs=1", "--from", tmp_path / "cut")
    assert "fine-tuned from the weights of small" in result.output
    both = load_model(tmp_path / "more").describe().trained_on
    assert both == 2 * load_model(tmp_path / "cut").describe().trained_on
    assert (
        load_model(tmp_path / "more").training_sessions == load_model(tmp_path / "cut").training_sessions != frozenset()
    )
    assert f"trained on {both[0]}." in (tmp_path / "more" / "README.md").read_text(encoding="utf-8")
    with pytest.raises(InputError, match=r"init_from is for networks; svr always learns from nothing"):
        run(folder, "-o", tmp_path / "svr", "--from", tmp_path / "cut")
    with pytest.raises(InputError, match=r"is a small, and dcfe cannot start from its weights"):
        run(folder, "--estimator", "dcfe", "-o", tmp_path / "dcfe", "--from", tmp_path / "cut")


def test_a_training_that_cannot_begin_leaves_nothing(small: NetworkEstimator, folder: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="has no actuation 'wire_mm'"):
        run(folder, *OPTIONS, "--set", 'actuation=["wire_mm"]', "-o", tmp_path / "m")
    assert [path.name for path in tmp_path.iterdir()] == ["images"]


def test_a_folder_that_holds_other_things_is_no_place_to_train_in(tmp_path):
    folder = tmp_path / "heart.training"
    folder.mkdir()
    (folder / "metadata.csv").write_text("file_name\n")
    (folder / "image.npy").write_bytes(b"left by a training")
    (folder / "labels.npy").write_bytes(b"mine")
    with (
        pytest.raises(InputError, match=r"heart\.training: .*holds other things \(labels\.npy\)"),
        run_directory(Dcfe(), tmp_path / "heart", resume=False),
    ):
        pytest.fail("nothing may be trained there")
    assert (folder / "metadata.csv").read_text() == "file_name\n"


def test_a_training_that_begins_with_weights_has_the_settings_for_that(monkeypatch, tmp_path):
    start = load_initial_model(Dcfe(), "pretrained")
    assert start is not None
    assert start.describe().samples > 10_000
    plain, stated = Dcfe(), Dcfe(DcfeSettings(epochs=7, optimiser="sgd"))
    assert plain.settings.optimiser == "sgd"
    settings = plain.fine_tuned_from(start).settings
    assert (settings.optimiser, settings.epochs, settings.average, settings.rate) == (
        "adamw",
        80,
        0.99,
        plain.settings.rate,
    )
    settings = stated.fine_tuned_from(start).settings
    assert (settings.optimiser, settings.epochs, settings.average) == ("sgd", 7, 0.99)
    monkeypatch.chdir(tmp_path)
    (tmp_path / "pretrained").mkdir()
    assert load_initial_model(Dcfe(), "pretrained") is not None  # a folder of that name that is no model is not meant
    (tmp_path / "pretrained" / "model.json").write_text("{}")
    with pytest.raises(ModelError, match=r"pretrained"):
        load_initial_model(Dcfe(), "pretrained")
