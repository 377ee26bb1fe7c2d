"""A small simulated bench on disk, as `simulate --as files` and `import` leave it; made once for all contracts."""

import re
import shlex
import shutil
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path

import cv2
import pytest
from typer.testing import CliRunner

from tipforce._system.registry import Registry
from tipforce.cli import app
from tipforce.io import open_source
from tipforce.pipelines import import_session, simulate
from tipforce.pipelines._simulate import preset_settings
from tipforce.simulation import PRESETS
from tipforce.types import Frame

from ..two_view_set import write_two_view_set  # type: ignore[import-not-found]

SMALL = {"bench-2021": (320, 240), "generalise": (320, 240), "fluoro": (256, 256)}
"""Presets that examples name, and the size of image that makes them quick."""


def small(preset: str, seconds: float = 9.0, tare_s: float = 2.0, size: tuple[int, int] | None = None):
    """A preset with few, small images and short sessions: the same code in a tenth of the time."""
    width, height = size or SMALL[preset]
    world = {"seconds": seconds, "tare_s": tare_s, "clock": {"fps": 12.0}, "motion": {"peak_within_n": 5e-3}}
    made = preset_settings(preset, changes={"width": width, "height": height, "world": world})
    return made.model_copy(update={"preset": preset})


@pytest.fixture(scope="session")
def bench(made_once: Callable[[str, Callable[[Path], None]], Path]) -> Path:
    """Two sessions as files (session_00, session_01), imported as runs/session_00.mcap, runs/session_01.mcap."""
    return made_once("bench", make_bench)


def make_bench(folder: Path) -> None:
    simulate(folder, small("bench-2021"), sessions=2, seed=4, form="files")
    for name in ("session_00", "session_01"):
        session = folder / name
        logs = [session / "force.csv", session / "stage.csv"]
        import_session(session / "video.mp4", logs, folder / "runs" / f"{name}.mcap", bench=session / "bench.toml")


@pytest.fixture
def small_presets(monkeypatch: pytest.MonkeyPatch) -> None:
    """The presets by their names, but small."""
    made = {name: small(name) for name in SMALL}
    for name, settings in made.items():
        monkeypatch.setitem(PRESETS, name, settings)


def lay_out(bench: Path, place: Path) -> None:
    """Files by the names that the examples of the help texts use."""
    session = bench / "session_01"
    for name in ("video.mp4", "force.csv", "stage.csv", "bench.toml"):
        shutil.copy(session / name, place / name)
    for view in ("a", "b"):
        shutil.copy(session / "video.mp4", place / f"video_{view}.mp4")
    write_two_view_set(place / "soft-arm-two-views" / "pulled")
    (place / "runs").mkdir()
    for number in range(8):
        shutil.copy(bench / "runs" / f"session_0{number % 2}.mcap", place / "runs" / f"session_0{number}.mcap")
    for path in bench.glob("*.truth.npz"):
        shutil.copy(path, place / "runs" / path.name)
    shutil.copy(bench / "runs" / "session_00.mcap", place / "run.mcap")
    (place / "damaged.mcap").write_bytes((place / "run.mcap").read_bytes()[:-1000])
    (place / "frames").mkdir()
    with open_source(place / "video.mp4") as source:
        frames = [event for event in source if isinstance(event, Frame)]
    for frame in frames:
        cv2.imwrite(str(place / "frames" / f"{frame.stamp_ns}_ns.png"), frame.image)
    cv2.imwrite(str(place / "frame.png"), frames[0].image)
    lines = (place / "force.csv").read_text().splitlines()
    # the same log as another logger writes it: tabs, milliseconds, grams, no units in the names
    rows = [line.split(",") for line in lines[1:]]
    text = "\n".join("\t".join([f"{1e3 * float(t):.3f}", *(f"{float(x) / 9.80665e-3:.4f}" for x in xyz[:3])])
                     for t, *xyz in rows)  # fmt: skip
    (place / "log.tsv").write_text(f"t\tFx\tFy\tFz\n{text}\n")


QUICKER = {
    "minutes=60": "minutes=0.05",
    "--samples 10000": "--samples 30 --samples-per-session 10",
    # nine seconds are too short to learn the inertia of what the sensor carries without the stage's log
    "import video.mp4 force.csv --bench": "import video.mp4 force.csv stage.csv --bench",
}
"""What is replaced in a command that is written down so that it ends within a test."""


def type_command(line: str, replacements: dict[str, str] | None = None) -> str:
    """Runs a command line that is written down; returns what it printed. Networks train on few samples."""
    for slow, quick in (QUICKER | (replacements or {})).items():
        line = line.replace(slow, quick)
    words = shlex.split(line, comments=True)[1:]
    expanded = [path for word in words for path in (sorted(map(str, Path().glob(word))) if "*" in word else [word])]
    if expanded[0] == "train" and {"dcfe", "compact"} & {*expanded} and "--samples" not in expanded:
        expanded += ["--samples", "40"]
        if "compact" in expanded:
            expanded += ["--set", "epochs=1"]
    result = CliRunner().invoke(app, expanded, catch_exceptions=False)
    assert result.exit_code == 0, f"{line}\n{result.output}"
    return result.output


def code_blocks(text: str, language: str = "") -> list[str]:
    """The fenced blocks of a page, in order."""
    return re.findall(rf"```{language}\n(.*?)```", text, flags=re.DOTALL)


def install(site: Path, package: str, project: str, registry: Registry, monkeypatch: pytest.MonkeyPatch) -> None:
    """Installs a package into ``site`` as `pip install` does: with the entry points of its ``pyproject.toml``.

    Until the end of the test ``registry`` finds them beside its own.
    """
    information = site / f"{package.replace('-', '_')}-0.1.dist-info"
    information.mkdir(parents=True)
    (information / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {package}\nVersion: 0.1\n")
    groups = re.sub(r'\[project\.entry-points\."(.+)"\]', r"[\1]", project[project.index("[project.entry-points") :])
    (information / "entry_points.txt").write_text(groups.replace('"', "").replace(" = ", "="))
    monkeypatch.syspath_prepend(str(site))
    for name in [name for name in sys.modules if name.partition(".")[0] in ("tipforce_ridge", "my_lab")]:
        del sys.modules[name]
    fresh = Registry(registry.group, registry.noun, registry._own, registry._kind)
    monkeypatch.setattr(registry, "__dict__", fresh.__dict__)


@pytest.fixture(scope="session")
def laid_out(bench: Path, made_once: Callable[[str, Callable[[Path], None]], Path]) -> Path:
    """Files by the names that examples use; see `lay_out`."""
    return made_once("laid-out", partial(lay_out, bench))


@pytest.fixture
def work_folder(laid_out: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, small_presets: None) -> Path:
    """The current folder, with a copy of what is `laid_out`."""
    shutil.copytree(laid_out, tmp_path, dirs_exist_ok=True)
    monkeypatch.chdir(tmp_path)
    return tmp_path
