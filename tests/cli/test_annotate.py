"""``tipforce annotate``: annotations from and to files, the page, the training, and messages."""

import json
import re
import signal
import subprocess
import sys
import urllib.request
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from typer.testing import CliRunner

from tipforce.cli import app
from tipforce.errors import InputError, OutputError
from tipforce.types import read_bench

from .conftest import bend_at, draw_image  # type: ignore[import-not-found]

LINES = "image,u,v\nf00.png,5,150\nf00.png,120,120\nf00.png,180,60\nf01.png,5,150\nf01.png,190,70\n"


@dataclass(frozen=True)
class Trained:
    folder: Path
    seconds: float = 3.0
    left_out: tuple[()] = ()


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "frames").mkdir()
    for k in range(10):
        cv2.imwrite(f"frames/f{k:02d}.png", draw_image(bend_at(k)))
    (tmp_path / "lines.csv").write_text(LINES)
    return tmp_path


@pytest.fixture
def trained(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """Calls of the training, which does nothing."""
    calls: list[Any] = []

    def fine_tune(annotations, images, folder, *, xray, on_progress):
        calls.append((folder, annotations, images, xray))
        on_progress("training", 0.5)
        return Trained(folder)

    monkeypatch.setattr("tipforce.pipelines._fine_tune_locator.fine_tune_locator", fine_tune)
    return calls


def run(*words: object) -> Any:
    return CliRunner().invoke(app, ["annotate", *map(str, words)], catch_exceptions=False)


def test_annotations_of_a_file_are_kept_and_written_as_another(folder: Path) -> None:
    result = run("frames", "--from", "lines.csv", "--export", "lines.json", "--json", "figures.json")
    assert result.exit_code == 0
    assert "took 2 frames of lines.csv" in result.output
    assert "2 of 2 frames are finished" in result.output
    coco = json.loads((folder / "lines.json").read_text())
    assert [image["file_name"] for image in coco["images"]] == ["f00.png", "f01.png"]
    assert coco["images"][0]["width"] == 320
    assert coco["annotations"][0]["keypoints"][:3] == [5, 150, 2]
    assert json.loads((folder / "figures.json").read_text())["finished"] == 2
    assert run("frames", "--export", "again.csv").exit_code == 0
    assert (folder / "again.csv").read_text().splitlines()[1] == "f00.png,5.000,150.000,0"


def test_the_detector_is_trained_on_the_finished_frames(folder: Path, trained: list[Any]) -> None:
    result = run("frames", "--from", "lines.csv", "--train")
    assert result.exit_code == 0
    assert re.search(r"trained on 2 frames in 3 s; wrote .*detector", result.output)
    ((detector, annotations, images, xray),) = trained
    assert detector == Path("detector")
    assert not xray
    assert [each.points_px.shape for each in annotations] == [(64, 2), (64, 2)]
    assert np.array_equal(images[0], draw_image(bend_at(0)))


def test_the_detector_is_stored_beside_the_bench_file(folder: Path, trained: list[Any]) -> None:
    (folder / "lab").mkdir()
    bench = folder / "lab" / "bench.toml"
    bench.write_text("# my bench\n[views.camera]\nbase_side = 'left'\n")
    result = run("frames", "--from", "lines.csv", "--train", "--bench", "lab/bench.toml")
    assert "lab/bench.toml names it" in result.output
    assert "vision.detector=own" in run("frames", "--train", "-o", "own").output
    assert [detector for detector, *_ in trained] == [Path("lab/detector"), Path("own")]
    assert bench.read_text().startswith("# my bench\n[views.camera]\nbase_side = 'left'\n")
    assert read_bench(bench).view("camera").detector == str(folder / "lab" / "detector")


def test_the_training_for_xray_images_begins_with_the_network_for_xray(folder: Path, trained: list[Any]) -> None:
    (folder / "bench.toml").write_text("[views.camera]\nmodality = 'xray'\n")
    result = run("frames", "--from", "lines.csv", "--train", "--bench", "bench.toml")
    assert result.exit_code == 0
    assert [xray for *_, xray in trained] == [True]


def test_the_page_is_served_until_it_is_finished(
    folder: Path, trained: list[Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    seen: list[dict[str, Any]] = []

    def visit(server: Any) -> None:
        with urllib.request.urlopen(f"{server.address}state") as answer:
            seen.append(json.loads(answer.read()))

    monkeypatch.setattr("tipforce.cli.annotate._wait", visit)
    for _ in range(2):  # the second time with the same frames
        result = run("frames", "--frames", "8", "--port", "0", "--set", "vision.polarity=dark")
        assert result.exit_code == 0
        assert re.search(r"page: http://127\.0\.0\.1:\d+/", result.output)
        assert "0 of 8 frames are finished; saved in" in result.output
    assert [frame["image"] for frame in seen[0]["frames"]] == [frame["image"] for frame in seen[1]["frames"]]
    assert all(len(frame["proposal"]["points_px"]) >= 4 for frame in seen[0]["frames"])


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--export", "out.csv"], r"no frame is finished; mark some with `tipforce annotate frames`"),
        (["--from", "lines.csv", "--export", "out.txt"], r"out.txt: annotations are written as .csv"),
        (["--from", "none.csv"], r"none.csv: there is no such file"),
        (["--train"], "0 finished frames show a catheter; a training needs at least 2"),
        (["--from", "lines.csv", "--train", "-o", "frames"], "frames: exists already and is no detector"),
        (["--set", "vision.colour=red"], "colour"),
    ],
)
def test_a_mistake_is_one_sentence(folder: Path, words: list[str], message: str) -> None:
    with pytest.raises(InputError, match=message) as refused:
        run("frames", *words)
    assert "\n" not in str(refused.value)


def test_an_export_does_not_replace_the_images(folder: Path) -> None:
    with pytest.raises(OutputError, match="is a folder"):
        run("frames", "--from", "lines.csv", "--export", "frames")


def test_advice_that_is_given_works(folder: Path) -> None:
    with pytest.raises(InputError) as refused:
        run("frames", "--export", "out.csv")
    advised = re.findall(r"`tipforce annotate ([^`]+)`", str(refused.value))[1].replace("FILE", "lines.csv").split()
    assert run(*advised).exit_code == 0
    assert run("frames", "--export", "out.csv").exit_code == 0


def test_annotations_of_other_images_are_not_mixed_in(folder: Path) -> None:
    run("frames", "--from", "lines.csv")
    (folder / "frames" / "f00.png").unlink()
    with pytest.raises(InputError, match=r"f00\.png is not in frames; the annotations belong to other images"):
        run("frames", "--port", "0")


@pytest.mark.parametrize("words", [["--export", "out.csv"], ["--train"], ["--port", "0"]])
def test_annotations_of_an_image_that_was_replaced_are_refused(
    folder: Path, trained: list[Any], words: list[str]
) -> None:
    run("frames", "--from", "lines.csv")
    cv2.imwrite("frames/f00.png", draw_image(bend_at(3)))
    with pytest.raises(InputError, match=r"f00\.png is another image than the one that was marked"):
        run("frames", *words)


def test_a_jpeg_of_the_same_image_is_the_image_that_was_marked(folder: Path, trained: list[Any]) -> None:
    run("frames", "--from", "lines.csv")
    _, data = cv2.imencode(".jpg", draw_image(bend_at(0)), [cv2.IMWRITE_JPEG_QUALITY, 85])
    cv2.imwrite("frames/f00.png", cv2.imdecode(data, cv2.IMREAD_GRAYSCALE))
    assert run("frames", "--train").exit_code == 0


@pytest.mark.skipif(sys.platform == "win32", reason="signals of Unix")
def test_ctrl_c_ends_the_page_and_keeps_the_annotations(folder: Path) -> None:
    run("frames", "--from", "lines.csv")
    words = ["annotate", "frames", "--port", "0", "--frames", "2"]
    child = subprocess.Popen([sys.executable, "-m", "tipforce", *words], stderr=subprocess.PIPE, text=True)
    assert child.stderr is not None
    while "Ctrl-C" not in (line := child.stderr.readline()):
        assert line or child.poll() is None
    with pytest.raises(
        OutputError, match=r"frames\.annotations\.json: is being written by process \d+ \(tipforce annotate"
    ):
        run("frames", "--from", "lines.csv")
    child.send_signal(signal.SIGINT)
    _, said = child.communicate(timeout=30)
    assert child.returncode == 130
    assert said.strip() == ("tipforce: stopped by SIGINT; the annotations are saved, and the same command goes on")
