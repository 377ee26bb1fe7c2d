"""The loop closed on the simulated bench: states, files, and the same bytes for the same seed."""

import csv
import json
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from tipforce.control import ControlSettings
from tipforce.errors import InputError
from tipforce.pipelines import ControlSession, bench_of_regime, control, live_bench, verdict
from tipforce.pipelines._control import _EstimatorFeedback
from tipforce.simulation import PRESETS
from tipforce.types import ForceEstimate, Frame, Observation, SessionInfo, Status

FILES = ("control.csv", "control.json", "control.svg", "recording.mcap", "report.html")
# PI holds without learning: eight seconds suffice.
SETTINGS = ControlSettings(controller="pi", approach_mm_per_s=6.0, ramp_n_per_s=0.5)


@pytest.fixture(scope="module")
def simulation():
    settings = bench_of_regime(PRESETS["bench-2021"], "oblique", 30.0)
    world = settings.world.model_copy(update={"seconds": 8.0, "tare_s": 1.2})
    return live_bench("truth", settings.model_copy(update={"world": world}), seed=1)


def run(simulation, folder: Path) -> dict:
    session = ControlSession("truth", simulation, SETTINGS, "both", seconds=2.0)
    return control(session, folder, 2.0, title="a <short> run", command="tipforce control truth -o run/")


def test_a_run_is_reproducible_to_the_byte_and_says_what_happened(simulation, tmp_path: Path) -> None:
    first, again = run(simulation, tmp_path / "first"), run(simulation, tmp_path / "again")
    assert first == again
    for name in FILES:
        assert (tmp_path / "first" / name).read_bytes() == (tmp_path / "again" / name).read_bytes(), name
    figures = json.loads((tmp_path / "first" / "control.json").read_text())
    assert figures == first
    assert 0.0 < figures["rms_n"] < 0.2
    assert figures["peak_whole_run_n"] >= figures["peak_n"] > 0.1
    rows = list(csv.DictReader((tmp_path / "first" / "control.csv").read_text().splitlines()))
    states = list(dict.fromkeys(row["state"] for row in rows))
    assert states == ["retract", "approach", "contact", "hold"]
    time, sent = (np.array([float(row[name]) for row in rows]) for name in ("time_s", "sent_mm"))
    assert np.all(np.abs(np.diff(sent)) <= 30.0 * (np.diff(time) + 1e-4) + 1e-3)  # as the table rounds
    page = (tmp_path / "first" / "report.html").read_text()
    assert "mN RMS of the true force" in page
    assert "a &lt;short&gt; run" in page
    assert "http" not in page.replace("http://www.w3.org", "").replace("http://purl.org", "").replace(
        "http://creativecommons.org", ""
    )


def test_a_folder_with_files_is_left_alone(simulation, tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("mine")
    with pytest.raises(InputError, match="is not empty"):
        run(simulation, tmp_path)


def test_a_run_whose_recording_cannot_be_labelled_keeps_its_figures(
    simulation, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def without_tare(writer, events, *_: object) -> None:
        for event in events:
            writer.write(event)
        raise InputError("tare: the tip seems to be in contact")

    monkeypatch.setattr("tipforce.pipelines._control_report.write_run", without_tare)
    figures = run(simulation, tmp_path / "run")
    assert figures["rms_n"] < 0.2
    assert verdict(figures).endswith("The recording has no labels: tare: the tip seems to be in contact.")
    assert all((tmp_path / "run" / name).exists() for name in FILES)


def test_under_xray_the_wall_is_where_the_knob_presses_and_the_rate_is_that_of_the_fluoroscope() -> None:
    made = bench_of_regime(PRESETS["biplane"], "lateral", 30.0)
    assert PRESETS["biplane"].world.wall.either_side
    assert not made.world.wall.either_side
    assert made.world.clock.fps == PRESETS["biplane"].world.clock.fps


def test_the_benchmark_states_the_motion_and_leaves_the_rest() -> None:
    preset = PRESETS["bench-2021"]
    made = bench_of_regime(preset, "lateral", 30.0)
    motion, world = made.world.motion, made.world
    assert (motion.amplitude_m, motion.beat_hz, motion.respiration_m) == ((4e-3, 4e-3), (1.2, 1.2), (2e-3, 2e-3))
    assert (world.clamp.max_speed_m_per_s, world.clamp.delay_s, world.clamp.lag_s) == (0.03, 0.02, 0.01)
    assert (world.clock.fps, world.clock.camera_delay_s) == (30.0, 0.04)
    assert world.wall.contact_angle_deg == (60.0, 75.0)
    assert world.shaft == preset.world.shaft
    assert world.wall.friction == preset.world.wall.friction
    assert motion.lateral_share == preset.world.motion.lateral_share
    assert made.preset != preset.preset


class TwoViews:
    """A bench whose images of two views come 1 ms after one another."""

    session_info = SessionInfo("two views")
    views = ("a", "b")


class Notes:
    """A method that keeps its observations; its frame rate is that of its first view."""

    required_actuation = required_metadata = ()
    needs_all_views = True

    def __init__(self, *views: str) -> None:
        self.views, self.seen = views, []

    def for_views(self, there: tuple[str, ...]) -> "Notes":
        return self

    def obstacle(self, info: SessionInfo) -> str:
        return ""

    def start(self, info: SessionInfo) -> "Notes":
        return self

    def update(self, observation: Observation) -> ForceEstimate:
        self.seen.append(observation)
        return ForceEstimate.invalid(observation.stamp_ns, Status.STALE, "")


@pytest.mark.parametrize(("views", "seen"), [(("b",), {"b"}), (("a",), {"a"}), (("a", "b"), {"a", "b"})])
def test_the_loop_gets_an_estimate_for_each_image_of_the_view_that_is_read(views, seen):
    method = Notes(*views)
    feedback = _EstimatorFeedback(SimpleNamespace(source=TwoViews()), 0, method)
    image = np.zeros((8, 8), np.uint8)
    for number in range(3):
        for place, view in enumerate(("a", "b")):
            stamp_ns = number * 66_000_000 + place * 1_000_000
            feedback.add(Frame(stamp_ns, image, view), stamp_ns)
    assert [set(each.views) for each in method.seen] == [seen] * 3
    assert len(list(feedback.due(10**10))) == 3
