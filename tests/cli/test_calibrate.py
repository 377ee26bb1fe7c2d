"""``tipforce calibrate``: from recordings, a ruler or a board into bench.toml."""

import json
import math
from pathlib import Path

import cv2
import numpy as np
import pytest
from click.testing import Result
from typer.testing import CliRunner

from tipforce.cli import app
from tipforce.errors import FileFormatError, InputError
from tipforce.geometry import curve_from_angle
from tipforce.io import RecordingWriter
from tipforce.types import Actuation, ActuationInfo, BasePose, Catheter, Frame, SessionInfo, ViewInfo, read_bench

SCALE, GAIN, OFFSET = 3e-4, 0.6, 0.5
INFO = SessionInfo(
    "free",
    Catheter(diameter_m=2.7e-3, flexible_length_m=0.05, rigid_length_m=8e-3, bending_stiffness_nm2=4.3e-4),
    {"camera": ViewInfo(SCALE, "left", polarity="dark")},
    actuation=ActuationInfo(0.533),
)


def run(*words: object) -> Result:
    return CliRunner().invoke(app, ["calibrate", *map(str, words)], catch_exceptions=False)


def free_image(curvature_per_m: float) -> np.ndarray:
    """(240, 320) grey: the catheter without load, bent to an arc; its tip is straight."""
    flexible, rigid = 0.05 / SCALE, 8e-3 / SCALE
    turn = curvature_per_m * 0.05
    arc = curve_from_angle(np.array([0.5 * turn, 0.5 * turn]), flexible, 200)
    tip = arc[-1] + np.linspace(0.0, rigid, 20)[1:, None] * (math.cos(turn), math.sin(turn))
    axis = BasePose(np.array([0.0, 170.0]), 0.0).to_image(np.vstack([(-20.0, 0.0), arc, tip]))
    image = np.full((240, 320), 215, np.uint8)
    cv2.polylines(image, [np.round(axis * 16).astype(np.int32)], False, 45, 9, cv2.LINE_AA, 4)
    rough = cv2.GaussianBlur(image, (0, 0), 0.8) + np.random.default_rng(7).normal(0, 2, image.shape)
    return np.clip(np.rint(rough), 0, 255).astype(np.uint8)


@pytest.fixture(scope="module")
def contact_free(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """12 s at 4 Hz; the knob goes up and down."""
    path = tmp_path_factory.mktemp("free") / "free.mcap"
    with RecordingWriter(path, INFO, lossless=True) as writer:
        for k in range(48):
            knob = 12.0 + 8.0 * math.sin(2 * math.pi * k / 24)
            writer.write(Actuation(k * 250_000_000, {"knob_deg": knob}))
            writer.write(Frame(k * 250_000_000, free_image(OFFSET + GAIN * knob)))
    return path


def test_contact_free_frames_give_the_knob_and_name_what_stays_unknown(contact_free: Path, tmp_path: Path) -> None:
    bench = tmp_path / "bench.toml"
    bench.write_text("# mine\n[actuation]\nknob_gain_per_m_deg = 0.533  # data sheet\n")
    result = run(
        contact_free, "--contact-free", "--bench", bench, "-o", bench, "--overwrite",
        "--plot", tmp_path / "plot.png", "--json", tmp_path / "found.json",
    )  # fmt: skip
    assert result.exit_code == 0
    assert result.stderr.splitlines()[0].startswith("quantity"), "the answer comes first"
    said = " ".join(result.stderr.split())
    assert "was not checked" in said
    found = read_bench(bench).actuation
    assert found.knob_gain_per_m_deg == pytest.approx(GAIN, rel=0.05)
    assert found.knob_offset_per_m == pytest.approx(OFFSET, abs=0.4)
    text = bench.read_text()
    assert text.startswith("# mine\n[actuation]\n# before: knob_gain_per_m_deg = 0.533  # data sheet\n")
    assert "tipforce calibrate" in text
    assert cv2.imread(str(tmp_path / "plot.png")) is not None
    figures = json.loads((tmp_path / "found.json").read_text())
    assert {each["name"] for each in figures["quantities"]} >= {
        "knob gain",
        "knob offset",
        "rest curvature, mean",
        "scale, by the shaft",
    }


def test_a_ruler_writes_the_scale_and_keeps_the_file(tmp_path: Path) -> None:
    bench = tmp_path / "bench.toml"
    bench.write_text('[views.camera]\nbase_side = "left"  # as mounted\n')
    with pytest.raises(InputError, match="exists already"):
        run("--ruler", "100,240,500,240,80", "-o", bench)
    assert run("--ruler", "100,240,500,240,80", "-o", bench, "--overwrite").exit_code == 0
    found = read_bench(bench).view("camera")
    assert found == ViewInfo(2e-4, "left", metres_per_px_uncertainty=found.metres_per_px_uncertainty)
    assert found.metres_per_px_uncertainty == pytest.approx(math.sqrt(2.0) / 400.0, rel=0.01), "a pixel at each end"
    assert "# as mounted" in bench.read_text()


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ([], "recordings, board and ruler are all missing"),
        (["--ruler", "1,2,3"], "U0,V0,U1,V1,MM"),
        (["--ruler", "1,2,3,x,5"], "U0,V0,U1,V1,MM"),
        (["--board", "nowhere.png"], "state its squares, as in --squares 7x5,8"),
        (["--board", "nowhere.png", "--squares", "many,8"], "expected squares across and down"),
        (["video.mp4"], "is no recording"),
    ],
)
def test_what_cannot_be_calibrated_from_is_refused_in_one_sentence(words: list[str], said: str) -> None:
    with pytest.raises((InputError, FileFormatError)) as caught:
        run(*words)
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_folder_without_recordings_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"holds no recording \(\.mcap\)"):
        run(tmp_path)
