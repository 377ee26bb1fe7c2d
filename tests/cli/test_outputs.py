"""What is written: never over what is read, never after minutes of work that were in vain."""

import io
import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from tipforce import __version__, cli
from tipforce.cli._common import progress_bar, write_json
from tipforce.errors import InputError, TipforceError


def refused(*words: object) -> str:
    """What the program says of a command that it must not run."""
    result = CliRunner().invoke(cli.app, [str(word) for word in words])
    assert isinstance(result.exception, TipforceError), result.output
    return str(result.exception)


@pytest.mark.parametrize("option", ["-o", "--overlay", "--json"])
def test_what_is_read_is_never_written_over(model: Path, video: Path, tmp_path: Path, option: str) -> None:
    before = video.read_bytes()
    said = refused("estimate", model, video, "--knob-deg", 10, "-o", tmp_path / "f.csv", "--overwrite", option, video)
    assert "is the input" in said
    assert video.read_bytes() == before
    assert not list(tmp_path.iterdir())
    assert "is the input" in refused("inspect", video, option.replace("--overlay", "-o"), video)


def test_two_outputs_must_not_be_one_file(model: Path, video: Path, tmp_path: Path) -> None:
    (tmp_path / "x").mkdir()
    both = tmp_path / "f.csv"
    assert "written twice" in refused(
        "estimate", model, video, "-o", both, "--overlay", tmp_path / "x" / ".." / "f.csv"
    )


def test_estimates_replace_a_file_only_when_told_to(model: Path, video: Path, tmp_path: Path) -> None:
    log = tmp_path / "force.csv"
    log.write_text("time_s,fx_n\n0,1\n")
    assert "--overwrite" in refused("estimate", model, video, "-o", log)
    assert log.read_text().startswith("time_s")
    done = CliRunner().invoke(
        cli.app, ["estimate", str(model), str(video), "--knob-deg", "10", "-o", str(log), "--overwrite"]
    )
    assert done.exit_code == 0
    assert log.read_text().startswith("frame,time_s,stamp_ns")


@pytest.mark.parametrize(
    "words",
    [
        ["train", "DATA", "-o", "OUT/m", "--json", "OUT/no/x.json"],
        ["train", "DATA", "-o", "OUT/m", "--onnx", "OUT/no/x.onnx"],
        ["evaluate", "svr", "--data", "DATA", "-o", "OUT/r", "--json", "OUT"],
        ["import", "DATA", "log.csv", "-o", "OUT/r.mcap", "--json", "OUT/no/x.json"],
        ["init-bench", "-o", "OUT/no/bench.toml"],
        ["simulate", "-o", "OUT/s", "--json", "OUT/no/x.json"],
        ["inspect", "DATA", "-o", "OUT/no/x.png"],
    ],
    ids=lambda words: f"{words[0]} {words[-2]} {words[-1]}",
)
def test_a_place_that_cannot_be_written_is_named_before_the_work(video: Path, tmp_path: Path, words: list[str]) -> None:
    (tmp_path / "no").write_text("a file where a folder must be")
    said = refused(*(word.replace("OUT", str(tmp_path)).replace("DATA", str(video)) for word in words))
    assert str(tmp_path) in said
    assert [path.name for path in tmp_path.iterdir()] == ["no"]


def test_names_in_brackets_are_printed_as_they_are(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def app() -> None:
        raise InputError("run [3]/[bold]x[/red].csv: has no column 'Time [s]' :smile:")

    monkeypatch.setattr(cli, "app", app)
    with pytest.raises(SystemExit) as caught:
        cli.main()
    assert caught.value.code == 2
    assert capsys.readouterr().err == "tipforce: run [3]/[bold]x[/red].csv: has no column 'Time [s]' :smile:\n"


@pytest.mark.parametrize("value", ["nan", "inf"])
def test_a_knob_without_a_finite_angle_is_refused(model: Path, video: Path, tmp_path: Path, value: str) -> None:
    assert "--knob-deg" in refused("estimate", model, video, "-o", tmp_path / "f.csv", f"--knob-deg={value}")


def test_the_version_is_told() -> None:
    result = CliRunner().invoke(cli.app, ["--version"])
    assert result.exit_code == 0
    assert result.output == f"tipforce {__version__}\n"


def test_in_a_log_progress_is_a_line_now_and_then(capsys, monkeypatch) -> None:
    monkeypatch.setattr("tipforce.cli._common._LINE_EVERY_S", 0.0)
    with progress_bar() as report:
        report("epoch 3 of 20", 0.153)
    assert capsys.readouterr().err == "epoch 3 of 20: 15%\n"
    monkeypatch.setattr("tipforce.cli._common._LINE_EVERY_S", 60.0)
    with progress_bar() as report:
        report("epoch 3 of 20", 0.153)
    assert not capsys.readouterr().err


def test_what_stands_in_files_is_shown_in_one_line_that_steers_no_terminal(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    log = tmp_path / "log.csv"
    log.write_text(f"\x1b[2J,\u202eabc,{'x' * 5000}\n1,2,3\n")
    (tmp_path / "frames").mkdir()
    monkeypatch.setattr("sys.argv", ["tipforce", "import", str(log), str(log), "-o", str(tmp_path / "run.mcap")])
    with pytest.raises(SystemExit) as end:
        cli.main()
    said = capsys.readouterr().err
    assert end.value.code == 2
    assert said.isprintable() or said.count("\n") == 1
    assert len(said) < 600
    assert "log.csv" in said


def test_figures_that_are_not_finite_are_null(tmp_path: Path) -> None:
    write_json({"a": [float("nan"), 1.5], "b": {"c": float("inf")}}, str(tmp_path / "figures.json"))
    assert json.loads((tmp_path / "figures.json").read_text()) == {"a": [None, 1.5], "b": {"c": None}}


def test_figures_are_shown_on_a_terminal_that_lacks_a_letter(monkeypatch: pytest.MonkeyPatch) -> None:
    shown = io.BytesIO()
    with io.TextIOWrapper(shown, encoding="ascii", write_through=True) as terminal:
        monkeypatch.setattr("sys.stdout", terminal)
        write_json({"title": "Größe"}, "-")
        assert json.loads(shown.getvalue()) == {"title": "Größe"}
