"""Any source of events becomes a recording; what rides on a moving stage is taken out of the force."""

from dataclasses import replace

import numpy as np
import pytest

from tipforce.alignment import ForceCorrections, StageMotion, _find_clock, labels, observations
from tipforce.errors import FileFormatError, InputError, TimeError
from tipforce.io import ClockMap, Inertia, RecordingReader, Tare
from tipforce.pipelines import describe_recording, import_session, record
from tipforce.types import STAGE, Actuation, DetectedShape, Frame, SensorInfo, SessionInfo, Status, ViewInfo, Wrench

from ..short_run import draw_image, push  # type: ignore[import-not-found]

OFFSET_S, LAG_S, MASS_KG = 0.03, 0.006, 0.05
BIAS = np.array([0.2, -0.1, 0.05])
FORCE = np.array([0.05, -0.2, 0.0])


def place_m(t):
    """Two axes of the stage."""
    return np.stack([6e-3 * np.sin(2 * np.pi * 1.3 * t), 4e-3 * np.sin(2 * np.pi * 1.3 * t + 1.0)], axis=-1)


def acceleration(t):
    return -((2 * np.pi * 1.3) ** 2) * place_m(t)


class Bench:
    """A source with its own inertia: the sensor's axes lie along the stage's, but for three degrees."""

    def __init__(self, *, mass_kg=MASS_KG, force=True, seconds=9.0):
        self.mass_kg, self.force, self.seconds = mass_kg, force, seconds
        self.session_info = SessionInfo("bench", views={"camera": ViewInfo(2e-4)})

    def __enter__(self):
        return self

    def __exit__(self, *what):
        pass

    def __iter__(self):
        rng = np.random.default_rng(1)
        turn = np.radians(3.0)
        axes = np.array([[np.cos(turn), np.sin(turn), 0.0], [-np.sin(turn), np.cos(turn), 0.0]])
        ticks = np.arange(0, self.seconds, 1e-3)
        carried = self.mass_kg * acceleration(ticks - LAG_S) @ axes
        # the stamp of the force log lies OFFSET_S before the camera's
        readings = np.outer(push(ticks), FORCE) + BIAS - carried + rng.normal(0, 3e-3, (len(ticks), 3))
        for k, t in enumerate(ticks.tolist()):
            stamp = round(t * 1e9)
            if self.force and t >= OFFSET_S:
                yield Wrench(stamp - round(OFFSET_S * 1e9), readings[k], np.full(3, np.nan), "sensor")
            if k % 10 == 0:
                normal, across = place_m(t).tolist()
                yield Actuation(stamp, {"stage_normal_mm": 1e3 * normal, "stage_across_mm": 1e3 * across}, STAGE)
            if k % 40 == 0:
                yield Actuation(stamp, {"knob_deg": 10.0})
                yield Frame(stamp, draw_image(float(push(np.array(t)))))


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    path = tmp_path_factory.mktemp("record") / "bench.mcap"
    counts = []
    report = record(
        Bench(), path, sensor=SensorInfo(0.0, "tissue-on-tip"), tare=(0.0, 1.8), offset_ms=OFFSET_S * 1e3,
        progress=counts.append,
    )  # fmt: skip
    return path, report, counts


def test_inertia_lag_and_tare_are_found_in_the_contact_free_stretch(made):
    path, report, counts = made
    info = report.summary.info
    assert info.inertia.how == "estimated"
    assert info.inertia.axes == ("stage_normal_mm", "stage_across_mm")
    np.testing.assert_allclose(np.linalg.norm(info.inertia.gain_kg, axis=1), MASS_KG, rtol=0.05)
    # stage stamp = force stamp + lag: the force's clock is behind by the offset, and the stage moves later than stated
    assert info.inertia.lag_ns * 1e-9 == pytest.approx(OFFSET_S - LAG_S, abs=1.5e-3)
    np.testing.assert_allclose(info.tare.force_n, BIAS, atol=2e-3)
    assert counts == list(range(1, 226))
    with RecordingReader(path) as reader:
        assert reader.info.inertia.gain_kg == pytest.approx(info.inertia.gain_kg)


def test_labels_are_free_of_what_the_sensor_carries(made):
    path, _, _ = made
    with RecordingReader(path) as reader:
        found = labels(reader)
        seconds = found.stamp_ns * 1e-9
        inside = np.isfinite(found.force_n).all(axis=1)
        miss = found.force_n[inside] - np.outer(push(seconds[inside]), FORCE)
    assert inside.sum() > 200
    assert np.sqrt((miss**2).mean()) < 4e-3  # the noise; untreated inertia would be 14 mN


def test_estimators_do_not_see_the_stage(made):
    path, _, _ = made
    with RecordingReader(path) as reader:
        assert set(reader.actuation_at(reader.stamps())) == {"knob_deg"}
        assert {frozenset(seen.actuation) for seen in observations(reader)} == {frozenset({"knob_deg"})}


def test_a_sensor_that_carries_nothing_has_no_inertia(tmp_path):
    report = record(Bench(mass_kg=0.0), tmp_path / "run.mcap", tare=(0.0, 1.8), offset_ms="none")
    assert report.summary.info.inertia.how == "none"
    assert "do not show the stage's movement" in " ".join(report.remarks)
    np.testing.assert_allclose(report.summary.info.tare.force_n, BIAS, atol=1e-3)


def test_a_light_load_that_the_noise_nearly_hides_is_found(tmp_path):
    """5 g show as 2 mN in noise of 3 mN."""
    report = record(Bench(mass_kg=5e-3), tmp_path / "run.mcap", tare=(0.0, 1.8), offset_ms="none")
    assert report.summary.info.inertia.how == "estimated"
    np.testing.assert_allclose(np.linalg.norm(report.summary.info.inertia.gain_kg, axis=1), 5e-3, rtol=0.2)


def test_the_offset_is_found_from_the_deflection_once_the_inertia_is_out(tmp_path):
    report = record(
        Bench(seconds=20.0), tmp_path / "run.mcap", sensor=SensorInfo(0.0, "tissue-on-tip"), tare=(0.0, 1.8)
    )
    found = report.summary.info.clock_map
    assert found.how == "estimated", found.detail
    assert found.offset_ms == pytest.approx(OFFSET_S * 1e3, abs=4.0)


def test_bad_wishes_are_refused_in_a_sentence(tmp_path):
    with pytest.raises(InputError, match=r"a recording ends in \.mcap; name it run\.mcap"):
        record(Bench(), tmp_path / "run.bag")
    with pytest.raises(InputError, match=r"tare=\(20, 30\): has 0\.00 s of readings"):
        record(Bench(), tmp_path / "late.mcap", tare=(20.0, 30.0), offset_ms="none")
    record(Bench(force=False, seconds=1.0), tmp_path / "blind.mcap")
    with pytest.raises(FileFormatError, match=r"blind\.mcap"):
        record(Bench(), tmp_path / "blind.mcap")


def test_force_and_images_of_different_times_are_refused(tmp_path):
    class Late(Bench):
        def __iter__(self):
            for event in super().__iter__():
                yield (
                    Wrench(event.stamp_ns + 10**12, event.force_n, event.torque_nm)
                    if isinstance(event, Wrench)
                    else event
                )

    with pytest.raises(TimeError, match="do not overlap"):
        record(Late(), tmp_path / "run.mcap", offset_ms="none")


def test_a_stage_log_beside_the_force_log_serves_an_import_too(run, tmp_path):
    ticks = np.arange(0, 8.0, 0.01)
    rows = [f"{t:.3f},{1e3 * x:.6f},{1e3 * y:.6f}" for t, (x, y) in zip(ticks, place_m(ticks), strict=True)]
    (tmp_path / "stage.csv").write_text("time_s,stage_normal_mm,stage_across_mm\n" + "\n".join(rows) + "\n")
    log = np.loadtxt(run.force, delimiter=",", skiprows=1)
    log[:, 1:] -= MASS_KG * acceleration(log[:, 0] + OFFSET_S)
    lines = [f"{t:.3f},{x:.5f},{y:.5f}" for t, x, y in log.tolist()]
    (tmp_path / "force.csv").write_text("time_s,fx_n,fy_n\n" + "\n".join(lines) + "\n")
    done = import_session(
        run.video, [tmp_path / "force.csv", tmp_path / "stage.csv"], tmp_path / "run.mcap", tare=(0.0, 1.8)
    )
    inertia = done.summary.info.inertia
    assert inertia.gain_kg[:, 2].tolist() == [0.0, 0.0]  # the sensor has no such axis
    np.testing.assert_allclose(inertia.gain_kg[:, :2], -MASS_KG * np.eye(2), atol=2e-3)
    assert inertia.lag_ns * 1e-9 == pytest.approx(OFFSET_S, abs=2e-3)
    assert any("taken out: 5" in line or "taken out: 4" in line for line in describe_recording(done.summary))


UNSURE = ClockMap(40_000_000, "refused", stderr_ms=8.0, detail="too little motion")


@pytest.mark.parametrize(
    ("seen", "carried", "shares", "how", "said"),
    [
        (ClockMap(40_000_000, "estimated", 2.0, rate_stderr=1e-5), "estimated", False, "estimated", ""),
        (ClockMap(40_000_000, "estimated", 2.0, rate_stderr=1e-5), "none", False, "estimated", ""),
        (ClockMap(265_000_000, "estimated", 1.5, rate_stderr=1e-5), "estimated", False, "estimated", "+265.0 ms"),
        (ClockMap(265_000_000, "estimated", 1.5, rate_stderr=1e-5), "estimated", True, "estimated", "+265.0 ms"),
        (
            ClockMap(40_000_000, "estimated", 1.5, rate=0.8, rate_stderr=1e-5),
            "estimated",
            True,
            "estimated",
            "rate of 0.8",
        ),
        (UNSURE, "estimated", False, "stage", "agrees with it"),
        (replace(UNSURE, offset_ns=90_000_000), "estimated", True, "refused", ""),
        (replace(UNSURE, rate=0.98, rate_stderr=1e-4), "estimated", True, "refused", ""),
        (UNSURE, "none", False, "refused", ""),
        (ClockMap(40_000_000, "refused", 8.0, rate=1.02), "estimated", False, "refused", ""),
        (ClockMap(how="refused", detail="no motion"), "estimated", False, "refused", ""),
        (ClockMap(how="refused", detail="no motion"), "estimated", True, "stage", "no motion"),
        # the force explains the deflection, but by no line
        (ClockMap(how="refused", explained=0.9, detail="a clock jumps"), "estimated", True, "refused", ""),
    ],
)
def test_the_stage_tells_the_offset_only_where_it_shares_the_cameras_clock(
    monkeypatch, seen, carried, shares, how, said
):
    monkeypatch.setattr(_find_clock, "_estimated", lambda *rest: (seen, rest[4].inertia))
    axes = ("stage_mm",) if carried == "estimated" else ()
    inertia = Inertia(axes, np.zeros((len(axes), 3)), 45_000_000, carried)
    facts = ForceCorrections(None, Tare(), inertia, StageMotion.of([]))
    stamps = np.arange(10, dtype=np.int64) * 1_000_000_000
    remarks: list[str] = []
    found, _ = _find_clock.find_clock(
        _find_clock.DetectedShapes(stamps, [DetectedShape(Status.NO_CATHETER)]), SessionInfo(), stamps,
        np.zeros((10, 3)),
        facts, _find_clock.ClockChoice(), remarks, stage_shares=shares,
    )  # fmt: skip
    assert found.how == how
    assert found.offset_ms == {"stage": 45.0, "refused": 0.0}.get(how, seen.offset_ms)
    assert said in " ".join(remarks)
    assert bool(said) == bool(remarks)


@pytest.mark.parametrize(
    ("stated", "stage_rate", "nominal", "how"),
    [
        (0.8, 0.8, False, "stage"),
        (0.8, 1.0, False, "refused"),
        (None, 0.8, False, "refused"),
        (None, 1.0, False, "stage"),
        (None, 1.0, True, "refused"),
        (1.0, 1.0, True, "stage"),
    ],
)
def test_the_stage_gives_the_offset_at_a_rate_that_is_certain_or_not_at_all(
    monkeypatch, stated, stage_rate, nominal, how
):
    seen = ClockMap(how="refused", detail="no motion")
    monkeypatch.setattr(_find_clock, "_estimated", lambda *rest: (seen, rest[4].inertia))
    facts = ForceCorrections(
        None,
        Tare(),
        Inertia(("stage_mm",), np.zeros((1, 3)), 45_000_000, "estimated", rate=stage_rate),
        StageMotion.of([]),
    )
    stamps = np.arange(10, dtype=np.int64) * 1_000_000_000
    found, _ = _find_clock.find_clock(
        _find_clock.DetectedShapes(stamps, [DetectedShape(Status.NO_CATHETER)]), SessionInfo(), stamps,
        np.zeros((10, 3)),
        facts, _find_clock.ClockChoice("auto", stated), [], stage_shares=True, nominal_rate=nominal,
    )  # fmt: skip
    assert found.how == how
    assert ("state rate=1" in found.detail) == (nominal and stated is None)
    assert found.rate == (stated or 1.0 if how == "stage" else 1.0)
