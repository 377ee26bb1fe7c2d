"""``tipforce init-bench``: a file that a person goes on writing, and that all other verbs read."""

import re
from dataclasses import replace
from pathlib import Path

import pytest
from click.testing import Result
from typer.testing import CliRunner

from tipforce.cli import app
from tipforce.errors import InputError
from tipforce.types import Catheter, SessionInfo, ViewInfo, bench_text, read_bench

NOTHING = SessionInfo(views={"camera": ViewInfo()})
"""What a new file states: there is a camera."""


def run(*words: object, answers: str | None = None) -> Result:
    return CliRunner().invoke(app, ["init-bench", *map(str, words)], input=answers, catch_exceptions=False)


def test_without_a_person_to_ask_the_file_has_every_value_as_a_comment(tmp_path: Path) -> None:
    path = tmp_path / "bench.toml"
    result = run("-o", path)
    assert result.exit_code == 0
    assert "0 values stated" in " ".join(result.stderr.split())
    assert read_bench(path) == NOTHING
    content = path.read_text(encoding="utf-8")
    for part in ("[catheter]", "[views.camera]", "[sensor]", "[sensor.log]", "[actuation]", "#diameter_m = 2.33e-3"):
        assert f"\n{part}" in content


def test_every_commented_line_is_valid_once_it_is_no_comment_any_more(tmp_path: Path) -> None:
    path = tmp_path / "bench.toml"
    run("-o", path)
    content = path.read_text(encoding="utf-8")
    lines = [line for line in content.splitlines() if re.match(r"#\w+ = ", line)]
    assert len(lines) > 20
    for line in lines:
        path.write_text(content.replace(f"\n{line}\n", f"\n{line[1:]}\n"), encoding="utf-8")
        stated = read_bench(path)
        assert stated != NOTHING, line
        assert bench_text(stated, guide=False).count("=") >= 1
    path.write_text(re.sub(r"(?m)^#(\w+ = )", r"\1", content), encoding="utf-8")
    full = read_bench(path)
    others = len(full.values()["bag"]) + 2  # the bag's topics, the catheter's name, the clock of the stage's log
    assert len(full.stated_keys()) == len(lines) - others
    path.write_text(bench_text(full), encoding="utf-8")
    assert read_bench(path) == full


def test_facts_and_another_file_are_written_down(tmp_path: Path) -> None:
    (tmp_path / "old.toml").write_text("[catheter]\ndiameter_m = 2e-3\nrigid_length_m = 0\n")
    words = ["--fact", "catheter.diameter_m=2.33e-3", "--fact", "views.camera.base_side=right"]
    run("--bench", tmp_path / "old.toml", *words, "-o", tmp_path / "bench.toml")
    stated = SessionInfo(
        catheter=Catheter(diameter_m=2.33e-3, rigid_length_m=0.0), views={"camera": ViewInfo(base_side="right")}
    )
    assert read_bench(tmp_path / "bench.toml") == stated
    with pytest.raises(InputError, match=r"catheter\.length is not known"):
        run("--fact", "catheter.length=3", "-o", tmp_path / "other.toml")
    assert not (tmp_path / "other.toml").exists()


def test_a_person_is_asked_for_what_is_open_in_the_units_of_a_bench(tmp_path: Path) -> None:
    path = tmp_path / "bench.toml"
    answers = ["7F", "40", "8,5", "", "0.2", "up", "left", "ninety", "90", "", ""]
    result = run("--ask", "--fact", "catheter.diameter_m=2.33e-3", "-o", path, answers="\n".join(answers) + "\n")
    assert result.exit_code == 0, result.output
    asked = " ".join(result.stderr.split())
    assert "Diameter" not in asked, "what is stated is not asked for"
    assert "base_side = 'up' is refused" in asked
    assert "expected a number, got 'ninety'" in asked
    assert "6 values stated" in asked
    found = read_bench(path)
    assert found.catheter == Catheter("7F", 2.33e-3, 40e-3, 8.5e-3)
    assert found.view("camera") == ViewInfo(2e-4, "left")
    assert (found.sensor.angle_deg, found.sensor.reads) == (90.0, None)


def test_lengths_that_are_none_are_asked_for_again(tmp_path: Path) -> None:
    path = tmp_path / "bench.toml"
    result = run("--ask", "-o", path, answers="\n0.00233e6\n-1\n2.33\n" + "\n" * 8)
    assert result.stderr.count("Diameter of the shaft") == 3
    assert read_bench(path) == replace(NOTHING, catheter=Catheter(diameter_m=2.33e-3))


def test_a_file_that_is_there_is_kept_unless_told_otherwise(tmp_path: Path) -> None:
    path = tmp_path / "bench.toml"
    path.write_text("precious")
    with pytest.raises(InputError, match=r"bench\.toml: exists already; choose another name or state --overwrite"):
        run("-o", path)
    assert path.read_text() == "precious"
    run("-o", path, "--overwrite", "--bench", _other(tmp_path))
    assert read_bench(path).catheter.diameter_m == 1e-3


def _other(folder: Path) -> Path:
    path = folder / "other.toml"
    path.write_text("[catheter]\ndiameter_m = 1e-3\n")
    return path
