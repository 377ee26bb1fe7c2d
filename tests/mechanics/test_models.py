"""Each model is itself, with its known values and its known failures."""

import math

import numpy as np
import pytest
from bench.published import CANTILEVER
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.oracles.planar_rod import solve_static

from tipforce.mechanics import (
    ConstantCurvature,
    LargeDeflection,
    LinearBeam,
    MassSpring,
    PlanarRod,
    PseudoRigidBody,
    RigidLinks,
)

UNIT = PlanarRod(1.0, 1.0)
SLIM = 0.02
"""Diameter of the unit rods: thin enough for their stretch not to matter."""

MODELS = {
    "linear beam": LinearBeam,
    "rigid links": RigidLinks,
    "mass-spring": MassSpring,
    "large deflection": LargeDeflection,
    "constant curvature": ConstantCurvature,
    "four arcs": lambda rod: ConstantCurvature(rod, 4),
    "pseudo-rigid body": PseudoRigidBody,
}
every_model = pytest.mark.parametrize("model", MODELS.values(), ids=MODELS)
large_models = pytest.mark.parametrize("model", [m for n, m in MODELS.items() if n != "linear beam"])

rods = st.builds(
    PlanarRod,
    flexible_length_m=st.floats(0.035, 0.065),
    bending_stiffness_nm2=st.floats(3e-4, 9e-4),
    rigid_length_m=st.sampled_from([0.0, 0.008]),
    precurvature_per_m=st.floats(-20, 20),
    stiffening_curvature_per_m=st.sampled_from([math.inf, 40.0]),
)
directions = st.floats(0, 2 * math.pi)


def along(angle, size):
    return size * np.array([math.cos(angle), math.sin(angle)])


def deflection(model, alpha):
    return model.solve_static(np.array([0.0, alpha])).tip_m[1]


@pytest.mark.parametrize("alpha", CANTILEVER)
@pytest.mark.parametrize(
    ("model", "tolerance"),
    [
        (LargeDeflection(UNIT), 1e-5),
        (RigidLinks(UNIT, 300), 2e-5),
        (ConstantCurvature(UNIT, 300), 2e-5),
        (MassSpring(UNIT, 300, diameter_m=2e-3), 2e-5),
    ],
)
def test_models_of_large_bending_meet_the_published_cantilever(model, tolerance, alpha):
    x, y = model.solve_static(np.array([0.0, alpha])).tip_m
    np.testing.assert_allclose([y, 1 - x], CANTILEVER[alpha][:2], atol=tolerance)


@pytest.mark.parametrize("alpha", [0.01, 2.0, 10.0])
def test_the_linear_beam_bends_in_proportion_however_far(alpha):
    x, y = LinearBeam(UNIT).solve_static(np.array([0.0, alpha])).tip_m
    assert y == pytest.approx(alpha / 3, rel=1e-9)
    assert x == pytest.approx(1.0, abs=1e-12)


def test_the_linear_beam_is_off_by_35_percent_at_alpha_2():
    assert deflection(LinearBeam(UNIT), 2.0) / CANTILEVER[2.0][0] == pytest.approx(1.351, abs=1e-3)


def test_the_linear_beam_has_the_cubic_line_of_a_straight_cantilever():
    line = LinearBeam(UNIT, 8).solve_static(np.array([0.0, 1.0])).centreline_m(9)
    x = np.linspace(0, 1, 9)
    np.testing.assert_allclose(line[:, 1], x**2 * (3 - x) / 6, atol=1e-12)


@pytest.mark.parametrize("alpha", [2.0, 5.0, 10.0])
def test_the_pseudo_rigid_body_is_within_one_percent_for_large_loads(alpha):
    assert deflection(PseudoRigidBody(UNIT), alpha) == pytest.approx(CANTILEVER[alpha][0], rel=0.01)


def test_the_pseudo_rigid_body_is_too_stiff_for_small_loads_and_for_moments():
    assert deflection(PseudoRigidBody(UNIT), 1e-4) == pytest.approx(1e-4 * 0.8517 / 2.67617, rel=1e-6)
    with_tip = PlanarRod(1.0, 1.0, rigid_length_m=0.5)
    *_, end, tip = PseudoRigidBody(with_tip).solve_static(np.zeros(2), 1e-4).centreline_m(31)
    turn = math.atan2(*(tip - end)[::-1])
    assert turn / 1e-4 == pytest.approx(1.2385**2 / (0.8517 * 2.67617), rel=1e-6)  # the true one is 1


@pytest.mark.parametrize("n", [1, 2, 5])
def test_few_pieces_are_wrong_by_a_known_share_for_small_loads(n):
    exact = 1e-4 / 3
    assert deflection(RigidLinks(UNIT, n), 1e-4) / exact == pytest.approx(1 - 1 / (4 * n**2), rel=1e-6)
    assert deflection(ConstantCurvature(UNIT, n), 1e-4) / exact == pytest.approx(1 - 1 / (4 * n**2), rel=1e-6)
    assert deflection(MassSpring(UNIT, n), 1e-4) / exact == pytest.approx(1 + 1 / (2 * n**2), rel=1e-6)


def test_particles_on_springs_give_way_along_the_string():
    tip = MassSpring(UNIT, 7, diameter_m=0.1).solve_static(np.array([3.0, 0.0])).tip_m
    np.testing.assert_allclose(tip, [1 + 3.0 / (16 / 0.1**2), 0], atol=1e-12)


@pytest.mark.parametrize(
    "of",
    [
        lambda rod, n: RigidLinks(rod, n),
        lambda rod, n: MassSpring(rod, n, SLIM),
        lambda rod, n: ConstantCurvature(rod, n),
        lambda rod, n: LinearBeam(rod, n, SLIM),
    ],
    ids=["rigid links", "mass-spring", "arcs", "linear beam"],
)
def test_the_error_falls_with_the_square_of_the_number_of_pieces(of):
    rod = PlanarRod(1.0, 1.0, 0.2, 1.2, 3.0)
    load = np.array([-0.8, 1.5])
    exact = (4 * of(rod, 400).solve_static(load).tip_m - of(rod, 200).solve_static(load).tip_m) / 3
    errors = [np.linalg.norm(of(rod, n).solve_static(load).tip_m - exact) for n in (10, 20, 40)]
    assert errors[0] / errors[1] == pytest.approx(4, rel=0.1)
    assert errors[1] / errors[2] == pytest.approx(4, rel=0.1)


def test_many_links_and_many_arcs_are_the_elastica():
    rod = PlanarRod(0.04, 4.3e-4, 0.008, 15.0, 40.0, segments=400)
    load = np.array([-0.2, 0.15])
    exact = solve_static(rod, load, 0.002).tip_m
    np.testing.assert_allclose(RigidLinks(rod, 400).solve_static(load, 0.002).tip_m, exact, atol=1e-7)
    np.testing.assert_allclose(ConstantCurvature(rod, 400).solve_static(load, 0.002).tip_m, exact, atol=1e-7)
    np.testing.assert_allclose(MassSpring(rod, 400, 1e-5).solve_static(load, 0.002).tip_m, exact, atol=1e-7)


JOINTS = np.linspace(0, 1, 401)


@pytest.mark.parametrize(
    "model",
    [
        lambda rod: RigidLinks(rod, 300),
        lambda rod: ConstantCurvature(rod, 300),
        lambda rod: MassSpring(rod, 300, 1e-5),
        LargeDeflection,
    ],
    ids=["rigid links", "arcs", "mass-spring", "large deflection"],
)
def test_precurvature_along_the_shaft_is_followed(model):
    rod = PlanarRod(0.04, 4.3e-4, 0.008, 15 * np.sin(5 * JOINTS), segments=400)
    load = np.array([-0.1, 0.15])
    np.testing.assert_allclose(model(rod).solve_static(load).tip_m, solve_static(rod, load).tip_m, atol=3e-7)


@pytest.mark.parametrize("model", [lambda rod: RigidLinks(rod, 300), lambda rod: ConstantCurvature(rod, 300)])
def test_stiffness_along_the_shaft_is_followed(model):
    rod = PlanarRod(0.04, 4.3e-4, 0.008, 10.0, stiffness_profile=1 + 0.5 * np.cos(4 * JOINTS), segments=400)
    load = np.array([-0.1, 0.15])
    np.testing.assert_allclose(model(rod).solve_static(load).tip_m, solve_static(rod, load).tip_m, atol=3e-7)


@pytest.mark.parametrize("model", [LinearBeam, LargeDeflection])
def test_stiffness_along_the_shaft_counts_by_what_it_does_to_the_tip(model):
    # Exact for small loads across a straight shaft, also where the model knows one stiffness only.
    rod = PlanarRod(0.04, 4.3e-4, stiffness_profile=1 + 0.5 * np.cos(4 * JOINTS), segments=400)
    small = np.array([0.0, 1e-5])
    assert model(rod).solve_static(small).tip_m[1] == pytest.approx(solve_static(rod, small).tip_m[1], rel=2e-3)


TOLERANCE = {  # of the deflection of a straight shaft under the same force across
    "linear beam": 0.01,
    "rigid links": 0.01,
    "mass-spring": 0.01,
    "large deflection": 0.01,
    "constant curvature": 0.27,
    "four arcs": 0.02,
    "pseudo-rigid body": 0.1,
}


@pytest.mark.parametrize("name", MODELS)
@settings(max_examples=25)
@given(rods, directions)
def test_all_agree_for_small_loads(name, rod, direction):
    small = along(direction, 1e-3 * rod.bending_stiffness_nm2 / rod.length_m**2)
    scale = np.linalg.norm(small) * rod.length_m**3 / (3 * rod.bending_stiffness_nm2)
    model = MODELS[name](rod)
    way = model.solve_static(small).tip_m - model.solve_static(0 * small).tip_m
    true = solve_static(rod, small).tip_m - solve_static(rod, 0 * small).tip_m
    assert np.linalg.norm(way - true) < TOLERANCE[name] * scale


@every_model
@settings(max_examples=15)
@given(rods, directions, st.floats(0, 0.2), st.floats(-0.004, 0.004))
def test_mirrored_rod_under_mirrored_load_has_the_mirrored_shape(model, rod, direction, size, moment):
    mirrored = PlanarRod(
        rod.flexible_length_m,
        rod.bending_stiffness_nm2,
        rod.rigid_length_m,
        -rod.precurvature_per_m,
        rod.stiffening_curvature_per_m,
    )
    force = along(direction, size)
    here = model(rod).solve_static(force, moment).centreline_m(20)
    there = model(mirrored).solve_static(force * [1, -1], -moment).centreline_m(20)
    np.testing.assert_allclose(there, here * [1, -1], atol=1e-9)


@every_model
@settings(max_examples=15)
@given(rods, directions, st.floats(0, 0.1))
def test_compliance_is_symmetric_and_smooth(model, rod, direction, size):
    # All follow from an energy, so what fx does to y is what fy does to x (Maxwell); and differences can be taken.
    force, bent = along(direction, size), model(rod).solve_static

    def compliance(step):
        ways = np.eye(2) * step
        return np.array([(bend_at(force + way) - bend_at(force - way)) / (2 * step) for way in ways])

    def bend_at(load):
        return bent(load).tip_m

    coarse, fine = compliance(2e-5), compliance(1e-5)
    scale = np.abs(fine).max()
    assert abs(fine[0, 1] - fine[1, 0]) < 1e-4 * scale
    np.testing.assert_allclose(coarse, fine, atol=1e-4 * scale)


@every_model
@settings(max_examples=15)
@given(rods, directions, st.floats(0, 0.35), st.floats(-0.005, 0.005))
def test_clinical_loads_converge_and_the_line_runs_from_base_to_tip(model, rod, direction, size, moment):
    shape = model(rod).solve_static(along(direction, size), moment)
    assert shape.converged
    line = shape.centreline_m(33)
    np.testing.assert_allclose(line[[0, -1]], [[0, 0], shape.tip_m], atol=1e-12)


@large_models
def test_a_pure_moment_turns_the_tip_by_moment_length_over_stiffness(model):
    # Approximate for the pseudo-rigid body (see above); all others are exact, with stiffening or without.
    if model is PseudoRigidBody:
        model, tolerance = (lambda rod: PseudoRigidBody(rod)), 0.4
    else:
        tolerance = 1e-6
    rod = PlanarRod(0.04, 4.3e-4, 0.008, 5.0)
    shape = model(rod).solve_static(np.zeros(2), 0.004)
    before, tip = shape.centreline_m(97)[-2:]
    turned = math.atan2(*(tip - before)[::-1]) - 5.0 * 0.04
    assert turned == pytest.approx(0.004 * 0.04 / 4.3e-4, rel=tolerance)


@pytest.mark.parametrize("model", [RigidLinks, ConstantCurvature, lambda rod: MassSpring(rod, 300)])
def test_moment_over_curvature_follows_the_stiffening(model):
    rod = PlanarRod(0.04, 4.3e-4, 0.008, 5.0, 40.0)
    before, tip = model(rod).solve_static(np.zeros(2), 0.012).centreline_m(97)[-2:]
    curvature = math.atan2(*(tip - before)[::-1]) / 0.04
    assert 4.3e-4 * (1 + (curvature / 40) ** 2) * (curvature - 5.0) == pytest.approx(0.012, rel=1e-6)


def test_large_deflection_takes_one_stiffness_for_the_whole_shaft():
    load = np.array([-0.1, 0.2])
    stiffening = LargeDeflection(PlanarRod(0.04, 4.3e-4, 0.008, 20.0, 40.0)).solve_static(load).tip_m
    uniform = PlanarRod(0.04, 4.3e-4 * 1.25, 0.008, 20.0, segments=800)
    np.testing.assert_allclose(stiffening, solve_static(uniform, load).tip_m, atol=1e-7)


def test_large_deflection_converges_with_the_fourth_power_of_its_steps():
    rod, load = PlanarRod(1.0, 1.0, 0.2, 1.0), np.array([-1.0, 3.0])
    exact = LargeDeflection(rod, 400).solve_static(load).tip_m
    errors = [np.linalg.norm(LargeDeflection(rod, n).solve_static(load).tip_m - exact) for n in (10, 20)]
    assert errors[0] / errors[1] == pytest.approx(16, rel=0.3)


@large_models
def test_a_straight_column_stays_straight(model):
    shape = model(PlanarRod(0.065, 4.3e-4)).solve_static(np.array([-0.4, 0.0]))  # 1.6 times its buckling load
    assert shape.converged
    assert shape.tip_m[1] == 0.0


@pytest.mark.parametrize(
    ("model", "share"), [(RigidLinks, 1.0), (LargeDeflection, 1.0), (ConstantCurvature, 12 / math.pi**2)]
)
def test_columns_buckle_at_their_own_load(model, share):
    # Just below, a small push across is enlarged by 1 / (1 - P / P_c). One arc: 3 EI / L^2 instead of pi^2 / 4.
    critical = share * math.pi**2 / 4
    push = 1e-6
    ways = [model(UNIT).solve_static(np.array([-part * critical, push])).tip_m[1] for part in (0.9, 0.95)]
    assert ways[1] / ways[0] == pytest.approx(2, rel=0.1)


@pytest.mark.parametrize(
    ("make", "match"),
    [
        (lambda: RigidLinks(UNIT, 0), "joints"),
        (lambda: ConstantCurvature(UNIT, 0), "arcs"),
        (lambda: LargeDeflection(UNIT, 0), "steps"),
        (lambda: MassSpring(UNIT, 5, 0.0), "diameter"),
        (lambda: LinearBeam(UNIT, 0), "element"),
    ],
)
def test_impossible_models_are_refused(make, match):
    with pytest.raises(ValueError, match=match):
        make()
