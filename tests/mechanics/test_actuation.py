"""From the knob to the curvature: what hysteresis must obey."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from tipforce.mechanics import KnobMap, Play, PrandtlIshlinskii, Tendon

WIDTHS, WEIGHTS = [0.3, 0.8, 2.0, 5.0], [0.4, 0.3, 0.2, 0.3]


def make_play():
    return Play(1.6)


def make_sum():
    return PrandtlIshlinskii(WIDTHS, WEIGHTS, 0.1)


def make_tendon():
    return OnDegrees(Tendon(0.04, 4.3e-4, friction=0.1, wrap_rad=3.0))


class OnDegrees:
    """A tendon pulled by 0.2 mm for each degree from 10 degrees below zero, so that it is not slack all the time."""

    def __init__(self, tendon):
        self.tendon = tendon

    def run(self, values):
        return self.tendon.run(2e-4 * (np.asarray(values) + 10))[0]

    def step(self, value):
        return self.tendon.step(2e-4 * (value + 10))


operators = pytest.mark.parametrize("make", [make_play, make_sum, make_tendon, KnobMap])
angles = st.floats(-9, 9)
histories = st.lists(angles, max_size=8)


def refined(path, pieces):
    """The same path with ``pieces`` samples on each of its ways."""
    return np.interp(np.arange((len(path) - 1) * pieces + 1) / pieces, np.arange(len(path)), path)


@operators
@given(st.lists(angles, min_size=2, max_size=12), st.integers(2, 7))
def test_speed_does_not_matter(make, path, pieces):
    np.testing.assert_allclose(make().run(refined(path, pieces))[::pieces], make().run(path), atol=1e-12)


@operators
@given(histories)
def test_step_by_step_is_the_same_as_all_at_once(make, path):
    operator = make()
    np.testing.assert_array_equal([operator.step(value) for value in path], make().run(path))


@operators
@given(histories, histories)
def test_a_pause_between_two_runs_changes_nothing(make, first, second):
    parts = make()
    np.testing.assert_array_equal(np.concatenate([parts.run(first), parts.run(second)]), make().run(first + second))


@operators
@given(histories, angles, angles, st.lists(st.floats(0, 1), max_size=5))
def test_a_closed_loop_wipes_itself_out(make, history, low, high, inside):
    # Return-point memory: whatever happens between the last two turns is forgotten when the last one is reached again.
    low, high = sorted((low, high))
    there, back = make(), make()
    there.run([*history, low, high])
    back.run([*history, low, high, *(low + share * (high - low) for share in inside), high])
    after = [high, low - 1.0, high + 1.0, 0.0, -9.0, 9.0]
    np.testing.assert_allclose(back.run(after), there.run(after), atol=1e-12)


@pytest.mark.parametrize("make", [make_play, make_sum])
@given(histories, histories, angles, angles)
def test_loops_between_the_same_turns_are_congruent(make, one, other, low, high):
    loop = refined([low, high, low], 20)
    shapes = []
    for history in (one, other):
        operator = make()
        operator.run([*history, low, high])
        around = operator.run(loop)
        shapes.append(around - around[0])
    np.testing.assert_allclose(shapes[0], shapes[1], atol=1e-12)


@given(st.floats(0, 5), angles, st.lists(st.floats(0, 1), min_size=1, max_size=10))
def test_play_transmits_nothing_inside_its_width(width, top, inside):
    play = Play(width)
    play.step(top - 20)
    held = play.step(top)
    np.testing.assert_allclose(play.run([top - share * width for share in inside]), held, atol=1e-12)
    assert play.step(top - width - 1) == pytest.approx(held - 1)


@given(st.floats(0, 5), histories)
def test_play_stays_within_half_its_width(width, path):
    assert (np.abs(Play(width).run(path) - path) <= 0.5 * width + 1e-12).all()


def test_play_without_width_is_the_input():
    np.testing.assert_array_equal(Play(0.0).run([1.0, -2.0, 0.5]), [1.0, -2.0, 0.5])


@given(st.floats(0.1, 9), st.sampled_from([-1, 1]))
def test_from_rest_the_sum_runs_along_its_loading_curve(top, sign):
    path = sign * np.linspace(0, top, 30)
    np.testing.assert_allclose(make_sum().run(path), make_sum().loading_curve(path), atol=1e-12)


@given(st.floats(0.1, 9))
def test_after_a_turn_the_curve_is_the_loading_curve_twice_as_large(top):
    operator = make_sum()
    peak = operator.run([top])[0]
    down = np.linspace(top, -top, 40)
    np.testing.assert_allclose(peak - operator.run(down), 2 * operator.loading_curve((top - down) / 2), atol=1e-12)


@given(arrays(float, 5, elements=st.floats(0.1, 2)), arrays(float, 5, elements=st.floats(-1, 3)))
def test_a_loading_curve_comes_back(ways, heights):
    inputs, outputs = np.cumsum(ways), np.cumsum(heights)
    operator = PrandtlIshlinskii.from_loading_curve(inputs, outputs)
    np.testing.assert_allclose(operator.run(inputs), outputs, atol=1e-9)


def test_reset_forgets():
    operator = make_sum()
    first = operator.run([3.0, -1.0])
    operator.reset()
    np.testing.assert_array_equal(operator.run([3.0, -1.0]), first)


@given(histories)
def test_the_sum_takes_up_energy_around_every_loop(path):
    loop = refined([0.0, *path, 0.0], 10)
    out = make_sum().run(np.concatenate([loop, loop]))[len(loop) - 1 :]  # the second time round it is closed
    u = np.concatenate([loop[-1:], loop])
    assert (0.5 * (u[1:] + u[:-1]) * np.diff(out)).sum() > -1e-9


def test_a_stiff_wire_gives_pull_over_offset_and_length():
    tendon = Tendon(0.065, 4.3e-4, compliance_m_per_n=1e-12)
    assert tendon.step(1e-3) == pytest.approx(1e-3 / (1.1e-3 * 0.065), rel=1e-6)


@given(st.floats(1e-4, 3e-3), st.floats(0, 0.3), st.floats(0, 6))
def test_forces_on_the_tendon_balance(pull, friction, wrap):
    tendon = Tendon(0.04, 4.3e-4, friction=friction, wrap_rad=wrap)
    for way, sign in ((pull, 1), (0.3 * pull, -1)):
        curvature = tendon.step(way)
        assert tendon.tip_tension_n * 1.1e-3 == pytest.approx(4.3e-4 * curvature)
        assert 1.1e-3 * 0.04 * curvature + 1.1e-4 * tendon.tension_n == pytest.approx(way)
        if math.exp(-2 * friction * wrap) > 0.3:  # a return so long that the wire slides at its end
            assert tendon.tension_n / tendon.tip_tension_n == pytest.approx(math.exp(sign * friction * wrap))


def test_the_wire_sticks_before_it_slides_back():
    tendon = Tendon(0.04, 4.3e-4, friction=0.1, wrap_rad=3.0)
    curvature, tension = tendon.run([2e-3, 1.9e-3, 1.8e-3, 1e-3])
    assert curvature[0] == curvature[1] == curvature[2] > curvature[3]
    np.testing.assert_allclose(np.diff(tension[:3]), -1e-4 / 1.1e-4)


@given(st.lists(st.floats(-1e-3, 4e-3), min_size=1, max_size=10))
def test_pulling_round_a_loop_costs_work(path):
    loop = refined([0.0, *path, 0.0], 40)
    _, tension = Tendon(0.04, 4.3e-4, friction=0.1, wrap_rad=3.0).run(loop)
    assert (0.5 * (tension[1:] + tension[:-1]) * np.diff(loop)).sum() >= -1e-6


def test_a_slack_wire_neither_pulls_nor_bends():
    tendon = Tendon(0.04, 4.3e-4, friction=0.1, wrap_rad=3.0)
    curvature, tension = tendon.run([1e-3, 0.0, -1e-3])
    np.testing.assert_array_equal(curvature[1:], 0.0)
    np.testing.assert_array_equal(tension[1:], 0.0)


def test_the_nominal_knob_bends_by_half_a_turn_of_curvature_at_90_degrees():
    assert KnobMap().step(90.5) == pytest.approx(48.0, abs=0.05)


@given(histories.map(np.abs))
def test_a_tendon_without_friction_gives_the_nominal_curvature(path):
    with_tendon = KnobMap(tendon=Tendon(0.04, 4.3e-4))
    nominal = KnobMap().run(path)
    np.testing.assert_allclose(with_tendon.run(path), np.maximum(nominal, 0.0), atol=1e-9)


def test_friction_lags_behind_on_either_way():
    up, down = np.linspace(0, 60, 30), np.linspace(60, 0, 30)
    tendon = Tendon(0.04, 4.3e-4, friction=0.1, wrap_rad=3.0)
    knob = KnobMap(hysteresis=Play(0.0), tendon=tendon)
    assert (knob.run(up)[1:] < 0.533 * up[1:]).all()
    returned = knob.run(down)
    assert (returned[8:-1] > 0.533 * down[8:-1]).all()


@pytest.mark.parametrize(
    ("make", "match"),
    [
        (lambda: Play(-1.0), "width"),
        (lambda: Play(1.0).run([[1.0]]), "row"),
        (lambda: Play(1.0).run([np.nan]), "finite"),
        (lambda: Play(1.0).step(np.inf), "finite"),
        (lambda: PrandtlIshlinskii([0.0], [1.0]), "half_widths"),
        (lambda: PrandtlIshlinskii([1.0], [1.0, 2.0]), "weights"),
        (lambda: PrandtlIshlinskii([1.0], [np.inf]), "finite"),
        (lambda: PrandtlIshlinskii.from_loading_curve([1.0, 1.0], [1.0, 2.0]), "loading curve"),
        (lambda: Tendon(0.04, 4.3e-4, compliance_m_per_n=0.0), "tendon"),
        (lambda: Tendon(0.04, 4.3e-4, friction=-0.1), "friction"),
    ],
)
def test_what_has_no_meaning_is_refused(make, match):
    with pytest.raises(ValueError, match=match):
        make()
