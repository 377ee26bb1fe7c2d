"""Derivatives at many instants of a contact, against finite differences."""

from dataclasses import replace

import numpy as np
import pytest

from tipforce.mechanics import SpatialRod, contact_derivatives, solve_static_spatial

SEGMENTS, POINTS = 24, 9
ROD = SpatialRod(
    0.04,
    4.3e-4,
    0.008,
    4.0e-4,
    np.array([0.0, 1.0, 6.0]),
    40.0,
    np.where(np.arange(SEGMENTS + 1) < 9, 1.05, 1.0),
    SEGMENTS,
)
FORCES = np.array([[0.0, 0.0, 0.0], [-0.05, -0.08, 0.004], [-0.12, 0.06, -0.01], [-0.1, -0.16, 0.02]])


@pytest.fixture(scope="module")
def shapes():
    return [solve_static_spatial(ROD, force) for force in FORCES]


@pytest.fixture(scope="module")
def lines(shapes):
    return np.array([shape.centreline_m(49) for shape in shapes])


def measured_slopes(rod, shape, changes):
    """(POINTS, 3, k): finite differences; each change returns rod, force and moment for a step of the stated size."""

    def line(change, step):
        moved, force, moment = change(step)
        return solve_static_spatial(moved, force, moment, start=shape).centreline_m(POINTS)

    columns = [(line(change, step) - line(change, -step)) / (2 * step) for change, step in changes]
    return np.stack(columns, axis=-1)


def test_derivatives_are_what_finite_differences_of_the_static_shape_measure(shapes, lines):
    found = contact_derivatives(ROD, lines, FORCES, lines[:, -1], POINTS)
    assert found.stable.all()
    zero, rest, ei, gj = np.zeros(3), ROD.precurvature_per_m, ROD.bending_stiffness_nm2, ROD.gj_nm2
    for row, (shape, force) in enumerate(zip(shapes, FORCES, strict=True)):
        np.testing.assert_allclose(found.centreline_m[row], shape.centreline_m(POINTS), atol=1e-9)

        def stiffer(share, force=force):
            rod = replace(ROD, bending_stiffness_nm2=ei * (1 + share), torsional_stiffness_nm2=gj * (1 + share))
            return rod, force, zero

        changes = {
            "force": [(lambda e, u=u, f=force: (ROD, f + e * u, zero), 1e-5) for u in np.eye(3)],
            "moment": [(lambda e, u=u, f=force: (ROD, f, e * u), 1e-6) for u in np.eye(3)],
            "precurvature": [
                (lambda e, u=u, f=force: (replace(ROD, precurvature_per_m=rest + e * u), f, zero), 1e-3)
                for u in np.eye(3)[1:]
            ],
            "stiffness": [(stiffer, 1e-5)],
        }
        for name, steps in changes.items():
            expected = measured_slopes(ROD, shape, steps)
            size = np.abs(expected).max()
            np.testing.assert_allclose(found[name][row], expected, atol=5e-6 * size + 1e-8, err_msg=name)


def test_a_force_beside_the_middle_of_the_dome_turns_it_too(lines):
    radius, step = 1.2e-3, 1e-6
    touch = lines[:, -1] - [4e-4, 3e-4, 0.0]

    def at(change):
        return contact_derivatives(ROD, lines, FORCES + change, touch, POINTS, tip_radius_m=radius)

    in_contact = FORCES.any(axis=1)  # where nothing acts there is no place at which it acts
    for axis in range(3):
        change = step * np.eye(3)[axis]
        measured = (at(change).centreline_m - at(-change).centreline_m) / (2 * step)
        slope = at(0.0)["force"][..., axis]
        np.testing.assert_allclose(slope[in_contact], measured[in_contact], atol=2e-6 * np.abs(measured).max())


def test_length_and_patterns_of_stiffness_are_those_of_another_rod(lines):
    pattern = np.linspace(1.0, 0.0, SEGMENTS + 1)
    found = contact_derivatives(ROD, lines, FORCES, lines[:, -1], POINTS, stiffness_patterns=pattern[None])

    def line(rod, places):
        return contact_derivatives(rod, lines, FORCES, lines[:, -1], places).centreline_m

    arc, step = np.linspace(0.0, 0.048, POINTS), 1e-7
    ends = []
    for way in (step, -step):
        longer = replace(ROD, flexible_length_m=0.04 + way)
        ends.append(line(longer, np.minimum(np.where(arc <= 0.04, arc * (1 + way / 0.04), arc + way), 0.048 + way)))
    measured = (ends[0] - ends[1]) / (2 * step)
    np.testing.assert_allclose(found["length"][..., 0], measured, atol=1e-5)
    step = 1e-5
    more, less = (replace(ROD, stiffness_profile=ROD.stiffness_profile * (1 + way * pattern)) for way in (step, -step))
    measured = (line(more, POINTS) - line(less, POINTS)) / (2 * step)
    np.testing.assert_allclose(found["stiffness"][..., 0], measured, atol=1e-6 * np.abs(measured).max())


def test_creep_bends_what_was_bent_further():
    """Under a steady force the strain grows by the creep's share; its derivative is the growth itself."""
    force = np.tile([-0.05, -0.08, 0.0], (40, 1))
    times = np.linspace(0.0, 20.0, 40)
    share = 0.03

    def run(creep):
        rod = replace(ROD, bending_stiffness_nm2=4.3e-4 / (1 + creep), torsional_stiffness_nm2=4.0e-4 / (1 + creep),
                      stiffening_curvature_per_m=np.inf)  # fmt: skip
        line = np.tile(solve_static_spatial(rod, force[0]).centreline_m(49), (40, 1, 1))
        return contact_derivatives(rod, line, force, line[:, -1], POINTS, time_s=times, creep=creep, creep_time_s=2.0)

    found = run(share)
    assert np.abs(found["creep"][0]).max() == 0.0  # nothing has crept at the first instant
    measured = (run(1.01 * share).centreline_m - run(0.99 * share).centreline_m)[-1] / 0.02
    np.testing.assert_allclose(found["creep"][-1, :, :, 0], measured, atol=0.05 * np.abs(measured).max())
    static = solve_static_spatial(
        replace(ROD, bending_stiffness_nm2=4.3e-4 / 1.03, torsional_stiffness_nm2=4.0e-4 / 1.03,
                stiffening_curvature_per_m=np.inf), force[0],
    )  # fmt: skip
    np.testing.assert_allclose(found.centreline_m[-1], static.centreline_m(POINTS), atol=2e-6)


def test_a_rod_without_an_electrode_has_derivatives_too():
    rod = replace(ROD, rigid_length_m=0.0)
    shape = solve_static_spatial(rod, FORCES[1])
    line = shape.centreline_m(49)[None]
    found = contact_derivatives(rod, line, FORCES[1:2], line[:, -1], POINTS)
    zero = np.zeros(3)
    expected = measured_slopes(rod, shape, [(lambda e, u=u: (rod, FORCES[1] + e * u, zero), 1e-5) for u in np.eye(3)])
    np.testing.assert_allclose(found["force"][0], expected, atol=5e-6 * np.abs(expected).max())


def test_points_may_stand_in_any_order_and_wrong_shapes_are_refused(lines):
    arc = np.array([0.048, 0.0, 0.02])
    mixed = contact_derivatives(ROD, lines, FORCES, lines[:, -1], arc)
    even = contact_derivatives(ROD, lines, FORCES, lines[:, -1], np.sort(arc))
    np.testing.assert_array_equal(mixed.slopes, even.slopes[:, [2, 0, 1]])
    with pytest.raises(ValueError, match="force_n: expected shape"):
        contact_derivatives(ROD, lines, FORCES[:2], lines[:, -1], POINTS)
    with pytest.raises(ValueError, match="creep needs the instants"):
        contact_derivatives(ROD, lines, FORCES, lines[:, -1], POINTS, creep=0.03)
