"""A shaft whose rest shape is an S, and a stepped shaft: stated, the force is right; taken for an arc, it is not."""

import math
from typing import Any

import numpy as np
import pytest
from tests.oracles.planar_rod import solve_static

from tipforce.estimators.rod_models._estimator import _model
from tipforce.estimators.session import Knowledge, LineFrame, RodTrackSettings, SessionFilter, rod_model
from tipforce.estimators.space._filter import rod_of
from tipforce.mechanics import PlanarRod
from tipforce.types import ActuationInfo, Catheter, CentrelinePx, SessionInfo, ViewInfo

SCALE, FLEXIBLE_M, RIGID_M, STIFFNESS = 2e-4, 0.04, 0.008, 4.3e-4
FRAME = LineFrame((640, 480), "left", SCALE)
S_SHAPE = (14.0, 7.0, 0.0, -7.0, -14.0)
STEP = ((0.0, 1.0), (0.6, 1.0), (0.61, 0.5), (1.0, 0.5))
FORCES = ((-0.1, 0.08), (-0.12, -0.09), (-0.05, 0.1))
SETTINGS = RodTrackSettings()


def info_of(catheter: dict[str, object]) -> SessionInfo:
    own = {"flexible_length_m": FLEXIBLE_M, "rigid_length_m": RIGID_M, "bending_stiffness_nm2": STIFFNESS}
    return SessionInfo(
        "s",
        Catheter(**own, **catheter),  # type: ignore[arg-type]
        {"camera": ViewInfo(SCALE, "left")},
        actuation=ActuationInfo(0.533),
    )


def line_of(force: tuple[float, float], catheter: Catheter, knob_deg: float) -> CentrelinePx:
    segments = 160
    rod = PlanarRod(
        FLEXIBLE_M,
        STIFFNESS,
        RIGID_M,
        0.533 * knob_deg + catheter.rest_curvatures_per_m(segments + 1),
        stiffening_curvature_per_m=4.5e-4**-0.5,
        stiffness_profile=catheter.stiffness_factors(segments + 1),
        segments=segments,
    )
    points = solve_static(rod, np.array(force)).centreline_m(np.linspace(1.5e-3, FLEXIBLE_M + RIGID_M, 64))
    return CentrelinePx((points - (1.5e-3, 0.0)) / SCALE * (1.0, -1.0) + (-0.5, 239.5))


def errors_n(true: dict[str, object], stated: dict[str, object]) -> tuple[list[float], float]:
    """Errors of the force vector in contact, and the share of frames that the rod explains."""
    info, catheter = info_of(stated), info_of(true).catheter
    session = SessionFilter(SETTINGS, Knowledge.stated(SETTINGS), rod_model(info, SETTINGS.segments), info)
    errors, explained = [], 0
    for force in ((0.0, 0.0), (0.0, 0.0), *FORCES):
        found = session.step(FRAME.line(line_of(force, catheter, 6.0)), SCALE, 6.0, 1.0)
        explained += found.explained
        if force != (0.0, 0.0):
            errors.append(math.dist(found.force.force_n, force))
    return errors, explained / (2 + len(FORCES))


@pytest.mark.parametrize(("name", "value"), [("rest_curvature_per_m", S_SHAPE), ("stiffness_profile", STEP)])
def test_a_stated_shape_or_profile_gives_the_force(name: str, value: object) -> None:
    with_fact, explained = errors_n({name: value}, {name: value})
    assert explained == 1.0
    assert max(with_fact) < 0.1
    without, explained_without = errors_n({name: value}, {})
    assert explained_without < 0.5 or max(without) > 4.0 * max(with_fact)


def test_rod_3d_and_the_models_of_the_thesis_use_both() -> None:
    catheter = info_of({"rest_curvature_per_m": S_SHAPE, "stiffness_profile": STEP}).catheter
    in_space = rod_of(SessionInfo(catheter=catheter), 40).rod
    np.testing.assert_allclose(in_space.precurvature_per_m[[0, 20, -1]], [[0, 0, 14], [0, 0, 0], [0, 0, -14]])
    kept: Any = _model(lambda rod: rod, catheter, STIFFNESS, 2.0)  # type: ignore[arg-type, return-value]
    for profile in (in_space.stiffness_profile, kept.stiffness_profile):
        np.testing.assert_allclose(np.asarray(profile)[[0, -1]], [1.0, 0.5])
    np.testing.assert_allclose(kept.precurvatures_per_m[[0, -1]], [16.0, -12.0])


def test_a_shaft_of_stated_shape_without_a_knob_rests_in_it() -> None:
    without = SessionInfo(catheter=info_of({"rest_curvature_per_m": S_SHAPE}).catheter)
    knowledge = Knowledge.stated(SETTINGS)
    _, covariance = knowledge.for_session(SETTINGS, without, math.nan)
    assert math.sqrt(covariance[0, 0]) == pytest.approx(SETTINGS.prior.precurvature_per_m)
    _, unknown = knowledge.for_session(SETTINGS, SessionInfo(catheter=info_of({}).catheter), math.nan)
    assert math.sqrt(unknown[0, 0]) == pytest.approx(SETTINGS.prior.unknown_precurvature_per_m)
