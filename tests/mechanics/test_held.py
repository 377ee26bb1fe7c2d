"""The rod whose tip is held: it equals the rod under the same dead load, and carries more than such a load could."""

import math

import numpy as np
import pytest
from tests.mechanics.test_line_fit import COUNT, CREPT, MODEL, NONE, POINTS, STD, line_of, prior

from tipforce.mechanics.planar import UNKNOWNS, loaded_point_aside, make_work, predict_held_line, predict_line

LINE = line_of((-0.1, 0.1), 5.3)._replace(past_n=np.zeros(2))
BUCKLING_N = 2.47 * MODEL.stiffness_nm2 / 0.046**2
"""Euler's load of a straight rod with a free tip: pi^2 / 4 EI / L^2."""


def held_at(force: tuple[float, float], c: float, s: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Returns unknowns, reaction and nodes of the held rod with the shape that ``force`` gives as a dead load."""
    work = make_work(MODEL, POINTS, COUNT)
    dead = prior(5.3)[0] + 0.3 * STD
    dead[:2] = force
    assert predict_line(dead, MODEL, LINE, NONE, work, True) == (True, True)
    nodes = work.nodes.copy()
    held = dead.copy()
    held[:2] = c * force[0] + s * force[1], loaded_point_aside(dead, c, s, MODEL, work)
    work.theta[:] += 0.05 * np.sin(np.arange(len(work.theta)))
    assert predict_held_line(held, 0.0, c, s, MODEL, LINE, NONE, work)
    assert np.abs(work.nodes - nodes).max() < 1e-9
    return held, work.reaction.copy(), work.reaction_rates.copy()


@pytest.mark.parametrize("force", [(-0.1, 0.12), (-0.25, -0.05), (0.05, 0.1)])
def test_the_reaction_is_the_force_across(force: tuple[float, float]) -> None:
    c, s = math.cos(0.2), math.sin(0.2)
    _, reaction, _ = held_at(force, c, s)
    assert reaction[0] == pytest.approx(c * force[1] - s * force[0], abs=1e-8)


@pytest.mark.parametrize("lever", [0.0, 3.0])
@pytest.mark.parametrize("along_n", [-0.1, -2.5 * BUCKLING_N])
def test_slopes_are_the_derivatives_below_and_beyond_buckling(along_n: float, lever: float) -> None:
    c, s, work = math.cos(0.1), math.sin(0.1), make_work(MODEL, POINTS, COUNT)
    line = LINE._replace(crept_per_m=CREPT)
    at = prior(5.3)[0] + 0.3 * STD
    predict_line(at, MODEL, line, NONE, work, True)
    at[1] = loaded_point_aside(at, c, s, MODEL, work)
    for share in np.linspace(0.0, 1.0, 8):
        at[0] = share * along_n
        assert predict_held_line(at, lever, c, s, MODEL, line, NONE, work)
    slopes, rates = work.slopes.copy(), work.reaction_rates.copy()
    assert (work.reaction[1] < 0.0) == (along_n < -BUCKLING_N)
    std = STD.copy()
    std[1] = 1e-3
    shape = {UNKNOWNS.index("creep"): 7, **{k: k for k in range(7)}}
    for k in range(COUNT):
        ends, reactions = [], []
        for way in (1.0, -1.0):
            moved = at.copy()
            moved[k] += way * 1e-2 * std[k]
            assert predict_held_line(moved, lever, c, s, MODEL, line, NONE, work)
            ends.append(work.residual.copy())
            reactions.append(work.reaction[0])
        if k in (0, 2) and lever:  # the caller adds the effect of the force's size on the lever
            continue
        numeric = (ends[1] - ends[0]) / (2e-2 * std[k])
        assert np.abs(numeric - slopes[:, k]).max() <= 3e-3 * np.abs(numeric).max() + 1e-7 / std[k], UNKNOWNS[k]
        if k in shape:
            rate = (reactions[0] - reactions[1]) / (2e-2 * std[k])
            assert rate == pytest.approx(rates[shape[k]], rel=1e-3, abs=1e-7 / std[k]), UNKNOWNS[k]
