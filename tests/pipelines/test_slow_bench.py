"""A simulated bench on a computer that is too slow for it."""

from tipforce.pipelines import LiveRunSettings
from tipforce.pipelines._live import slow_bench
from tipforce.simulation import RealTimeClock
from tipforce.types import SimulatedClock


def test_a_slow_computer_is_named_with_its_pace_and_a_fast_one_is_not():
    clock = RealTimeClock(0)
    assert slow_bench(clock, 24.0, "state fewer images") == ""
    for _ in range(3):
        clock.wait_for(clock.now_ns() - 1_000_000_000)
    message = slow_bench(clock, 24.0, "state fewer images, as in --set rate_hz=12")
    assert message.startswith("the computer is too slow for the simulated bench at 24 images a second: it runs at ")
    assert message.endswith("of real time; end other programs, or state fewer images, as in --set rate_hz=12")
    assert LiveRunSettings.model_validate({"rate_hz": 12}).rate_hz == 12.0
    assert slow_bench(SimulatedClock(), 24.0, "") == ""
