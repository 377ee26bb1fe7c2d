"""The advice where no catheter is found: objects with numbers, and a fact that makes the detection find one."""

import re
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from typer.testing import CliRunner

from tipforce.cli import app
from tipforce.pipelines._run import RunDetector
from tipforce.types import Catheter, Frame, Image, SessionInfo, ViewInfo, read_bench
from tipforce.vision import SessionDetector, VisionSettings, _session_calibration, advise, draw_objects

from .drawn_tubes import SIZE, draw_tubes  # type: ignore[import-not-found]

WIDTH, HEIGHT = SIZE
DIAMETER, LENGTH = 10.0, 180.0
CATHETER = Catheter("drawn", 0.01, 0.16, 0.02)
SESSION = SessionInfo("monday", CATHETER, {"camera": ViewInfo(1e-3, "left")})
MOUTHS = (70.0, 170.0)


def _shaft(v: float, turn: float) -> list[tuple[np.ndarray, float, float]]:
    """A shaft that comes out of a sheath at (60, ``v``), and the sheath."""
    s = np.linspace(0.0, LENGTH, 200)
    angle = turn * (s / LENGTH) ** 2
    steps = np.column_stack([np.cos(angle), np.sin(angle)]) * (s[1] - s[0])
    line = np.array([60.0, v]) + np.vstack([np.zeros(2), np.cumsum(steps[:-1], axis=0)])
    sheath = np.column_stack([np.linspace(-20.0, 60.0, 50), np.full(50, v)])
    return [(line, DIAMETER, 60.0), (sheath, 1.9 * DIAMETER, 90.0)]


@pytest.fixture(scope="module")
def two_shafts() -> list[Image]:
    turns = np.linspace(-0.25, 0.25, 5)
    return [draw_tubes(k, *[tube for v in MOUTHS for tube in _shaft(v, turn)]) for k, turn in enumerate(turns)]


@pytest.fixture(scope="module")
def refusing(two_shafts: list[Image]) -> SessionDetector:
    """The detector of a session in which two objects could be the catheter."""
    return SessionDetector(VisionSettings(), SESSION, two_shafts)


def _followed(advice: str, folder: Path, number: int) -> SessionInfo:
    """The metadata with the lines that ``advice`` names for one object, as bench.toml holds them."""
    (own,) = re.findall(rf"object {number}, .*? state (.*?)(?:;|$)", advice)
    lines = re.findall(r"(?:views|catheter)\.[\w.]+ = (?:\[[^\]]*\]|\"\w+\"|[\d.e-]+)", own)
    assert lines, own
    path = folder / "bench.toml"
    path.write_text("\n".join(lines), encoding="utf-8")
    return SESSION.updated(replace(read_bench(path), name=SESSION.name))


def test_of_two_shafts_each_is_found_by_the_line_of_bench_toml_that_the_advice_names(
    two_shafts: list[Image], refusing: SessionDetector, tmp_path: Path
) -> None:
    refused = refusing.detect(two_shafts[0])
    assert not refused.found
    assert "two objects could be the catheter" in refused.detail
    assert refusing.advice is not None
    begins = []
    for number in (1, 2):
        detector = SessionDetector(VisionSettings(), _followed(refused.detail, tmp_path, number), two_shafts)
        found = [detector.detect(image) for image in two_shafts[:2]]
        assert all(shape.found for shape in found)
        begins.append(found[0].base.origin_px)
        assert np.linalg.norm(found[0].base.origin_px - refusing.advice.candidates[number - 1].points[0]) < DIAMETER
    assert sorted(round(float(v) / 100.0) for _, v in begins) == [1, 2]


def test_a_wrong_scale_is_named_with_the_scale_that_finds_the_catheter(tmp_path: Path) -> None:
    images = [draw_tubes(k, *_shaft(120.0, turn)) for k, turn in enumerate(np.linspace(-0.5, 0.5, 4))]
    info = replace(SESSION, views={"camera": ViewInfo(2e-3, "left")})
    refused = SessionDetector(VisionSettings(), info, images).detect(images[0])
    assert not refused.found
    assert "views.camera.metres_per_px = 0.00" in refused.detail
    followed = _followed(refused.detail, tmp_path, 1)
    assert followed.view("camera").metres_per_px == pytest.approx(1e-3, rel=0.05)
    assert SessionDetector(VisionSettings(), followed, images).detect(images[0]).found


def test_where_no_fact_helps_the_advice_is_to_annotate() -> None:
    rng = np.random.default_rng(0)
    images = [rng.integers(0, 255, (HEIGHT, WIDTH), dtype=np.uint8)]
    advice = advise(VisionSettings(), images, SESSION)
    assert not advice.facts
    assert "`tipforce annotate frames/ --bench bench.toml --frames 8`" in advice.text("frames/")


def test_the_objects_are_drawn_with_their_numbers_and_no_bar_hides_them(refusing: SessionDetector) -> None:
    advice = refusing.advice
    assert advice is not None
    assert len(advice.candidates) >= 2
    drawing = draw_objects(advice.image, advice.candidates, "NOT FOUND", advice.text())
    zoom = drawing.shape[1] // WIDTH
    assert drawing.shape[0] > zoom * HEIGHT
    shown = cv2.resize(advice.image, None, fx=zoom, fy=zoom, interpolation=cv2.INTER_NEAREST)
    top = min(
        range(drawing.shape[0] - len(shown) + 1),
        key=lambda row: np.abs(drawing[row : row + len(shown) : 8, ::8].mean(axis=2) - shown[::8, ::8]).mean(),
    )
    assert np.median(np.abs(drawing[top : top + len(shown)].mean(axis=2) - shown)) < 1.0
    assert drawing[top : top + len(shown)].std(axis=2).max() > 60


@pytest.mark.slow
def test_inspect_shows_the_objects_and_its_advice_can_be_followed(two_shafts: list[Image], tmp_path: Path) -> None:
    folder, bench = tmp_path / "frames", tmp_path / "bench.toml"
    folder.mkdir()
    for k, image in enumerate(two_shafts):
        cv2.imwrite(str(folder / f"{k}.png"), image)
    bench.write_text(
        "[catheter]\ndiameter_m = 0.01\nflexible_length_m = 0.16\nrigid_length_m = 0.02\n"
        '[views.camera]\nmetres_per_px = 1e-3\nbase_side = "left"\n'
    )

    def inspect(*more: str) -> str:
        words = ["inspect", str(folder), "--bench", str(bench), "-o", str(tmp_path / "d.png"), "--overwrite", *more]
        result = CliRunner().invoke(app, words, catch_exceptions=False)
        assert result.exit_code == 0, result.output
        return result.stderr

    said = inspect()
    assert "found in 0 of 5 frames" in said
    assert "object 2   begins at" in said
    (region,) = re.findall(r"object 2, .*? state (views\.camera\.base_region) = (\[[^\]]*\])", said.replace("\n", " "))[
        :1
    ]
    assert "found in 5 of 5 frames" in inspect("--fact", "=".join(region))


def test_a_session_whose_images_come_one_by_one_gets_the_advice_once_they_are_resolved(
    two_shafts: list[Image], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(_session_calibration, "_FIRST", len(two_shafts))
    monkeypatch.setattr(_session_calibration, "_EVERY", 1)
    monkeypatch.setattr(_session_calibration, "RESOLVED_AFTER_IMAGES", 2)
    asked = []
    monkeypatch.setattr(_session_calibration, "advise", lambda *words: asked.append(1) or advise(*words))
    detector = SessionDetector(VisionSettings(), SESSION)
    details = [detector.detect(image).detail for image in (*two_shafts, *two_shafts[:3])]
    assert not any("views.camera.base_region = [" in detail for detail in details[: len(two_shafts) + 1])
    assert all("views.camera.base_region = [" in detail for detail in details[len(two_shafts) + 1 :])
    assert len(asked) == 1
    info = _followed(details[-1], tmp_path, 1)
    assert SessionDetector(VisionSettings(), info, two_shafts).detect(two_shafts[0]).found


def test_an_import_without_a_clock_map_says_which_fact_finds_the_catheter(two_shafts: list[Image]) -> None:
    detector = RunDetector(SESSION, VisionSettings())
    for k in range(5 * len(two_shafts)):
        detector.take(Frame(k * 40_000_000, two_shafts[k // 5]))
    detector.finish()
    assert "two objects could be the catheter" in detector.blind
    assert "views.camera.base_region = [" in detector.blind
