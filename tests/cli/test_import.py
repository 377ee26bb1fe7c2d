import json
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from tipforce.cli import app
from tipforce.datasets import open_dataset
from tipforce.errors import InputError, TipforceError
from tipforce.io import RecordingReader, write_video
from tipforce.types import Catheter, Frame, ViewInfo

BENCH = """
[catheter]
name = "decapolar"
diameter_m = 2e-3

[views.camera]
metres_per_px = 2e-4
base_side = "left"

[sensor]
angle_deg = 30
reads = "tip-on-tissue"

[sensor.log]
time = "zeit_ms"
force_unit = "g"
"""


@pytest.fixture
def files(tmp_path: Path) -> Path:
    """Four seconds: a video of nothing much, and a force log in grams with German decimals."""
    image = np.full((48, 64), 128, np.uint8)
    write_video(tmp_path / "video.mp4", (Frame(k * 50_000_000, image + np.uint8(k)) for k in range(80)), 20)
    rows = [
        f"{k},0;{max(0, np.sin(k / 300)) * 20:.3f};{max(0, np.sin(k / 300)) * 2:.3f}".replace(".", ",")
        for k in range(4000)
    ]
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
    (files / "bench.toml").write_text(BENCH)
    out = run(
        "import", files / "video.mp4", files / "log.csv", "--knob-deg", 10, "--bench", files / "bench.toml",
        "--fact", "sensor.reads=tissue-on-tip", "--fact", "actuation.constant.wire_mm=1.5",
        "--tare", "3:4", "--offset-ms", -7.5, "-o", files / "first.mcap", "--json", files / "run.json",
    )  # fmt: skip
    figures = json.loads((files / "run.json").read_text())
    assert figures["session"] == "first"
    assert figures["clock_map"]["offset_ms"] == -7.5
    with RecordingReader(files / "first.mcap") as reader:
        info = reader.session_info
    assert (info.sensor.angle_deg, info.sensor.reads) == (30.0, "tissue-on-tip")
    assert info.catheter == Catheter("decapolar", 0.002)
    assert info.view("camera") == ViewInfo(2e-4, "left")
    assert figures["actuation_range"] == {"knob_deg": [10.0, 10.0], "wire_mm": [1.5, 1.5]}
    assert 0.1 < figures["force_range_n"]["magnitude"][1] < 0.25
    assert "offset -7.5 ms, rate 1 (stated" in out
    assert "decapolar" in out


def test_recordings_become_a_dataset_folder(files: Path) -> None:
    (files / "bench.toml").write_text(BENCH)
    common = [files / "log.csv", "--bench", files / "bench.toml", "--offset-ms", "none", "--knob-deg", 10]
    for name in ("a", "b"):
        run("import", files / "video.mp4", *common, "-o", files / f"{name}.mcap")
    run("import", files / "a.mcap", files / "b.mcap", "-o", files / "dataset", "--json", files / "d.json")
    figures = json.loads((files / "d.json").read_text())
    assert figures["sessions"] == ["a", "b"]
    assert figures["samples"] == 160
    assert (files / "dataset" / "metadata.csv").exists()
    with pytest.raises(InputError, match=r"their own clock maps and tares; .*tipforce import \S+a.mcap -o NEW.mcap"):
        run("import", files / "a.mcap", "-o", files / "other", "--offset-ms", 5)
    run("import", files / "a.mcap", "-o", files / "NEW.mcap", "--offset-ms", 5)
    with pytest.raises(InputError, match="was imported; import its files again with the tare"):
        run("import", files / "a.mcap", "-o", files / "other.mcap", "--tare", "0:1")


def test_a_published_set_becomes_a_dataset_folder_with_the_stated_metadata(tmp_path: Path) -> None:
    h5py = pytest.importorskip("h5py")
    folder = tmp_path / "published" / "pulled"
    folder.mkdir(parents=True)
    for name, values in (("input_test", np.zeros((4, 3, 64, 64))), ("target_test", np.ones((4, 3, 1, 1)))):
        with h5py.File(folder / f"{name}.mat", "w") as file:
            file[name] = values
    with pytest.raises(InputError, match=r"becomes a dataset folder; .* without \.mcap: -o \S+/set$"):
        run("import", folder.parent, "-o", tmp_path / "set.mcap")
    with pytest.raises(InputError, match="labelled already; leave out --offset-ms"):
        run("import", folder.parent, "-o", tmp_path / "set", "--tare", "none")
    run("import", folder.parent, "-o", tmp_path / "set", "--fact", "catheter.diameter_m=0.012")
    data = open_dataset(tmp_path / "set")
    assert (len(data), data.sessions, data.session_info["pulled"].catheter.diameter_m) == (4, ("pulled",), 0.012)
    assert list(next(data.observations()).views) == ["a", "b"]


def test_logs_beside_one_of_a_stated_kind_are_told_apart_as_bench_toml_describes_them(files: Path) -> None:
    log = (files / "log.csv").read_text().partition("\n")[2]
    (files / "bare.csv").write_text(log)
    (files / "knob.csv").write_text("time_s,knob_deg\n" + "".join(f"{k},{k}\n" for k in range(10)))
    (files / "stage.csv").write_text("time_s,stage_mm\n" + "".join(f"{k},{k}\n" for k in range(10)))
    facts = ['sensor.log.columns=["zeit_ms", "Fx", "Fy"]', "sensor.log.force_unit=N"]
    run(
        "import", files / "video.mp4", files / "bare.csv", files / "knob.csv", "--stage", files / "stage.csv",
        *(word for fact in facts for word in ("--fact", fact)), "--tare", "none", "--offset-ms", "none",
        "-o", files / "run.mcap",
    )  # fmt: skip
    with RecordingReader(files / "run.mcap") as reader:
        assert {stream.kind for stream in reader.info.streams.values()} >= {"frame", "wrench", "actuation"}


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--fact", "actuation.constant.knob_deg=x"], "actuation.constant.knob_deg = 'x' is refused: input should be"),
        (["--fact", "base_side"], "expected KEY=VALUE"),
        (["--tare", "5"], "START:END"),
        (["--tare", "5:2"], "is not behind"),
        (["--offset-ms", "soon"], "milliseconds, auto, none or start"),
        (["--fact", "catheter.colour=1"], "catheter.colour is not known; catheter may hold name"),
        (["--fact", "views.camera.polarity=pink"], "views.camera.polarity = 'pink' is refused"),
        (["--fact", "catheter.diameter_m=-1"], "catheter.diameter_m = -1 is refused: expected 5e-05"),
        (["--fact", "catheter.diameter_m=2.33"], "it is in metres: for 2.33 mm write 0.00233"),
        (["--fact", "views.camera.metres_per_px=0"], "expected 1e-08 to 0.01"),
        (["--fact", "sensor.angle_deg=nan"], "sensor.angle_deg = nan is refused: input should be a finite number"),
        (["--knob-deg", "inf"], "--knob-deg: expected degrees, got 'inf'"),
        (["--bench", "none.toml"], "none.toml: does not exist; write one with `tipforce init-bench -o none.toml`"),
        (["--offset-ms", "1e30"], "less than 2e12 ms"),
        (["again.csv"], "again.csv: cannot determine the kind of this log (zeit_ms, Fx)"),
        (["extra.csv"], "extra.csv: "),
    ],
)
def test_a_mistyped_option_is_one_sentence_with_what_is_expected(files: Path, words: list[str], said: str) -> None:
    (files / "again.csv").write_text("zeit_ms;Fx\n0,0;0,5\n")
    words = [str(files / word) if word.endswith("again.csv") else word for word in words]
    with pytest.raises(TipforceError) as caught:
        run("import", files / "video.mp4", files / "log.csv", *words, "-o", files / "run.mcap")
    assert said in str(caught.value)
    assert not list(files.glob("run.mcap*"))
