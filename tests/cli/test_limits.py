"""``tipforce inspect RECORDING --limits``: which unknown limits the force, and the advice, followed."""

import json
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest
from click.testing import Result
from tests.oracles.planar_rod import solve_static
from typer.testing import CliRunner

from tipforce.cli import app
from tipforce.datasets import Dataset
from tipforce.errors import InputError
from tipforce.estimators import no_progress
from tipforce.estimators.session import RodTrack
from tipforce.evaluation._constant import Constant
from tipforce.evaluation._methods import Method
from tipforce.io import RecordingWriter
from tipforce.mechanics import PlanarRod
from tipforce.pipelines._evaluate import _limit_notes
from tipforce.types import Actuation, ActuationInfo, Catheter, Frame, Observation, SessionInfo, ViewInfo

SCALE = 3e-4
INFO = SessionInfo(
    "pushed",
    Catheter(
        diameter_m=2.7e-3,
        flexible_length_m=0.05,
        rigid_length_m=8e-3,
        bending_stiffness_nm2=4.3e-4,
        bending_stiffness_uncertainty=0.2,
    ),
    {"camera": ViewInfo(SCALE, "left", polarity="dark")},
    actuation=ActuationInfo(0.533),
)


def run(*words: object) -> Result:
    return CliRunner().invoke(app, ["inspect", *map(str, words)], catch_exceptions=False)


def image(across_n: float) -> np.ndarray:
    """(240, 320) grey: the catheter, pushed by the tissue."""
    rod = PlanarRod(0.05, 4.3e-4, 8e-3, 0.533 * 12.0, stiffening_curvature_per_m=4.5e-4**-0.5, segments=80)
    axis = solve_static(rod, np.array([-0.5 * across_n, -across_n])).centreline_m(120)
    axis = np.vstack([(-0.01, 0.0), axis]) / SCALE * (1.0, -1.0) + (12.0, 150.0)
    ground = np.full((240, 320), 215, np.uint8)
    cv2.polylines(ground, [np.round(axis * 16).astype(np.int32)], False, 45, 9, cv2.LINE_AA, 4)
    rough = cv2.GaussianBlur(ground, (0, 0), 0.8) + np.random.default_rng(7).normal(0, 2, ground.shape)
    return np.clip(np.rint(rough), 0, 255).astype(np.uint8)


@pytest.fixture(scope="module")
def pushed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """8 s at 1 Hz without a force log: two seconds without contact, then pushed."""
    path = tmp_path_factory.mktemp("pushed") / "pushed.mcap"
    with RecordingWriter(path, INFO, lossless=True) as writer:
        for k in range(8):
            writer.write(Actuation(k * 1_000_000_000, {"knob_deg": 12.0}))
            writer.write(Frame(k * 1_000_000_000, image(0.0 if k < 2 else 0.12 + 0.02 * k)))
    return path


def test_the_unknown_that_limits_the_force_is_named_and_its_measurement_helps(pushed: Path, tmp_path: Path) -> None:
    found = run(pushed, "--limits", "--json", tmp_path / "before.json")
    assert found.exit_code == 0
    first, *table = found.stderr.splitlines()
    assert first.startswith("the force is limited by stiffness ")
    assert "measure catheter.bending_stiffness_nm2 with `tipforce calibrate`" in first
    assert any(line.startswith("stiffness ") for line in table)
    measured = ("--fact", "catheter.bending_stiffness_uncertainty=0.02")
    assert run(pushed, "--limits", *measured, "--json", tmp_path / "after.json").exit_code == 0
    before, after = (json.loads((tmp_path / f"{name}.json").read_text()) for name in ("before", "after"))
    assert before["measurable"][0]["name"] == "stiffness"
    assert after["std_n"] < 0.7 * before["std_n"]


class Images:
    """The images of `pushed` as samples."""

    def read(self, rows: np.ndarray) -> Iterator[Observation]:
        for row in rows.tolist():
            across_n = 0.0 if row < 2 else 0.12 + 0.02 * row
            yield Observation(row * 1_000_000_000, {"camera": image(across_n)}, {"knob_deg": 12.0})


def test_an_evaluation_of_the_session_model_states_what_limits_the_force() -> None:
    count = 8
    data = Dataset(
        store=Images(),
        session=np.full(count, "pushed"),
        stamp_ns=np.arange(count) * 1_000_000_000,
        actuation={"knob_deg": np.full(count, 12.0)},
        force_n=np.zeros((count, 3)),
        known=np.array([True, True, False]),
        names=np.arange(count).astype(str),
        session_info={"pushed": INFO},
        rows=np.arange(count),
    )
    methods = (Method("model", RodTrack()), Method("constant", Constant()))
    evaluated: Any = SimpleNamespace(everything=data, methods=methods)
    (note,) = _limit_notes(evaluated, no_progress)
    assert note.startswith("model is limited in pushed by stiffness ")


def test_limits_need_the_rod_and_go_with_no_drawing(pushed: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="--limits draws nothing"):
        run(pushed, "--limits", "-o", tmp_path / "drawing.png")
    cv2.imwrite(str(tmp_path / "frame.png"), image(0.1))
    with pytest.raises(InputError, match=r"catheter\.flexible_length_m"):
        run(tmp_path, "--limits")
