"""A guided first session: a person is asked to tare, move and press, and sees immediately whether it was measured."""

import math
from array import array
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from ..io import RecordingReader, spread_images
from ..types import Event, FloatArray, Frame, Image, Wrench
from ..vision import SessionDetector, VisionSettings
from ._summary import RecordingSummary

_QUIET_N = 0.02
"""Range of the means of half seconds while nothing touches; with more the tare is begun again."""
_BLOCK_S = 0.5
"""Duration of the blocks of readings whose means are compared."""
_AGAIN = 3
MIN_PRESSED_N = 0.05
"""Smallest force to be reached: some 5 g, a quarter of the force of an ablation."""
_CHANGED = 4.0
"""Grey values by which one pixel in a hundred has to change while the catheter moves."""
_STEP = 8
"""Every eighth pixel is compared."""
_FEWEST_LABELS = 100
_DETECTED = 0.7
"""Share of the images in which the catheter has to be detected."""


@dataclass(frozen=True, slots=True)
class Phase:
    """A part of the session.

    Attributes:
        name: its name.
        seconds: its duration in s.
        prompt: the request to the person.
    """

    name: str
    seconds: float
    prompt: str


PHASES = (
    Phase("tare", 5.0, "tare: keep the tip free; nothing touches the catheter or the sensor"),
    Phase("move", 10.0, "move: move the catheter and turn its knob, still without contact"),
    Phase("press", 30.0, "press: press the tip on the tissue, softly and harder, at the angles that you will use"),
)


@dataclass
class Guide:
    """Follows the events of a session through its phases. Times are those of the events' stamps.

    Attributes:
        phases: the phases in order.
        tare_s: start and end of the stretch without contact, in seconds since the first reading of force; None: the
            force was not quiet yet.
        level_n: (3,) mean of the readings in the last tare, also where the force was not quiet.
        peak_n: largest force in the phase "press" in newtons.
        changed: largest change of the image since the first one, in grey levels.
        moved: drive -> smallest and largest reading.
    """

    phases: Sequence[Phase] = PHASES
    tare_s: tuple[float, float] | None = None
    level_n: FloatArray | None = None
    peak_n: float = 0.0
    changed: float = 0.0
    moved: dict[str, tuple[float, float]] = field(default_factory=dict[str, tuple[float, float]])
    _place: int = 0
    _began_ns: int | None = None
    _first_force_ns: int | None = None
    _tries: int = 0
    _stamps: "array[int]" = field(default_factory=lambda: array("q"))
    _force: "array[float]" = field(default_factory=lambda: array("d"))
    _image: Image | None = None
    _now_ns: int = 0
    _spread_n: float = math.nan

    @property
    def done(self) -> bool:
        """Whether all phases are over."""
        return self._place >= len(self.phases)

    @property
    def seconds(self) -> float:
        """Duration of all phases, without a repeated tare."""
        return sum(phase.seconds for phase in self.phases)

    def take(self, event: Event) -> None:
        """Takes the next event: updates the figures of the present phase, and ends the phase when its time is over."""
        if self.done:
            return
        self._now_ns = max(self._now_ns, event.stamp_ns)
        if self._began_ns is None:
            self._began_ns = self._now_ns
        name = self.phases[self._place].name
        if isinstance(event, Wrench):
            self._take_force(event, name)
        elif isinstance(event, Frame):
            self._take_image(event.image)
        else:
            for drive, value in event.values.items():
                low, high = self.moved.get(drive, (value, value))
                self.moved[drive] = min(low, value), max(high, value)
        if (self._now_ns - self._began_ns) * 1e-9 >= self.phases[self._place].seconds:
            self._end(name)

    def _take_force(self, event: Wrench, name: str) -> None:
        """Keeps a reading of the phase "tare", or takes the peak, less the tare, of the phase "press"."""
        if self._first_force_ns is None:
            self._first_force_ns = event.stamp_ns
        if name == "tare":
            self._stamps.append(event.stamp_ns)
            self._force.extend(event.force_n)
        elif name == "press" and self.level_n is not None:
            self.peak_n = max(self.peak_n, float(np.linalg.norm(np.nan_to_num(event.force_n - self.level_n))))

    def _take_image(self, image: Image) -> None:
        small = image[::_STEP, ::_STEP].astype(np.float32)
        if self._image is None:
            self._image = image[::_STEP, ::_STEP].copy()
        elif self._image.shape == small.shape:
            self.changed = max(self.changed, float(np.percentile(np.abs(small - self._image), 99)))

    def _end(self, name: str) -> None:
        """Ends the phase ``name``, and begins the next one, or the same again."""
        if name == "tare" and not self._set_tare() and self._tries < _AGAIN:
            self._tries += 1
        else:
            self._place += 1
        self._began_ns = self._now_ns
        self._stamps, self._force = array("q"), array("d")

    def _set_tare(self) -> bool:
        """Sets the level of the tare from the readings of the phase, and its stretch if the force was quiet.

        Returns:
            Whether it was: the means of half seconds, in newtons, differ by at most `_QUIET_N` on each axis. False
            also without readings.
        """
        if not self._stamps or self._first_force_ns is None:
            return False
        stamps, force = np.frombuffer(self._stamps, np.int64), np.frombuffer(self._force).reshape(-1, 3)
        seconds = (stamps - stamps[0]) * 1e-9
        block = np.floor(seconds / _BLOCK_S).astype(np.int64)
        means = np.array([force[block == number].mean(axis=0) for number in np.unique(block)])
        self._spread_n = float(np.nanmax(np.ptp(means, axis=0)))
        self.level_n = force.mean(axis=0)
        if self._spread_n > _QUIET_N:
            return False
        first = (int(stamps[0]) - self._first_force_ns) * 1e-9
        self.tare_s = first, first + float(seconds[-1])
        return True

    def prompt(self) -> str:
        """Returns the present request, the remaining time, and the measurement."""
        if self.done:
            return "done"
        phase = self.phases[self._place]
        remaining_s = phase.seconds - (self._now_ns - (self._began_ns or self._now_ns)) * 1e-9
        measured = ""
        if phase.name == "tare" and self._tries:
            measured = f" (again: the force moved by {1e3 * self._spread_n:.0f} mN)"
        elif phase.name == "move":
            measured = f" (the image changed by {self.changed:.0f} grey values)"
        elif phase.name == "press":
            measured = f" (up to {1e3 * self.peak_n:.0f} mN so far)"
        return f"{phase.prompt}: {max(remaining_s, 0.0):.0f} s{measured}"

    def lacking(self, *, simulated: bool = False) -> list[str]:
        """Returns one sentence for each thing that the session did not show; ``simulated``: there is no device."""
        found: list[str] = []
        slow = "the simulated bench is slow on this computer; end other programs, or record for longer"
        if not self.done:
            found.append(f"the session ended before its phase {self.phases[self._place].name!r} was over")
        if self._first_force_ns is None:
            found.append(f"no force came: {slow if simulated else 'check [hardware.force] of bench.toml'}")
        elif self.tare_s is None:
            found.append(
                f"the force was never quiet for {self.phases[0].seconds:g} s: it moved by "
                f"{1e3 * self._spread_n:.0f} mN; keep the tip free, and look for vibrations"
            )
        if self._image is None:
            found.append(f"no image came: {slow if simulated else 'check [hardware.cameras] of bench.toml'}")
        elif self.changed < _CHANGED:
            found.append("the images did not change while the catheter was to move: check that the camera sees it")
        if self._first_force_ns is not None and self.peak_n < MIN_PRESSED_N:
            found.append(
                f"the tip pressed with {1e3 * self.peak_n:.0f} mN at most; "
                f"press with more than {1e3 * MIN_PRESSED_N:.0f}"
            )
        return found


def missing_for_training(summary: RecordingSummary, guide: Guide | None = None) -> list[str]:
    """Returns one sentence for each thing that a recording lacks for training; empty: it can be used now.

    Args:
        summary: summary of the recording.
        guide: the guided run that made it; it states the stretches that are missing.
    """
    missing = guide.lacking(simulated=summary.session_info.simulated) if guide else []
    info = summary.info
    kinds = {stream.kind for stream in info.streams.values() if stream.count}
    if "frame" not in kinds or "wrench" not in kinds:
        lacking = "images" if "frame" not in kinds else "force"
        return missing or [f"the recording has no {lacking}"]
    if info.tare.how == "none":
        missing.append(f"the force is not tared: {info.tare.detail or 'state a stretch without contact'}")
    if info.clock_map.how == "refused":
        missing.append(f"the clock map of camera and force sensor could not be determined: {info.clock_map.detail}")
    if summary.labelled < _FEWEST_LABELS:
        why = f": {summary.unlabelled_because}" if summary.unlabelled_because else ""
        missing.append(f"only {summary.labelled} images have a force, {_FEWEST_LABELS} are the least{why}")
    if summary.session_info.sensor.angle_deg is None or summary.session_info.sensor.reads is None:
        missing.append("bench.toml does not state sensor.angle_deg and sensor.reads: the force's direction is a guess")
    if why := _not_detected(summary.path):
        missing.append(why)
    return missing


def _not_detected(path: Path) -> str:
    """Returns why the catheter is not found in most images, or empty."""
    with RecordingReader(path) as reader:
        vision = VisionSettings().for_views(reader.views, path)
        images = spread_images(reader, vision.view)
        detector = SessionDetector(vision, reader.session_info, images)
        shapes = [detector.detect(image) for image in images]
    share = sum(shape.centreline is not None for shape in shapes) / len(shapes)
    if share < _DETECTED:
        why = next(shape.detail for shape in shapes if shape.centreline is None)
        return f"the catheter is detected in {share:.0%} of the images only ({why}); see `tipforce inspect {path}`"
    return ""
