"""Short sessions in small images, for all that is not about the image."""

import pytest

from tipforce.simulation import SimulatedBench, SimulationSettings
from tipforce.simulation.world.settings import ClockSettings, MotionSettings, WorldSettings


@pytest.fixture(scope="session")
def short() -> SimulationSettings:
    clock = ClockSettings(fps=12.0)
    motion = MotionSettings(peak_within_n=5e-3)
    world = WorldSettings(seconds=8, tare_s=2, clock=clock, motion=motion)
    return SimulationSettings(preset="short", world=world, width=160, height=120)


@pytest.fixture(scope="session")
def bench(short: SimulationSettings) -> SimulatedBench:
    return SimulatedBench(short, seed=21, session=1)
