"""One session of the foreign bench: its random parameters, its physics, and the files that a laboratory would have."""

import csv
import json
import math
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from scipy.interpolate import make_interp_spline
from scipy.ndimage import gaussian_filter1d

from tipforce.io import write_force_csv
from tipforce.types import FloatArray, IntArray

from .rod import LAWS, CableWorld, Rod, Tissue

__all__ = ["FRAME_HZ", "Motion", "Plan", "Run", "draw_plan", "simulate", "write_bench", "write_logs", "write_truth"]

FRAME_HZ = 12.0
LEAD_S = 1.0
"""Contact-free at the beginning of every session, to tare the sensor."""
CONTROL_S = 2e-3
REST_S = 0.4
"""After which the rod has come to rest, the tissue still far away."""
FAR_M = np.array([1.0, 0.0, 0.0])
KNOB_GAIN_PER_M_DEG = 0.533
KNOB_PLAY_DEG = 1.0
LONGEST_PRESS_M = 0.014
STRONGEST_N = 0.6
"""The drives' own motion adds to the tissue's: a session that presses harder is run anew with a shorter stroke."""
SENSOR_NOISE_N, SENSOR_STEP_N, SENSOR_DRIFT_N = 3e-3, 5e-3, 4e-4
LINE_POINTS = 60


@dataclass(frozen=True, slots=True)
class Motion:
    """How the tissue and the drives move."""

    kind: str
    beat_hz: float
    breath_hz: float
    breath_share: float
    across_m: float
    peak_force_n: float
    free_share: float
    knob_deg: float
    knob_swing_deg: float
    advance_m: float


@dataclass(frozen=True, slots=True)
class Plan:
    """Parameters of the physics of one session, and the values in the notes of the laboratory."""

    seed: int
    rod: Rod
    tissue: Tissue
    motion: Motion
    contact_angle_deg: float
    knob_factor: float
    clock_offset_s: float
    sensor_angle_deg: float
    sensor_angle_error_deg: float
    sensor_bias_n: tuple[float, float, float]
    stated: dict[str, float] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, eq=False)
class Run:
    """Results of MuJoCo, every 2 ms (n rows), and the instants of the frames (m,).

    ``force_n`` (n, 3): of the tissue on the tip; ``line_m`` (n, p, 3): clamp to tip; ``wall_m`` (n, 3): middle of the
    undeformed face; ``dent_m`` (n,): indentation; ``knob_deg``, ``advance_m``, ``forward_m``, ``across_m`` (n,): of the
    drives.
    """

    time_s: FloatArray
    frame_s: FloatArray
    force_n: FloatArray
    line_m: FloatArray
    wall_m: FloatArray
    dent_m: FloatArray
    knob_deg: FloatArray
    advance_m: FloatArray
    forward_m: FloatArray
    across_m: FloatArray

    def at_frames(self, name: str) -> FloatArray:
        """One of the series at the frames, (m, ...)."""
        values = np.asarray(getattr(self, name))
        flat = values.reshape(len(values), -1)
        found = np.column_stack([np.interp(self.frame_s, self.time_s, column) for column in flat.T])
        return found.reshape(len(self.frame_s), *values.shape[1:])


def draw_plan(seed: int) -> Plan:
    """Draws the session of ``seed``."""
    rng = np.random.default_rng((seed, 1))
    u = rng.uniform
    french = float(rng.choice([6.0, 7.0, 7.0, 8.0]))
    rod = Rod(length_m=u(0.038, 0.060), rigid_m=u(0.004, 0.008), radius_m=french / 6e3, stiffness_nm2=u(2.6e-4, 8e-4))
    knob_deg = u(0.0, 18.0)
    angle_deg = float(rng.choice([-1.0, 1.0])) * u(5.0, 65.0)
    tip_yaw = rod.length_m * KNOB_GAIN_PER_M_DEG * knob_deg
    tissue = Tissue(
        stiffness_n_per_m=math.exp(u(math.log(40.0), math.log(400.0))),
        law=str(rng.choice(list(LAWS))),
        friction=u(0.05, 0.3),
        yaw_rad=math.pi + tip_yaw + math.radians(angle_deg),
        tilt_rad=math.radians(u(-4.0, 4.0)),
    )
    motion = Motion(
        kind=str(rng.choice(["heart", "hand"])),
        beat_hz=u(0.9, 1.4),
        breath_hz=u(0.2, 0.3),
        breath_share=u(0.0, 0.3),
        across_m=u(0.0, 2.5e-3),
        peak_force_n=u(0.06, 0.5),
        free_share=u(0.0, 0.12),
        knob_deg=knob_deg,
        knob_swing_deg=float(rng.choice([0.0, u(1.5, 4.0)])),
        advance_m=float(rng.choice([0.0, 0.0, u(0.4e-3, 1.2e-3)])),
    )
    return Plan(
        seed=seed,
        rod=rod,
        tissue=tissue,
        motion=motion,
        contact_angle_deg=angle_deg,
        knob_factor=u(0.98, 1.02),
        clock_offset_s=u(-0.08, 0.08),
        sensor_angle_deg=round(math.degrees(tissue.yaw_rad) + 180.0 + u(-20.0, 20.0)) % 360.0,
        sensor_angle_error_deg=u(-1.0, 1.0),
        sensor_bias_n=(u(-0.3, 0.3), u(-0.3, 0.3), u(-0.3, 0.3)),
        stated={
            "diameter_m": french / 3e3,
            "flexible_length_m": rod.length_m * u(0.97, 1.03),
            "rigid_length_m": rod.rigid_m,
            "bending_stiffness_nm2": rod.stiffness_nm2 * u(0.95, 1.05),
        },
    )


def _pressing(motion: Motion, time_s: FloatArray, rng: np.random.Generator) -> FloatArray:
    """(n,): 0 where the tissue is farthest back, 1 where it presses most."""
    t = time_s - LEAD_S
    if motion.kind == "heart":
        beat = 0.5 - 0.5 * np.cos(2 * np.pi * motion.beat_hz * t)
        breath = 0.5 - 0.5 * np.cos(2 * np.pi * motion.breath_hz * t)
        moved = (1 - motion.breath_share) * beat + motion.breath_share * breath
    else:
        moved = np.zeros(len(t))
        while moved[t > 0].max() <= 0.0:  # a hand that rests all the time is drawn anew
            wandering = gaussian_filter1d(rng.standard_normal(len(t)), 0.35 / CONTROL_S, mode="wrap")
            trembling = gaussian_filter1d(rng.standard_normal(len(t)), 0.06 / CONTROL_S, mode="wrap")
            moved = wandering / wandering.std() + 0.06 * trembling / trembling.std()
            moved = np.clip(moved, -1.5, 1.3)  # it rests at either end
            moved -= moved.min()
    begun = np.clip(t / 0.5, 0.0, 1.0)
    return np.where(t > 0, begun * moved / np.max(begun * moved), 0.0)


def _play(knob_deg: FloatArray) -> FloatArray:
    """(n,): the knob's angle behind its play."""
    out, held = np.empty_like(knob_deg), knob_deg[0]
    for i, angle in enumerate(knob_deg):
        held = min(max(held, angle - KNOB_PLAY_DEG / 2), angle + KNOB_PLAY_DEG / 2)
        out[i] = held
    return out


def _depth_for(plan: Plan, curvature_per_m: float) -> tuple[FloatArray, float]:
    """Where the wall touches the resting tip (3,), and how far beyond this it must go for the peak force."""
    world = CableWorld(plan.rod, plan.tissue)
    world.advance(REST_S, curvature_per_m=curvature_per_m, wall_m=FAR_M)
    line = world.joints_m
    along = (line[-1] - line[-2]) / np.linalg.norm(line[-1] - line[-2])
    touch = line[-1] - plan.rod.radius_m * (along + plan.tissue.normal)
    for depth in np.arange(-5e-4, LONGEST_PRESS_M, 1e-4):
        world.advance(8e-3, curvature_per_m=curvature_per_m, wall_m=touch + depth * plan.tissue.normal)
        if np.linalg.norm(world.tip_force_n) > plan.motion.peak_force_n:
            return touch, float(depth)
    return touch, LONGEST_PRESS_M


def simulate(plan: Plan, seconds: float, shortened: float = 1.0) -> Run:
    """Runs the session in MuJoCo. ``shortened``: ratio of the motion of the tissue to that of its peak force."""
    rng = np.random.default_rng((plan.seed, 2))
    motion, tissue = plan.motion, plan.tissue
    time_s = np.arange(0.0, seconds, CONTROL_S)
    later = np.clip(time_s - LEAD_S, 0.0, None)
    knob_deg = motion.knob_deg + motion.knob_swing_deg * np.sin(2 * np.pi * 0.15 * later)
    curvature = KNOB_GAIN_PER_M_DEG * plan.knob_factor * _play(knob_deg)
    advance_m = motion.advance_m * np.sin(2 * np.pi * 0.1 * later)
    pressing = _pressing(motion, time_s, rng)
    touch, depth = _depth_for(plan, float(curvature[0]))
    depth *= shortened
    stroke = depth / (1.0 - np.quantile(pressing[time_s > LEAD_S], motion.free_share)) + 5e-4
    forward_m = depth - stroke * (1.0 - pressing) - np.clip((LEAD_S - time_s) * 2e-3, 0.0, 1e-3)
    phase = rng.uniform(0.0, 2 * np.pi)
    across_m = motion.across_m * np.sin(2 * np.pi * motion.breath_hz * time_s + phase)
    offset = rng.uniform(-4e-3, 4e-3)

    world = CableWorld(plan.rod, tissue)
    rows: dict[str, list[Any]] = {"force_n": [], "line_m": [], "wall_m": [], "dent_m": []}
    world.advance(REST_S, curvature_per_m=float(curvature[0]), wall_m=FAR_M)
    for i in range(len(time_s)):
        wall = touch + forward_m[i] * tissue.normal + (across_m[i] + offset) * tissue.across
        world.advance(CONTROL_S, curvature_per_m=float(curvature[i]), wall_m=wall, base_x_m=float(advance_m[i]))
        rows["force_n"].append(world.tip_force_n)
        rows["line_m"].append(_smooth(world.joints_m))
        rows["wall_m"].append(wall)
        rows["dent_m"].append(world.indentation_m)
    frame_s = np.arange(0.1, seconds - 0.1, 1.0 / FRAME_HZ)
    frame_s = (frame_s + rng.normal(0.0, 1e-3, len(frame_s)))[rng.uniform(size=len(frame_s)) > 0.005]
    series = {name: np.asarray(values) for name, values in rows.items()}
    if np.linalg.norm(series["force_n"], axis=1).max() > STRONGEST_N:
        return simulate(plan, seconds, 0.8 * shortened)
    return Run(
        time_s, frame_s, **series, knob_deg=knob_deg, advance_m=advance_m, forward_m=forward_m, across_m=across_m
    )


def _smooth(joints_m: FloatArray) -> FloatArray:
    """(p, 3): the curve through the middles of the cable's straight segments, uniform in arc length."""
    middles = np.vstack([joints_m[0], (joints_m[1:-3] + joints_m[2:-2]) / 2, joints_m[-2:]])
    reach = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(middles, axis=0), axis=1))])
    fine = np.linspace(0.0, reach[-1], LINE_POINTS)
    shaft = make_interp_spline(reach[:-1], middles[:-1], k=3)(np.minimum(fine, reach[-2]))
    beyond = np.clip(fine - reach[-2], 0.0, None)[:, None]
    return shaft + beyond * (middles[-1] - middles[-2]) / (reach[-1] - reach[-2])


def write_logs(plan: Plan, run: Run, folder: Path) -> None:
    """Writes ``force.csv``, ``stage.csv`` and, where the knob moves, ``knob.csv``, on the force sensor's clock."""
    rng = np.random.default_rng((plan.seed, 3))
    angle = math.radians(plan.sensor_angle_deg + plan.sensor_angle_error_deg)
    turned = np.array(
        [[math.cos(angle), math.sin(angle), 0.0], [-math.sin(angle), math.cos(angle), 0.0], [0.0, 0.0, 1.0]]
    )
    read = -run.force_n @ turned.T + plan.sensor_bias_n
    drift = SENSOR_DRIFT_N * np.outer(run.time_s / run.time_s[-1], rng.standard_normal(3))
    read = np.round((read + drift + rng.normal(0.0, SENSOR_NOISE_N, read.shape)) / SENSOR_STEP_N) * SENSOR_STEP_N
    stamps = np.round((run.time_s - plan.clock_offset_s + 1.0) * 1e9).astype(np.int64)
    write_force_csv(folder / "force.csv", stamps, read)
    drives = {"stage": {"stage_forward_mm": 1e3 * run.forward_m, "stage_across_mm": 1e3 * run.across_m}}
    if plan.motion.knob_swing_deg or plan.motion.advance_m:
        drives["knob"] = {"knob_deg": run.knob_deg}
    for name, columns in drives.items():
        with (folder / f"{name}.csv").open("w", newline="") as out:
            table = csv.writer(out)
            table.writerow(["stamp_ns", *columns])
            for row in range(0, len(stamps), 5):
                table.writerow([stamps[row], *(f"{values[row]:.4f}" for values in columns.values())])


def write_bench(plan: Plan, folder: Path, metres_per_px: float, base_side: str) -> None:
    """Writes ``bench.toml``: the values that the laboratory knows, with their errors."""
    lines = ["simulated = true", "", "[catheter]", *(f"{name} = {value:.6g}" for name, value in plan.stated.items())]
    lines += ["", "[views.camera]", f"metres_per_px = {metres_per_px:.6g}", f'base_side = "{base_side}"']
    lines += ["", "[sensor]", f"angle_deg = {plan.sensor_angle_deg:.6g}", 'reads = "tip-on-tissue"']
    lines += ["", "[actuation]", f"knob_gain_per_m_deg = {KNOB_GAIN_PER_M_DEG}"]
    if not (folder / "knob.csv").exists():
        lines += [f"constant = {{ knob_deg = {plan.motion.knob_deg:.4f} }}"]
    (folder / "bench.toml").write_text("\n".join(lines) + "\n")


def write_truth(plan: Plan, run: Run, line_px: FloatArray, path: Path) -> None:
    """Writes the truth for the judge alone: force, centreline in pixels (m, p, 2) and metres, random parameters."""
    np.savez_compressed(
        path,
        stamp_ns=frame_stamps(run),
        force_n=run.at_frames("force_n"),
        line_px=line_px,
        line_m=run.at_frames("line_m"),
        dent_m=run.at_frames("dent_m"),
        plan=json.dumps(asdict(plan)),
    )


def frame_stamps(run: Run) -> IntArray:
    """(m,): nanoseconds on the camera's clock, on which the session begins at one second."""
    return np.round((run.frame_s + 1.0) * 1e9).astype(np.int64)
