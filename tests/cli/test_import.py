import json
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from tipforce.cli import app
from tipforce.errors import InputError, TipforceError
from tipforce.io import write_video
from tipforce.types import Frame


@pytest.fixture
def files(tmp_path: Path) -> Path:
    """Four seconds: a video of nothing much, and a force log in grams with German decimals."""
    image = np.full((48, 64), 128, np.uint8)
    write_video(tmp_path / "video.mp4", (Frame(k * 50_000_000, image + np.uint8(k)) for k in range(80)), 20)
    rows = [f"{k},0;{max(0, np.sin(k / 300)) * 20:.3f};0,5".replace(".", ",") for k in range(4000)]
    (tmp_path / "log.csv").write_text("zeit_ms;Fx;Fy\n" + "\n".join(rows) + "\n")
    return tmp_path


def run(*words: object) -> str:
    """Output of a command; raises what the program would tell the user."""
    result = CliRunner().invoke(app, [str(word) for word in words])
    if isinstance(result.exception, TipforceError):
        raise result.exception
    assert result.exit_code == 0, result.output
    return result.output


def test_import_writes_a_recording_and_its_figures(files: Path) -> None:
    out = run(
        "import", files / "video.mp4", files / "log.csv", "--knob-deg", 10, "--actuation", "wire_mm=1.5",
        "--force-unit", "g", "--time", "zeit_ms", "--sensor-angle-deg", 30, "--reads", "tissue-on-tip",
        "--tare", "3:4", "--offset-ms", -7.5, "--catheter", "decapolar,diameter_m=0.002", "--metres-per-px", 2e-4,
        "--session", "first", "-o", files / "run.mcap", "--plot", files / "run.png", "--json", files / "run.json",
    )  # fmt: skip
    figures = json.loads((files / "run.json").read_text())
    assert figures["session"] == "first"
    assert figures["clock_offset"]["offset_ms"] == -7.5
    assert figures["sensor"] == {"angle_deg": 30.0, "reads": "tissue-on-tip"}
    assert figures["catheter"]["diameter_m"] == 0.002
    assert figures["actuation_range"] == {"knob_deg": [10.0, 10.0], "wire_mm": [1.5, 1.5]}
    assert 0.1 < figures["force_range_n"]["magnitude"][1] < 0.25
    assert (files / "run.png").stat().st_size > 10_000
    assert "-7.5 ms (stated" in out
    assert "decapolar" in out


def test_recordings_become_a_dataset_folder(files: Path) -> None:
    common = [files / "log.csv", "--force-unit", "g", "--time", "zeit_ms", "--offset", "none", "--knob-deg", 10]
    for name in ("a", "b"):
        run("import", files / "video.mp4", *common, "-o", files / f"{name}.mcap")
    run("import", files / "a.mcap", files / "b.mcap", "-o", files / "dataset", "--json", files / "d.json")
    figures = json.loads((files / "d.json").read_text())
    assert figures["sessions"] == ["a", "b"]
    assert figures["samples"] == 160
    assert (files / "dataset" / "metadata.csv").exists()


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--actuation", "knob=3"], "NAME_UNIT=VALUE"),
        (["--actuation", "knob_deg=x"], "expected a number"),
        (["--tare", "5"], "START:END"),
        (["--tare", "5:2"], "does not lie behind"),
        (["--offset-ms", "soon"], "milliseconds, auto or none"),
        (["--catheter", "x,colour=1"], "there is no fact 'colour'"),
        (["--set", "polarity=pink"], "polarity"),
        (["--catheter", "x,diameter_m=-1"], "expected a number above zero for diameter_m"),
        (["--metres-per-px", "0"], "--metres-per-px: expected a number above zero"),
        (["--sensor-angle-deg", "nan"], "--sensor-angle-deg: expected degrees"),
        (["--offset-ms", "1e30"], "less than 2e12 ms"),
        (["extra.csv"], "got 3 files"),
    ],
)
def test_a_mistyped_option_is_one_sentence_with_what_is_expected(files: Path, words: list[str], said: str) -> None:
    with pytest.raises(InputError) as caught:
        run("import", files / "video.mp4", files / "log.csv", *words, "-o", files / "run.mcap")
    assert said in str(caught.value)
    assert not list(files.glob("run.mcap*"))
