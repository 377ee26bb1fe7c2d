"""Tare, inertia and plausibility of a force log together: a step of the zero shows once the carried mass is out."""

from dataclasses import replace

import numpy as np

from ..errors import InputError
from ..io import Inertia, Tare
from ..plausibility import ForceFinding, ForcePlausibility, ZeroStep, check_force_log, find_drift, find_zero_steps
from ..types import BoolArray, FloatArray, IntArray
from ._find import TareChoice, find_tare_and_inertia
from ._inertia import StageMotion, carried_n


def find_plausible_force(
    stamps: IntArray,
    force: FloatArray,
    stage: StageMotion,
    choice: TareChoice,
    remarks: list[str],
    *,
    status: IntArray | None = None,
    range_n: tuple[float, float, float] | None = None,
    moving_mass_kg: float | None = None,
) -> tuple[ForcePlausibility, Tare, Inertia]:
    """Checks a force log, and finds its tare and inertia from the readings that may be used.

    Args:
        stamps: (n,) stamps of the readings, rising.
        force: (n, 3) readings, N, in the sensor's frame; NaN where a reading is missing.
        stage: movement of the stage that carries the sensor.
        choice: the tare as it is stated, or "auto".
        remarks: sentences for the user are added to it.
        status: (n,) status words of the sensor, 0 without an error.
        range_n: (3,) largest reading of each axis, N.
        moving_mass_kg: the stated mass that moves with the sensor, or None.

    Returns:
        Findings with the readings that are not used, tare, inertia.

    Raises:
        InputError: no reading may be used, or ``choice`` does not fit the log.
    """
    findings = check_force_log(stamps, force, status=status, range_n=range_n)
    if not findings.usable(stamps).any():
        raise InputError(f"the force log has no reading that may be used: {'; '.join(findings.lines())}")
    corrected = findings.corrected(stamps, force)
    tare_remarks: list[str] = []
    try:
        tare, inertia = find_tare_and_inertia(stamps, corrected, stage, choice, tare_remarks, moving_mass_kg)
    except InputError as error:
        raise InputError("; ".join([str(error), *findings.lines()])) from None
    steps = _zero_steps(stamps, corrected - carried_n(stage, inertia, stamps), tare)
    if steps:  # tare and inertia again, without the steps
        findings = _with_steps(findings, stamps, steps, tare)
        tare_remarks = []
        corrected = findings.corrected(stamps, force)
        tare, inertia = find_tare_and_inertia(stamps, corrected, stage, choice, tare_remarks, moving_mass_kg)
    remarks += tare_remarks
    return _with_drift(findings, stamps, force, stage, tare, inertia), tare, inertia


def _with_drift(
    findings: ForcePlausibility, stamps: IntArray, force: FloatArray, stage: StageMotion, tare: Tare, inertia: Inertia
) -> ForcePlausibility:
    """Adds to the findings the drift of the zero in the readings ``force`` (n, 3), N, where it is more than usual."""
    if not tare.stretches_s:
        return findings
    remainder = findings.corrected(stamps, force) - carried_n(stage, inertia, stamps) - tare.force_n
    axes = ~np.isnan(remainder).all(axis=0)
    rows = np.isfinite(remainder[:, axes]).all(axis=1)
    seconds = (stamps - stamps[0]) * 1e-9
    start_s, end_s = tare.stretches_s[0]
    drift = find_drift(seconds[rows], remainder[rows], start_s, end_s)
    if not drift.any():
        return findings
    per_minute = ", ".join(f"f{'xyz'[axis]} {60e3 * drift[axis]:+.0f}" for axis in range(3) if drift[axis])
    total = float(np.linalg.norm(drift) * (seconds[-1] - seconds[0]))
    detail = f"the contact-free level moves by {per_minute} mN a minute and is corrected by a straight line"
    return replace(
        findings,
        findings=(*findings.findings, ForceFinding("drift", 0.0, float(seconds[-1]), size_n=total, detail=detail)),
        drift_n_per_s=(float(drift[0]), float(drift[1]), float(drift[2])),
        drift_zero_ns=int(stamps[0]) + round(0.5e9 * (start_s + end_s)),
    )


def _zero_steps(stamps: IntArray, force: FloatArray, tare: Tare) -> list[ZeroStep]:
    """Finds steps of the zero in readings (n, 3), N, forwards and backwards in time from the contact-free stretch.

    Backwards, stamps and steps have the other sign, and a step's row is the one before it in time.
    """
    axes = ~np.isnan(force).all(axis=0)
    rows = np.flatnonzero(np.isfinite(force[:, axes]).all(axis=1))
    if tare.how == "none" or not tare.stretches_s:
        return [replace(step, row=int(rows[step.row])) for step in find_zero_steps(stamps[rows], force[rows])]
    seconds = (stamps[rows] - stamps[0]) * 1e-9
    start_s, end_s = tare.stretches_s[0]
    later, earlier = rows[seconds >= start_s], rows[seconds <= end_s][::-1]
    forwards = find_zero_steps(stamps[later], force[later], tare.force_n)
    backwards = find_zero_steps(-stamps[earlier], force[earlier], tare.force_n)
    steps = [replace(step, row=int(later[step.row])) for step in forwards]
    steps += [replace(step, row=int(earlier[step.row - 1]), step_n=-step.step_n) for step in backwards]
    return sorted(steps, key=lambda step: step.row)


def _with_steps(
    plausibility: ForcePlausibility, stamps: IntArray, steps: list[ZeroStep], tare: Tare
) -> ForcePlausibility:
    """Returns the findings with the ``steps`` of the zero in a log with these ``stamps`` (n,).

    Where no contact-free moment measures the new zero, the readings beyond the step, seen from the tare, are not used.
    """
    seconds = (stamps - stamps[0]) * 1e-9
    tare_s = tare.stretches_s[0][0] if tare.stretches_s else 0.0
    unused = np.zeros(len(stamps), np.bool_)
    findings: list[ForceFinding] = []
    for step in steps:
        at_s, lost = float(seconds[step.row]), 0
        if step.free_s:  # time without contact beyond the step
            detail = f"; the new zero is measured in {step.free_s:.1f} s without contact and is corrected"
        else:
            beyond: BoolArray = seconds >= at_s if tare_s < at_s else seconds < at_s
            lost, unused = int((beyond & ~unused).sum()), unused | beyond
            where = "behind" if tare_s < at_s else "before"
            detail = (
                f"; no contact-free moment measures the zero {where} it, so the readings there are not used: "
                "state a contact-free stretch there as the tare (tare=(START, END)) to use that part instead"
            )
        findings.append(ForceFinding.of_step(at_s, step.step_n, lost, detail))
    zero = {int(stamps[step.row]): (float(x), float(y), float(z)) for step in steps for x, y, z in [step.step_n]}
    return replace(plausibility.without(stamps, unused), findings=(*plausibility.findings, *findings), zero_steps=zero)
