"""How a simulated session becomes files: as a real one does."""

from collections.abc import Callable, Iterator
from pathlib import Path

from ..dataset import replacing_folder
from ..recording import SensorPose, record, write_video
from ..twin import TwinBench, write_logs
from ..types import Frame, SimulatedClock
from ..vision import VisionSettings

__all__ = ["FORMS", "leave_files", "record_session"]


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


def leave_files(bench: TwinBench, target: Path, tick: Callable[[], None], lossless: bool = False) -> None:
    """``video.mp4`` and the logs beside it in the folder ``target``, to be imported."""

    def frames() -> Iterator[Frame]:
        for index in range(len(bench.frame_s)):
            yield bench.frame(index)
            tick()

    with replacing_folder(target) as part:
        # Drawing and encoding share the time: a faster preset pays with larger files, not with quality; one thread, for
        # there is a process for every core, and the same bytes however many there are.
        fps = bench.settings.world.clock.fps
        write_video(part / "video.mp4", frames(), fps, "ultrafast", 1, lossless=lossless, zero_ns=0)
        write_logs(bench, part)


FORMS = {"recording": (".mcap", record_session), "files": ("", leave_files)}
"""What ``--as`` may be: how the names of the sessions end, and what writes one."""
