"""Small dataset folders as a person would make them."""

import csv
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest


def write_rows(path: Path, rows: list[dict[str, object]]) -> None:
    with path.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.DictWriter(stream, list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)


@pytest.fixture
def make_folder(tmp_path: Path) -> Callable[..., Path]:
    """A folder with ``sessions`` sessions of ``frames`` tiny images; ``change`` may edit the rows first."""

    def make(
        sessions: int = 3, frames: int = 8, change: Callable[[list[dict[str, object]]], None] | None = None
    ) -> Path:
        folder = tmp_path / "data"
        (folder / "images").mkdir(parents=True)
        rows: list[dict[str, object]] = []
        for session in range(sessions):
            for frame in range(frames):
                name = f"images/{session}_{frame}.png"
                image = np.full((12, 16), 10 * session + frame, np.uint8)
                (folder / name).write_bytes(cv2.imencode(".png", image)[1].tobytes())
                rows.append(
                    {
                        "file_name": name,
                        "session": f"s{session}",
                        "stamp_ns": 1_700_000_000_000_000_001 + frame * 500_000_000,
                        "knob_deg": 10.0 + session,
                        "fx_n": 0.1 * frame,
                        "fy_n": -0.01 * session,
                    }
                )
        if change is not None:
            change(rows)
        write_rows(folder / "metadata.csv", rows)
        return folder

    return make
