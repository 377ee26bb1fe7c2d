"""What limits the force once the values of a calibration are stated."""

import numpy as np

from tipforce.calibration import CalibrationSession
from tipforce.pipelines import CalibrateReport, describe_calibration
from tipforce.pipelines._limits import limits_calibrated
from tipforce.types import ActuationInfo, Catheter, SessionInfo


def test_a_calibration_ends_with_the_unknown_that_still_limits_the_force(session: CalibrationSession) -> None:
    some = session.subset(np.arange(0, 150, 3))
    rough = SessionInfo(catheter=Catheter(bending_stiffness_nm2=4.6e-4, bending_stiffness_uncertainty=0.2))
    fine = SessionInfo(
        catheter=Catheter(bending_stiffness_nm2=4.6e-4, bending_stiffness_uncertainty=0.02),
        actuation=ActuationInfo(0.55, knob_offset_per_m=0.4, knob_play_deg=1.6),
    )
    before, after = (limits_calibrated([some], info) for info in (rough, fine))
    assert before.measurable[0].name == "stiffness"
    assert after.std_n < 0.9 * before.std_n
    report = CalibrateReport((), (), rough, None, None, {}, (), before)
    last = describe_calibration(report)[-1]
    assert last.startswith("with these values the force is limited by ")
    assert "measure catheter.bending_stiffness_nm2 with `tipforce calibrate`" in last
    assert report.figures()["limits"]["measurable"][0]["name"] == "stiffness"
