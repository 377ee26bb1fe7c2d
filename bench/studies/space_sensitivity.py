"""Sensitivity of `rod-3d` on true lines of simulated `biplane` sessions, to which measured noise is added.

    .venv/bin/python -m bench.studies.space_sensitivity --seed 76000 --sessions 10 --out DIR
    .venv/bin/python -m bench.studies.space_sensitivity --seed 108000 109000 --sessions 20 --cases base --out DIR

No image is drawn and nothing is detected: the true axis of the catheter is projected into both views. Its error is as
measured in X-ray images (`XRAY_FRESH_PX`, `XRAY_LASTING_PX`), fresh in each frame and lasting, times a factor. Its
covariance is stated with the line, as the locator does. The sessions are the same in all cases. Cases: angle between
the views; error of the second view's turn, drawn with this standard deviation about its right and its down and half of
it about the viewing direction, stated as uncertainty or not; factor of the noise; frame rate; the second view lost from
7.5 s on. Words and columns: `space_sessions`. The rows of each session and case are written as soon as they are done,
and are not computed again.
"""

import argparse
import json
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path

import numpy as np
from bench.studies.space_sessions import line, table
from scipy.interpolate import CubicSpline

from tipforce.estimators.session import LINE_PX, XRAY_FRESH_PX, XRAY_LASTING_PX
from tipforce.estimators.space import SpaceSettings
from tipforce.estimators.space._filter import SpaceFilter, ViewShape
from tipforce.estimators.space._widths import SpaceWidths
from tipforce.geometry import CameraModel, Pose
from tipforce.mechanics import LineNoise
from tipforce.simulation import PRESETS, SimulatedBench
from tipforce.types import CentrelinePx, DetectedShape, FloatArray, IntArray, SessionInfo, Status

POINTS = 65
LOST_FROM_S = 7.5
FREE_S, FREE_STEP = 4.5, 5
"""Before this time nothing touches the tip, and one frame of five is read."""


@dataclass(frozen=True)
class Case:
    """How the lines of a session are made and read; ``between_deg`` None: as the session has it."""

    between_deg: float | None = None
    turn_deg: float = 0.0
    shift_m: float = 0.0
    stated: float = 0.0
    noise: float = 1.0
    fps: float = 15.0
    lost: bool = False
    peak_n: tuple[float, float] | None = None


CASES = {
    "base": Case(),
    **{f"{angle} degrees": Case(between_deg=angle) for angle in (15, 30, 45, 60, 90)},
    **{
        f"off by {turn} degrees, {'stated' if stated else 'not stated'}": Case(turn_deg=turn, stated=stated)
        for turn in (1, 2, 3)
        for stated in (1.0, 0.0)
    },
    "exact, 2 degrees stated": Case(turn_deg=2e-9, stated=1e9),
    "2 degrees and 2 mm, stated": Case(turn_deg=2, shift_m=2e-3, stated=1.0),
    "2 degrees and 2 mm, not stated": Case(turn_deg=2, shift_m=2e-3),
    **{f"noise {noise}": Case(noise=noise) for noise in (0.5, 2, 4)},
    "7.5 frames/s": Case(fps=7.5),
    "view b lost": Case(lost=True),
    "large forces": Case(peak_n=(0.35, 0.6)),
}


@dataclass(frozen=True)
class TrueSession:
    """A session: instants (n,), forces (n, 3), axes (n, points, 3) in the frame of the projections, knob, metadata."""

    time_s: FloatArray
    force_n: FloatArray
    line_m: FloatArray
    tip_axis: FloatArray
    knob_deg: FloatArray
    info: SessionInfo


def true_session(seed: int, number: int, seconds: float, peak_n: tuple[float, float] | None) -> TrueSession:
    """Simulates a session; its cameras are exactly as stated."""
    preset = PRESETS["biplane"]
    world = preset.world.model_copy(update={"seconds": seconds})
    if peak_n:
        world = world.model_copy(update={"motion": world.motion.model_copy(update={"peak_force_n": peak_n})})
    bench = SimulatedBench(preset.model_copy(update={"world": world}), seed, number)
    return session_of(bench, np.arange(len(bench.frame_s)))


def session_of(bench: SimulatedBench, frames: IntArray) -> TrueSession:
    """Returns some frames of a simulated session."""
    times, when, trajectory = bench.frame_s[frames], bench.interpolator, bench.session.trajectory
    lines = when.lines_m(times)
    axis = lines[:, -1] - lines[:, -3]
    pose = bench.imaging.scene.patient_from_base
    return TrueSession(
        times,
        when.at(trajectory.contact.force_n, times),
        np.array([pose.apply(each) for each in lines]),
        axis / np.linalg.norm(axis, axis=1, keepdims=True),
        when.at(trajectory.knob_deg, times),
        bench.session_info,
    )


def turned(camera: CameraModel, turn_rad: FloatArray, shift_m: FloatArray) -> CameraModel:
    """Returns a camera, turned about the origin of its world and shifted along its own axes."""
    pose = camera.camera_from_world
    rotation = Pose.from_axis_angle(turn_rad, np.zeros(3)).rotation @ pose.rotation
    return camera.seen_from(Pose(rotation, pose.translation_m + shift_m))


def views_of_case(session: TrueSession, case: Case, rng: np.random.Generator) -> tuple[list[CameraModel], SessionInfo]:
    """Returns the true cameras, and the metadata that state the second one wrongly."""
    stated = [CameraModel.from_projection(session.info.view(view).projection) for view in ("a", "b")]
    if case.between_deg is not None:
        aside = turned(stated[0], np.radians([0.0, case.between_deg, 0.0]), np.zeros(3))
        stated[1] = stated[1].seen_from(aside.camera_from_world)
    std_deg, std_m = case.turn_deg * np.array([1.0, 1.0, 0.5]), case.shift_m * np.ones(3)
    true = turned(stated[1], np.radians(std_deg) * rng.standard_normal(3), std_m * rng.standard_normal(3))
    view = replace(session.info.view("b"), projection=stated[1].projection)
    if case.stated:
        deg, metres = (case.stated * each for each in (std_deg, std_m))
        view = replace(view, pose_uncertainty_deg=tuple(deg.tolist()), pose_uncertainty_m=tuple(metres.tolist()))
    return [stated[0], true], replace(session.info, views={"a": session.info.view("a"), "b": view})


class NoisyLines:
    """Adds errors to true lines of one view of a session."""

    def __init__(self, rng: np.random.Generator, factor: float) -> None:
        arc = np.linspace(0.0, 1.0, 33)
        self._rng, self._share = rng, arc
        self._fresh = self._root(XRAY_FRESH_PX, factor)
        lasting = self._root(XRAY_LASTING_PX, factor)
        self._lasting = lasting @ rng.standard_normal(34)
        self._variance = (self._fresh**2).sum(axis=1) + (lasting**2).sum(axis=1)

    @staticmethod
    def _root(noise: LineNoise, factor: float) -> FloatArray:
        arc = np.linspace(0.0, LINE_PX, 33)
        return factor * np.linalg.cholesky(noise.covariance_m2(arc) + 1e-9 * np.eye(34))

    def shape(self, true_px: FloatArray) -> DetectedShape:
        """Returns the detected shape of a true line (n, 2)."""
        error = self._fresh @ self._rng.standard_normal(34) + self._lasting
        arc = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(true_px, axis=0), axis=1)))
        curve = CubicSpline(arc, true_px)
        at = np.linspace(0.0, arc[-1] + error[-1], POINTS)
        inside = np.minimum(at, arc[-1])
        tangent = curve(inside, 1)
        points = curve(inside) + (at - inside)[:, None] * tangent
        normal = np.column_stack([-tangent[:, 1], tangent[:, 0]])
        share = np.linspace(0.0, 1.0, POINTS)
        points = points + np.interp(share, self._share, error[:-1])[:, None] * normal
        variance = np.interp(share, self._share, self._variance[:-1])
        covariance = variance[:, None, None] * np.eye(2)
        covariance[-1] += self._variance[-1] * np.outer(tangent[-1], tangent[-1])
        return DetectedShape(Status.VALID, centreline=CentrelinePx(points), covariance_px2=covariance)


def rows_of(
    session: TrueSession, case: Case, seed: tuple[int, int], *, all_frames: bool = False, by: SpaceFilter | None = None
) -> list[list[float]]:
    """Estimates a session; see `space_sessions.COLUMNS`. ``all_frames``: none is left out; ``by``: another model."""
    rng = np.random.default_rng(seed)
    cameras, info = views_of_case(session, case, rng)
    noisy = [NoisyLines(np.random.default_rng([*seed, place]), case.noise) for place in range(2)]
    model = by or SpaceFilter(SpaceSettings(views=("a", "b")), 0.5, info)
    settings, widths, last_s = SpaceSettings(), SpaceWidths(), None
    rows: list[list[float]] = []
    for k, now_s in enumerate(session.time_s):
        shapes = [each.shape(camera.project(session.line_m[k])) for each, camera in zip(noisy, cameras, strict=True)]
        if not all_frames and k % (FREE_STEP if now_s < FREE_S else round(15.0 / case.fps)):
            continue
        seen = {name: ViewShape(shape, (512, 512)) for name, shape in zip("ab", shapes, strict=True)}
        if case.lost and now_s >= LOST_FROM_S:
            del seen["b"]
        found = model.step(seen, float(session.knob_deg[k]), 0.0 if last_s is None else float(now_s - last_s), 0.0)
        last_s = now_s
        values, ends, views = np.full(3, np.nan), np.full((4, 2), np.nan), 0.0
        if found.explained and found.level <= settings.noise.max_level:
            estimate = widths.estimate(0, found.force, None)
            values, ends = estimate.force_n, np.vstack([estimate.interval_n, estimate.magnitude_interval_n])
            views = float(len(found.views))
        row = [*session.force_n[k], *values, *ends[:, 0], *ends[:, 1], *session.tip_axis[k], views]
        rows.append([float(value) for value in row])
    return rows


def main() -> None:
    """Estimates the sessions in all cases and prints the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, nargs="+", default=[76000])
    parser.add_argument("--sessions", type=int, default=10)
    parser.add_argument("--seconds", type=float, default=10.0)
    parser.add_argument("--cases", nargs="+", default=list(CASES), choices=list(CASES))
    parser.add_argument("--out", type=Path, required=True)
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    parts: dict[str, list[FloatArray]] = {name: [] for name in options.cases}
    for seed, number in product(options.seed, range(options.sessions)):
        sessions: dict[tuple[float, float] | None, TrueSession] = {}
        for name in options.cases:
            path = options.out / f"{name.replace(' ', '-').replace(',', '').replace('/', '-')}-{seed}-{number}.json"
            if not path.exists():
                case = CASES[name]
                if case.peak_n not in sessions:
                    sessions[case.peak_n] = true_session(seed, number, options.seconds, case.peak_n)
                path.write_text(json.dumps(rows_of(sessions[case.peak_n], case, (seed, number))))
            parts[name].append(np.array(json.loads(path.read_text())))
            print(line(f"{seed} {number} {name}", parts[name][-1]), flush=True)
    for name, found in parts.items():
        rows = np.concatenate(found)
        print(line(name, rows), flush=True)
        if name in ("base", "large forces"):
            print("\n".join(table(rows)), flush=True)


if __name__ == "__main__":
    main()
