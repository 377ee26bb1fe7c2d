"""Every command of the README and of a model card runs, in a folder with files of those names."""

import shutil
from itertools import islice
from pathlib import Path

import pytest

from tipforce.estimators import located, pretrained_names
from tipforce.io import open_source, write_video
from tipforce.types import Frame

from .conftest import code_blocks, type_command  # type: ignore[import-not-found]

README = (Path(__file__).resolve().parents[2] / "README.md").read_text(encoding="utf-8")
QUICKER = {
    "--data runs/ -o": "--data runs/ --every 12 -o",
    "--estimator svr -o": "--estimator svr --set max_left_out=0.3 -o",  # of these nine seconds a sixth is not detected
}
NEED_A_PERSON = ("tipforce live", "tipforce annotate")
"""Commands that wait for a bench's devices, or for the button Finish of a page. Tests of their own run them."""


def commands(text: str) -> list[str]:
    lines = [line for block in code_blocks(text, "console") for line in block.splitlines()]
    return [line for line in lines if line.startswith("tipforce ")]


@pytest.mark.walkthrough
def test_the_commands_for_a_bench_run(work_folder: Path) -> None:
    shutil.copy("video.mp4", "new.mp4")
    shutil.copy("bench.toml", "known.toml")
    lines = commands(README.partition("## On your bench")[2].partition("\n## ")[0])
    assert len(lines) > 5
    for line in lines:
        if line.startswith("tipforce init-bench"):
            Path("bench.toml").unlink()
            type_command(line)
            shutil.copy("known.toml", "bench.toml")  # as filled in by a person
            for path in sorted(Path("runs").glob("session_0[2-7]*")):  # copies; two sessions suffice
                path.unlink()
        elif not line.startswith(NEED_A_PERSON):
            type_command(line, QUICKER)
    assert Path("forces.mp4").is_file()
    assert Path("report/report.html").is_file()


def test_the_python_example_runs(work_folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (code,) = code_blocks(README, "python")
    shutil.copy("run.mcap", "runs/monday.mcap")
    exec(code, {})  # it is the README's own
    assert capsys.readouterr().out.strip()


@pytest.mark.walkthrough
def test_the_commands_without_a_bench_run(work_folder: Path) -> None:
    shutil.rmtree("runs")
    for line in commands(README.partition("## Without a bench")[2].partition("\n## ")[0]):
        type_command(line, {"--sessions 8": "--sessions 1"})
    assert Path("set/metadata.csv").is_file()


@pytest.mark.walkthrough
@pytest.mark.parametrize("name", pretrained_names())
def test_the_command_of_a_model_card_runs(name: str, work_folder: Path) -> None:
    folder = located(f"pretrained/{name}")
    card = (folder / "README.md").read_text(encoding="utf-8")
    (line,) = [line for block in code_blocks(card) for line in block.splitlines()]
    assert "--bench bench.toml" in line
    with open_source("video.mp4") as source:  # a second of it
        frames = (event for event in source if isinstance(event, Frame))
        write_video("second.mp4", islice(frames, 24), fps=24.0)
    Path("second.mp4").replace("video.mp4")
    printed = type_command(line.replace("THIS_FOLDER", str(folder)))
    assert "missing_input" not in printed
