"""The demo types commands that exist, and trains nothing on the sessions that it judges on."""

import json
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest
from typer.main import get_command

from tipforce._system.processes import run_child
from tipforce.cli import app
from tipforce.errors import TipforceError
from tipforce.pipelines import _demo, demo

COMMANDS = get_command(app).commands  # type: ignore[attr-defined]
ERRORS = {"pretrained/compact": 0.02, "compact": 0.01, "svr": 0.03}


@pytest.fixture
def typed(monkeypatch: pytest.MonkeyPatch) -> list[list[str]]:
    """The commands that the demo types; instead of running, they are parsed, and evaluate leaves figures."""
    commands: list[list[str]] = []

    def run(command: list[str], **_: object) -> SimpleNamespace:
        verb, *words = command[3:]
        assert COMMANDS[verb].make_context(verb, list(words)).command is COMMANDS[verb]
        commands.append([verb, *words])
        if verb == "evaluate":
            report = Path(words[words.index("-o") + 1])
            report.mkdir(exist_ok=True)
            results = [
                {"method": name, "against_sensor": {"quantities": {"magnitude": {"mae_n": error}}}}
                for name, error in ERRORS.items()
            ]
            (report / "metrics.json").write_text(json.dumps({"results": results}))
        return SimpleNamespace(returncode=0, stderr="clock map     offset +1 ms (from the deflection)\n")

    monkeypatch.setattr(_demo, "run_child", run)
    return commands


def of(typed: list[list[str]], verb: str) -> list[list[str]]:
    return [words for words in typed if words[0] == verb]


def test_every_command_can_be_typed_and_no_model_sees_the_last_two_sessions(
    typed: list[list[str]], tmp_path: Path
) -> None:
    lines: list[str] = []
    done = demo(tmp_path / "demo", sessions=4, say=lambda text, _: lines.append(text))
    assert len(of(typed, "import")) == 4
    for words in of(typed, "train"):
        left_out = [words[i + 1] for i, word in enumerate(words) if word == "--without"]
        assert left_out == ["session_02", "session_03"]
    assert sum(text.startswith("$ tipforce ") for text in lines) == len(typed)
    assert done.best == str(tmp_path / "demo" / "models" / "compact")
    assert of(typed, "estimate")[-1][1:3] == [done.best, str(tmp_path / "demo" / "bench" / "session_03" / "video.mp4")]
    assert {
        "first session", "first force", "simulate", "import", "train", "evaluate", "first report", "estimate", "splits",
        "total",
    } == {*done.seconds}  # fmt: skip


def test_the_first_force_comes_before_the_other_sessions_are_simulated(typed: list[list[str]], tmp_path: Path) -> None:
    lines: list[str] = []
    demo(tmp_path / "demo", sessions=4, say=lambda text, _: lines.append(text))
    assert [words[0] for words in typed[:3]] == ["simulate", "estimate", "simulate"]
    first, estimated, all_of_them = typed[:3]
    assert [words[words.index("--sessions") + 1] for words in (first, all_of_them)] == ["1", "4"]
    assert estimated[1] == "pretrained/compact"
    said = next(line for line in lines if line.startswith("The force in the video after"))
    assert estimated[estimated.index("--overlay") + 1] in said


def test_imports_run_side_by_side_on_one_core_each(
    typed: list[list[str]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    threads: dict[str, set[int | None]] = {}
    stand_in = _demo.run_child

    def run(command: list[str], **options: int | None) -> object:
        threads.setdefault(command[3], set()).add(options["threads"])
        return stand_in(command, **options)  # type: ignore[arg-type]

    monkeypatch.setattr(_demo, "run_child", run)
    demo(tmp_path / "demo", sessions=3, say=lambda *_: None)
    assert threads.pop("import") == {1}
    assert set().union(*threads.values()) == {None}


def test_a_child_is_told_how_many_cores_it_may_use() -> None:
    code = "import os, sys; sys.stderr.write(os.environ['TIPFORCE_CORES'] + os.environ['OMP_NUM_THREADS'])"
    assert run_child([sys.executable, "-c", code], capture=True, threads=1).stderr == "11"


def test_without_torch_fine_tuning_is_skipped_in_a_sentence(
    typed: list[list[str]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(_demo.importlib.util, "find_spec", lambda _: None)
    lines: list[str] = []
    done = demo(tmp_path / "demo", sessions=3, say=lambda text, _: lines.append(text))
    assert [words[words.index("--estimator") + 1] for words in of(typed, "train")] == ["svr"]
    assert any("torch is not installed" in text for text in lines)
    assert done.best == "pretrained/compact"


def test_a_command_that_fails_ends_the_demo(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(_demo, "run_child", lambda *_, **__: SimpleNamespace(returncode=2, stderr="a reason"))
    with pytest.raises(TipforceError, match=r"simulate .* exit code 2"):
        demo(tmp_path / "demo", say=lambda *_: None)
