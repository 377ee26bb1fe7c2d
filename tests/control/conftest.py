"""An analytic plant: a drive with dead time and a largest speed, a wall that moves as it is told, a linear contact."""

import math
from collections import deque
from collections.abc import Callable

import numpy as np
import pytest

from tipforce.control import ControlLoop, ControlSettings, ControlTick, Path
from tipforce.types import Actuation, AxisLimits, Commanded, ForceEstimate, SimulatedClock, Status

DT_S, FRAME_S, IMAGE_DELAY_S, DRIVE_DELAY_S = 10e-3, 1 / 30, 60e-3, 25e-3
PATH = Path({"advance_mm": -10.0}, {"advance_mm": 10.0})


def estimate_of(stamp_ns: int, newtons: float, half_width_n: float = 0.0) -> ForceEstimate:
    return ForceEstimate(
        stamp_ns=stamp_ns,
        force_n=np.array([-newtons, 0.0, 0.0]),
        known=np.ones(3, np.bool_),
        covariance_n2=np.zeros((3, 3)),
        interval_n=np.zeros((3, 2)),
        magnitude_n=newtons,
        magnitude_interval_n=np.array([max(0.0, newtons - half_width_n), newtons + half_width_n]),
    )


class Plant:
    """`Actuators` and the rest of a bench: ``wall_mm`` (time -> place), force = gain * depth."""

    def __init__(self, wall_mm: Callable[[float], float], gain_n_per_mm: float) -> None:
        self.clock = SimulatedClock()
        self.wall_mm, self.gain = wall_mm, gain_n_per_mm
        self.place = -10.0
        self.sent: deque[tuple[float, float]] = deque([(-1.0, -10.0)])
        self.commands: list[tuple[float, float]] = []
        self.stops = 0
        self.limits = {"advance_mm": AxisLimits(-20.0, 20.0, 30.0, 10_000.0)}

    def command(self, targets: dict[str, float]) -> Commanded:
        taken = Commanded.of(self.clock.now_ns(), targets, self.limits)
        now = self.clock.now_ns() * 1e-9
        self.sent.append((now + DRIVE_DELAY_S, taken.targets["advance_mm"]))
        self.commands.append((now, taken.targets["advance_mm"]))
        return taken

    def read(self) -> Actuation:
        return Actuation(self.clock.now_ns(), {"advance_mm": self.place})

    def stop(self, *axes: str) -> None:
        self.stops += 1
        self.sent = deque([(-1.0, self.place)])

    def step(self) -> float:
        """Time goes on by a step; returns the true force."""
        now = self.clock.now_ns() * 1e-9 + DT_S
        self.clock.sleep_until_ns(round(now * 1e9))
        while len(self.sent) > 1 and self.sent[1][0] <= now:
            self.sent.popleft()
        goal = self.sent[0][1]
        self.place += min(max(goal - self.place, -30.0 * DT_S), 30.0 * DT_S)
        return max(0.0, self.gain * (self.place - self.wall_mm(now)))


class Bench:
    """A plant with a loop around it."""

    def __init__(self, plant: Plant, settings: ControlSettings, half_width_n: float = 0.02) -> None:
        self.plant, self.half_width_n = plant, half_width_n
        self.loop = ControlLoop(plant, plant.clock, PATH, settings, FRAME_S)  # type: ignore[arg-type]
        self.waiting: deque[tuple[float, ForceEstimate]] = deque()
        self.next_frame_s = 0.0
        self.ticks: list[ControlTick] = []
        self.forces: list[float] = []
        self.status, self.silent = Status.VALID, False
        self.spoil: Callable[[ForceEstimate], ForceEstimate] = lambda estimate: estimate

    def run(self, seconds: float) -> np.ndarray:
        """(n,) the true force meanwhile."""
        first = len(self.forces)
        for _ in range(round(seconds / DT_S)):
            force = self.plant.step()
            now_ns = self.plant.clock.now_ns()
            now = now_ns * 1e-9
            if now >= self.next_frame_s and not self.silent:
                self.next_frame_s += FRAME_S
                found = (
                    estimate_of(now_ns, force, self.half_width_n)
                    if self.status is Status.VALID
                    else ForceEstimate.invalid(now_ns, self.status, "no catheter in the image")
                )
                self.waiting.append((now + IMAGE_DELAY_S, self.spoil(found)))
            while self.waiting and self.waiting[0][0] <= now:
                self.loop.update(self.waiting.popleft()[1])
            self.ticks.append(self.loop.tick())
            self.forces.append(force)
        return np.array(self.forces[first:])


def beating(amplitude_mm: float, breath_mm: float, heart_hz: float = 1.2) -> Callable[[float], float]:
    def wall(time_s: float) -> float:
        heart = amplitude_mm * math.sin(2 * math.pi * heart_hz * time_s + 0.4)
        return heart + breath_mm * math.sin(2 * math.pi * 0.25 * time_s)

    return wall


@pytest.fixture
def bench() -> Callable[..., Bench]:
    def make(
        amplitude_mm: float = 0.0,
        breath_mm: float = 0.0,
        gain_n_per_mm: float = 0.08,
        half_width_n: float = 0.02,
        heart_hz: float = 1.2,
        **settings: object,
    ) -> Bench:
        plant = Plant(beating(amplitude_mm, breath_mm, heart_hz), gain_n_per_mm)
        return Bench(plant, ControlSettings.model_validate(settings), half_width_n)

    return make
