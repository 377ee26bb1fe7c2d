"""The loop on live updates: what reaches it, who may command it, and what ends it. Drives and clock are fakes."""

import math
import threading
import time
from collections.abc import Callable
from pathlib import Path as FilePath
from types import MappingProxyType

import numpy as np
import pytest

from tipforce.control import SafetySettings
from tipforce.errors import DeviceError, InputError
from tipforce.hardware import AxisConfig, GrblConfig, GrblStage, HardwareSource
from tipforce.hardware.emulators import GrblEmulator
from tipforce.live import LiveHealth, LiveReport, LiveUpdate
from tipforce.pipelines import HoldSettings, LiveControl, LiveRunSettings, open_live_source
from tipforce.pipelines._control import path_of_drives
from tipforce.pipelines._live import _control, _CurrentDrives, simulated_bench
from tipforce.pipelines._live_page import _Buttons
from tipforce.types import Actuation, AxisLimits, Commanded, ForceEstimate, Status, SystemClock

PERIOD_S = 2e-3
FAST = HoldSettings(
    controller="pi", period_s=PERIOD_S, approach_mm_per_s=30.0, safety=SafetySettings(least_stale_s=0.05, coast_s=0.03)
)
MARKS = ({"advance_mm": -2.0}, {"advance_mm": 10.0})


class Drives:
    """One axis that is where it was sent at once; counts what it was told."""

    def __init__(self, max_speed: float = 30.0) -> None:
        self.place, self.error = 0.0, None
        self.commands: list[float] = []
        self.stops = 0
        self.limits = {"advance_mm": AxisLimits(-20.0, 20.0, max_speed, 1000.0)}
        self.clock = SystemClock()

    def command(self, targets: dict[str, float]) -> Commanded:
        if self.error is not None:
            raise self.error
        self.place = targets["advance_mm"]
        self.commands.append(self.place)
        return Commanded.of(self.clock.now_ns(), targets, self.limits)

    def read(self) -> Actuation:
        if self.error is not None:
            raise self.error
        return Actuation(self.clock.now_ns(), {"advance_mm": self.place, "stage_forward_mm": 3.0})

    def stop(self, *axes: str) -> None:
        assert axes == ("advance_mm",)
        self.stops += 1


class Run:
    """A loop on fake drives; `feed` gives it an estimate each 5 ms until `silent` is set."""

    def __init__(self, control: LiveControl, drives: Drives) -> None:
        self.control, self.drives = control, drives
        self.silent = threading.Event()
        self.status = Status.VALID
        self.newtons = 0.0
        self._number = 0
        self._thread = threading.Thread(target=self._feed)

    def __enter__(self) -> "Run":
        self.control.__enter__()
        self._thread.start()
        self.until(lambda: self.control.status.length_mm > 0 or bool(self.control.status.reason))
        self.until(lambda: self.control.status.force_n == 0.0)
        return self

    def __exit__(self, *_: object) -> None:
        self.silent.set()
        self._thread.join()
        self.control.__exit__(None, None, None)

    def put(self) -> None:
        now = self.drives.clock.now_ns()
        newtons = self.newtons
        estimate = (
            ForceEstimate(
                stamp_ns=now, force_n=np.array([-newtons, 0.0, 0.0]), known=np.ones(3, np.bool_),
                covariance_n2=np.zeros((3, 3)), interval_n=np.zeros((3, 2)), magnitude_n=newtons,
                magnitude_interval_n=np.array([newtons, newtons]),
            )
            if self.status is Status.VALID
            else ForceEstimate.invalid(now, self.status, "the camera is silent")
        )  # fmt: skip
        self._number += 1
        self.control.sink.put(
            LiveUpdate(self._number, estimate, None, MappingProxyType({}), now - 1_000_000, now, LiveHealth())
        )

    def _feed(self) -> None:
        while not self.silent.wait(5e-3):
            self.put()

    def until(self, true: Callable[[], bool], seconds: float = 3.0) -> None:
        end = time.monotonic() + seconds
        while not true():
            assert time.monotonic() < end, self.control.status
            time.sleep(1e-3)

    def reach(self, state: str) -> None:
        self.until(lambda: self.control.status.state == state)


def made(settings: HoldSettings = FAST, marks=MARKS, drives: Drives | None = None, **more) -> Run:
    drives = drives or Drives()
    return Run(LiveControl(drives, drives.clock, settings, marks, frame_period_s=5e-3, **more), drives)


def test_estimates_reach_the_loop_and_drive_a_run_to_contact() -> None:
    with made() as run:
        assert run.control.status.state == "idle"
        assert not run.drives.commands  # nothing moves before it is started
        run.control.start()
        run.reach("approach")
        run.newtons = 0.05
        run.reach("hold")
        status = run.control.status
        assert (status.force_n, status.moves) == (0.05, True)
        run.control.retract()
        run.reach("idle")
        assert run.drives.place == pytest.approx(-2.0, abs=0.06)
    assert run.drives.stops == 1


def test_each_run_states_its_peak_and_the_time_above_the_limits() -> None:
    true = {"newtons": 0.0}
    with made(true_force_n=lambda: true["newtons"]) as run:
        assert run.control.runs == ()
        assert math.isnan(run.control.status.peak_n)
        run.control.start()
        run.reach("approach")
        run.newtons, true["newtons"] = 0.05, 0.35
        run.reach("hold")
        run.newtons, true["newtons"] = 0.45, 0.5
        run.until(lambda: run.control.status.true_above_limit_s > 0.05)
        run.status = Status.NO_CATHETER  # an estimate that is not valid adds to neither
        run.until(lambda: run.control.runs[0].not_valid_s > 0.0)
        run.control.retract()
        run.until(lambda: not run.control.running)
        run.newtons, run.status = 0.0, Status.VALID
        run.until(lambda: run.control.status.force_n == 0.0)
        (first,) = run.control.runs
        seconds = first.seconds
        run.control.start()
        run.reach("approach")
    first, second = run.control.runs
    assert first.seconds == pytest.approx(seconds, abs=0.02)  # nothing is added after the run
    assert first.true is not None
    assert (first.estimated.peak_n, first.true.peak_n) == (0.45, 0.5)
    assert 0.0 < first.estimated.above_limit_s < first.true.above_limit_s
    assert first.true.above_limit_s < first.true.above_safe_s <= first.seconds
    assert second.seconds < first.seconds
    text = LiveReport(loop_runs=run.control.runs).text().splitlines()
    assert text[-2].startswith(f"run 1 of the loop: {first.seconds:.1f} s, held for 0.0 s, no valid force for ")
    assert "Peak of the estimated force: 0.45 N (46 g);" in text[-2]
    assert "s above the loop's limit, 0.4 N;" in text[-2]
    assert "Peak of the true force: 0.50 N (51 g);" in text[-2]
    assert text[-2].endswith("s above the thesis's safe limit, 0.3 N.")
    assert text[-1].startswith("run 2 of the loop:")


def test_stop_brakes_at_once_though_the_loop_is_busy_and_a_release_moves_nothing() -> None:
    with made() as run:
        run.control.start()
        run.reach("approach")
        with run.control._lock:  # as a tick that takes long
            begin = time.monotonic()
            run.control.stop()
            assert time.monotonic() - begin < 0.1
        assert run.drives.stops == 1
        count = len(run.drives.commands)
        run.until(lambda: run.control.status.state == "stopped")
        with pytest.raises(InputError, match="release it first"):
            run.control.start()
        with pytest.raises(InputError, match="release it first"):
            run.control.retract()
        time.sleep(5 * PERIOD_S)
        run.control.release()
        time.sleep(5 * PERIOD_S)
        assert len(run.drives.commands) == count
        assert run.control.status.state == "idle"
        run.control.retract()
        run.until(lambda: not run.control.running)
        assert run.drives.place == pytest.approx(-2.0, abs=0.06)
        with pytest.raises(InputError, match="no run is on its way"):
            run.control.retract()
        with pytest.raises(InputError, match="nothing is stopped"):
            run.control.release()


def test_a_limit_that_is_lowered_in_a_run_draws_back_and_none_is_raised_above_that_of_the_settings() -> None:
    with made() as run:
        with pytest.raises(InputError, match=r"at most 0\.4, where the loop draws the catheter back .* got 0\.41"):
            run.control.set_limit(0.41)
        run.control.start()
        run.reach("approach")
        run.newtons = 0.15
        run.reach("hold")
        run.until(lambda: run.control.status.action == "pass")
        run.control.set_limit(0.1)
        run.until(lambda: run.control.status.action == "over_limit")
        assert run.control.status.limit_n == 0.1
        run.control.set_limit(0.4)
        run.until(lambda: run.control.status.action == "pass")
        run.control.retract()
        run.reach("idle")
        run.control.set_limit(0.2)
        run.control.mark_start()  # the loop on a new path keeps it
        run.until(lambda: run.control._loop is not None)
        assert run.control._loop.safety.limit_n == 0.2


def test_no_command_follows_a_stop_that_came_while_it_was_on_its_way() -> None:
    drives = Drives()
    sending, free = threading.Event(), threading.Event()
    order: list[str] = []

    class Slow(Drives):
        def command(self, targets: dict[str, float]) -> Commanded:
            sending.set()
            free.wait(2.0)
            order.append("command")
            return super().command(targets)

        def stop(self, *axes: str) -> None:
            order.append("stop")
            super().stop(*axes)

    drives = Slow()
    with made(drives=drives) as run:
        run.control.start()
        assert sending.wait(2.0)
        stopping = threading.Thread(target=run.control.stop)
        stopping.start()
        time.sleep(0.02)
        free.set()
        stopping.join()
        time.sleep(5 * PERIOD_S)
        assert order[-1] == "stop"
        assert order.count("stop") == 1


@pytest.mark.parametrize("dead", [True, False])
def test_a_dead_engine_and_an_invalid_estimate_draw_the_catheter_back(dead: bool) -> None:
    with made() as run:
        run.control.start()
        run.until(lambda: run.drives.place > 0.0)
        if dead:
            run.silent.set()
        else:
            run.status = Status.STALE
        run.reach("retract")
        assert ("no estimate" if dead else "the camera is silent") in run.control.status.reason
        run.reach("idle")
        assert run.drives.place == pytest.approx(-2.0, abs=0.06)


def test_without_a_page_that_could_stop_it_a_run_ends_at_its_start() -> None:
    silent_s = [0.5]
    with made(silent_s=lambda: silent_s[0]) as run:
        run.control.start()
        run.until(lambda: run.drives.place > 0.0)
        assert run.control.status.state == "approach"
        silent_s[0] = FAST.page_lost_s + 0.1
        run.reach("retract")
        assert "no page was heard for 3 s" in run.control.status.reason
        run.reach("idle")
        time.sleep(0.05)
        assert run.control.status.state == "idle"  # it does not begin again by itself
        assert not run.control.status.moves


def test_an_error_of_the_drives_stops_the_run_and_is_told() -> None:
    with made() as run:
        run.control.start()
        run.reach("approach")
        run.drives.error = DeviceError("hardware.stage: alarm 1")
        run.reach("stopped")
        assert run.control.status.reason == "hardware.stage: alarm 1"
        assert run.drives.stops == 1
        run.drives.error = None
        time.sleep(5 * PERIOD_S)
        assert run.control.status.state == "stopped"  # until somebody has looked
        run.control.release()
        run.reach("idle")


def test_a_force_expires_in_the_status_though_the_drives_do_not_answer() -> None:
    with made() as run:
        hangs = threading.Event()
        read = run.drives.read
        run.drives.read = lambda: (hangs.wait(3.0) and read()) or read()  # type: ignore[method-assign]
        run.silent.set()
        run.put()
        assert run.control.status.force_n == 0.0
        time.sleep(1.05)
        assert math.isnan(run.control.status.force_n)
        assert math.isnan(run.control.status.upper_n)
        assert not run.control.status.held
        hangs.set()


def test_drives_that_are_not_there_yet_are_waited_for() -> None:
    drives = Drives()
    drives.error = DeviceError("hardware.stage: is not connected")
    with made(drives=drives) as run:
        run.until(lambda: run.control.status.reason == "hardware.stage: is not connected")
        with pytest.raises(DeviceError):
            run.control.mark_start()
        drives.error = None
        run.until(lambda: run.control.status.reason == "ready")
        run.control.start()
        run.reach("approach")


def test_start_and_goal_are_marked_where_the_drives_are() -> None:
    with made(marks=None) as run:
        run.until(lambda: run.control.status.reason == "mark start and goal")
        with pytest.raises(InputError, match="mark start and goal"):
            run.control.start()
        run.control.mark_start()
        run.until(lambda: run.control.status.reason == "mark goal")
        with pytest.raises(InputError, match="two positions"):
            run.control.mark_goal()
        run.drives.place = 0.3
        with pytest.raises(InputError, match=r"1 mm of path or more, got 0\.30"):
            run.control.mark_goal()
        run.drives.place = 5.0
        run.control.mark_goal()
        run.until(lambda: run.control.status.length_mm == 5.0)
        assert run.control.status.goal == {"advance_mm": 5.0}
        run.control.start()
        run.reach("approach")
        with pytest.raises(InputError, match="on its way"):
            run.control.mark_goal()


def test_a_run_begins_with_a_valid_force_alone() -> None:
    with made() as run:
        run.status = Status.NO_CATHETER
        run.until(lambda: run.control.status.force_n != run.control.status.force_n)
        time.sleep(0.05)
        with pytest.raises(InputError, match="not now: no_catheter: the camera is silent"):
            run.control.start()


def test_drives_faster_than_the_limits_begin_on_the_path_and_slower_ones_anywhere() -> None:
    with made(drives=Drives(max_speed=100.0)) as run:
        run.drives.place = -9.0
        with pytest.raises(InputError, match=r"advance_mm: -9.0 is off the path"):
            run.control.start()
        run.drives.place = 3.0
        run.control.start()
    with made() as run:
        run.drives.place = -9.0
        run.control.start()
        run.reach("approach")


def test_marks_have_the_axes_of_the_drives() -> None:
    drives = Drives()
    with pytest.raises(InputError, match="expected knob_deg as drives = knob"):
        LiveControl(drives, drives.clock, HoldSettings(drives="knob"), MARKS)


def test_zero_is_refused_while_the_loop_has_the_drives() -> None:
    class Engine:
        zeroed = 0

        def zero(self, *, by: str, confirmed_n: float | None) -> None:
            self.zeroed += 1

        def clear_zero(self) -> None:
            self.zeroed -= 1

        def start_integral(self) -> None: ...
        def stop_integral(self) -> None: ...

    with made() as run:
        engine = Engine()
        buttons = _Buttons(engine, run.control)  # type: ignore[arg-type]
        buttons.zero(by="", confirmed_n=None)
        run.control.start()
        with pytest.raises(InputError, match="retract first"):
            buttons.zero(by="", confirmed_n=None)
        with pytest.raises(InputError, match="retract first"):
            buttons.clear_zero()
        assert engine.zeroed == 1


def at_rest(grbl: GrblEmulator) -> bool:
    before = grbl.place[1]
    time.sleep(0.05)
    return grbl.place[1] == before


def test_a_grbl_stage_is_driven_and_stopped(tmp_path: FilePath) -> None:
    axes = {"advance_mm": AxisConfig(axis="Y", low=-5.0, high=20.0, max_speed=30.0, scale=-2.0)}
    with GrblEmulator(tmp_path / "stage") as grbl:
        source = HardwareSource([GrblStage(GrblConfig(port=str(grbl.path), axes=axes))])
        drives = source.actuators
        assert drives is not None
        control = LiveControl(drives, source.clock, FAST, ({"advance_mm": 0.0}, {"advance_mm": 15.0}))
        run = Run(control, drives)  # type: ignore[arg-type]
        drives.clock = source.clock  # type: ignore[attr-defined]
        with run:  # before the stage is connected
            run.until(lambda: "not connected" in control.status.reason)
            with source:
                run.until(lambda: control.status.length_mm == 15.0)
                control.start()
                run.until(lambda: control.status.axes["advance_mm"] > 2.0)
                control.stop()
                run.until(lambda: control.status.state == "stopped")
                run.until(lambda: at_rest(grbl))
                assert abs(grbl.place[1]) < 2 * 15.0  # on its way, in the controller's units


def test_a_source_without_drives_is_refused(tmp_path: FilePath) -> None:
    bench = tmp_path / "bench.toml"
    bench.write_text('[hardware.cameras.camera]\ndriver = "opencv"\ndevice = 0\n')
    wanted = r"expected a simulated bench, or a bench.toml with \[hardware.stage\]"
    with open_live_source(bench=bench) as source, pytest.raises(InputError, match=wanted):
        _control(source, SystemClock(), HoldSettings(), with_page=True)


def test_a_run_without_a_page_is_refused() -> None:
    class Bench:
        actuators = Drives()

    with pytest.raises(InputError, match="started and stopped on the page"):
        _control(Bench(), SystemClock(), HoldSettings(), with_page=False)  # type: ignore[arg-type]


def test_the_live_simulation_is_that_of_the_closed_loop_benchmark() -> None:
    settings = LiveRunSettings.model_validate({"rate_hz": 15, "hold": {"drives": "both", "contact": "oblique"}})
    assert settings.hold is not None
    bench = simulated_bench("bench-2021", settings)
    world = bench.world
    assert (world.clamp.logged, world.clock.fps, world.clock.camera_delay_s) == (True, 15.0, 40e-3)
    path = path_of_drives("both", 1e3 * world.clamp.home_m)
    assert path.start == {"advance_mm": 0.0, "knob_deg": -14.0}  # the base where the metadata have it


def test_drives_of_a_simulated_session_that_has_ended_stop_the_run() -> None:
    class Simulation:
        actuators = Drives()

    simulation = Simulation()
    drives = _CurrentDrives(simulation)  # type: ignore[arg-type]
    run = Run(LiveControl(drives, simulation.actuators.clock, FAST, MARKS, frame_period_s=5e-3), simulation.actuators)
    drives.sessions = drives._session = 1
    with run:
        run.control.start()
        run.reach("approach")
        simulation.actuators = Drives()
        drives.sessions = 2
        run.reach("stopped")
        assert "the simulated session has ended" in run.control.status.reason
        assert simulation.actuators.commands == []
        run.control.release()
        run.reach("idle")
