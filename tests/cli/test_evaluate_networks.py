"""The verb evaluate with networks that are trained from nothing, on a few small images."""

import json

import cv2
import numpy as np
import pytest
from typer.testing import CliRunner

from tipforce.cli import app
from tipforce.errors import InputError


@pytest.fixture
def images(tmp_path):
    """A dataset folder of two sessions of 16 images each: the force bends a dark line."""
    folder = tmp_path / "images"
    folder.mkdir()
    lines = ["file_name,session,stamp_ns,knob_deg,fx_n,fy_n"]
    for number in range(32):
        force = 0.2 + 0.05 * np.sin(number)
        along = np.arange(0, 70)
        image = np.full((96, 128), 220, np.uint8)
        curve = np.stack([along, 48 - 100 * force * (along / 70) ** 2], axis=1)
        cv2.polylines(image, [np.round(curve * 16).astype(np.int32)], False, 40, 5, cv2.LINE_AA, 4)
        cv2.imwrite(str(folder / f"{number}.png"), image)
        cells = [f"{number}.png", f"s{number // 16}", number % 16 * 100_000_000, 10, 0.2 * force, force]
        lines.append(",".join(map(str, cells)))
    (folder / "metadata.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    return folder


def evaluated(images, folder, *words):
    """What metrics.json holds after the verb."""
    words = ["evaluate", *words, "--data", str(images), "-o", str(folder)]
    result = CliRunner().invoke(app, words)
    assert result.exception is None, result.exception
    return json.loads((folder / "metrics.json").read_text(encoding="utf-8"))


@pytest.mark.parametrize(
    ("method", "settings"),
    [
        pytest.param("dcfe", ("epochs=2",), marks=pytest.mark.slow),  # the next test trains one every time
        pytest.param("compact", ("epochs=1", "size=64", "base_side=left"), marks=pytest.mark.slow),
    ],
)
def test_a_network_is_trained_from_nothing_and_judged(images, tmp_path, no_figures, method, settings):
    words = [word for each in settings for word in ("--set", each)]
    figures = evaluated(images, tmp_path / "report", method, "--protocol", "random", *words)
    assert [row["method"] for row in figures["results"]] == [method, "constant"]
    split = figures["results"][0]["splits"][0]
    assert (split["train"], split["test"]) == (24, 8)
    assert split["facts"]["epochs_run"] == int(settings[0][-1])
    assert split["facts"]["fine_tuned_from"] is None


@pytest.mark.slow
def test_dcfe_to_the_letter_trains_on_all_images_and_stands_beside_the_thesis(images, tmp_path, no_figures):
    words = ("dcfe", "--to-the-letter", "--protocol", "thesis", "--samples", "32", "--set", "epochs=1")
    figures = evaluated(images, tmp_path / "report", *words)
    facts = figures["results"][0]["splits"][0]["facts"]
    assert (facts["training_samples"], facts["validation_samples"], facts["epochs_run"]) == (24, 0, 1)
    assert facts["validation_error_n"] is None
    assert "nothing: no sample was held out" in figures["methods"]["dcfe"]["interval_basis"]
    magnitude = figures["results"][0]["against_sensor"]["quantities"]["magnitude"]
    assert magnitude["unbounded_share"] == 1.0
    beside = figures["beside_thesis"]["dcfe"]
    assert list(beside["rows"]) == ["dcfe", "constant predictor", "the thesis, its own bench"]
    assert all(set(row["by_direction"]) == {"x", "y"} for row in beside["rows"].values())
    assert "another bench; " in beside["text"]
    assert "24 training and 8 test samples (thesis: 461 and 154)" in beside["text"]
    assert "epochs=1 (to the letter: 10000)" in beside["text"]
    assert "validation" not in beside["text"]


def test_only_the_thesis_s_methods_are_trained_to_the_letter(images, tmp_path):
    for words, said in (
        (("compact",), "compact: the thesis has no such method; to_the_letter goes with svr and dcfe"),
        (("dcfe", "--from", "pretrained"), "leave init_from out"),
        (("dcfe", "--set", "schedule=plateau"), "patience=null, schedule=cosine"),
    ):
        command = ["evaluate", *words, "--to-the-letter", "--data", str(images), "-o", str(tmp_path / "r")]
        result = CliRunner().invoke(app, command)
        assert isinstance(result.exception, InputError), result.exception
        assert said in str(result.exception)


def test_svr_to_the_letter_uses_algorithm_1_and_the_knob_alone(images, tmp_path, no_figures):
    table = (images / "metadata.csv").read_text(encoding="utf-8").replace("knob_deg", "bend_mm,knob_deg", 1)
    rows = [row.split(",") for row in table.splitlines()[1:]]
    table = "\n".join([table.splitlines()[0], *(",".join([*row[:3], row[2][:2], *row[3:]]) for row in rows)])
    (images / "metadata.csv").write_text(table + "\n", encoding="utf-8")
    words = ("svr", "--to-the-letter", "--protocol", "thesis", "--samples", "32", "--set", "vision.threshold=128")
    figures = evaluated(images, tmp_path / "report", *words)
    settings = figures["methods"]["svr"]["settings"]
    assert (settings["vision"]["method"], settings["vision"]["threshold"]) == ("classic", 128)
    facts = figures["results"][0]["splits"][0]["facts"]
    assert facts["features"] == ["A1", "A2", "A3", "A4", "A5", "knob_deg"]
    assert "vision.threshold=128 (to the letter: 110)" in figures["beside_thesis"]["svr"]["text"]
    assert figures["beside_thesis"]["svr"]["rows"]["the thesis, its own bench"]["mae_n"] == 0.042
