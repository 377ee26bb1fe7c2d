"""How a simulated session becomes a recording: as a real one does."""

from collections.abc import Callable
from pathlib import Path

from ..recording import SensorPose, record
from ..twin import TwinBench
from ..types import SimulatedClock
from ..vision import VisionSettings

__all__ = ["record_session"]


def record_session(bench: TwinBench, target: Path, tick: Callable[[], None], lossless: bool = False) -> None:
    """Record ``bench``, with what its sheet of facts says of the sensor, the tare and the picture."""
    notes = bench.context.notes
    start, end = notes["no_contact_s"].split(":")
    record(
        bench,
        target,
        sensor=SensorPose(float(notes["sensor_angle_deg"]), "tip-on-tissue"),
        tare=(float(start), float(end)),
        vision=VisionSettings.model_validate({"base_side": notes["base_side"]}),
        lossless=lossless,
        jpeg_quality=bench.scene.jpeg_quality,
        overwrite=True,
        clock=SimulatedClock(),  # stands still: nothing in the file hangs on how fast this machine is
        progress=lambda _: tick(),
    )
