"""How a simulated session becomes files: as a real one does."""

import importlib.util
from collections.abc import Callable, Iterator
from pathlib import Path

from ..errors import InputError, MissingExtraError
from ..io import replacing_folder, write_video
from ..simulation import AnySimulationSettings, FluoroSettings, SimulatedBench, write_logs
from ..simulation.rendering.fluoroscope import XrayScene, write_dicom
from ..types import Frame, SimulatedClock
from ._record import record


def record_session(bench: SimulatedBench, target: Path, tick: Callable[[], None], lossless: bool = False) -> None:
    """Records a simulated session with its metadata.

    Args:
        bench: the session.
        target: the recording (.mcap); an existing one is replaced.
        tick: called for each frame.
        lossless: keep images as PNG.
    """
    record(
        bench,
        target,
        lossless=lossless,
        jpeg_quality=bench.imaging.jpeg_quality,
        overwrite=True,
        clock=SimulatedClock(),  # stands still: nothing in the file hangs on how fast this machine is
        progress=lambda _: tick(),
        analysis="along",  # it waits: nothing is lost, and no image is decoded again
    )


def _frames(bench: SimulatedBench, view: str, tick: Callable[[], None]) -> Iterator[Frame]:
    for index in bench.arrived(view).tolist():
        yield bench.frame(index, view)
        tick()


def _named(stem: str, bench: SimulatedBench, view: str, suffix: str) -> str:
    """Returns the name of the file of a view: "video.mp4", or where there are two, "video_a.mp4"."""
    return f"{stem}{suffix}" if len(bench.views) == 1 else f"{stem}_{view}{suffix}"


def leave_files(bench: SimulatedBench, target: Path, tick: Callable[[], None], lossless: bool = False) -> None:
    """Writes ``video.mp4`` of each view, and the logs beside it, to be imported.

    Args:
        bench: the session.
        target: the folder; an existing one is replaced.
        tick: called for each frame.
        lossless: keep every pixel as it is rendered.
    """
    with replacing_folder(target) as part:
        # Drawing and encoding share the time: a faster preset pays with larger files, not with quality; one thread, for
        # there is a process for every core, and the same bytes however many there are.
        fps = bench.settings.world.clock.fps
        for view in bench.views:
            path = part / _named("video", bench, view, ".mp4")
            write_video(path, _frames(bench, view, tick), fps, "ultrafast", 1, lossless=lossless, zero_ns=0)
        write_logs(bench, part)


def leave_dicom(bench: SimulatedBench, target: Path, tick: Callable[[], None], lossless: bool = False) -> None:
    """Writes ``run.dcm`` of each view, and the logs beside it; the images lose nothing.

    Args:
        bench: the session, with X-ray images.
        target: the folder; an existing one is replaced.
        tick: called for each frame.
        lossless: not used.
    """
    del lossless
    scene = bench.imaging.scene
    assert isinstance(scene, XrayScene)  # `refuse_form` lets no other come here
    with replacing_folder(target) as part:
        for place, view in enumerate(bench.views):
            frames = list(_frames(bench, view, tick))
            stamps = [frame.stamp_ns for frame in frames]
            path = part / _named("run", bench, view, ".dcm")
            write_dicom(path, [frame.image for frame in frames], stamps, scene, view=place)
        write_logs(bench, part)


def refuse_form(form: str, settings: AnySimulationSettings) -> None:
    """Checks, before the work, that sessions can be written in a form.

    Args:
        form: "recording", "files" or "dicom".
        settings: settings of the sessions.

    Raises:
        InputError: DICOM is wanted for a camera.
        MissingExtraError: DICOM is wanted, and pydicom is not installed.
    """
    if form != "dicom":
        return
    if not isinstance(settings, FluoroSettings):
        raise InputError(f"DICOM is for X-ray images, not for the camera of {settings.preset}; take the preset fluoro")
    if importlib.util.find_spec("pydicom") is None:
        raise MissingExtraError("pydicom", extra="dicom")


FORMS = {"recording": (".mcap", record_session), "files": ("", leave_files), "dicom": ("", leave_dicom)}
"""Values of ``--as``: ending of the names of the sessions, and the function that writes one."""
