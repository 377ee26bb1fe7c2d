"""A session is known by what is in it, not by its name or by what it is stored in."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from tipforce.datasets import PERTURBATIONS, Dataset, open_dataset, perturbed, write_dataset
from tipforce.io import RecordingWriter
from tipforce.types import Frame, SensorInfo, SessionInfo, Wrench


def recorded(path: Path, name: str, scale: float) -> Path:
    """A second of frames and forces."""
    with RecordingWriter(path, SessionInfo(name)) as writer:
        writer.state(SensorInfo(0.0, "tissue-on-tip"))
        for k in range(0, 1000, 10):
            stamp = k * 1_000_000
            force = np.array([scale * np.sin(k), 0.1 * scale, np.nan])
            writer.write(Wrench(stamp, force, np.full(3, np.nan), "sensor"))
            if k % 40 == 0:
                writer.write(Frame(stamp, np.full((48, 64), 50 + k // 40, np.uint8)))
    return path


@pytest.fixture
def session(tmp_path: Path) -> Path:
    return recorded(tmp_path / "monday.mcap", "monday", 0.1)


def fingerprints(path: Path) -> list[str]:
    return list(open_dataset(path).session_fingerprints.values())


def test_a_recording_keeps_its_fingerprint_as_a_folder_under_any_name(session: Path, tmp_path: Path) -> None:
    folder = write_dataset(open_dataset(session), tmp_path / "folder")
    assert fingerprints(folder) == fingerprints(session)
    table = folder / "metadata.csv"
    table.write_text(table.read_text().replace("monday", "tuesday"))
    facts = json.loads((folder / "dataset.json").read_text())
    (folder / "dataset.json").write_text(json.dumps({**facts, "sessions": {}}))
    assert open_dataset(folder).sessions == ("tuesday",)
    assert fingerprints(folder) == fingerprints(session)
    shutil.copy(session, tmp_path / "renamed.mcap")
    assert fingerprints(tmp_path / "renamed.mcap") == fingerprints(session)


def test_another_recording_of_the_same_name_is_another_session(session: Path, tmp_path: Path) -> None:
    other = open_dataset(recorded(tmp_path / "other.mcap", "monday", 0.2))
    known = set(open_dataset(session).session_fingerprints.values())
    assert other.sessions == ("monday",)
    assert other.sessions_among(known) == ()
    assert open_dataset(session).sessions_among(known) == ("monday",)
    assert other.sessions_among({"monday"}) == ("monday",), "models made before fingerprints were kept have names only"


def test_a_part_of_a_session_is_still_that_session(session: Path) -> None:
    data = open_dataset(session)
    part: Dataset = data.subset(np.array([3, 5]))
    assert part.session_fingerprints == data.session_fingerprints
    turned = perturbed(part, next(each for each in PERTURBATIONS if each.force_turn_deg))
    assert turned.session_fingerprints == data.session_fingerprints
