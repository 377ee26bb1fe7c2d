"""The planar rod under 100,000 random loads from a cold start: none is lost, and each says on which branch it lies."""

import math

import numpy as np
import pytest

from tipforce.mechanics import Branch, Rod, Shapes, bend_many

pytestmark = pytest.mark.slow

LENGTH, STIFFNESS = 0.065, 4.3e-4
COUNT = 100_000


def loads(count: int, seed: int) -> dict[str, np.ndarray]:
    """|F| L^2 / EI to 12 in any direction, moments to 2 EI / L, pre-curvatures to the knob's full 48 1/m both ways."""
    rng = np.random.default_rng(seed)
    size, angle = rng.uniform(0, 12, count) * STIFFNESS / LENGTH**2, rng.uniform(0, 2 * math.pi, count)
    return {
        "force_n": size[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1),
        "moment_nm": rng.uniform(-2, 2, count) * STIFFNESS / LENGTH,
        "precurvature_per_m": rng.uniform(-48, 48, count),
    }


def unbalanced(shapes: Shapes) -> np.ndarray:
    """Largest moment that is missing on an element of each shape, over EI / length of the shaft; in plain NumPy."""
    rod, angles = shapes.rod, shapes.angles_rad
    k = rod.curvatures_per_m(angles)
    stiffer = 1 + (k / rod.stiffening_curvature_per_m) ** 2
    moment = rod.stiffnesses_nm2 * stiffer * (k - shapes.precurvature_per_m[:, None])  # type: ignore[index]
    after = np.append(moment[:, 1:], shapes.moment_nm[:, None], axis=1)
    arm = rod.element_lengths_m * np.stack([np.cos(angles), np.sin(angles)])
    couple = arm[0] * shapes.force_n[:, 1:] - arm[1] * shapes.force_n[:, :1]
    return np.abs(after + couple - moment).max(axis=1) / (rod.bending_stiffness_nm2 / rod.flexible_length_m)


def walked(rod: Rod, given: dict[str, np.ndarray], steps: int) -> tuple[np.ndarray, np.ndarray]:
    """Angles after raising the loads in many equal steps, and the largest change of an angle in one of them."""
    curved = given["precurvature_per_m"]
    none = {"force_n": 0 * given["force_n"], "moment_nm": 0 * given["moment_nm"], "precurvature_per_m": curved}
    shapes, largest = bend_many(rod, **none), np.zeros(len(curved))
    for share in np.arange(1, steps + 1) / steps:
        part = {"force_n": share * given["force_n"], "moment_nm": share * given["moment_nm"]}
        following = bend_many(rod, **part, precurvature_per_m=curved, start=shapes)
        largest = np.maximum(largest, np.abs(following.angles_rad - shapes.angles_rad).max(axis=1))
        shapes = following
    return shapes.angles_rad, largest


@pytest.mark.parametrize(
    ("rod", "seed"),
    [
        (Rod(LENGTH - 0.008, STIFFNESS, 0.008), 0),
        (Rod(LENGTH - 0.008, STIFFNESS, 0.008, stiffening_curvature_per_m=40.0), 1),
    ],
    ids=["constant stiffness", "stiffening"],
)
def test_no_load_is_lost_and_each_shape_knows_its_branch(rod: Rod, seed: int) -> None:
    given = loads(COUNT, seed)
    shapes = bend_many(rod, **given)
    assert shapes.converged.all()
    assert unbalanced(shapes).max() < 1e-9
    assert shapes.residual.max() < 1e-9
    assert shapes.stable.all()
    fallen = shapes.branch == Branch.FALLEN
    assert np.isin(shapes.branch, [Branch.UNLOADED, Branch.FALLEN]).all()

    # Many small steps without any look ahead: all fallen ones and a part of the rest. They fall where it is said.
    rows = np.append(np.flatnonzero(fallen), np.flatnonzero(~fallen)[:3000])
    angles, largest = walked(rod, {name: value[rows] for name, value in given.items()}, 500)
    away = np.abs(angles - shapes.angles_rad[rows]).max(axis=1)
    fell = fallen[rows]
    # A step of 1/500 turns no angle of a branch by more than 0.1 rad, but close to a fold.
    assert (largest[fell] > 0.1).all()
    assert (away[~fell & (largest < 0.1)] < 1e-6).all()
    assert (largest[~fell] > 0.1).mean() < 0.003
    print(
        f"{COUNT} loads: {shapes.residual.max():.1e} largest residual, {fallen.sum()} fell at a fold, "
        f"{away[~fell].max():.1e} rad off a walk in 500 steps, {(largest[~fell] > 0.1).sum()} of them walked too fast"
    )
