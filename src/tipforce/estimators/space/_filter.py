"""The model of a session over time: each instant has its force, and some of them teach the constants.

As in the model of a session in the plane (`session`), constants are learnt from one instant in
`SpaceSettings.update_s`: errors of the model stay for many instants, and all of them together have little more
information on the constants than one.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from ...mechanics.spatial import SpatialRod, SpatialShapes
from ...types import DetectedShape, FloatArray, SessionInfo
from ..session import LINE_PX, MODES, LineError, NoiseLevel
from ._cameras import Reference, base_axes_px, camera_of, scale_at, toward_viewer, turns
from ._constants import DEPTH, FORCE, TURN, Constants, error_slopes
from ._direction import SpaceDirection
from ._mixture import SpaceForce, mixed_constants, mixed_force
from ._motion import LineMemory, ShownLine, whitened_with_motion
from ._posterior import Fit, Measurement, Nodes, Problem, fit, force_slopes, lay_grid
from ._settings import SpaceSettings
from ._view_pose import POSE_ERRORS, PoseError, PosePrior, probability_of

_LEAST_SHARE = 1e-6
"""No hypothesis is ever given up."""
_UNCLEAR = 0.1
"""An instant teaches the constants if the probability of contact is within this of 0 or 1."""
_GROWN = 1.5
"""The session starts again if the noise is found to be larger by this factor."""
_USUAL_MISFIT_RATIO, _USUAL_MISFIT_RATIO_XRAY = 1.0 / 3.0, 0.2
"""Usual misfit of `rod` over that of this model, both where the noise is as stated. In X-ray images most of the error
is new in each frame: with 1/3 the magnitude was off by 30 in place of 29 mN on 40 sessions of `biplane`."""
_CONFLICT = 2.0
"""Two lines whose common misfit is larger than this times the limit exclude each other: one is read alone."""
_EXCLUDED_S = 2.0
"""Where no rod explains the lines of both views for so long, this is no mistake in one image."""
_LEAST_POSE_PROBABILITY = 1e-6
"""Two views are not read together where an error of the stated pose as large as found is less probable than this."""
_WORSE = 2.0
"""A fit with a force whose cost is higher than without one by more than this is in a local minimum."""
_APART = 1.0
"""Two mirror images of the force are separate modes where they are further apart, in standard deviations."""


class ViewShape(NamedTuple):
    """A detected shape in one view, and the size of its image in px."""

    shape: DetectedShape
    size_px: tuple[int, int]


class SpaceResult(NamedTuple):
    """The force of one instant.

    Attributes:
        force: the force.
        misfit: mean square, of the better hypothesis, in the noise's variances.
        explained: whether the rod explains the lines.
        level: of the noise relative to the stated one.
        views: the views that the force is from: one, where the lines of two exclude each other.
        late_s: age in s of the image of those views whose next image is late.
        axes_px: (3, 2) directions of the base frame's axes in the image of each view, see `ShapeBeside`.
        tip_axis: (3,) unit vector along the tip, base frame.
        pose_is_wrong: whether the lines exclude the stated pose of the second view; it is not read then.
        excluded: whether no rod has explained the lines of both views for `_EXCLUDED_S`.
    """

    force: SpaceForce
    misfit: float
    explained: bool
    level: float
    views: tuple[str, ...]
    late_s: Mapping[str, float]
    axes_px: Mapping[str, FloatArray]
    tip_axis: FloatArray
    pose_is_wrong: bool
    excluded: bool


class _Solution(NamedTuple):
    """The posterior of some lines."""

    force: SpaceForce
    misfit: float
    free: Fit
    grids: list[Nodes]
    shares: list[FloatArray]
    directions: tuple[FloatArray, FloatArray]
    measurements: Sequence[Measurement]

    @property
    def tip_axis(self) -> FloatArray:
        """Axis of the tip of the most probable shape."""
        if not self.grids or self.force.contact < 0.5:
            return self.free.tip_axis
        best = max(self.grids, key=lambda nodes: float(nodes.log_weight.max()))
        return best.tip_axis[int(best.log_weight.argmax())]


@dataclass(frozen=True, eq=False)
class _Start:
    """Values that are fixed at the start of a session.

    Attributes:
        reference: frame of the base.
        pose: error of the second view's pose; None: the pose counts as exact.
        modes_px: the noise's modes of each view.
    """

    reference: Reference
    pose: PoseError | None
    modes_px: dict[str, FloatArray]


def rod_of(info: SessionInfo, segments: int) -> SpatialShapes:
    """Returns the shapes of the rod that the metadata state; the middle of its tip's dome is loaded.

    Args:
        info: the session metadata, with length and stiffness.
        segments: number of segments.
    """
    catheter = info.catheter
    assert catheter.flexible_length_m is not None
    assert catheter.bending_stiffness_nm2 is not None
    rigid = max(catheter.rigid_length_m or 0.0, 1e-6)  # without a rigid tip the last element is as good as nothing
    dome = min(rigid, 0.5 * (catheter.diameter_m or 0.0))
    rod = SpatialRod(
        catheter.flexible_length_m,
        catheter.bending_stiffness_nm2,
        rigid,
        precurvature_per_m=np.outer(catheter.rest_curvatures_per_m(segments + 1), [0.0, 0.0, 1.0]),
        stiffness_profile=catheter.stiffness_factors(segments + 1),
        segments=segments,
    )
    return SpatialShapes(rod, rigid - dome)


class SpaceFilter:
    """The state of one session; `step` takes its next lines.

    Args:
        settings: the settings.
        contact_share: share of frames in contact.
        info: the session metadata.
    """

    def __init__(self, settings: SpaceSettings, contact_share: float, info: SessionInfo) -> None:
        self._settings, self._contact_share, self._info = settings, contact_share, info
        self._shapes = rod_of(info, settings.segments)
        diameter = info.catheter.diameter_m or 0.0
        stiffness = self._shapes.rod.bending_stiffness_nm2
        self._lever_per_m_n = settings.prior.friction * 0.5 * diameter / stiffness  # moment over EI is a curvature
        self._level = NoiseLevel(settings.noise, settings.level_s)
        self._xray_error = LineError.of_xray(MODES)
        xray = info.view(settings.views[0]).modality == "xray"
        self._misfit_ratio = _USUAL_MISFIT_RATIO_XRAY if xray else _USUAL_MISFIT_RATIO
        self._pose_prior = PosePrior.of(info, settings.views)
        self._pose_is_wrong = False
        self._begun_factor = 1.0
        self.constants: Constants | None = None
        self._start: _Start | None = None
        self._share = contact_share
        self._direction, self._unlearnt_s = SpaceDirection(), math.inf
        self._waited_s, self._lost_s, self._excluded_s = math.inf, 0.0, 0.0
        self._lines, self._begun_with = LineMemory(), 0
        self._last: dict[str, tuple[FloatArray, FloatArray]] = {}  # last fit without ("free") and with force ("touch")

    def step(self, seen: Mapping[str, ViewShape], knob_deg: float, elapsed_s: float, advance_m: float) -> SpaceResult:
        """Returns the force at one instant, and learns from it.

        In this order: predict lines and constants to this time, fit the rod to the lines, then learn the level of the
        noise and, from some clear instants, the constants. Lines that exclude each other are read alone, one by one.

        Args:
            seen: found shapes by the name of their view; at least one. The line of a view that is absent is predicted.
            knob_deg: reading of the knob; NaN: not known.
            elapsed_s: time since the last instant.
            advance_m: advance of the clamp.
        """
        self._waited_s += elapsed_s
        self._unlearnt_s += elapsed_s
        self._lost_s += elapsed_s
        shown = {
            view: ShownLine.of(detected.shape, detected.shape.centreline, detected.size_px)
            for view, detected in seen.items()
            if detected.shape.centreline
        }
        lines = self._lines.at_next(elapsed_s, shown)
        first = self._settings.views[0]
        if self._pose_is_wrong and first in lines:
            lines = {first: lines[first]}
        cameras = {view: camera_of(self._info, view, each.size_px) for view, each in lines.items()}
        # where the first line of the second view comes later it shows the base in space
        if self.constants is None or self._lost_s > self._settings.gap_s or len(lines) > self._begun_with:
            self._begin(lines, cameras, knob_deg, advance_m)
        assert self.constants is not None
        self.constants.predict(elapsed_s, knob_deg)
        change = 1.0 - math.exp(-elapsed_s / self._settings.contact_s)
        share = self._share * (1.0 - change) + (1.0 - self._share) * change  # prior probability of contact
        problem = self._problem(lines, cameras, advance_m)
        log_odds = math.log(share / (1.0 - share))
        found = self._solve(problem, log_odds)
        if len(lines) > 1 and found.misfit > _CONFLICT * self._settings.max_misfit:
            parts = (replace(problem, measurements=[line]) for line in problem.measurements if not line.age_s)
            by_one_line = (self._solve(part, log_odds) for part in parts)
            found = next((solution for solution in by_one_line if self._explained(solution)), found)
        if len(lines) > 1:
            together = len(found.measurements) > 1 and self._explained(found)
            self._excluded_s = 0.0 if together else self._excluded_s + elapsed_s
        force, explained, level = found.force, self._explained(found), self._level.factor
        if explained:
            self._lost_s = 0.0
            self._share = min(1.0 - _LEAST_SHARE, max(_LEAST_SHARE, force.contact))
        if math.isfinite(found.misfit):
            self._level.add(self._misfit_ratio * found.misfit, elapsed_s)
        if self._level.factor > _GROWN * self._begun_factor:
            self._lost_s = math.inf  # the next instant begins the session again
        contact = force.contact > 0.5
        clear = abs(force.contact - float(contact)) < _UNCLEAR and (contact or found.free.ok)
        used = tuple(self._settings.views[each.place] for each in found.measurements)
        late_s = {view: lines[view].age_s for view in used if lines[view].overdue}
        teaches = len(used) > 1 or first in used
        if explained and clear and contact and self._settings.direction_s:
            self._direction.learn(*found.directions, self._unlearnt_s / self._settings.direction_s)
            self._unlearnt_s = 0.0
        if explained and clear and teaches and self._waited_s >= self._settings.update_s:
            # one view alone would teach the depth in one of its two mirror images
            self.constants.learn(
                *mixed_constants(found.grids, found.shares, found.free, contact=contact),
                held=() if len(used) > 1 else DEPTH,
            )
            self._waited_s = 0.0
            if len(used) > 1 and self._improbable_pose():  # the next instant begins the session again, in one view
                self._pose_is_wrong, self._lost_s = True, math.inf
        return SpaceResult(
            force, found.misfit, explained, level, used, late_s, self._axes_px(problem), found.tip_axis,
            self._pose_is_wrong, self._excluded_s > _EXCLUDED_S,
        )  # fmt: skip

    def _improbable_pose(self) -> bool:
        """Whether the constants have a pose of the second view that its stated uncertainty excludes."""
        if self.constants is None or self._pose_prior is None:
            return False
        pose = slice(-POSE_ERRORS, None)
        probability = probability_of(self.constants.mean[pose], self.constants.covariance[pose, pose])
        return probability < _LEAST_POSE_PROBABILITY

    def _axes_px(self, problem: Problem) -> dict[str, FloatArray]:
        """Returns the directions of the base frame's axes in the image of each view that has a line."""
        turn = turns(problem.mean[None, TURN : TURN + 3])[0][0]
        return {self._settings.views[each.place]: base_axes_px(each.camera, turn) for each in problem.measurements}

    def _explained(self, found: "_Solution") -> bool:
        return found.misfit <= self._settings.max_misfit and found.force.modes > 0

    def _solve(self, problem: Problem, log_odds: float) -> "_Solution":
        """Returns force, fits and misfit of some lines."""
        free, touch, grids = self._fit(problem)
        force, shares, directions = mixed_force(
            grids, free, log_odds, self._settings.prior.largest_force_n, self._direction
        )
        misfit = min((each.chi2 for each in (free, touch) if each and each.ok), default=math.inf) / problem.rows
        return _Solution(force, misfit, free, grids, shares, directions, problem.measurements)

    def _begin(
        self, lines: Mapping[str, ShownLine], cameras: Mapping[str, FloatArray], knob_deg: float, advance_m: float
    ) -> None:
        """Begins the session, at its first instant or again: finds the frame of the base, sets the constants' priors.

        Line and projection (3, 4) are by the name of the view. The origin is where the clamp is at an advance of 0.
        """
        views = self._settings.views
        prior = self._pose_prior
        self.constants = Constants(
            self._settings, self._info, views, knob_deg, several=len(lines) > 1, open_pose=prior is not None
        )
        order = [view for view in views if view in lines]
        size_px = lines[order[0]].size_px
        viewer = toward_viewer(camera_of(self._info, views[0], size_px), np.zeros(3))
        reference = Reference.of(
            [cameras[view] for view in order], [lines[view].line for view in order], self._shapes.rod.length_m, viewer
        )
        reference = replace(reference, origin_m=reference.origin_m - advance_m * reference.axes[:, 0])
        self._begun_factor, self._begun_with = self._level.factor, len(lines)
        self._start = _Start(reference, PoseError(prior, reference) if prior else None, {})
        self._share, self._waited_s, self._lost_s, self._last = self._contact_share, math.inf, 0.0, {}
        self._direction, self._unlearnt_s = SpaceDirection(), math.inf

    def _problem(self, lines: Mapping[str, ShownLine], cameras: Mapping[str, FloatArray], advance_m: float) -> Problem:
        """Returns lines and prior of an instant as the problem of its posterior, with the noise of each line.

        A line that is older than this instant is predicted and has more noise. ``cameras``: (3, 4) projections.
        """
        assert self.constants is not None
        assert self._start is not None
        information = np.zeros_like(self.constants.covariance)
        information[FORCE:, FORCE:] = np.linalg.inv(self.constants.covariance[FORCE:, FORCE:])
        measurements: list[Measurement] = []
        problem = Problem(
            self._shapes, measurements, self.constants.mean, information, self.constants.gain_per_m_deg,
            self.constants.knob_deg, self._lever_per_m_n, advance_m, self._settings.huber,
        )  # fmt: skip
        for place, view in enumerate(self._settings.views):
            if view not in lines:
                continue
            shown = lines[view]
            line = shown.line
            camera = self._start.reference.camera(cameras[view])
            # errors grow with the blur in pixels: a finer image than that in which they were measured has larger ones
            unit_px = max(1.0, self._shapes.rod.length_m * scale_at(camera, np.zeros(3)) / LINE_PX)
            if self._info.view(view).modality == "xray":
                error = self._xray_error.as_stated(shown.stated, 1.0 / unit_px)
                alone = self._settings.one_view_noise if len(lines) == 1 else 1.0
                error = error.at_level(alone * self._settings.xray_noise * self._level.factor)
            else:
                error = LineError.of(self._settings.noise, MODES, self._level.factor)
                # the amplitudes of the modes are unknowns: their unit stays for the session
                error = replace(error, modes=self._start.modes_px.setdefault(view, error.modes))
                error = error.beside(shown.stated, 1.0 / unit_px)
            middle = 0.5 * (np.array(shown.size_px) - 1.0)
            slopes = error_slopes(line.points, line.normals, middle, error.modes * unit_px)
            whiten = error.whiten / (unit_px * shown.noise_factor)
            pose = self._start.pose if place else None
            measurement = Measurement(place, line, camera, whiten, slopes, error.rows, shown.age_s, pose)
            if shown.age_s:
                q, shape = self._last.get("touch") or self._last.get("free") or (
                    problem.mean, self._shapes.unloaded(1)[0],
                )  # fmt: skip
                motion_per_n = force_slopes(problem, measurement, q, shape)
                whiten = whitened_with_motion(whiten, motion_per_n, shown.force_change_n(self._settings))
                measurement = replace(measurement, whiten=whiten)
            measurements.append(measurement)
        return problem

    def _fit(self, problem: Problem) -> tuple[Fit, Fit | None, list[Nodes]]:
        """Fits the rod without and with a force, and lays a grid of forces about each minimum with a force.

        A fit with a force starts from the last shape, then from others until it explains the lines. One view alone
        does not show on which side of its image's plane the force is: there a fit starts from the mirror image, too.

        Returns:
            The fit without a force; the fit with a force, None where no start explains the lines; the grids.
        """
        unloaded = self._shapes.unloaded(1)[0]
        start, shape = self._last.get("free", (problem.mean, unloaded))
        free = fit(problem, start, shape, contact=False)
        if free.ok:
            self._last["free"] = free.q, free.quaternions
        starts = [(free.q, free.quaternions), (problem.mean, unloaded)]
        if "touch" in self._last:
            starts.insert(0, self._last["touch"])
        touch: Fit | None = None
        for start, shape in starts:
            tried = fit(problem, start, shape, contact=True)
            if tried.ok and (touch is None or tried.cost < touch.cost):
                touch = tried
            if touch is not None and touch.cost < free.cost + _WORSE and self._explains(touch, problem):
                break
        if touch is None:
            self._last.pop("touch", None)
            return free, None, []
        largest_n = self._settings.prior.largest_force_n
        # the mirror image is excluded by lines of two views at this instant only
        alone = sum(not line.age_s for line in problem.measurements) == 1
        mirror = self._mirrored(problem, touch) if alone else None
        if mirror is not None and mirror.cost < touch.cost - 1.0:  # the first fit has not reached its minimum
            touch = self._mirrored(problem, mirror) or touch
        self._last["touch"] = touch.q, touch.quaternions
        nodes = lay_grid(problem, touch, largest_n)
        mirror_nodes = None if mirror is None else lay_grid(problem, mirror, largest_n)
        if nodes is not None and mirror_nodes is not None and mirror is not None:
            return free, touch, _each_on_its_side(nodes, mirror_nodes, touch.q[:FORCE], mirror.q[:FORCE])
        return free, touch, [grid for grid in (nodes, mirror_nodes) if grid is not None]

    def _explains(self, found: Fit, problem: Problem) -> bool:
        return found.chi2 <= self._settings.max_misfit * problem.rows

    def _mirrored(self, problem: Problem, touch: Fit) -> Fit | None:
        """Returns a second fit, from the force of the first one, ``touch``, mirrored in the image's plane.

        None where it is no separate one. The image is that of the first view that shows this instant.
        """
        shown = next(line for line in problem.measurements if not line.age_s)
        depth = toward_viewer(shown.camera, np.zeros(3))
        start = problem.mean.copy()
        force = touch.q[:FORCE]
        start[:FORCE] = force - 2.0 * (force @ depth) * depth
        quaternions = touch.quaternions.copy()
        quaternions[:, 1:3] *= -1.0  # a start only: the mirror image in the plane z = 0 of the base
        mirror = fit(problem, start, quaternions, contact=True)
        if not mirror.ok:
            return None
        distance_n = mirror.q[:FORCE] - force
        std_n = math.sqrt(max(1e-12, float(depth @ np.linalg.inv(touch.matrix)[:FORCE, :FORCE] @ depth)))
        return mirror if abs(distance_n @ depth) > _APART * std_n else None


def _each_on_its_side(first: Nodes, second: Nodes, first_n: FloatArray, second_n: FloatArray) -> list[Nodes]:
    """Returns two grids without overlap: each keeps the nodes that are nearer to its own best force (3,), N."""
    grids: list[Nodes] = []
    for nodes, own_n, other_n in ((first, first_n, second_n), (second, second_n, first_n)):
        middle_n, toward_own = 0.5 * (own_n + other_n), own_n - other_n
        nearer = (nodes.q[:, :FORCE] - middle_n) @ toward_own > 0.0
        if nearer.any():
            arrays = ("q", "cost", "covariance", "log_weight", "tip_axis")
            grids.append(replace(nodes, **{name: getattr(nodes, name)[nearer] for name in arrays}))
    return grids
