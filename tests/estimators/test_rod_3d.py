"""Method `rod-3d`: the force in space from lines of one view or two."""

import math
from dataclasses import replace

import numpy as np
import pytest

from tipforce.errors import InputError
from tipforce.estimators import create
from tipforce.estimators._session_detection import DetectedLine
from tipforce.estimators.space import Rod3d, SpaceSettings, space
from tipforce.estimators.space._cameras import Reference, ViewLine, base_axes_px, turns
from tipforce.estimators.space._constants import (
    BEND_Y,
    BEND_Z,
    DEPTH,
    FIRST_VIEW,
    PLAY,
    SHAPE,
    Constants,
    errors_of_view,
)
from tipforce.estimators.space._direction import SpaceDirection
from tipforce.estimators.space._filter import SpaceFilter, SpaceResult, ViewShape, rod_of
from tipforce.estimators.space._mixture import mixed_force
from tipforce.estimators.space._motion import MAX_LINE_AGE_S, LineMemory, ShownLine, whitened_with_motion
from tipforce.estimators.space._posterior import Fit, Nodes, linearise
from tipforce.estimators.space._view_pose import POSE_ERRORS, probability_of
from tipforce.estimators.space._widths import SpaceWidths
from tipforce.estimators.space.space import SpaceStream
from tipforce.mechanics import SpatialRod, solve_static_spatial
from tipforce.types import (
    ActuationInfo,
    Catheter,
    CentrelinePx,
    DetectedShape,
    FloatArray,
    Observation,
    SessionInfo,
    Status,
    ViewInfo,
)

GAIN, KNOB_DEG, SIZE = 0.533, 20.0, (512, 512)
FORCE_N = np.array([-0.12, 0.06, 0.10])


def camera(degrees: float) -> ViewInfo:
    """A view that looks along z, turned about x; the base is at the image's left border, the origin in its middle."""
    cos, sin = float(np.cos(np.radians(degrees))), float(np.sin(np.radians(degrees)))
    right, up, back = np.eye(3)[0], np.array([0.0, cos, sin]), np.array([0.0, -sin, cos])
    focal, distance, middle = 2900.0, 0.72, 255.5
    depth = np.append(-back, distance)
    rows = [np.append(focal * right, 0.0) + middle * depth, np.append(-focal * up, 0.0) + middle * depth, depth]
    u, v, w = (tuple(map(float, row)) for row in rows)
    return ViewInfo(0.25e-3, "left", projection=(u, v, w), projection_frame="isocentre")  # type: ignore[arg-type]


INFO = SessionInfo(
    "s",
    Catheter("c", 2.33e-3, 45e-3, 8e-3, 5e-4, bending_stiffness_uncertainty=0.02, flexible_length_uncertainty=0.01),
    {"a": camera(0.0), "b": camera(85.0)},
    actuation=ActuationInfo(GAIN, knob_play_deg=0.5),
)


def with_pose(std_deg: float, std_m: float, off_deg: float = 0.0, off_m: float = 0.0) -> SessionInfo:
    """The metadata with a pose of the second view that is wrong, and its stated standard uncertainties."""
    view, wrong = INFO.view("b"), np.eye(4)
    wrong[:3, :3] = turns(np.radians([[off_deg, -off_deg, off_deg]]))[0][0]
    wrong[:3, 3] = [off_m, off_m, -off_m]
    u, v, w = (tuple(map(float, row)) for row in np.array(view.projection) @ wrong)
    stated = replace(view, projection=(u, v, w), pose_uncertainty_deg=(std_deg,) * 3, pose_uncertainty_m=(std_m,) * 3)
    return replace(INFO, views={"a": INFO.view("a"), "b": stated})


def nodes_m(force_n: FloatArray) -> FloatArray:
    """The true curve in the frame of the projections; the base is 60 mm left of the origin."""
    bend = np.array([0.0, 1.5, GAIN * KNOB_DEG])
    rod = SpatialRod(45e-3, 5e-4, 8e-3, precurvature_per_m=bend, stiffening_curvature_per_m=45.0, segments=48)
    shape = solve_static_spatial(rod, force_n)
    return shape.centreline_m(np.linspace(0.0, rod.length_m, 64)) - [60e-3, 0.0, 0.0]


def seen(force_n: FloatArray, rng: np.random.Generator, views: tuple[str, ...] = ("a", "b")) -> dict[str, ViewShape]:
    found: dict[str, ViewShape] = {}
    for view in views:
        u, v, w = np.array(INFO.view(view).projection) @ np.column_stack([nodes_m(force_n), np.ones(64)]).T
        points = np.column_stack([u / w, v / w]) + rng.normal(0.0, 0.02, (64, 2))
        found[view] = ViewShape(DetectedShape(Status.VALID, centreline=CentrelinePx(points)), SIZE)
    return found


def session(
    views: tuple[str, ...],
    forces_n: list[FloatArray],
    shown: list[tuple[str, ...]],
    step_s: float = 0.07,
    info: SessionInfo = INFO,
) -> list[SpaceResult]:
    """The lines are those of the views of `INFO`; ``info`` may state other ones."""
    rng = np.random.default_rng(3)
    model = SpaceFilter(SpaceSettings(views=views), 0.5, info)
    return [
        model.step(seen(force, rng, each), KNOB_DEG, step_s if k else 0.0, 0.0)
        for k, (force, each) in enumerate(zip(forces_n, shown, strict=True))
    ]


def width_n(result: SpaceResult) -> FloatArray:
    return result.force.high_n - result.force.low_n


def test_two_views_give_the_force_in_space() -> None:
    free = np.zeros(3)
    *_, before, contact = session(("a", "b"), [free] * 4 + [FORCE_N], [("a", "b")] * 5)
    assert before.force.contact < 0.1
    assert np.linalg.norm(before.force.force_n) < 5e-3
    assert contact.explained
    assert contact.force.contact > 0.99
    true = np.append(FORCE_N, np.linalg.norm(FORCE_N))
    assert np.abs(contact.force.force_n - FORCE_N)[1:].max() < 0.02
    outside = np.maximum(contact.force.low_n - true, true - contact.force.high_n)
    assert outside.max() < 0.01, "a 90 % interval may miss, by little"
    assert contact.force.modes == 1
    along = nodes_m(FORCE_N)[-1] - nodes_m(FORCE_N)[-2]
    assert contact.tip_axis @ along / np.linalg.norm(along) > 0.999


def test_a_view_that_drops_out_widens_the_interval() -> None:
    """First its line is predicted, 70 and 140 ms ahead; then there is one view alone."""
    forces, both = [np.zeros(3)] * 4 + [FORCE_N] * 6, ("a", "b")
    kept = session(both, forces, [both] * 10)[-4:]
    *predicted, late, alone = session(both, forces, [both] * 6 + [("a",)] * 4)[-4:]
    assert all(each.explained for each in (*predicted, late, alone))
    assert [each.views for each in (*predicted, late, alone)] == [both, both, ("a",), ("a",)]
    assert [dict(each.late_s) for each in predicted] == [{}, {"b": pytest.approx(0.14)}]
    shares = [width_n(lost)[2] / width_n(there)[2] for lost, there in zip((*predicted, late, alone), kept, strict=True)]
    assert 1.0 < shares[0] < shares[1] < shares[3]
    assert shares[3] > 3.0
    for each in (*predicted, late, alone):
        assert each.force.low_n[2] <= FORCE_N[2] <= each.force.high_n[2]


def test_views_exposed_in_turn_give_the_force_in_space() -> None:
    """The force rises steadily; each instant shows one view, and the line of the other one is predicted."""
    forces = [FORCE_N * min(1.0, max(0.0, (k - 6) / 6)) for k in range(13)]
    found = session(("a", "b"), forces, [("a",), ("b",)] * 6 + [("a",)], step_s=0.035)
    for each, force in zip(found[-4:], forces[-4:], strict=True):
        assert each.views == ("a", "b")
        assert not each.late_s
        assert abs(each.force.force_n[2] - force[2]) < 0.02
        assert each.force.low_n[2] - 0.005 <= force[2] <= each.force.high_n[2] + 0.005
    alone = session(("a", "b"), forces, [("a",)] * 13, step_s=0.035)[-1]
    assert width_n(found[-1])[2] < 0.5 * width_n(alone)[2]


def test_a_predicted_line_is_as_unsure_as_the_motion_that_is_expected() -> None:
    shapes = [seen(force, np.random.default_rng(0))["b"] for force in (np.zeros(3), FORCE_N)]
    lines = [ShownLine.of(each.shape, each.shape.centreline, SIZE) for each in shapes if each.shape.centreline]
    memory, settings = LineMemory(), SpaceSettings()
    memory.at_next(0.0, {"b": lines[0]})
    (last,) = memory.at_next(0.03, {}).values()
    assert np.array_equal(last.line.points, lines[0].line.points)
    assert (last.noise_factor, last.force_change_n(settings)) == (1.0, pytest.approx(0.03))
    memory.at_next(0.03, {"b": lines[1]})
    (ahead,) = memory.at_next(0.03, {}).values()
    assert np.allclose(ahead.line.points, 1.5 * lines[1].line.points - 0.5 * lines[0].line.points)
    assert ahead.noise_factor == pytest.approx(np.hypot(1.5, 0.5))
    assert ahead.force_change_n(settings) == pytest.approx(0.5 * 10.0 * 0.03 * 0.09)
    assert memory.at_next(MAX_LINE_AGE_S, {}) == {}


def test_the_noise_with_motion_is_that_of_line_and_force() -> None:
    rng = np.random.default_rng(0)
    root = np.tril(rng.normal(size=(5, 5))) + 3.0 * np.eye(5)
    slopes = rng.normal(size=(5, 3))
    whiten = whitened_with_motion(np.linalg.inv(root), slopes, 0.7)
    assert np.allclose(whiten @ (root @ root.T + 0.49 * slopes @ slopes.T) @ whiten.T, np.eye(5))


def test_the_directions_of_the_base_frame_in_an_image() -> None:
    ahead = base_axes_px(np.array(INFO.view("a").projection), np.eye(3))
    across = base_axes_px(np.array(INFO.view("b").projection), np.eye(3))
    assert np.allclose(ahead, [[1.0, 0.0], [0.0, -1.0], [0.0, 0.0]], atol=1e-3)
    cos, sin = np.cos(np.radians(85.0)), np.sin(np.radians(85.0))
    assert np.allclose(across, [[1.0, 0.0], [0.0, -cos], [0.0, -sin]], atol=1e-3)


def test_a_pose_that_is_wrong_within_its_stated_uncertainty_keeps_the_interval_honest() -> None:
    forces, shown = [np.zeros(3)] * 4 + [FORCE_N], [("a", "b")] * 5
    exact, tight, wide = (
        session(("a", "b"), forces, shown, info=info)[-1]
        for info in (INFO, with_pose(0.5, 0.5e-3), with_pose(2.0, 2e-3, off_deg=2.0, off_m=2e-3))
    )
    for found in (exact, tight, wide):
        assert found.explained
        assert len(found.views) == 2
        assert found.force.low_n[2] - 5e-3 <= FORCE_N[2] <= found.force.high_n[2] + 5e-3
    assert width_n(exact)[2] < width_n(tight)[2] < width_n(wide)[2]


def test_a_distance_that_is_not_well_known_widens_the_scale_of_the_first_view() -> None:
    view = replace(INFO.view("a"), pose_uncertainty_m=(0.0, 0.0, 20e-3), metres_per_px_uncertainty=0.05)
    info = replace(INFO, views={"a": view, "b": replace(INFO.view("b"), metres_per_px_uncertainty=0.04)})
    constants = Constants(SpaceSettings(), info, ("a", "b"), KNOB_DEG, several=True)
    scales = [float(np.sqrt(constants.covariance.diagonal()[errors_of_view(place)][2])) for place in range(2)]
    assert scales == pytest.approx([0.05, 0.04], rel=0.01)
    both = replace(view, metres_per_px_uncertainty=None)
    constants = Constants(SpaceSettings(), replace(INFO, views={"a": both}), ("a",), KNOB_DEG, several=False)
    assert np.sqrt(constants.covariance.diagonal()[errors_of_view(0)][2]) == pytest.approx(20e-3 / 0.72, rel=0.01)


@pytest.mark.parametrize(("off_deg", "std_deg"), [(10.0, 0.05), (20.0, 0.0)], ids=["stated", "not stated"])
def test_a_pose_that_does_not_fit_the_lines_is_reported(
    off_deg: float, std_deg: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    info = with_pose(std_deg, 1e-3 * std_deg, off_deg=off_deg, off_m=1e-3 * off_deg)
    stream = create("rod-3d").for_views(("a", "b")).start(info)
    assert isinstance(stream, SpaceStream)
    rng, image = np.random.default_rng(3), np.zeros((512, 512), np.uint8)
    detail = ""
    for k in range(4 if std_deg else 3):
        for view, each in seen(np.zeros(3), rng).items():
            line = DetectedLine(each.shape, each.shape.centreline, SIZE, "left", 0.25e-3, 0.0)  # type: ignore[arg-type]
            monkeypatch.setattr(stream._detections[view], "read", lambda _, line=line: line)
        observation = Observation(k * 1_500_000_000, {"a": image, "b": image}, {"knob_deg": KNOB_DEG})
        detail = stream.update(observation).detail
    assert "`tipforce calibrate RECORDING --views`" in detail
    if std_deg:
        assert "from the view a alone" in detail
        assert "the lines of a and b do not fit the stated pose of b" in detail
    else:
        assert "views.b.projection is" in detail


def test_an_interval_is_open_where_the_grid_ends_on_a_push_that_explains_the_lines() -> None:
    pushes = np.zeros((5, FIRST_VIEW))
    pushes[:, 0] = [-0.1, -0.14, -0.18, -0.22, -0.26]
    free = Fit(np.zeros(FIRST_VIEW), np.zeros((1, 4)), 50.0, 50.0, np.eye(FIRST_VIEW), np.array([1.0, 0.0, 0.0]), True)
    ends: list[float] = []
    for last_cost in (0.5, 5.0):
        cost = np.array([0.0, 0.0, 0.1, 0.2, last_cost])
        covariance = np.tile(1e-6 * np.eye(FIRST_VIEW), (5, 1, 1))
        nodes = Nodes(np.eye(3), 1, 0.04, pushes, cost, covariance, -cost, np.tile([1.0, 0.0, 0.0], (5, 1)))
        force, *_ = mixed_force([nodes], free, 0.0, 0.8, SpaceDirection())
        ends.append(float(force.high_n[3]))
        assert force.low_n[0] == pytest.approx(-force.high_n[3], abs=1e-3)
    assert ends == [0.8, pytest.approx(0.222, abs=2e-3)]


def test_the_probability_of_a_pose_counts_only_what_the_lines_show() -> None:
    shown = np.diag([0.1, 0.2, 1.0, 1.0, 1.0, 1.0])
    assert probability_of(np.array([0.0, 0.0, 9.0, 9.0, 9.0, 9.0]), shown) == 1.0
    assert probability_of(np.array([5.0, 0.0, 0.0, 0.0, 0.0, 0.0]), shown) < 1e-5
    assert probability_of(np.array([9.0, 0.0, 0.0, 0.0, 0.0, 0.0]), np.eye(6)) == 1.0


def test_a_wrong_line_in_one_view_is_left_out() -> None:
    rng = np.random.default_rng(3)
    model = SpaceFilter(SpaceSettings(views=("a", "b")), 0.5, INFO)
    for k in range(4):
        model.step(seen(np.zeros(3), rng), KNOB_DEG, 0.07 if k else 0.0, 0.0)
    shapes = seen(FORCE_N, rng)
    line = shapes["b"].shape.centreline
    assert line is not None
    short = DetectedShape(Status.VALID, centreline=CentrelinePx(line.points[:40]))
    found = model.step(shapes | {"b": ViewShape(short, SIZE)}, KNOB_DEG, 0.07, 0.0)
    assert found.explained
    assert found.views == ("a",)
    assert found.force.low_n[2] <= FORCE_N[2] <= found.force.high_n[2]


def test_one_view_keeps_both_mirror_images_of_the_depth() -> None:
    force_n = 2.0 * FORCE_N
    *_, contact = session(("a",), [np.zeros(3)] * 4 + [force_n], [("a",)] * 5)
    assert contact.explained
    assert contact.force.modes == 2
    assert contact.force.low_n[2] < -0.05
    assert contact.force.high_n[2] > force_n[2]
    assert contact.force.low_n[1] <= force_n[1] <= contact.force.high_n[1] + 0.01


@pytest.mark.parametrize("info", [INFO, with_pose(2.0, 2e-3)], ids=["exact pose", "unsure pose"])
def test_derivatives_of_the_residuals_are_those_of_differences(info: SessionInfo) -> None:
    model = SpaceFilter(SpaceSettings(views=("a", "b")), 0.5, info)
    shapes = seen(FORCE_N, np.random.default_rng(0))
    model.step(shapes, KNOB_DEG, 0.0, 0.0)
    lines = {
        view: ShownLine.of(each.shape, each.shape.centreline, SIZE)
        for view, each in shapes.items()
        if each.shape.centreline
    }
    cameras = {view: np.array(info.view(view).projection) for view in lines}
    problem = model._problem(lines, cameras, 0.0)
    here = problem.mean.copy()
    here[:3] = FORCE_N
    if info is not INFO:
        here[-POSE_ERRORS:] = [0.8, -0.6, 0.4, -0.5, 0.7, -0.9]
    steps = np.full(here.size, 1e-4)
    steps[SHAPE - 1], steps[SHAPE : SHAPE + 3] = 1e-7, 1e-7
    quaternions = model._shapes.unloaded(1)
    linear = linearise(problem, here[None], quaternions.copy())
    for k in range(here.size):
        around = here + np.outer([1.0, -1.0], np.eye(here.size)[k] * steps[k])
        cost = linearise(problem, around, np.tile(quaternions, (2, 1, 1))).cost
        most = math.sqrt(2.0 * linear.cost[0] * linear.matrix[0, k, k])  # if all residuals were along the slopes
        assert linear.side[0, k] == pytest.approx((cost[1] - cost[0]) / (2.0 * steps[k]), abs=0.05 + 1e-3 * most), k


def test_the_turn_of_the_base_has_exact_derivatives() -> None:
    angles = np.array([[0.1, -0.2, 0.3]])
    whole, slopes = turns(angles)
    assert np.allclose(whole[0] @ whole[0].T, np.eye(3))
    for axis in range(3):
        ahead, behind = (turns(angles + sign * 1e-6 * np.eye(3)[axis])[0] for sign in (1.0, -1.0))
        assert np.allclose(slopes[0, axis], (ahead - behind)[0] / 2e-6, atol=1e-8)


def test_the_base_is_found_from_the_first_lines() -> None:
    shapes = seen(np.zeros(3), np.random.default_rng(0))
    lines = [ViewLine.of(each.shape.centreline) for each in shapes.values() if each.shape.centreline]
    cameras = [np.array(INFO.view(view).projection) for view in shapes]
    found = Reference.of(cameras, lines, 53e-3, np.array([0.0, 0.0, 1.0]))
    assert np.abs(found.origin_m - [-60e-3, 0.0, 0.0]).max() < 1.5e-3
    assert np.degrees(np.arccos(np.clip(np.diag(found.axes), -1.0, 1.0))).max() < 3.0


def test_an_uncertain_knob_and_tilt_are_in_the_prior() -> None:
    known = Constants(SpaceSettings(views=("a", "b")), INFO, ("a", "b"), KNOB_DEG, several=True)
    unknown = Constants(SpaceSettings(views=("a", "b")), INFO, ("a", "b"), float("nan"), several=True)
    assert np.sqrt(np.diag(known.covariance))[4] < 0.5 < 5.0 < np.sqrt(np.diag(unknown.covariance))[4]
    assert rod_of(INFO, 16).rod.length_m == pytest.approx(53e-3)


def test_the_mechanism_stays_until_the_knob_has_crossed_its_play() -> None:
    constants = Constants(SpaceSettings(views=("a", "b")), INFO, ("a", "b"), 10.0, several=True)
    mechanism_deg: list[float] = []
    for knob_deg in (15.0, 14.9, 14.6, 14.4, 14.0):
        constants.predict(0.07, knob_deg)
        mechanism_deg.append(knob_deg + float(constants.mean[PLAY]))
    assert mechanism_deg == pytest.approx([14.75, 14.75, 14.75, 14.65, 14.25], abs=0.1)
    assert math.sqrt(constants.covariance[PLAY, PLAY]) < 0.15


def test_it_reads_the_first_two_views_unless_others_are_stated() -> None:
    method = create("rod-3d")
    assert method.for_views(("camera",)) is method
    assert method.for_views(("a", "b", "c")).views == ("a", "b")
    assert method.for_views(("b",)).views == ("b",)
    stated = create("rod-3d", {"views": ["a", "c"]})
    assert stated.for_views(("a", "b", "c")).views == ("a", "c")
    with pytest.raises(InputError, match="there is no view 'c'; there are a and b, and rod-3d reads the views a and c"):
        stated.for_views(("a", "b"))


def test_missing_metadata_are_named() -> None:
    method = create("rod-3d").for_views(("a", "b"))
    without = INFO.only(key for key in INFO.stated_keys() if key != "views.b.projection")
    assert "views.b.projection is not stated" in method.obstacle(without)
    estimate = method.start(without).update(Observation(0, {}, {}))
    assert estimate.status is Status.MISSING_INPUT
    assert "views.b.projection" in estimate.detail
    frames = SessionInfo.from_values({"views": {"b": {"projection_frame": "base"}}})
    assert "views.b.projection_frame is base" in method.obstacle(INFO.updated(frames))
    assert method.obstacle(INFO) == ""


def test_an_instant_without_images_is_refused() -> None:
    stream = create("rod-3d").for_views(("a", "b")).start(INFO)
    estimate = stream.update(Observation(0, {}, {"knob_deg": KNOB_DEG}))
    assert estimate.status is Status.MISSING_INPUT
    assert "no image of this instant" in estimate.detail


def test_a_saved_method_keeps_its_intervals_and_its_share_of_contact() -> None:
    method = Rod3d()
    method.fitted_ = replace(method.fitted_, contact_share=0.3, widths=SpaceWidths((1.1, 1.2, 1.3, 1.4), "8 sessions"))
    again = Rod3d.from_state({}, *method.state())
    assert again.fitted_ == method.fitted_
    assert again.unfitted().fitted_ == Rod3d().fitted_
    assert again.describe().interval_basis == "8 sessions"


def test_one_view_does_not_teach_the_depth() -> None:
    constants = Constants(SpaceSettings(), INFO, ("a",), KNOB_DEG, several=False)
    before, mean = constants.covariance.copy(), constants.mean.copy()
    mean[list(DEPTH)] += 1.0
    mean[BEND_Z] += 0.5
    taught = 0.25 * before
    taught[BEND_Z, BEND_Y] = taught[BEND_Y, BEND_Z] = 0.02 * taught[BEND_Y, BEND_Y]
    constants.learn(mean, taught, held=DEPTH)
    own = np.ix_(DEPTH, DEPTH)
    assert np.allclose(constants.mean[list(DEPTH)], 0.0)
    assert np.allclose(constants.covariance[own], before[own])
    # the bend in the plane follows the bend out of it, which was 1 higher, by 0.02
    assert constants.mean[BEND_Z] == pytest.approx(0.5 - 0.02)
    assert constants.covariance[BEND_Z, BEND_Y] == pytest.approx(0.02 * before[BEND_Y, BEND_Y])
    assert np.linalg.eigvalsh(constants.covariance[3:, 3:]).min() > 0.0


def test_a_session_does_not_begin_with_the_second_view_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    stream = create("rod-3d").for_views(("a", "b")).start(INFO)
    assert isinstance(stream, SpaceStream)
    shape = seen(np.zeros(3), np.random.default_rng(0))["b"].shape
    line = DetectedLine(shape, shape.centreline, SIZE, "left", 0.25e-3, 0.0)  # type: ignore[arg-type]
    monkeypatch.setattr(stream._detections["b"], "read", lambda _: line)
    image = np.zeros((512, 512), np.uint8)
    estimate = stream.update(Observation(0, {"b": image}, {"knob_deg": KNOB_DEG}))
    assert estimate.status is Status.MISSING_INPUT
    assert "a: no image of this instant (a session begins with a line in a" in estimate.detail


def test_images_at_hand_resolve_the_detection_in_each_view(monkeypatch: pytest.MonkeyPatch) -> None:
    given: list[tuple[str, int]] = []
    monkeypatch.setattr(
        space, "SessionDetection", lambda settings, _, images: given.append((settings.view, len(images)))
    )
    method, image = create("rod-3d").for_views(("a", "b")), np.zeros((64, 64), np.uint8)
    method.start_on(INFO, {"a": [image] * 3, "b": [image] * 2})
    method.start(INFO, [image])
    assert given == [("a", 3), ("b", 2), ("a", 1), ("b", 0)]
