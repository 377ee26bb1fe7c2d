"""What sessions tell of a bench: recovered within what is stated, and what they do not tell is said."""

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tipforce.calibration import CalibrationSession, calibrate_sessions, combined, fit_knob, fit_tissue, read_session
from tipforce.calibration._session import _past as mean_of_past_forces
from tipforce.errors import InputError
from tipforce.io import Inertia, RecordingWriter
from tipforce.mechanics import Play
from tipforce.types import Actuation, Frame, SessionInfo, ViewInfo

from .conftest import GAIN, OFFSET, PLAY, STIFFNESS, TISSUE

Make = Callable[..., CalibrationSession]


def test_a_session_with_forces_tells_stiffness_knob_tissue_and_mass(session: CalibrationSession) -> None:
    found = calibrate_sessions([session])
    true = {
        "bending stiffness": STIFFNESS,
        "knob gain": GAIN,
        "knob offset": OFFSET,
        "knob hysteresis": PLAY,
        "tissue stiffness": TISSUE,
        "moving mass": 0.05,
        "sensor angle": 45.0,
    }
    for name, value in true.items():
        each = found.quantity(name)
        assert abs(each.value - value) < 3.0 * each.std, (name, each.value, each.std)
    stiffness = found.quantity("bending stiffness")
    assert stiffness.std < 0.04 * STIFFNESS
    assert stiffness.written
    assert stiffness.before == 4.3e-4
    assert found.quantity("knob gain").std < 0.02
    assert not found.quantity("sensor angle").written, "what a person read off is as good"
    assert np.nanmedian(np.abs(found.sessions[0].errors_n[:, 1])) < 0.02


def test_a_wrong_sensor_angle_is_found_and_said(made: Make) -> None:
    each = calibrate_sessions([made(turned_deg=90.0, moving_knob=False)]).quantity("sensor angle")
    assert abs(each.value - 135.0) < 5.0
    assert each.written
    assert "the stated angle does not fit: turned by +9" in each.doubt


def test_without_contact_the_knob_is_told_and_the_rest_is_named_as_unknown(made: Make) -> None:
    session = made(contact=False)
    free = replace(session, force_n=np.zeros_like(session.force_n), inertia=Inertia(), mass_std_kg=np.zeros(0))
    found = calibrate_sessions([free])
    assert abs(found.quantity("knob gain").value - GAIN) < 0.02
    assert abs(found.quantity("knob hysteresis").value - PLAY) < 0.5
    assert not {"bending stiffness", "tissue stiffness", "sensor angle"} & {each.name for each in found.quantities}
    assert "the stated stiffness of 0.00043 N m^2 was not checked" in found.remarks[0]
    assert "an error of 5 % is 5 % of every force" in found.remarks[0]


def test_a_knob_that_stands_still_tells_the_curvature_there_and_no_more() -> None:
    stamps = np.arange(60) * 500_000_000
    found = fit_knob((stamps, np.full(60, 10.0)), stamps, np.full(60, 5.4), np.full(60, 0.05))
    assert np.isnan([found.gain_per_m_deg, found.play_deg]).all()
    assert found.curvature_per_m == pytest.approx(5.4)
    with pytest.raises(InputError, match="8 are needed for the knob"):
        fit_knob((stamps, np.full(60, 10.0)), stamps[:3], np.full(3, 5.4), np.full(3, 0.05))
    with pytest.raises(InputError, match=r"state actuation\.constant\.knob_deg"):
        fit_knob((stamps, np.full(60, np.nan)), stamps, np.full(60, 5.4), np.full(60, 0.05))


def test_a_knob_that_only_goes_up_tells_no_hysteresis() -> None:
    stamps, knob = np.arange(60) * 500_000_000, np.linspace(0.0, 30.0, 60)
    curvature = 0.5 * Play(2.0).run(knob)
    found = fit_knob((stamps, knob), stamps, curvature, np.full(60, 0.05))
    assert np.isnan(found.play_deg)
    assert found.gain_per_m_deg == pytest.approx(0.5, rel=0.03)
    shared = fit_knob((stamps, knob), stamps, curvature, np.full(60, 0.05), common_std_per_m=0.4)
    assert shared.curvature_std == pytest.approx(math.hypot(found.curvature_std, 0.4))


def test_tissue_that_is_not_told_is_refused_with_the_reason(session: CalibrationSession) -> None:
    with pytest.raises(InputError, match="no log of the stage"):
        fit_tissue(replace(session, stage_names=()))
    with pytest.raises(InputError, match="do not show in which direction the stage moves"):
        fit_tissue(replace(session, stage_to_base=np.full((2, 2), np.nan)))
    with pytest.raises(InputError, match="too little contact"):
        fit_tissue(replace(session, force_n=0.1 * session.force_n))


def test_a_tissue_that_stiffens_shows_in_the_exponent(session: CalibrationSession) -> None:
    normal = session.stage_to_base[:, 0]
    depth = np.maximum(session.force_n @ normal, 0.0) / TISSUE
    force = 0.1 * (depth / 1e-3) ** 1.5
    found = fit_tissue(replace(session, force_n=force[:, None] * normal))
    assert found.exponent == pytest.approx(1.5, abs=0.15)


def test_values_that_share_a_prior_hold_it_once_and_disagreement_widens() -> None:
    mean, std = combined([0.5, 0.5], [0.1, 0.1], prior_std=0.2)
    assert mean > 0.5
    assert std < 0.1
    assert combined([0.0, 1.0], [0.1, 0.1])[1] > 0.3


def test_a_recording_in_which_the_clamp_is_advanced_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    with RecordingWriter(path, SessionInfo(views={"camera": ViewInfo(0.2e-3)})) as writer:
        for k in range(3):
            writer.write(Actuation(k, {"advance_mm": float(k)}))
            writer.write(Frame(k, np.zeros((8, 8), np.uint8)))
    with pytest.raises(InputError, match="the clamp is advanced in this recording"):
        read_session(path)


def test_a_gap_in_the_force_is_no_time_without_contact() -> None:
    stamps, force = np.arange(0, 60_000_000_000, 40_000_000), np.full((1500, 2), 0.2)
    whole = mean_of_past_forces(stamps, force)
    force[700:1000] = np.nan  # 12 s in which the sensor was clipped
    np.testing.assert_allclose(mean_of_past_forces(stamps, force), whole)
    assert not mean_of_past_forces(stamps, np.full_like(force, np.nan)).any()
