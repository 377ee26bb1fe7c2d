"""The foreign bench: what of it can be told without its engines, and its rod where MuJoCo is installed."""

import json
import math
from pathlib import Path

import numpy as np
import pytest
from benchmarks.foreign.camera import HEIGHT, WIDTH, draw_camera, expose
from benchmarks.foreign.check import elastica
from benchmarks.foreign.judge import score
from benchmarks.foreign.rod import LAWS, CableWorld, Rod, Tissue
from benchmarks.foreign.session import Plan, Run, draw_plan, frame_stamps, write_bench, write_logs, write_truth

from tipforce.io import read_force_log
from tipforce.types import ForceLogInfo, read_bench


def resting(plan: Plan, force_n: tuple[float, float, float]) -> Run:
    """A session in which nothing moves."""
    time_s = np.arange(0.0, 2.0, 2e-3)
    line = np.linspace([0.0, 0.0, 0.0], [plan.rod.length_m + plan.rod.rigid_m, 0.0, 0.0], 20)
    still = np.zeros(len(time_s))
    rows = (len(time_s), 1)
    return Run(
        time_s=time_s,
        frame_s=np.array([0.5, 1.0]),
        force_n=np.tile(force_n, rows),
        line_m=np.tile(line, (len(time_s), 1, 1)),
        wall_m=np.tile(line[-1], rows),
        dent_m=still,
        knob_deg=still + plan.motion.knob_deg,
        advance_m=still,
        forward_m=still,
        across_m=still,
    )


def test_a_seed_gives_the_same_session_and_another_seed_another() -> None:
    assert draw_plan(3) == draw_plan(3)
    assert draw_plan(3) != draw_plan(4)


@pytest.mark.parametrize("seed", range(8))
def test_the_camera_sees_the_catheter_come_from_the_stated_border(seed: int) -> None:
    plan = draw_plan(seed)
    run = resting(plan, (0.0, 0.0, 0.0))
    camera = draw_camera(plan, run)
    base, tip = camera.project(1e3 * run.line_m[0][[0, -1]])
    towards = {"left": (1, 0), "right": (-1, 0), "top": (0, 1), "bottom": (0, -1)}[camera.base_side]
    along = (tip - base) / np.linalg.norm(tip - base)
    assert along @ towards > math.cos(math.radians(12.0))
    assert np.all((tip > 0) & (tip < [WIDTH, HEIGHT]))
    scale = (plan.rod.length_m + plan.rod.rigid_m) / np.linalg.norm(tip - base)
    assert scale == pytest.approx(camera.metres_per_px, rel=0.02)


def test_y_of_the_base_frame_is_counter_clockwise_from_x_in_the_image() -> None:
    plan = draw_plan(0)
    camera = draw_camera(plan, resting(plan, (0.0, 0.0, 0.0)))
    origin, x, y = camera.project(np.array([[0.0, 0, 0], [1.0, 0, 0], [0.0, 1, 0]]))
    (xu, xv), (yu, yv) = x - origin, y - origin
    assert xu * yv - xv * yu < 0, "v points down"


def test_the_sensor_of_the_camera_keeps_colours_and_order() -> None:
    light = np.full((32, 32, 3), [0.5, 0.2, 0.05], np.float32)
    seen = expose(light, 1.0, 1e-3, grey=False, rng=np.random.default_rng(0))
    assert seen.shape == (32, 32, 3)
    assert np.median(seen.reshape(-1, 3), axis=0) == pytest.approx([188, 124, 63], abs=2)  # sRGB of the three
    assert expose(light, 1.0, 1e-3, grey=True, rng=np.random.default_rng(0)).shape == (32, 32)


def test_the_files_say_what_the_truth_says(tmp_path: Path) -> None:
    plan, force = draw_plan(1), (0.1, -0.2, 0.03)
    run = resting(plan, force)
    write_logs(plan, run, tmp_path)
    write_bench(plan, tmp_path, 2e-4, "left")
    write_truth(plan, run, np.zeros((2, 20, 2)), tmp_path / "session.truth.npz")
    info = read_bench(tmp_path / "bench.toml")
    log = read_force_log(tmp_path / "force.csv", ForceLogInfo(), None)
    assert info.sensor.angle_deg is not None
    angle = math.radians(info.sensor.angle_deg)
    read = np.median(log.force_n, axis=0) - plan.sensor_bias_n
    turned = [
        read[0] * math.cos(angle) - read[1] * math.sin(angle),
        read[0] * math.sin(angle) + read[1] * math.cos(angle),
    ]
    assert -np.array([*turned, read[2]]) == pytest.approx(force, abs=8e-3)  # a degree, and half a step of the sensor
    with np.load(tmp_path / "session.truth.npz") as truth:
        assert truth["force_n"] == pytest.approx(np.tile(force, (2, 1)))
        assert truth["stamp_ns"].tolist() == frame_stamps(run).tolist()
        assert json.loads(str(truth["plan"]))["seed"] == 1
    offset_ns = frame_stamps(run)[0] - np.interp(0.5, run.time_s, log.stamp_ns)
    assert offset_ns == pytest.approx(1e9 * plan.clock_offset_s, abs=1e3)


@pytest.mark.parametrize("law", LAWS)
def test_tissue_begins_without_force_and_stiffens_or_stays(law: str) -> None:
    forces = [LAWS[law](depth) for depth in np.linspace(0.0, 4e-3, 9)]
    assert forces[0] == 0.0
    assert np.all(np.diff(forces) > 0)
    assert np.all(np.diff(forces, 2) >= -1e-12)


def test_a_score_counts_what_was_answered_wrong_apart_from_what_was_not() -> None:
    nan = math.nan
    rows = np.array([[0.1, 0.12, 0.1, 0.2], [0.2, 0.1, 0.05, 0.15], [0.2, nan, nan, nan], [0.0, 0.03, 0.0, 0.1]])
    scored = score(rows)
    assert scored["frames"] == 3
    assert scored["abstained"] == pytest.approx(1 / 3)
    assert scored["mae_n"] == pytest.approx(0.06)
    assert scored["bias_n"] == pytest.approx(-0.04)
    assert scored["wrong"] == 0.5
    assert scored["holds"] == 0.5
    assert scored["free_mae_n"] == pytest.approx(0.03)


def test_the_exact_elastica_is_the_published_one() -> None:
    """Bisshopp and Drucker 1945, P L^2 / EI = 2."""
    x, y = elastica(2.0)[-1]
    assert (1 - x, y) == pytest.approx((0.16064, 0.49346), abs=2e-5)


def test_the_cable_bends_as_the_elastica_and_its_contact_force_is_what_the_clamp_feels() -> None:
    pytest.importorskip("mujoco")
    rod = Rod(rigid_m=1e-9)
    world = CableWorld(rod)
    world.advance(0.3, dead_load_n=np.array([0.0, 2.0 * rod.stiffness_nm2 / rod.length_m**2, 0.0]))
    assert world.joints_m[-2, :2] / rod.length_m == pytest.approx([1 - 0.16064, 0.49346], abs=1e-3)
    tissue = Tissue(120.0, "hertz", 0.2, math.radians(230.0), 0.0)
    world = CableWorld(Rod(), tissue)
    start = world.end_m - 1e-3 * tissue.normal
    for depth in np.linspace(0.0, 5e-3, 11):
        world.advance(0.02, wall_m=start + depth * tissue.normal)
        push_n = world.tip_force_n @ tissue.normal
        across_n = np.linalg.norm(world.tip_force_n - push_n * tissue.normal)
        assert across_n <= 1.01 * tissue.friction * abs(push_n), "the tissue's friction counts, not the dome's"
    assert np.linalg.norm(world.tip_force_n) > 0.02
    assert world.tip_force_n == pytest.approx(world.base_reaction_n, abs=2e-3)
