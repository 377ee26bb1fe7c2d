"""Fine-tuning of the locator: annotated lines become windows, the seed decides, the frozen part stays."""

import math

import numpy as np
import pytest

torch = pytest.importorskip("torch")

from tipforce.training.locator import (  # noqa: E402
    HIDDEN,
    LABEL_POINTS,
    LINE_POINTS,
    OUTSIDE,
    SEEN,
    SIDES,
    WINDOW_PX,
    FineTuneSettings,
    LabelledImage,
    Locator,
    border_behind,
    fine_tune,
    labelled_line,
    random_scene,
    window,
)

SIZE = (120, 160)


def example(seed: int, *, present: bool = True) -> LabelledImage:
    rng = np.random.default_rng(seed)
    image = rng.integers(90, 140, (*SIZE, 3), dtype=np.uint8)
    line, state = labelled_line(np.array([[5.0, 60.0], [60.0, 62.0], [110.0, 80.0]]), SIZE, tip_hidden=False)
    mask = None if present else np.zeros(SIZE, np.bool_)
    state = state if present else np.full(LABEL_POINTS, OUTSIDE, np.uint8)
    return LabelledImage(image, line, state, mask, 0 if present else -1, math.nan, present=present)


@pytest.fixture(scope="module")
def network() -> Locator:
    torch.manual_seed(0)
    return Locator().eval()


def test_a_marked_line_becomes_even_points_with_a_hidden_tip():
    line, state = labelled_line(np.array([[0.0, 10.0], [10.0, 10.0], [100.0, 10.0]]), SIZE, tip_hidden=True)
    assert np.allclose(np.diff(line[:, 0]), 100.0 / (LABEL_POINTS - 1))
    assert state[-1] == HIDDEN
    assert (state[: -LABEL_POINTS // LINE_POINTS] == SEEN).all()


def test_points_outside_of_the_image_are_labelled_so():
    _, state = labelled_line(np.array([[80.0, 60.0], [200.0, 60.0]]), SIZE, tip_hidden=False)
    assert state[0] == SEEN
    assert state[-1] == OUTSIDE


@pytest.mark.parametrize(
    ("line", "side"),
    [
        ([[20, 60], [90, 60]], "left"),
        ([[140, 60], [60, 60]], "right"),
        ([[80, 10], [85, 100]], "top"),
        ([[80, 110], [80, 20]], "bottom"),
    ],
)
def test_the_border_behind_the_base_is_the_one_that_the_catheter_comes_from(line, side):
    assert SIDES[border_behind(np.array(line, np.float64), SIZE)] == side


def test_a_window_keeps_the_line_on_the_catheter():
    sample = example(0)
    image = np.full_like(sample.image, 200)
    for u, v in np.rint(sample.line_px).astype(int):
        image[v - 2 : v + 3, u - 2 : u + 3] = 20
    dark = LabelledImage(image, sample.line_px, sample.state, None, 0, 5.0)
    for seed in range(10):
        scene = random_scene(dark, np.random.default_rng(seed))
        on_line = scene.line[scene.state == SEEN]
        values = scene.image[tuple(np.clip(np.rint(on_line[:, ::-1]), 0, WINDOW_PX - 1).astype(int).T)].mean()
        assert abs(values - scene.image.mean()) > 30.0


def test_an_image_without_a_catheter_has_no_point_in_its_windows():
    drawn = window(random_scene(example(0, present=False), np.random.default_rng(1)), np.random.default_rng(2))
    assert drawn.facts[0] == 0.0
    assert (drawn.state == OUTSIDE).all()


def test_the_seed_decides_and_the_frozen_part_stays(network):
    annotated, rehearsal = [example(0), example(1, present=False)], [example(2)]
    settings = FineTuneSettings(steps=2, batch=4, trained="late")
    heard: list[float] = []
    before = {name: value.clone() for name, value in network.state_dict().items()}
    first = fine_tune(network, annotated, rehearsal, settings, lambda _text, share: heard.append(share))
    second = fine_tune(network, annotated, rehearsal, settings)
    assert first.steps == 2
    assert heard == [0.0, 0.5]
    again = second.network.state_dict()
    for name, value in first.network.state_dict().items():
        assert torch.isfinite(value.float()).all(), name
        assert torch.equal(value, again[name]), name
        assert torch.equal(before[name], network.state_dict()[name]), name
        frozen = name.startswith(("encoder._conv_stem", "encoder._blocks.3.")) or "running_" in name
        if frozen:
            assert torch.equal(value, before[name]), name
    assert not torch.equal(first.network.head.weight, network.head.weight)


def test_the_result_is_between_the_initial_and_the_trained_weights(network):
    trained, mixed = (
        fine_tune(network, [example(0)], [example(2)], FineTuneSettings(steps=1, batch=2, tuned_share=share)).network
        for share in (1.0, 0.5)
    )
    expected = 0.5 * (network.head.weight + trained.head.weight)
    assert torch.allclose(mixed.head.weight, expected, atol=1e-7)


def test_a_training_that_is_cancelled_raises_what_the_caller_raised(network):
    def cancel(_text: str, _share: float) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        fine_tune(network, [example(0)], [example(2)], FineTuneSettings(steps=2, batch=2), cancel)


def test_a_slow_computer_makes_fewer_steps(network):
    settings = FineTuneSettings(steps=100, batch=2, trained="decoder", max_seconds=0.01)
    assert fine_tune(network, [example(0)], [example(2)], settings).steps == 8
