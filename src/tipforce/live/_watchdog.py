"""The one rule that decides whether an image, and with it a force, is still valid."""

import statistics
from collections import deque
from dataclasses import dataclass

import numpy as np

from ..types import MAX_AGE_S, Image
from ._settings import LiveSettings
from ._update import CAMERA_STATES, CameraState

PERIOD_INTERVALS = 16
"""The period is the median of this number of last intervals: a slow start or a pause does not change it."""
MAX_AHEAD_NS = 10_000_000
"""A stamp may be ahead of the engine's clock by this, because two threads read the same clock."""
GRID_STEP_PX = 8
"""A grid of every eighth row and column shows whether an image is black, and mostly whether it is a new one."""


@dataclass(frozen=True, slots=True)
class Fault:
    """Reason why there is no valid force.

    Attributes:
        camera: state of the camera.
        message: one sentence.
    """

    camera: CameraState
    message: str


def worst(faults: list[Fault]) -> Fault | None:
    """Returns the worst of several faults, which is reported; None without a fault."""
    return max(faults, key=lambda fault: CAMERA_STATES.index(fault.camera), default=None)


class CameraWatch:
    """Watches one view. Only an image that is new, not black and of the right size keeps the estimate valid.

    Times are on the engine's clock. One repeated image is not a fault yet: the estimate before it stays valid until it
    expires. A black image, or an image of another size, ends it immediately.

    Args:
        view: name of the view.
        settings: limits of age and silence.
    """

    def __init__(self, view: str, settings: LiveSettings) -> None:
        self.view, self._settings = view, settings
        self._state: CameraState = "waiting"
        """State after the newest image."""
        self._last_image: Image | None = None
        self._last_arrival_ns: int | None = None
        """Arrival of the newest image, on the engine's clock."""
        self._fresh_ns: int | None = None
        """Mid-exposure of the last image without a fault, on the engine's clock."""
        self._ahead_ns = 0
        """Time by which the mid-exposure of the newest image is later than its arrival."""
        self._first_shape: tuple[int, ...] = ()
        """(h, w) or (h, w, 3) of the first image; all later ones must have it."""
        self._wrong_size = ""
        """Description of the last image that had another size."""
        self._stamp_ns: int | None = None
        """Stamp of the newest image, on the source's clock."""
        self._intervals_ns: deque[int] = deque(maxlen=PERIOD_INTERVALS)
        """Differences of successive stamps."""

    def restart(self) -> None:
        """Forgets rate and stamps after the source was opened again; the size must stay the same."""
        self._stamp_ns, self._last_image = None, None
        self._intervals_ns.clear()

    def see(self, image: Image, stamp_ns: int, captured_ns: int, now_ns: int) -> CameraState:
        """Checks an image that arrives now.

        Args:
            image: the image.
            stamp_ns: stamp of the image, on the source's clock.
            captured_ns: mid-exposure, on the engine's clock.
            now_ns: present time, on the engine's clock.

        Returns:
            "running", or the fault of the image.
        """
        self._last_arrival_ns = now_ns
        if self._stamp_ns is not None and stamp_ns > self._stamp_ns:
            self._intervals_ns.append(stamp_ns - self._stamp_ns)
        self._stamp_ns = stamp_ns
        self._ahead_ns = max(0, captured_ns - now_ns)
        self._state = "late" if self._ahead_ns > MAX_AHEAD_NS else self._judge(image)
        self._last_image = image
        if self._state == "running":
            self._fresh_ns = captured_ns
        return self._state

    @property
    def limit_ns(self) -> int:
        """Age at which an image is stale."""
        by_period_s = self._settings.stale_periods * self.period_s
        return round(min(max(self._settings.stale_s, by_period_s), MAX_AGE_S) * 1e9)

    @property
    def period_s(self) -> float:
        """Median time between the last images in seconds; 0 before the second one."""
        intervals = tuple(self._intervals_ns)  # another thread adds and, when the source is reopened, clears them
        return statistics.median(intervals) * 1e-9 if intervals else 0.0

    @property
    def fresh_ns(self) -> int | None:
        """Mid-exposure of the last good image; None before the first one."""
        return self._fresh_ns

    @property
    def deadline_ns(self) -> int | None:
        """Time at which the last good image becomes stale; None without one, or if a fault has ended it already."""
        if self._fresh_ns is None or self._state in ("black", "wrong_size", "late"):
            return None
        return self._fresh_ns + self.limit_ns

    def fault(self, now_ns: int) -> Fault | None:
        """Returns the fault at ``now_ns``; None without a fault.

        A view that has sent nothing for ``lost_s`` counts as lost, regardless of the fault of its last image. Otherwise
        the last image may be unusable, or the last good one may be older than `limit_ns`.

        Args:
            now_ns: present time, on the engine's clock.
        """
        view = self.view
        if self._last_arrival_ns is None:
            return Fault("waiting", f"no image of the view {view} has come yet")
        if self._state == "black":
            unusable = Fault("black", f"the view {view} is black: lens cap, light or exposure")
        elif self._state == "wrong_size":
            unusable = Fault(
                "wrong_size", f"the view {view} sends {self._wrong_size}; it began with {_size(self._first_shape)}"
            )
        elif self._state == "late":
            unusable = Fault(
                "late",
                f"the stamps of the view {view} are {self._ahead_ns * 1e-6:.0f} ms ahead of this machine's clock, so "
                "the age of its images is unknown; set the clock of its source",
            )
        elif self._fresh_ns is not None and now_ns - self._fresh_ns <= self.limit_ns:
            return None
        else:
            unusable = None
        silence_ns = now_ns - self._last_arrival_ns
        if silence_ns > self._settings.lost_s * 1e9:
            return Fault("lost", f"the view {view} has sent nothing for {silence_ns * 1e-9:.0f} s")
        if unusable is not None:
            return unusable
        if self._state == "frozen" and silence_ns <= self.limit_ns:
            return Fault("frozen", f"the view {view} sends the same image again and again")
        assert self._fresh_ns is not None  # an image has come and has no fault of its own, so one was good
        age_ms = (now_ns - self._fresh_ns) * 1e-6
        slow = ""
        if self.period_s > MAX_AGE_S:
            slow = f"; one comes every {self.period_s:.1f} s, and a force counts for {MAX_AGE_S:g} s at most"
        return Fault("late", f"the last image of the view {view} is {age_ms:.0f} ms old{slow}")

    def _judge(self, image: Image) -> CameraState:
        """Returns the state that an image shows: "wrong_size", "black", "frozen" (same pixels as before) or "running".

        Both checks use a grid of every eighth row and column first: it is 64 times smaller.
        """
        if not self._first_shape:
            self._first_shape = image.shape
        if image.shape != self._first_shape:
            self._wrong_size = _size(image.shape)
            return "wrong_size"
        grid = image[::GRID_STEP_PX, ::GRID_STEP_PX]
        if float(np.percentile(grid, 99)) <= self._settings.black_level:  # single hot pixels do not count
            return "black"
        last = self._last_image
        if last is None or last.shape != image.shape or not np.array_equal(last[::GRID_STEP_PX, ::GRID_STEP_PX], grid):
            return "running"
        return "frozen" if np.array_equal(last, image) else "running"


def _size(shape: tuple[int, ...]) -> str:
    height, width, *colours = shape
    return f"{'colour' if colours else 'grey'} images of {width}x{height}"
