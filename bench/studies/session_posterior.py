"""The session model on true lines: errors, intervals and abstentions of the estimators that read the catheter's line.

    .venv/bin/python -m bench.studies.session_posterior lines --seed 61000 --sessions 16 --out DIR
    .venv/bin/python -m bench.studies.session_posterior detect --seed 61000 --sessions 16 --out DIR
    .venv/bin/python -m bench.studies.session_posterior score --lines DIR --method rod-track --out scores.json
    .venv/bin/python -m bench.studies.session_posterior images --seed 95000 --sessions 8 --out scores.json
    .venv/bin/python -m bench.studies.session_posterior table scores.json ...

``lines`` simulates sessions of a preset and draws no image: the true centreline is projected through the true camera
and gets an error like that of detected lines (`CENTRELINE_NOISE` of ``bench-2021``, the lasting part drawn once a
session). ``detect`` draws the images (5 a second) and stores the shapes that vision detects in them, hidden tips
included, and the readings of the image at the tip. ``score`` gives these lines and the knob's readings to a method, and
to `fusion` the readings of the tip, and keeps its estimate for every ``--every``-th frame in contact. ``images`` draws
the images (5 a second) and gives them to `fusion` without a limit of the error, as a user would; with ``--true-lines``
the true line with its error takes the place of detection. With ``--measured`` base, camera and knob of the bench are
measured as well as `MEASURED` states.
``--known`` gives the truth in place of priors: ``base`` (position and direction of the base, and the camera), ``knob``
(these and the curvature of the unloaded shaft), ``all`` (these, stiffness and length).
``table`` prints errors in all frames and by force and angle. Coverage is also shown as the range of its standard error
over sessions, because the errors of a session go together.
"""

import argparse
import json
import pickle
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from tipforce.clinical import CONTACT_N
from tipforce.estimators import Fusion, FusionSettings
from tipforce.estimators._reading import Abstention
from tipforce.estimators.session import (
    Detected,
    LineFrame,
    PriorSettings,
    Rod,
    RodSettings,
    RodTrack,
    RodTrackSettings,
)  # fmt: skip
from tipforce.geometry import arc_length
from tipforce.io import spread_rows
from tipforce.limits import CENTRELINE_NOISE, CramerRaoBound
from tipforce.mechanics import LineNoise
from tipforce.simulation import PRESETS, SimulatedBench, SimulationSettings
from tipforce.types import CentrelinePx, DetectedShape, FloatArray, Observation, SessionInfo, Status
from tipforce.vision import SessionDetector, VisionSettings
from tipforce.vision.contact import ContactReader, ContactReading

KNOWN = ("nothing", "base", "knob", "all")
WRONG_N = 0.05
"""An error of the magnitude beyond this counts as wrong."""
NARROW_N = 0.1
"""Widest 90 % interval of the estimates that the table also shows alone."""
PLACES = {"answered": 0, "mae": 0, "rmse": 0, "wrong": 1, "bias": 0}
"""Decimal places of the figures in the table."""
NOISE_PRESET, NOISE_PIXEL_M, NOISE_PIXELS = "bench-2021", 0.2e-3, 240.0
"""Preset whose measured line noise is added, its pixel, and the length in px of the lines that it was measured on."""

REACHES_N = (0.05, 0.06, 0.08, 0.1)
"""Limits of the interval's reach from the estimate, as ``max_error_n``."""

MEASURED = {"angle_deg": 0.3, "scale": 3e-3, "gain": 5e-3, "base_m": 5e-4}
"""Largest errors of a measured bench: turns of camera and base, scale and gain of the knob (relative). They are drawn
within these, and the distortion nearly vanishes. Last the standard deviation of the base's place about its image."""
DETECTED_FPS, DETECTED_S = 5.0, 30.0
"""Rate of the images that are drawn for ``detect``, and the length of the beginning of a session."""
ANY_STD_PX = 1e5
INTERVAL_SIGMAS = 1.645
"""A 90 % interval reaches this number of standard deviations."""


@dataclass(frozen=True, eq=False)
class Lines:
    """The lines of one session with their truth.

    Attributes:
        info: the session metadata.
        time_s: (n,) times of the frames.
        knob_deg: (n,) newest reading of the knob at each frame.
        points_px: (n, p, 2) true centreline in the image, base to tip.
        points_m: (n, p, 2) the same in the plane of bending, base frame.
        size_px: width and height of the image.
        force_n: (n, 3) true force.
        touching: (n,) whether the tip is in contact.
        curvature_per_m: (n,) true curvature of the unloaded shaft.
        stiffness_nm2: true stiffness.
        flexible_length_m: true length of the flexible part.
        stiffening_m2: growth of the stiffness with the square of the curvature.
        proximal: share by which the third next to the base is stiffer.
        creep: share of creep.
        seed: seed and number of the session.
        shapes: (n) shapes that vision detects; None: the lines are true ones.
        tip_visible: (n,) whether the tip is visible in the image, with ``shapes``.
        readings: (n,) the geometry of the contact that a network reads at the tip, with ``shapes``.
    """

    info: SessionInfo
    time_s: FloatArray
    knob_deg: FloatArray
    points_px: FloatArray
    points_m: FloatArray
    size_px: tuple[int, int]
    force_n: FloatArray
    touching: np.ndarray
    curvature_per_m: FloatArray
    stiffness_nm2: float
    flexible_length_m: float
    stiffening_m2: float
    proximal: float
    creep: float
    seed: tuple[int, int]
    shapes: Sequence[DetectedShape] | None = None
    tip_visible: np.ndarray | None = None
    readings: Sequence[ContactReading | None] | None = None

    @classmethod
    def detected(cls, preset: str, seed: int, number: int) -> "Lines":
        """Simulates the first part of a session and detects the catheter in its images; see the module."""
        bench = SimulatedBench(PRESETS[preset], seed, number)
        stride = max(1, round(1.0 / (DETECTED_FPS * float(np.median(np.diff(bench.frame_s))))))
        rows = np.flatnonzero(bench.frame_s < DETECTED_S)[::stride]
        view, whole = bench.views[0], cls._of(bench)
        wanted = spread_rows(len(rows)).tolist()
        detector = SessionDetector(
            VisionSettings(max_tip_std_px=ANY_STD_PX), bench.session_info,
            [bench.frame(int(rows[k]), view).image for k in wanted],
        )  # fmt: skip
        reader, scale = ContactReader(), whole.info.view(view).metres_per_px
        shapes, readings = list[DetectedShape](), list[ContactReading | None]()
        for k in rows:
            image = bench.frame(int(k), view).image
            shapes.append(detector.detect(image))
            readings.append(reader.read(image, shapes[-1], scale) if scale else None)
        visible = [bool(np.asarray(bench.image_truth(int(k), view).visible, bool)[-3:].all()) for k in rows]
        part = {
            name: value[rows]
            for name in (each.name for each in fields(cls))
            if isinstance(value := getattr(whole, name), np.ndarray)
        }
        return replace(whole, **part, shapes=shapes, tip_visible=np.array(visible), readings=readings)

    @classmethod
    def of(cls, preset: str, seed: int, number: int) -> "Lines":
        """Simulates a session; see the class."""
        return cls._of(SimulatedBench(PRESETS[preset], seed, number))

    @classmethod
    def _of(cls, bench: SimulatedBench) -> "Lines":
        when, trajectory = bench.interpolator, bench.trajectory
        stamps, knob = bench.knob_log()
        newest = np.searchsorted(stamps, bench.stamp_ns, side="right") - 1
        lines = when.lines_m(bench.frame_s)
        camera = bench.imaging.camera(bench.views[0])
        pixels = camera.project(lines.reshape(-1, 3)).reshape(*lines.shape[:2], 2)
        shaft, device = bench.settings.world.shaft, bench.session.bench_model.parameters.device
        return cls(
            bench.session_info, bench.frame_s, knob[newest], pixels, lines[..., :2],
            (bench.settings.width, bench.settings.height), when.at(trajectory.contact.force_n, bench.frame_s),
            trajectory.contact.touching[when.nearest(bench.frame_s)],
            when.at(trajectory.curvature_per_m, bench.frame_s), device.stiffness_nm2, device.flexible_length_m,
            shaft.stiffening_curvature_per_m**-2, shaft.proximal_stiffer, shaft.creep_share, (bench.seed, bench.number),
        )  # fmt: skip

    @property
    def angle_deg(self) -> FloatArray:
        """(n,) angle between the force and the tip's axis, 0: it pushes along the axis."""
        axis = self.points_m[:, -1] - self.points_m[:, -2]
        axis /= np.linalg.norm(axis, axis=1, keepdims=True)
        push = -np.sum(axis * self.force_n[:, :2], axis=1)
        return np.degrees(np.arccos(np.clip(push / np.maximum(self.size_n, 1e-9), -1.0, 1.0)))

    @property
    def size_n(self) -> FloatArray:
        """(n,) magnitude of the force in the plane."""
        return np.linalg.norm(self.force_n[:, :2], axis=1)

    def knowing(self, known: str) -> "Lines":
        """Returns the session as a camera without tilt, with its base at the border, would see it; see the module."""
        if known == "nothing":
            return self
        scale = self.info.view("camera").metres_per_px or NOISE_PIXEL_M
        pixels = self.points_m / scale * (1.0, -1.0) + (-0.5, 0.5 * (self.size_px[1] - 1))
        view = replace(
            self.info.views["camera"], base_side="left", metres_per_px_uncertainty=1e-3, tilt_uncertainty_deg=0.02
        )
        info, knob = replace(self.info, views={"camera": view}), self.knob_deg
        gain = info.actuation.knob_gain_per_m_deg
        if known in ("knob", "all") and gain is not None:
            knob = self.curvature_per_m / gain
        if known == "all":
            catheter = replace(
                info.catheter, flexible_length_m=self.flexible_length_m, bending_stiffness_nm2=self.stiffness_nm2,
                flexible_length_uncertainty=1e-3, bending_stiffness_uncertainty=1e-3,
            )  # fmt: skip
            info = replace(info, catheter=catheter)
        return replace(self, info=info, points_px=pixels, knob_deg=knob)

    def prior(self, known: str, usual: PriorSettings) -> PriorSettings:
        """Returns the prior with the truth in place of the known constants."""
        prior = usual
        if known != "nothing":
            prior = prior.model_copy(
                update={
                    "base_position_m": 1e-5, "base_angle_deg": 0.01, "tilt_per_m": 1e-3, "distortion_per_m2": 1e-3,
                    "scale": 1e-3,
                }
            )  # fmt: skip
        if known in ("knob", "all"):
            prior = prior.model_copy(update={"precurvature_per_m": 0.02, "knob_gain": 1e-3, "knob_play_deg": 0.0})
        if known == "all":
            prior = prior.model_copy(
                update={
                    "stiffening_m2": self.stiffening_m2, "stiffening_std_m2": 1e-5, "proximal_stiffness": 0.01,
                    "creep": self.creep, "creep_std": 0.003,
                }
            )  # fmt: skip
        return prior

    def noise_px(self, draw: int = 0) -> tuple[FloatArray, FloatArray]:
        """Returns the error across the line (n, p) and along it at the tip (n,), px; ``draw``: number of the draw."""
        arc = arc_length(self.points_px[0])
        unit = max(1.0, float(arc[-1]) / NOISE_PIXELS)
        rng = np.random.default_rng([*self.seed, 77, draw])
        noise = CENTRELINE_NOISE[NOISE_PRESET]

        def errors(part: LineNoise, count: int) -> FloatArray:
            covariance = part.scaled(unit / NOISE_PIXEL_M).covariance_m2(arc)
            values, vectors = np.linalg.eigh(covariance)
            return rng.standard_normal((count, len(values))) @ (vectors * np.sqrt(np.maximum(values, 0.0))).T

        whole = errors(noise.lasting, 1) + errors(noise.fresh, len(self.time_s))
        return whole[:, :-1], whole[:, -1]

    def seen_px(self, draw: int = 0) -> FloatArray:
        """Returns the lines (n, p, 2) as a detector would see them: with their error."""
        across, along = self.noise_px(draw)
        tangent = np.gradient(self.points_px, axis=1)
        tangent /= np.linalg.norm(tangent, axis=2, keepdims=True)
        left = np.stack([tangent[..., 1], -tangent[..., 0]], axis=2)
        seen = self.points_px + across[..., None] * left
        # the whole line is stretched, so that the points stay even
        share = np.linspace(0.0, 1.0, seen.shape[1])
        return seen + (along[:, None] * share)[..., None] * tangent


Estimate = tuple[float, float, float, float, float]
"""Force along x and y, ends of the magnitude's 90 % interval, N, and the probability of contact; NaN: abstains."""


def frame_of(lines: Lines) -> LineFrame:
    """Returns the frame of a session's lines, whose origin is where the first one begins."""
    view = lines.info.view("camera")
    assert view.metres_per_px is not None
    first = lines.points_px[0]
    if lines.shapes is not None:
        first = next((each.centreline.points for each in lines.shapes if each.centreline is not None), first)
    return LineFrame(lines.size_px, view.base_side or "left", view.metres_per_px, first[0])


class _GivenLine:
    """Takes the place of the detection: the line of the frame that is set, and the reading of the tip's image."""

    def __init__(self, frame: LineFrame) -> None:
        self.frame = frame
        self.shape = DetectedShape(Status.NO_CATHETER, "")
        self.reading: ContactReading | None = None

    def read(self, observation: Observation) -> Detected | Abstention:
        """Returns the line."""
        del observation
        return Detected(self.shape, self.frame) if self.shape.found else Abstention(self.shape.status, "")


METHODS: dict[str, tuple[type[Any], RodSettings]] = {
    "rod": (Rod, RodSettings()),
    "rod-track": (RodTrack, RodTrackSettings()),
    "fusion": (Fusion, FusionSettings(max_error_n=None)),
}
WITH_MEMORY = ("rod-track", "fusion")


def estimates_of(lines: Lines, method: str, known: str) -> Callable[[int, DetectedShape], Estimate]:
    """Returns ``method`` for one session, as a function of a frame's number and shape."""
    kind, settings = METHODS[method]
    settings = settings.model_copy(update={"prior": lines.prior(known, settings.prior)})
    lines = lines.knowing(known)
    stream: Any = kind(settings).start(lines.info)
    given = _GivenLine(frame_of(lines))
    stream._detection, stream._contact_reading = given, lambda *_: given.reading

    def estimate(index: int, shape: DetectedShape) -> Estimate:
        given.shape = shape
        given.reading = lines.readings[index] if lines.readings else None
        stamp = int(lines.time_s[index] * 1e9)
        found = stream.update(Observation(stamp, {}, {"knob_deg": float(lines.knob_deg[index])}))
        return (*found.force_n[:2].tolist(), *found.magnitude_interval_n.tolist(), found.contact)

    return estimate


def score(lines: Lines, method: str, known: str, every: int, draw: int = 0) -> dict[str, Any]:
    """Returns truth and estimates on every ``every``-th frame in contact; a method with memory sees all frames.

    A frame without a detected shape counts as abstained; its tip counts as hidden.
    """
    estimate = estimates_of(lines, method, known)
    shown = lines.knowing(known)
    shapes = shown.shapes or [DetectedShape(Status.VALID, "", CentrelinePx(line)) for line in shown.seen_px(draw)]
    wanted = np.flatnonzero(lines.touching & (lines.size_n > CONTACT_N))[::every]
    chosen = set(wanted.tolist())
    memory = method in WITH_MEMORY
    rows, spent = [], []
    for k in range(len(shapes)) if memory else wanted.tolist():
        start = time.perf_counter()
        found = estimate(k, shapes[k])
        spent.append(time.perf_counter() - start)
        if k in chosen:
            rows.append([k, *found])
    angle, size = lines.angle_deg, lines.size_n
    return {
        "session": lines.seed, "method": method, "known": known,
        "ms": 1e3 * float(np.median(spent)),
        "frame": [row[0] for row in rows],
        "force_n": lines.force_n[wanted, :2].tolist(), "size_n": size[wanted].tolist(),
        "angle_deg": angle[wanted].tolist(), "time_s": lines.time_s[wanted].tolist(),
        "estimate": [row[1:] for row in rows],
        "tip_seen": [shapes[k].tip_seen for k in wanted.tolist()],
    }  # fmt: skip


def measured_bench(settings: SimulationSettings) -> SimulationSettings:
    """Returns the preset with camera, base and knob within `MEASURED`."""
    turn = (-MEASURED["angle_deg"], MEASURED["angle_deg"])
    scene = settings.scene.model_copy(
        update={
            "yaw_deg": turn, "pitch_deg": turn, "base_turn_deg": turn, "distortion_k1": (-0.002, 0.002),
            "distortion_tangential": (-1e-5, 1e-5),
        }
    )  # fmt: skip
    knob = settings.world.actuation.model_copy(update={"factor": (1.0 - MEASURED["gain"], 1.0 + MEASURED["gain"])})
    world = settings.world.model_copy(update={"actuation": knob})
    return settings.model_copy(update={"scene": scene, "world": world, "scale_error": MEASURED["scale"]})


def measured_prior() -> PriorSettings:
    """Returns the prior of a bench of `measured_bench`; its metadata state scale and tilt."""
    return PriorSettings(
        base_position_m=MEASURED["base_m"], base_angle_deg=MEASURED["angle_deg"], knob_gain=MEASURED["gain"],
        distortion_per_m2=0.03,
    )  # fmt: skip


def score_images(
    preset: str, seed: int, number: int, method: str, *, true_lines: bool, measured: bool = False
) -> dict[str, Any]:
    """Gives the images of the beginning of a session to ``method``; returns the scores of all its frames in contact."""
    settings = PRESETS[preset]
    prior = PriorSettings()
    if measured:
        assert isinstance(settings, SimulationSettings)
        settings, prior = measured_bench(settings), measured_prior()
    bench = SimulatedBench(settings, seed, number)
    lines, view = Lines._of(bench), bench.views[0]
    stride = max(1, round(1.0 / (DETECTED_FPS * float(np.median(np.diff(bench.frame_s))))))
    rows = np.flatnonzero(bench.frame_s < DETECTED_S)[::stride].tolist()
    first = [bench.frame(rows[k], view).image for k in spread_rows(len(rows)).tolist()]
    noise = CENTRELINE_NOISE.get(preset, CENTRELINE_NOISE[NOISE_PRESET])
    estimator = (
        Fusion(FusionSettings(max_error_n=None, prior=prior))
        if method == "fusion"
        else METHODS[method][0](RodTrackSettings(prior=prior))
    )
    stream: Any = estimator.start(lines.info, [] if true_lines else first)
    given, seen = _GivenLine(frame_of(lines)), lines.seen_px() if true_lines else lines.points_px
    if true_lines:
        stream._detection = given
    kept, found, spent = [], [], []
    for k in rows:
        given.shape = DetectedShape(Status.VALID, "", CentrelinePx(seen[k]))
        observation = Observation(
            int(lines.time_s[k] * 1e9), {view: bench.frame(k, view).image}, {"knob_deg": float(lines.knob_deg[k])}
        )
        start = time.perf_counter()
        force = stream.update(observation)
        spent.append(time.perf_counter() - start)
        if lines.touching[k] and lines.size_n[k] > CONTACT_N:
            kept.append(k)
            found.append([*force.force_n[:2].tolist(), *force.magnitude_interval_n.tolist(), force.contact])
    return {
        "session": lines.seed, "method": method, "known": "bench" if measured else "nothing",
        "ms": 1e3 * float(np.median(spent)),
        "frame": kept, "force_n": lines.force_n[kept, :2].tolist(), "size_n": lines.size_n[kept].tolist(),
        "angle_deg": lines.angle_deg[kept].tolist(), "time_s": lines.time_s[kept].tolist(), "estimate": found,
        "tip_seen": [True] * len(kept),
        "bound_n": CramerRaoBound.of(bench, noise).sequential().magnitude_std_n[kept].tolist(),
    }  # fmt: skip


def against_bound(rows: list[dict[str, Any]]) -> str:
    """Returns the errors and the share of answers beside those that the bound of the shape allows."""
    all_, bound = gathered(rows), np.concatenate([row["bound_n"] for row in rows])
    valid = np.isfinite(all_["said"]) & np.isfinite(bound)
    error = (all_["said"] - all_["truth"])[valid]
    ratio = np.sqrt(np.mean(error**2) / np.mean(bound[valid] ** 2))
    reach = np.maximum(all_["high"] - all_["said"], all_["said"] - all_["low"])
    lines = [f"RMSE {ratio:.2f} times the bound of the shape over all frames so far"]
    for limit in REACHES_N:
        allowed, answered = bound * INTERVAL_SIGMAS <= limit, reach <= limit
        lines.append(f"{limit} N: the bound allows {allowed.mean():.0%} of the frames, answered {answered.mean():.0%}")
    return "; ".join(lines)


def gathered(rows: list[dict[str, Any]]) -> dict[str, np.ndarray]:
    """Returns the scores of sessions as arrays."""
    estimate = np.concatenate([np.array(row["estimate"], float).reshape(-1, 5) for row in rows])
    size = np.concatenate([row["size_n"] for row in rows])
    said = np.hypot(estimate[:, 0], estimate[:, 1])
    return {
        "truth": size, "said": said, "low": estimate[:, 2], "high": estimate[:, 3],
        "angle": np.concatenate([row["angle_deg"] for row in rows]),
        "tip_seen": np.concatenate([row["tip_seen"] for row in rows]).astype(bool),
        "session": np.repeat(np.arange(len(rows)), [len(row["size_n"]) for row in rows]),
    }  # fmt: skip


def figures(all_: dict[str, np.ndarray], inside: np.ndarray) -> dict[str, float]:
    """Returns the figures of the frames ``inside``: shares in percent, errors of the magnitude in mN."""
    valid = inside & np.isfinite(all_["said"])
    error = (all_["said"] - all_["truth"])[valid]
    holds = ((all_["low"] <= all_["truth"]) & (all_["truth"] <= all_["high"]))[valid]
    by_session = [holds[all_["session"][valid] == s].mean() for s in np.unique(all_["session"][valid])]
    nan = float("nan")
    return {
        "frames": int(inside.sum()), "answered": 100 * valid.sum() / max(1, inside.sum()),
        "mae": 1e3 * np.abs(error).mean() if len(error) else nan,
        "rmse": 1e3 * np.sqrt((error**2).mean()) if len(error) else nan,
        "wrong": 100 * (np.abs(error) > WRONG_N).mean() if len(error) else nan,
        "bias": 1e3 * error.mean() if len(error) else nan,
        "holds": 100 * holds.mean() if len(error) else nan,
        "error_of_holds": 100 * np.std(by_session) / np.sqrt(max(1, len(by_session))) if by_session else nan,
        "width": 1e3 * np.median((all_["high"] - all_["low"])[valid]) if len(error) else nan,
    }  # fmt: skip


def strata(all_: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Returns which frames are in each row of the table."""
    truth, angle = all_["truth"], all_["angle"]
    width = all_["high"] - all_["low"]
    reach = np.maximum(all_["high"] - all_["said"], all_["said"] - all_["low"])
    return {
        "all": truth > 0, "below 0.1 N": truth < 0.1, "0.1 to 0.2 N": (truth >= 0.1) & (truth < 0.2),
        "0.2 to 0.3 N": (truth >= 0.2) & (truth < 0.3), "above 0.3 N": truth >= 0.3,
        "within 20 deg": angle < 20, "20 to 50 deg": (angle >= 20) & (angle < 50), "beyond 50 deg": angle >= 50,
        "tip hidden": ~all_["tip_seen"], "interval < 100 mN": width < NARROW_N,
        **{f"reaches at most {limit} N": reach <= limit for limit in REACHES_N},
    }  # fmt: skip


def table(rows: list[dict[str, Any]]) -> str:
    """Returns the rows in Markdown."""
    all_ = gathered(rows)
    head = ("frames", "answered", "MAE", "RMSE", "wrong", "bias", "90 % holds", "median width")
    lines = [f"| {rows[0]['method']}, {rows[0]['known']} known | " + " | ".join(head) + " |", "|---" * 9 + "|"]
    for name, inside in strata(all_).items():
        f = figures(all_, inside)
        holds = f"{f['holds']:.0f} (+- {f['error_of_holds']:.0f})"
        cells = [f"{f['frames']}", *(f"{f[k]:.{places}f}" for k, places in PLACES.items())]
        lines.append(f"| {name} | " + " | ".join([*cells, holds, f"{f['width']:.0f}"]) + " |")
    return "\n".join([*lines, f"{len(rows)} sessions, {np.median([row['ms'] for row in rows]):.2f} ms a frame"])


def main() -> None:
    """Runs one of the steps."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    steps = parser.add_subparsers(dest="step", required=True)
    draws = steps.add_parser("lines"), steps.add_parser("detect")
    for draw in draws:
        draw.add_argument("--preset", default="varied", choices=list(PRESETS))
        draw.add_argument("--seed", type=int, default=61000)
        draw.add_argument("--first", type=int, default=0)
        draw.add_argument("--sessions", type=int, default=16)
        draw.add_argument("--stride", type=int, default=5, help="step of the sessions' numbers: 5 for other catheters")
    run = steps.add_parser("score")
    run.add_argument("--lines", type=Path, required=True)
    run.add_argument("--method", default="rod-track", choices=list(METHODS))
    run.add_argument("--known", default="nothing", choices=KNOWN)
    run.add_argument("--every", type=int, default=20)
    run.add_argument("--skip", type=int, default=0, help="number of sessions that are left out first")
    run.add_argument("--limit", type=int, default=1000, help="number of sessions")
    shown = steps.add_parser("images")
    shown.add_argument("--preset", default="varied", choices=list(PRESETS))
    shown.add_argument("--seed", type=int, default=95000)
    shown.add_argument("--sessions", type=int, default=8)
    shown.add_argument("--method", default="fusion", choices=["fusion", "rod-track"])
    shown.add_argument("--true-lines", action="store_true")
    shown.add_argument("--measured", action="store_true")
    for step in (*draws, run, shown):
        step.add_argument("--out", type=Path, required=True)
    show = steps.add_parser("table")
    show.add_argument("scores", type=Path, nargs="+")
    options = parser.parse_args()
    if options.step in ("lines", "detect"):
        make = Lines.of if options.step == "lines" else Lines.detected
        options.out.mkdir(parents=True, exist_ok=True)
        for k in range(options.sessions):
            number = options.first + options.stride * k
            place = options.out / f"{options.preset}-{options.seed}-{number:03d}.pickle"
            if not place.exists():
                place.write_bytes(pickle.dumps(make(options.preset, options.seed, number)))
                print(place, flush=True)
    elif options.step == "images":
        rows = []
        for k in range(options.sessions):
            number = 5 * k
            given = {"true_lines": options.true_lines, "measured": options.measured}
            rows.append(score_images(options.preset, options.seed, number, options.method, **given))
            options.out.write_text(json.dumps(rows) + "\n", encoding="utf-8")
        print(table(rows))
        print(against_bound(rows))
    elif options.step == "score":
        rows = []
        for place in sorted(options.lines.glob("*.pickle"))[options.skip :][: options.limit]:
            rows.append(score(pickle.loads(place.read_bytes()), options.method, options.known, options.every))
            options.out.write_text(json.dumps(rows) + "\n", encoding="utf-8")
        print(table(rows))
    else:
        for place in options.scores:
            print(table(json.loads(place.read_text())), end="\n\n")


if __name__ == "__main__":
    from bench.studies.session_posterior import main as run_step  # pickles then name the module, not __main__

    run_step()
