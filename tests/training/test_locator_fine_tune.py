"""Fine-tuning of the locator: annotated lines become windows, the seed decides, other benches are not forgotten."""

import math
from pathlib import Path

import numpy as np
import onnxruntime
import pytest

from tipforce.errors import ModelError
from tipforce.vision import locator as locator_package
from tipforce.vision.locator import ACROSS, ALONG, straightened, strip_input

torch = pytest.importorskip("torch")

from tipforce.training.locator import (  # noqa: E402
    HIDDEN,
    LABEL_POINTS,
    LINE_POINTS,
    OUTSIDE,
    PROMPT_FIELDS,
    SEEN,
    SIDES,
    WINDOW_PX,
    FineTuneSettings,
    LabelledImage,
    Locator,
    border_behind,
    fine_tune,
    fine_tune_line,
    graph_with_line_weights,
    labelled_line,
    line_network_from_graph,
    network_input,
    prompt_channels,
    random_scene,
    rehearsal_windows,
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


def test_among_other_instruments_a_prompt_always_says_which_one_is_meant():
    line, state = labelled_line(np.array([[-40.0, 60.0], [60.0, 62.0], [110.0, 80.0]]), SIZE, tip_hidden=False)
    image = np.full((*SIZE, 3), 120, np.uint8)
    labelled = LabelledImage(image, line, state, None, 0, 8.0, xray=True, ambiguous=True)
    rng = np.random.default_rng(1)
    windows = [window(random_scene(labelled, rng), rng) for _ in range(30)]
    prompts = ("base", "region", "tip", "clicks", "track")
    assert all(any(np.isfinite(getattr(each, name)).any() for name in prompts) for each in windows)
    marked = [each for each in windows if np.isfinite(each.base).all()]
    assert marked  # the base is outside: the prompt is where the catheter enters the image
    for each in marked:
        entry = each.line[np.flatnonzero(each.state != OUTSIDE)[0]]
        assert np.linalg.norm(each.base - entry) < 0.2 * WINDOW_PX


def test_an_image_without_a_catheter_has_no_point_in_its_windows():
    drawn = window(random_scene(example(0, present=False), np.random.default_rng(1)), np.random.default_rng(2))
    assert drawn.facts[0] == 0.0
    assert (drawn.state == OUTSIDE).all()


@pytest.fixture(scope="module")
def rehearsal() -> dict[str, np.ndarray]:
    return {name: values[::24] for name, values in rehearsal_windows().items()}


def test_the_stored_windows_are_of_composed_scenes_and_of_camera_and_x_ray_presets():
    stored = rehearsal_windows()
    assert stored["image"].shape[1:] == (WINDOW_PX, WINDOW_PX, 3)
    assert all(len(values) == len(stored["image"]) for values in stored.values())
    assert set(stored["facts"][:, 3]) == {0.0, 1.0, 2.0}
    on = [
        image[tuple(np.clip(np.rint(line[state == SEEN][:, ::-1]), 0, WINDOW_PX - 1).astype(int).T)].mean()
        for image, line, state in zip(stored["image"], stored["line"], stored["state"], strict=True)
        if (state == SEEN).any()
    ]
    assert np.std(on) > 20.0


@pytest.mark.slow
def test_the_seed_decides_and_the_frozen_part_stays(network, rehearsal):
    annotated = [example(0), example(1, present=False)]
    settings = FineTuneSettings(steps=2, batch=4)
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


@pytest.mark.slow
def test_the_loss_on_other_benches_holds_the_network_back(network, rehearsal):
    moved = [
        fine_tune(network, [example(0)], rehearsal, FineTuneSettings(steps=2, batch=4, rate=1e-3, kept_weight=weight))
        for weight in (0.0, 100.0)
    ]
    free, held = (_heat(each.network, rehearsal) for each in moved)
    before = _heat(network, rehearsal)
    assert (held - before).abs().mean() < (free - before).abs().mean()


def _heat(network: Locator, windows: dict[str, np.ndarray]) -> "torch.Tensor":
    channels = prompt_channels((WINDOW_PX, WINDOW_PX), *(torch.from_numpy(windows[name]) for name in PROMPT_FIELDS))
    with torch.inference_mode():
        return network(network_input(torch.from_numpy(windows["image"]), channels)).heat


def test_a_training_that_is_cancelled_raises_what_the_caller_raised(network, rehearsal):
    def cancel(_text: str, _share: float) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        fine_tune(network, [example(0)], rehearsal, FineTuneSettings(steps=2, batch=2), cancel)


def test_a_slow_computer_makes_fewer_steps(network, rehearsal):
    settings = FineTuneSettings(steps=100, batch=2, max_seconds=0.01)
    assert fine_tune(network, [example(0)], rehearsal, settings).steps == 8


LINE_GRAPH = Path(locator_package.__file__).with_name("refine.onnx")


def test_the_line_network_from_its_graph_computes_what_the_graph_computes(tmp_path: Path):
    network = line_network_from_graph(LINE_GRAPH)
    strip = torch.randn((1, 3, ACROSS, ALONG), generator=torch.Generator().manual_seed(2))
    path = tmp_path / "line.onnx"
    path.write_bytes(graph_with_line_weights(LINE_GRAPH.read_bytes(), network))
    session = onnxruntime.InferenceSession(str(path), providers=["CPUExecutionProvider"])
    with torch.inference_mode():
        expected = network(strip)
    for found, wanted in zip(session.run(None, {"strip": strip.numpy()}), expected, strict=True):
        assert np.abs(found - wanted.numpy()).max() < 1e-4


def test_another_file_is_no_line_network():
    with pytest.raises(ModelError, match="this is no graph of the line network"):
        line_network_from_graph(LINE_GRAPH.with_name("locator.onnx"))


def test_the_line_network_learns_that_an_annotated_line_is_the_catheter(rehearsal):
    network = line_network_from_graph(LINE_GRAPH)
    settings = FineTuneSettings(steps=12, batch=8, rate=2e-3, kept_weight=0.1)
    invisible = example(0)  # noise: the network before sees no catheter there
    tuned = fine_tune_line(network, [invisible, example(1, present=False)], rehearsal, settings)
    assert tuned.steps == 12
    strip = straightened(invisible.image, invisible.line_px, 6.0)
    values = torch.from_numpy(strip_input(strip.values, strip.inside))[None]
    with torch.inference_mode():
        before, after = network(values), tuned.network(values)
    assert after[5].mean() > before[5].mean()  # right
    assert after[4].mean() > before[4].mean()  # seen
