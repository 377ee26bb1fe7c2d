"""The commands of the tutorial run in the order of the page, and print what stands in it, but for the numbers."""

import re
from pathlib import Path

import pytest

from .conftest import type_command  # type: ignore[import-not-found]

PAGE = Path(__file__).resolve().parents[2] / "docs" / "tutorial" / "your-bench-in-an-hour.md"
QUICKER = {
    "--seconds 20": "--seconds 12",
    "width=800": "width=320",
    "height=600": "height=240",
    "metres_per_px = 0.00016": "metres_per_px = 0.0004",
    "--samples 400 --set epochs=8": "--samples 60 --set epochs=1",
    "--protocol saved": "--protocol saved --every 8",
}
"""What is replaced in the page so that it ends within a test: shorter sessions, smaller images, less training."""


def form(line: str) -> str:
    """The beginning of a printed line, up to its first number: what does not depend on the data."""
    return re.split(r"[-+]?\d", line.strip(), maxsplit=1)[0].rstrip()


@pytest.mark.walkthrough
def test_the_tutorial_runs_and_prints_what_it_shows(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    blocks = re.findall(r"```(\w+)\n(.*?)```", PAGE.read_text(encoding="utf-8"), flags=re.DOTALL)
    assert [kind for kind, _ in blocks].count("console") >= 8
    printed = ""
    for kind, block in blocks:
        if kind == "console":
            printed = "".join(type_command(line, QUICKER) for line in block.splitlines())
        elif kind == "toml":
            for slow, quick in QUICKER.items():
                block = block.replace(slow, quick)
            Path("bench.toml").write_text(block, encoding="utf-8")
        else:
            said = [form(line) for line in printed.splitlines()]
            missing = [line for line in block.splitlines() if form(line) and form(line) not in said]
            assert not missing, printed
    for name in ("detected.png", "session_00.png", "report/report.html", "forces.csv", "overlay.mp4"):
        assert Path(name).is_file(), name
