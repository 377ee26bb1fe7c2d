"""``tipforce control``: options that contradict each other are refused before anything is simulated."""

from pathlib import Path

from typer.testing import CliRunner

from tipforce import cli
from tipforce.errors import InputError


def test_a_limit_that_is_stated_and_lifted_is_refused(tmp_path: Path) -> None:
    words = ["control", "truth", "--no-limit", "--set", "safety.limit_n=0.3", "-o", str(tmp_path / "run")]
    result = CliRunner().invoke(cli.app, words)
    assert isinstance(result.exception, InputError), result.output
    assert "leave one of both out" in str(result.exception)
    assert not (tmp_path / "run").exists()
