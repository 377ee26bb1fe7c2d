"""Short sessions in small pictures, for all that is not about the picture."""

import pytest

from tipforce.twin import TwinBench, TwinSettings
from tipforce.twin.world.settings import ClockSettings, WorldSettings


@pytest.fixture(scope="session")
def short() -> TwinSettings:
    clock = ClockSettings(fps=12.0)
    return TwinSettings(preset="short", world=WorldSettings(seconds=8, tare_s=2, clock=clock), width=160, height=120)


@pytest.fixture(scope="session")
def bench(short: TwinSettings) -> TwinBench:
    return TwinBench(short, seed=21, session=1)
