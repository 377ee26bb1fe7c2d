"""Which unknown limits the force: the contributions agree with a session in which the unknown really is stated."""

import math
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from tests.estimators.test_session import FRAME, INFO, SCALE, image_of

from tipforce.estimators.session import (
    ForceLimits,
    Knowledge,
    Limit,
    LimitsTally,
    RodTrackSettings,
    SessionFilter,
    rod_model,
)  # fmt: skip
from tipforce.estimators.session._limits import GROUPS
from tipforce.mechanics.planar import FORCE, UNKNOWNS
from tipforce.types import CentrelinePx, SessionInfo, merged_values

FORCES = ((-0.12, 0.1), (-0.1, -0.12), (-0.2, 0.16))
SEGMENTS = 24
TRUE = {"precurvature_per_m": 0.2, "base_x_m": -1.5e-3, "base_angle_rad": 0.017}
"""The rod of `image_of` beside its metadata."""


@cache
def lines() -> list[CentrelinePx]:
    return [CentrelinePx(image_of(force)) for force in FORCES]


Stated = tuple[dict[str, float], dict[str, Any]]
"""Settings of the prior, and lines of bench.toml."""


def limits_of(stated: Stated = ({}, {})) -> ForceLimits:
    """The limits of a session whose frames are all in contact."""
    prior, bench = stated
    settings = RodTrackSettings(prior=RodTrackSettings().prior.model_copy(update=prior), segments=SEGMENTS)
    info = INFO.updated(SessionInfo.from_values(bench))
    known = Knowledge.stated(settings)
    for unknown, value in TRUE.items():
        known.constants[UNKNOWNS.index(unknown) - FORCE] = value
    session = SessionFilter(settings, known, rod_model(info, SEGMENTS), info)
    tally = LimitsTally()
    for line in lines():
        session.step(FRAME.line(line), SCALE, 10.0, 1.0)
        tally.add(session)
    return tally.limits("camera")


def limit(found: ForceLimits, name: str) -> Limit:
    return next(each for each in found.limits if each.name == name)


def camera(**values: float) -> Stated:
    return {}, {"views": {"camera": values}}


def catheter(**values: float) -> Stated:
    return {}, {"catheter": values}


def knob(**values: float) -> Stated:
    return {}, {"actuation": values}


CASES: dict[str, tuple[Stated, Stated]] = {
    "knob map": (knob(knob_gain_uncertainty=0.2), knob(knob_gain_uncertainty=1e-3, knob_play_deg=0.01)),
    "curvature without load": (({"precurvature_per_m": 2.0}, {}), ({"precurvature_per_m": 1e-2}, {})),
    "camera tilt": (camera(tilt_uncertainty_deg=40.0), camera(tilt_uncertainty_deg=0.05)),
    "bend toward the camera": (
        ({"stretch": 0.02, "depth_per_m": 0.5}, {}),
        ({"stretch": 1e-4, "depth_per_m": 1e-3}, {}),
    ),
    "image scale": (camera(metres_per_px_uncertainty=0.1), camera(metres_per_px_uncertainty=1e-3)),
    "lens": (({"distortion_per_m2": 20.0}, {}), ({"distortion_per_m2": 1e-3}, {})),
    "clamp": (({"base_angle_deg": 10.0}, {}), ({"base_angle_deg": 1e-2, "base_position_m": 1e-5}, {})),
    "stiffness": (catheter(bending_stiffness_uncertainty=0.2), catheter(bending_stiffness_uncertainty=1e-3)),
    "stiffness along the shaft": (
        ({"proximal_stiffness": 0.4}, {}),
        ({"proximal_stiffness": 1e-3, "stiffening_std_m2": 1e-7}, {}),
    ),
    "length": (catheter(flexible_length_uncertainty=0.1), catheter(flexible_length_uncertainty=1e-4)),
    "creep": (({"creep_std": 0.3}, {}), ({"creep_std": 1e-4}, {})),
}
"""Group -> a session in which it is known badly, and the values of its remedy, as good as can be."""


def test_every_group_has_a_case() -> None:
    assert set(CASES) == {group.name for group in GROUPS}


@pytest.mark.parametrize("name", CASES)
def test_a_group_that_is_stated_takes_away_what_was_said(name: str) -> None:
    before, after = (limits_of(stated) for stated in CASES[name])
    said = limit(before, name)
    gone_n = math.sqrt(max(0.0, before.std_n**2 - after.std_n**2))
    if name == "creep":  # the forces change from frame to frame, so that nothing remains of earlier ones
        assert max(said.std_n, gone_n) < 1e-3
        return
    assert 1.0 / 1.7 < gone_n / said.std_n < 1.7
    assert limit(after, name).std_n < 0.3 * gone_n, "nothing is left to measure"


LIMITING = ("knob map", "curvature without load", "camera tilt", "bend toward the camera", "stiffness")


@pytest.mark.parametrize("name", LIMITING)
def test_the_group_that_limits_is_the_first(name: str) -> None:
    found = limits_of(CASES[name][0])
    assert found.measurable[0].name == name
    assert found.text().startswith(name) or found.text().startswith("the shape itself")
    assert found.measurable[0].remedy in found.text()


def test_all_that_can_be_measured_together_takes_away_what_was_said() -> None:
    prior: dict[str, float] = {}
    bench: dict[str, Any] = {}
    for _, (settings, stated) in CASES.values():
        prior, bench = prior | settings, merged_values(bench, stated)
    before, after = limits_of(), limits_of((prior, bench))
    lefts = [each.left_n for each in before.measurable]
    assert (np.diff(lefts) < 1e-12).all()
    assert after.std_n == pytest.approx(lefts[-1], rel=0.3)


def test_the_sentence_names_the_largest_contributions_and_their_remedy() -> None:
    found = ForceLimits(
        9,
        0.05,
        (Limit("knob map", 0.038, 0.03, "measure the knob map"), Limit("clamp", 0.021, 0.02, "align the clamp")),
        (Limit("error of the line", 0.009, math.nan, "take a sharper image"),),
    )
    assert found.text() == "knob map 38 mN, clamp 21: measure the knob map"
    by_shape = replace(found, others=(Limit("the shape itself", 0.04, math.nan, "push at an angle"),))
    assert (
        by_shape.text() == "the shape itself 40 mN, knob map 38, clamp 21: push at an angle; and measure the knob map"
    )


def test_without_contact_nothing_is_stated() -> None:
    settings = RodTrackSettings(segments=SEGMENTS)
    session = SessionFilter(settings, Knowledge.stated(settings), rod_model(INFO, SEGMENTS), INFO)
    tally = LimitsTally()
    tally.add(session)
    for _ in range(4):
        session.step(FRAME.line(CentrelinePx(image_of((0.0, 0.0)))), SCALE, 10.0, 1.0)
        tally.add(session)
    nothing = tally.limits("camera")
    assert nothing.lines() == [
        "0 frames in contact that the rod explains: too few to find their limit; expected at least 3"
    ]
    assert nothing.figures()["std_n"] is None
