"""Play between knob and curvature: the laws of hysteresis that it obeys."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tipforce.mechanics import Play


def make_play():
    return Play(1.6)


angles = st.floats(-9, 9)
histories = st.lists(angles, max_size=8)


def refined(path, pieces):
    """The same path with ``pieces`` samples on each of its ways."""
    return np.interp(np.arange((len(path) - 1) * pieces + 1) / pieces, np.arange(len(path)), path)


@given(st.lists(angles, min_size=2, max_size=12), st.integers(2, 7))
def test_speed_does_not_matter(path, pieces):
    np.testing.assert_allclose(make_play().run(refined(path, pieces))[::pieces], make_play().run(path), atol=1e-12)


@given(histories)
def test_step_by_step_is_the_same_as_all_at_once(path):
    operator = make_play()
    np.testing.assert_array_equal([operator.step(value) for value in path], make_play().run(path))


@given(histories, histories)
def test_a_pause_between_two_runs_changes_nothing(first, second):
    parts = make_play()
    np.testing.assert_array_equal(
        np.concatenate([parts.run(first), parts.run(second)]), make_play().run(first + second)
    )


@given(histories, angles, angles, st.lists(st.floats(0, 1), max_size=5))
def test_a_closed_loop_wipes_itself_out(history, low, high, inside):
    # Return-point memory: whatever happens between the last two turns is forgotten when the last one is reached again.
    low, high = sorted((low, high))
    there, back = make_play(), make_play()
    there.run([*history, low, high])
    back.run([*history, low, high, *(low + share * (high - low) for share in inside), high])
    after = [high, low - 1.0, high + 1.0, 0.0, -9.0, 9.0]
    np.testing.assert_allclose(back.run(after), there.run(after), atol=1e-12)


@given(histories, histories, angles, angles)
def test_loops_between_the_same_turns_are_congruent(one, other, low, high):
    loop = refined([low, high, low], 20)
    shapes = []
    for history in (one, other):
        operator = make_play()
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


@pytest.mark.parametrize(
    ("make", "match"),
    [
        (lambda: Play(-1.0), "width"),
        (lambda: Play(1.0).run([[1.0]]), "row"),
        (lambda: Play(1.0).run([np.nan]), "finite"),
        (lambda: Play(1.0).step(np.inf), "finite"),
    ],
)
def test_what_has_no_meaning_is_refused(make, match):
    with pytest.raises(ValueError, match=match):
        make()
