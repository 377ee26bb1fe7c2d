"""The locator's training: drawn scenes are true to their labels, prompts are channels, the loss judges what it says."""

from pathlib import Path

import numpy as np
import pytest

torch = pytest.importorskip("torch")

from bench.locator import scene  # noqa: E402
from bench.locator.curves import curve  # noqa: E402
from bench.locator.line import average, found_lines  # noqa: E402
from bench.locator.tubes import Drawer  # noqa: E402

from tipforce.geometry import arc_length, resampled  # noqa: E402
from tipforce.training.locator import (  # noqa: E402
    CATHETER,
    CELLS,
    HIDDEN,
    INSTRUMENT,
    LABEL_POINTS,
    OUTSIDE,
    PROMPT_FIELDS,
    SEEN,
    WINDOW_FIELDS,
    WINDOW_PX,
    FoundLine,
    Scene,
    StripSource,
    graph_with_line_weights,
    line_loss,
    line_network_from_graph,
    strip_target,
    window,
    window_shapes,
)
from tipforce.training.locator import _strips as strips  # noqa: E402
from tipforce.vision.locator import straightened  # noqa: E402

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def scenes() -> list[Scene]:
    rng, drawer = np.random.default_rng(3), Drawer(WINDOW_PX, WINDOW_PX)
    return [scene.draw(rng, drawer, WINDOW_PX) for _ in range(24)]


def test_a_curve_is_uniform_in_arc_length_and_begins_along_x():
    for seed in range(20):
        points = curve(np.random.default_rng(seed), 100.0)
        steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
        assert np.allclose(steps, 100.0 / (LABEL_POINTS - 1))
        assert points[0].tolist() == [0.0, 0.0]
        assert abs(np.arctan2(points[1, 1], points[1, 0])) < 0.12


def test_seen_points_lie_on_pixels_of_the_catheter(scenes):
    on, seen = 0, 0
    for one in scenes:
        at = np.clip(np.rint(one.line).astype(int), 0, WINDOW_PX - 1)[one.state == SEEN]
        on += int((one.kind[at[:, 1], at[:, 0]] == CATHETER).sum())
        seen += len(at)
    assert seen > 500
    assert on > 0.95 * seen


def test_points_outside_of_the_image_are_said_to_be_outside(scenes):
    for one in scenes:
        beyond = ((one.line < -0.5) | (one.line > WINDOW_PX - 0.5)).any(axis=1)
        assert (one.state[beyond] == OUTSIDE).all()
        assert one.present or (one.state == OUTSIDE).all()


def test_the_same_seed_draws_the_same_scene():
    first, second = (scene.draw(np.random.default_rng(8), Drawer(WINDOW_PX, WINDOW_PX), WINDOW_PX) for _ in range(2))
    assert (first.image == second.image).all()
    assert (first.line == second.line).all()


def test_x_ray_scenes_are_grey_and_drawn_in_the_share_that_is_asked_for():
    rng, drawer = np.random.default_rng(4), Drawer(WINDOW_PX, WINDOW_PX)
    xray, camera = ([scene.draw(rng, drawer, WINDOW_PX, xray_share=share) for _ in range(8)] for share in (1.0, 0.0))
    tints = [np.array([np.ptp(each.image.mean(axis=(0, 1))) for each in drawn]) for drawn in (xray, camera)]
    assert tints[0].max() < 1.0
    assert np.median(tints[1]) > 5.0
    assert any((each.kind == INSTRUMENT).any() for each in xray)


def test_where_there_are_decoys_a_prompt_decides(scenes):
    rng = np.random.default_rng(0)
    with_decoys = [one for one in scenes if one.decoys]
    assert with_decoys
    for one in with_decoys * 5:
        drawn = window(one, rng)
        assert any(np.isfinite(getattr(drawn, name)).any() for name in ("base", "region", "tip", "clicks", "track"))


def test_a_window_has_the_shapes_that_the_feed_expects(scenes):
    drawn = window(scenes[0], np.random.default_rng(0))
    for name, (shape, kind) in window_shapes().items():
        assert getattr(drawn, name).shape == shape
        assert getattr(drawn, name).dtype == kind


def _batch(scenes):
    rng = np.random.default_rng(1)
    drawn = [window(one, rng) for one in scenes[:2]]
    return {name: torch.from_numpy(np.stack([getattr(each, name) for each in drawn])) for name in WINDOW_FIELDS}


def test_a_prompt_that_is_not_stated_leaves_its_channel_empty():
    from tipforce.training.locator import prompt_channels

    nan = float("nan")
    nothing = {
        "base": (1, 2), "region": (1, 4), "side": (1, 1), "tip": (1, 2), "clicks": (1, 5, 2), "track": (1, 16, 2),
        "sizes": (1, 2),
    }  # fmt: skip
    empty = {name: torch.full(shape, nan) for name, shape in nothing.items()}
    assert not prompt_channels((64, 96), **empty).any()
    clicked = prompt_channels((64, 96), **(empty | {"base": torch.tensor([[30.0, 20.0]])}))
    assert int(clicked[0, 0].argmax()) == 20 * 96 + 30
    assert not clicked[:, 1:].any()


def test_the_loss_is_least_for_heat_at_the_true_points(scenes):
    from bench.locator.train import heat_peaks

    from tipforce.training.locator import (
        HEATMAP_SIGMA_CELLS,
        LINE_POINTS,
        STRIDE_PX,
        LocatorOutputs,
        locator_loss,
    )

    one = next(s for s in scenes if s.present and (s.state == SEEN).all())
    batch = _batch([one, one])
    pick = np.round(np.linspace(0, LABEL_POINTS - 1, LINE_POINTS)).astype(int)
    heat = torch.empty(2, LINE_POINTS, CELLS, CELLS)
    rows, columns = np.mgrid[0:CELLS, 0:CELLS]
    for k, (u, v) in enumerate((one.line[pick] + 0.5) / STRIDE_PX - 0.5):
        heat[:, k] = torch.from_numpy(8.0 - ((columns - u) ** 2 + (rows - v) ** 2) / (2.0 * HEATMAP_SIGMA_CELLS**2))
    rest = [torch.zeros(shape) for shape in ((2, 5, CELLS, CELLS), (2, 5, CELLS, CELLS), (2, LINE_POINTS, 3), (2,))]
    truth = [batch[name] for name in ("line", "state", "kind", "facts")]
    right = locator_loss(LocatorOutputs(heat, *rest), *truth)[1]["heat"]
    wrong = locator_loss(LocatorOutputs(heat.flip(1), *rest), *truth)[1]["heat"]
    assert right < 0.5 * wrong
    points, mass = heat_peaks(heat)
    assert np.abs(points[0].numpy() - one.line[pick]).max() < STRIDE_PX
    assert float(mass.min()) > 0.8


def test_the_checkpoint_of_the_repository_finds_the_catheter_in_most_scenes(scenes):
    from bench.locator.train import figures, heat_peaks

    from tipforce.training.locator import locator_from_graph, network_input, prompt_channels

    network = locator_from_graph(ROOT / "src/tipforce/vision/locator/locator.onnx")
    rng = np.random.default_rng(5)
    drawn = [window(one, rng) for one in scenes if one.present][:12]
    batch = {name: torch.from_numpy(np.stack([getattr(each, name) for each in drawn])) for name in WINDOW_FIELDS}
    planes = prompt_channels((WINDOW_PX, WINDOW_PX), *(batch[name] for name in PROMPT_FIELDS))
    with torch.inference_mode():
        found = network(network_input(batch["image"], planes))
    assert heat_peaks(found.heat)[0].shape == (12, 16, 2)
    assert float(figures(found, batch)["points"].nanmean()) > 0.6


def test_the_mean_of_two_networks_has_the_mean_of_their_weights():
    from bench.locator.export import mean_network

    from tipforce.training.locator import Locator

    torch.manual_seed(0)
    one, other = Locator(), Locator()
    mean, first, second = (each.state_dict() for each in (mean_network(one, other), one, other))
    name = "encoder._conv_stem.weight"
    assert not torch.equal(first[name], second[name])
    assert torch.allclose(mean[name], 0.5 * (first[name] + second[name]))
    assert mean.keys() == first.keys()


def test_a_strip_of_a_scene_has_the_true_axis_and_ends(scenes):
    from tipforce.vision.locator import ALONG

    one = next(scene for scene in scenes if scene.present and (scene.state == SEEN).all())
    source = StripSource(one.image, one.line, one.state, one.diameter_px)
    rng = np.random.default_rng(3)
    drawn = [strip_target(source, rng) for _ in range(12)]
    right = [each for each in drawn if each.right > 0.5]
    assert len(right) > 3
    for each in right:
        assert np.abs(each.offset[each.asked]).max() < 1.5
        assert 0.0 < each.ends[0] < 0.4 * ALONG or each.ends[0] == -1.0
        assert each.ends[1] > 0.6 * ALONG
    wanted = {
        name: torch.from_numpy(np.stack([getattr(each, name) for each in drawn]))
        for name in ("offset", "asked", "seen", "judged", "ends", "right", "log_width")
    }
    zero = torch.zeros(12, ALONG)
    right = zero + (8.0 * wanted["right"] - 4.0)[:, None]
    true = (
        wanted["offset"], zero - 3.0, zero, zero, 8.0 * wanted["seen"] - 4.0, right,
        wanted["log_width"],
    )  # fmt: skip
    wrong = (
        wanted["offset"] + 0.5, zero - 3.0, zero, zero, 4.0 - 8.0 * wanted["seen"], -right,
        wanted["log_width"] + 0.5,
    )  # fmt: skip
    for k in (0, 4, 5, 6):
        false = (*true[:k], wrong[k], *true[k + 1 :])
        assert line_loss(true, wanted) < line_loss(false, wanted)


def test_wrong_lines_of_strips_are_not_exactly_on_an_axis(scenes, monkeypatch):
    """A line without errors across the shaft would be known as wrong by that alone."""
    one = next(scene for scene in scenes if scene.present and (scene.state == SEEN).all())
    lines: list[np.ndarray] = []

    def kept(image, line, diameter_px):
        lines.append(line)
        return straightened(image, line, diameter_px)

    monkeypatch.setattr(strips, "straightened", kept)
    monkeypatch.setattr(strips, "_elsewhere", lambda line, *_: line[::-1])
    monkeypatch.setattr(strips, "WRONG_SHARE", 1.0)
    rng = np.random.default_rng(4)
    for _ in range(6):
        strip_target(StripSource(one.image, one.line, one.state, one.diameter_px), rng)
    fine = resampled(one.line, 2000)
    off = [np.linalg.norm(line[10:-10, None] - fine, axis=2).min(axis=1).max() for line in lines]
    assert min(off) > 0.02 * one.diameter_px


def test_a_strip_without_its_catheter_is_wrong(scenes):
    one = next(scene for scene in scenes if scene.present and (scene.state == SEEN).all())
    empty = StripSource(
        np.full_like(one.image, 127), one.line, np.zeros_like(one.state), one.diameter_px, present=False
    )
    rng = np.random.default_rng(5)
    drawn = [strip_target(empty, rng) for _ in range(12)]
    assert all(each.right < 0.5 and not each.asked.any() and not each.seen.any() for each in drawn)


def test_lines_that_the_locator_found_are_judged_by_the_true_line(scenes, monkeypatch):
    """Right where they follow what is visible of the catheter, and end where its visible ends are."""
    one = next(scene for scene in scenes if scene.present and (scene.state == SEEN).all())
    monkeypatch.setattr(strips, "FOUND_SHARE", 1.0)
    rng = np.random.default_rng(6)

    def judged(line, true=one.line, state=one.state):
        found = (FoundLine(line, one.diameter_px),)
        drawn = strip_target(StripSource(one.image, true, state, one.diameter_px, found=found), rng)
        return float(drawn.right), drawn.ends

    right, ends = judged(one.line)
    assert right == 1.0
    assert min(ends) > 0.0
    assert judged(one.line[::-1])[0] == 0.0
    assert judged(one.line[: len(one.line) // 2])[0] == 0.0

    entering = np.column_stack([np.linspace(-30.0, 150.0, len(one.line)), np.full(len(one.line), 100.0)])
    inside = entering[:, 0] >= 0.0
    right, ends = judged(entering[inside], entering, np.where(inside, SEEN, OUTSIDE).astype(np.uint8))
    assert right == 1.0
    assert ends[0] == -1.0
    assert ends[1] > 0.0


def test_a_found_line_is_not_judged_by_its_hidden_end(scenes, monkeypatch):
    one = next(scene for scene in scenes if scene.present and (scene.state == SEEN).all())
    monkeypatch.setattr(strips, "FOUND_SHARE", 1.0)
    true = np.column_stack([np.linspace(40.0, 160.0, len(one.line)), np.full(len(one.line), 100.0)])
    leaves = true + np.outer(np.clip(true[:, 0] - 120.0, 0.0, None), (0.0, 1.0))  # by 45 degrees from u = 120 on

    def judged(first_hidden_px, line):
        state = np.where(true[:, 0] < first_hidden_px, SEEN, HIDDEN).astype(np.uint8)
        found = (FoundLine(line, 8.0),)
        drawn = strip_target(StripSource(one.image, true, state, 8.0, found=found), np.random.default_rng(8))
        return float(drawn.right), float(drawn.ends[1])

    assert judged(1000.0, leaves)[0] == 0.0
    assert judged(120.0, leaves) == (1.0, -1.0)
    assert judged(70.0, leaves)[0] == 0.0  # too little of it is visible
    assert judged(120.0, true[:, ::-1])[0] == 0.0


def test_the_locator_finds_lines_in_a_scene_with_random_prompts(scenes):
    one = next(scene for scene in scenes if scene.present and (scene.state == SEEN).all())
    found = found_lines(one.image, float(arc_length(one.line)[-1]), np.random.default_rng(7))
    assert 2 <= len(found) <= 4
    nearest = min(float(np.linalg.norm(line.points[[0, -1]] - one.line[[0, -1]], axis=1).max()) for line in found)
    assert nearest < 2.0 * one.diameter_px


def test_a_further_training_keeps_half_of_the_first_weights(tmp_path):
    begin = ROOT / "src/tipforce/vision/locator/refine.onnx"
    network = line_network_from_graph(begin)
    with torch.no_grad():
        network.head.weight += 1.0
    (tmp_path / "trained.onnx").write_bytes(graph_with_line_weights(begin.read_bytes(), network))
    average(begin, tmp_path / "trained.onnx")
    mean = line_network_from_graph(tmp_path / "trained.onnx")
    assert torch.allclose(mean.head.weight, network.head.weight - 0.5, atol=2e-3)
