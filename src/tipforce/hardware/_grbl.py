"""Driver of a motion stage (or of the catheter's own drives) with a GRBL 1.1 controller at a serial port.

The protocol is send-response: each line waits for the ``ok`` to the one before. Only a trajectory
(`GrblActuators.follow`) sends as many lines ahead as the buffer of the controller takes. Moves are jogs (``$J=``),
which keep to the soft limits of the controller and can be cancelled (0x85) without losing the position; ``?`` requests
the status at any time. Source: the GRBL v1.1 wiki, "Interface" and "Jogging".
"""

import math
import re
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Annotated, Literal

from pydantic import Field

from .._system.contexts import ClosedAtExit
from ..errors import DeviceError
from ..types import JOINTS, STAGE, Actuation, AxisLimits, Clock, Commanded, Event, refuse_unknown
from ._driver import DeclaredStream, DeviceConfig, DeviceTable, Driver, Number, Setting
from ._grbl_course import Course, CourseStream
from ._serial import LinePort

STATUS, HOLD, RESET, CANCEL = b"?", b"!", b"\x18", b"\x85"
"""Real-time commands: the controller executes them immediately, at any position in a line."""
_LETTERS = "XYZABC"
_SPEED, _ACCELERATION, _TRAVEL = 110, 120, 130
"""First number of the settings of each axis: mm/min, mm/s^2, mm."""
_INCHES = "13"
MAX_WAKE_S, MAX_RESPONSE_S, MAX_SILENCE_S = 3.0, 1.0, 1.0
MAX_WAIT_S = 0.005
"""Longest wait for a response; it is also the longest delay of a command."""
_STATUS = re.compile(r"<(\w+)(?::\d+)?\|(.*)>")

_ALARMS = {
    "1": "a hard limit was hit: the position may be lost", "2": "the target is beyond the soft limits",
    "3": "a reset while it moved: the position may be lost", "8": "homing failed", "9": "homing failed",
    "at power-up": "the controller is locked until it is homed or unlocked",
}  # fmt: skip


class AxisConfig(DeviceTable, frozen=True):
    """``[hardware.stage.axes.NAME_UNIT]``: one axis.

    Attributes:
        axis: letter of the controller.
        low: lowest position.
        high: highest position.
        max_speed: largest speed; None for that of the controller.
        max_acceleration: largest acceleration; None for that of the controller.
        scale: units of the controller for one of ours; negative values reverse the direction.
    """

    axis: Literal["X", "Y", "Z", "A", "B", "C"]
    low: Number
    high: Number
    max_speed: Annotated[float, Field(gt=0, le=1e6)] | None = None
    max_acceleration: Annotated[float, Field(gt=0, le=1e9)] | None = None
    scale: Annotated[float, Field(ge=-1e6, le=1e6)] = 1.0


class MotionConfig(DeviceTable, frozen=True):
    """``[hardware.stage.motion]``: the stage moves like a heart while `tipforce record` runs.

    Attributes:
        wave: one of `mechanics.HEART_WAVES`.
        amplitude_mm: forward amplitude, half of peak to peak, mm.
        rate_hz: heart rate, Hz.
        lateral_share: amplitude to the side, divided by the forward one.
        lateral_phase_deg: phase by which the motion to the side is ahead, degrees.
        respiration_mm: amplitude of the respiration, a sine forward, mm.
        respiration_hz: its rate, Hz.
        middle_mm: middle of the motion, position of the axis ``stage_forward_mm``, mm.
        rest_s: time for which the stage first rests at the middle minus both amplitudes, away from the tip, for the
            tare, s.
    """

    wave: Literal["sine", "half-wave PQRST"] = "sine"
    amplitude_mm: Annotated[float, Field(gt=0, le=100)]
    rate_hz: Annotated[float, Field(gt=0, le=10)]
    lateral_share: Annotated[float, Field(ge=0, le=10)] = 0.0
    lateral_phase_deg: Annotated[float, Field(ge=-360, le=360)] = 0.0
    respiration_mm: Annotated[float, Field(ge=0, le=100)] = 0.0
    respiration_hz: Annotated[float, Field(gt=0, le=2)] = 0.25
    middle_mm: Number = 0.0
    rest_s: Annotated[float, Field(ge=0, le=600)] = 5.0


class GrblConfig(DeviceConfig, frozen=True):
    """``[hardware.stage]`` with ``driver = "grbl"``; positions are the controller's work coordinates.

    Attributes:
        settings: settings of the controller by number, as { "120" = 500.0 }; they are compared with the response to
            ``$$``, never set.
        zero: whether the positions of the axes at connecting become 0.
        status_hz: rate of the requests for the position, Hz.
        latency_ms: delay of the status, which is subtracted from the stamps, ms.
        motion: motion during `tipforce record`.
    """

    driver: Literal["grbl"] = "grbl"
    port: str
    baud: Annotated[int, Field(gt=0, le=10_000_000)] = 115200
    axes: dict[str, AxisConfig]
    settings: dict[str, Number] = Field(default_factory=dict)
    zero: bool = False
    status_hz: Annotated[float, Field(gt=0, le=200)] = 50.0
    latency_ms: Annotated[float, Field(ge=0.0, le=900.0)] = 5.0
    motion: MotionConfig | None = None


class GrblStage(Driver):
    """Driver of one controller. ``actuators`` commands it, from any thread, while a source reads it.

    A command only leaves its targets here: `read`, which the source calls in a loop, sends the newest ones as soon as
    the controller can take them. A stop is sent immediately.

    Args:
        config: settings of the device.
        name: name of the device in ``[hardware]``.
    """

    config_type = GrblConfig

    def __init__(self, config: GrblConfig, name: str = "stage") -> None:
        """Prepares the state of a controller that is not connected yet."""
        super().__init__(name)
        self.config = config
        self.actuators = GrblActuators(self)
        self.lock = threading.RLock()
        """Held while the state of this object is read or changed: commands come from other threads."""
        self.state = ""
        """State that the controller reports: "Idle", "Jog", "Run", "Hold", "Alarm", ...; empty while not connected."""
        self.alarm = ""
        """Alarm of the controller as text; empty without one."""
        self.limits: dict[str, AxisLimits] = {}
        """Limits by name of the axis, in the axis's own unit; empty before the controller was read."""
        self._port: LinePort | None = None
        self._clock: Clock | None = None
        self._pending: dict[str, float] = {}
        """Targets by name of the axis, in its own unit, that were commanded and not sent yet."""
        self._sent: dict[str, float] = {}
        """Targets that were sent and not cancelled."""
        self._positions: dict[str, float] = {}
        """Positions by name of the axis, in its own unit, at the last status."""
        self._position_ns = 0
        """Stamp of these positions, on the clock of the source."""
        self._work_offset: list[float] = []
        """Machine position minus work position of each axis of the controller, in its units: GRBL's WCO."""
        self._unanswered_jog: str | None = None
        """The jog that was sent and that the controller has not answered yet; None if all are answered."""
        self._jog_sent_s = 0.0
        """Time at which that jog was sent. This and the next two are on `time.monotonic`."""
        self._status_requested_s = 0.0
        """Time of the last request for the status."""
        self._heard_s = 0.0
        """Time of the last line from the controller."""
        self._cancelled = False
        """Whether a jog was cancelled and the controller has not reported since that it is at rest."""
        self._stopping = False
        """Whether all axes are to stop: until they are at rest nothing is sent."""
        self._course: CourseStream | None = None
        """Trajectory that is followed; None without one."""

    @property
    def streams(self) -> tuple[DeclaredStream, ...]:
        """The stage, the catheter's own drives, or both."""
        clock = f"the host's, on arrival of the status, minus latency_ms = {self.config.latency_ms:g}"
        names = dict.fromkeys(_stream(name) for name in self.config.axes)
        return tuple(DeclaredStream(name, "actuation", self.config.status_hz, clock) for name in names)

    def connect(self, clock: Clock) -> tuple[Setting, ...]:
        """Resets the controller, which cancels its motion, and reads its settings back."""
        port = self._port = LinePort(self.config.port, self.config.baud, self._where)
        self._clock = clock
        port.write(RESET)
        self._await(lambda line: line.startswith("Grbl "), MAX_WAKE_S, "its greeting")
        reported = self._settings_read()
        if reported.get(_INCHES):
            raise DeviceError(f"{self._where}: reports inches; send $13=0 to it")
        settings: list[Setting] = []
        limits: dict[str, AxisLimits] = {}
        for name, axis in self.config.axes.items():
            limits[name] = self._limits_of(name, axis, reported, settings)
        for number, value in self.config.settings.items():
            settings.append(Setting(f"${number}", value, reported.get(number, math.nan)))
        with self.lock:
            self._forget()
            self._cancelled = self._stopping = False
            self.limits = limits
            self.state = self.alarm = ""
            self._heard_s = time.monotonic()
        self._request_status()
        self._await(lambda _: bool(self.state), MAX_RESPONSE_S, "its status")
        if self.config.zero and not self.alarm:
            letters = "".join(f" {axis.axis}0" for axis in self.config.axes.values())
            port.write(f"G10 L20 P1{letters}\n".encode())  # the work coordinates here become 0
            self._await(lambda line: line == "ok", MAX_RESPONSE_S, "ok to the new zero")
            self._work_offset = []
        return tuple(settings)

    def _limits_of(
        self, name: str, axis: AxisConfig, reported: Mapping[str, float], settings: list[Setting]
    ) -> AxisLimits:
        """Returns the limits of an axis: of each, the lower of the stated value and that of the controller.

        Args:
            name: name of the axis, NAME_UNIT.
            axis: its config.
            reported: number -> value of the controller's settings; its axis X, Y, Z, ... has the numbers 110, 111, 112.
            settings: gets the stated and the actual values.
        """
        index, per_unit = _LETTERS.index(axis.axis), abs(axis.scale)
        values: list[float] = []
        for key, first_number, per_second, stated in (
            ("max_speed", _SPEED, 60.0, axis.max_speed),
            ("max_acceleration", _ACCELERATION, 1.0, axis.max_acceleration),
        ):
            number = str(first_number + index)
            if number not in reported:
                raise DeviceError(f"{self._where}: has no setting ${number}, so no axis {axis.axis}")
            actual = reported[number] / per_second / per_unit  # GRBL states speeds for a minute
            settings.append(Setting(f"{name}.{key}", stated, actual))
            values.append(actual if stated is None else min(stated, actual))
        travel, needed = reported.get(str(_TRAVEL + index), math.inf) / per_unit, axis.high - axis.low
        settings.append(Setting(f"{name}.travel", needed if needed > travel else None, travel))
        try:
            return AxisLimits(axis.low, axis.high, *values)
        except ValueError as error:
            raise DeviceError(f"{self._where}: {name}: {error}") from None

    def _settings_read(self) -> dict[str, float]:
        """Requests all settings of the controller (``$$``); returns number -> value, in its units."""
        assert self._port is not None
        settings: dict[str, float] = {}

        def take(line: str) -> bool:
            if match := re.fullmatch(r"\$(\d+)=([-\d.]+)(?: .*)?", line):
                settings[match[1]] = float(match[2])
            return line == "ok"

        self._port.write(b"$$\n")
        self._await(take, MAX_RESPONSE_S, "its settings")
        return settings

    def _await(self, done: Callable[[str], bool], seconds: float, reply: str) -> None:
        """Processes lines until ``done`` accepts one; raises DeviceError, which names ``reply``, after ``seconds``."""
        assert self._port is not None
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            for line in self._port.lines(0.05):
                self._take(line)
                if done(line):
                    return
        raise DeviceError(f"{self._where}: {self.config.port} does not answer ({reply}); check baud and power")

    def read(self, timeout_s: float) -> Sequence[Event]:
        """Requests the status when it is due, reads the responses, and sends pending commands."""
        assert self._port is not None
        end = time.monotonic() + timeout_s
        while True:
            now = time.monotonic()
            if now - self._status_requested_s >= (MAX_WAIT_S if self._cancelled else 1.0 / self.config.status_hz):
                self._request_status()
            events = [event for line in self._port.lines(MAX_WAIT_S) for event in self._take(line)]
            self._send_what_waits()
            now = time.monotonic()
            if now - self._heard_s > MAX_SILENCE_S:
                raise DeviceError(f"{self._where}: {self.config.port} has not answered for {MAX_SILENCE_S:g} s")
            if events or now >= end:
                return events

    def _request_status(self) -> None:
        assert self._port is not None
        self._status_requested_s = time.monotonic()
        self._port.write(STATUS)

    def _take(self, line: str) -> Sequence[Event]:
        """Processes one line of the controller; returns the positions that it reports, none for another line."""
        self._heard_s = time.monotonic()
        with self.lock:
            if match := _STATUS.fullmatch(line):
                return self._take_status(match[1], match[2])
            if line == "ok":
                if self._course is None or not self._course.answered():
                    self._unanswered_jog = None
            elif line.startswith("error:"):
                self.counts["errors"] += 1
                refused = "a move of its trajectory" if self._course else self._unanswered_jog or "a line"
                self.remark = f"{self._where}: refused {refused} with {line}"
                if self._course:
                    self._stopping = True
                    self._cancel()
                self._forget()
            elif line.startswith("ALARM:"):
                self.counts["alarms"] += 1
                self._alarmed(line.removeprefix("ALARM:"))
            elif line.startswith("Grbl ") and self.limits:
                self.counts["resets"] += 1  # a person pressed its button: its motion is cancelled
                self._forget()
        return ()

    def _forget(self) -> None:
        """Discards all commands."""
        self._pending, self._sent, self._unanswered_jog, self._course = {}, {}, None, None

    def _alarmed(self, number: str) -> None:
        self.alarm = f"alarm {number}: {_ALARMS.get(number, 'see the manual of GRBL')}"
        self.remark = f"{self._where}: {self.alarm}; look at the stage, then unlock it"
        self.state = "Alarm"
        self._forget()

    def _take_status(self, state: str, fields: str) -> Sequence[Event]:
        """Processes a status report ``<state|fields>``.

        GRBL reports the work position (WPos), or the machine position (MPos) whose offset (WCO) it sends only at times.

        Args:
            state: state of the controller, as "Idle".
            fields: the other fields, as "MPos:0.000,1.000,0.000|FS:0,0".

        Returns:
            The positions, an event for each stream; none for a report that cannot be read.
        """
        values: dict[str, list[float]] = {}
        for part in fields.split("|"):
            key, colon, numbers = part.partition(":")
            if colon and key in ("MPos", "WPos", "WCO"):
                try:
                    values[key] = [float(number) for number in numbers.split(",")]
                except ValueError:
                    self.counts["malformed"] += 1
                    return ()
        if state == "Alarm" and not self.alarm:
            self._alarmed("at power-up")
        if state != "Alarm":
            self.alarm = ""
        self.state = state
        self._work_offset = values.get("WCO", self._work_offset)
        position = values.get("WPos")
        if position is None and "MPos" in values:
            offset = self._work_offset or [0.0] * len(values["MPos"])
            position = [machine - shift for machine, shift in zip(values["MPos"], offset, strict=False)]
        if position is None or len(position) <= max(_LETTERS.index(axis.axis) for axis in self.config.axes.values()):
            self.counts["malformed"] += 1
            return ()
        assert self._clock is not None
        self._position_ns = self._clock.now_ns() - round(self.config.latency_ms * 1e6)
        self._positions = {
            name: position[_LETTERS.index(axis.axis)] / axis.scale for name, axis in self.config.axes.items()
        }
        if self._course is not None:
            self._course.read(self._positions, time.monotonic() - 1e-3 * self.config.latency_ms)
        by_stream: dict[str, dict[str, float]] = {}
        for name, value in self._positions.items():
            by_stream.setdefault(_stream(name), {})[name] = value
        return [Actuation(self._position_ns, each, stream) for stream, each in by_stream.items()]

    def _send_what_waits(self) -> None:
        """Sends the newest targets: immediately if no axis changes direction, else after moving axes have stopped."""
        assert self._port is not None
        with self.lock:
            if self._unanswered_jog is not None and time.monotonic() - self._jog_sent_s > MAX_SILENCE_S:
                raise DeviceError(f"{self._where}: has not answered {self._unanswered_jog} for {MAX_SILENCE_S:g} s")
            if self._stopping and self.state == "Jog" and not self._cancelled:
                self._cancel()  # a jog that was sent just before the stop
            if self._unanswered_jog is not None:
                return
            if self.state == "Idle":  # at rest: a cancel or stop is done
                self._cancelled = False
                if self._course is None or not self._course.unanswered:
                    self._stopping = False
                if self._course is not None and self._course.ended and not self._stopping:
                    self._course = None
            if self._course is not None and self.state in ("Idle", "Jog") and not self._stopping:
                for line in self._course.due(time.monotonic()):
                    self._port.write(line.encode())
                return
            if not self._pending or self.state not in ("Idle", "Jog") or self._cancelled or self._stopping:
                return
            if self.state == "Jog" and not self._goes_on():
                self._cancel()  # the targets stay pending until the axes are at rest
                return
            self._jog()

    def _goes_on(self) -> bool:
        """Returns whether every axis continues in its present direction to its new target."""
        for name, target in self._pending.items():
            present_target = self._sent.get(name, self._positions[name])
            if (target - present_target) * (present_target - self._positions[name]) < 0:
                return False
        return True

    def _course_line(self, places: Mapping[str, float], seconds: float) -> str:
        """Returns a jog to ``places`` (position by axis, in its unit) that takes ``seconds`` at constant speed.

        The feed rate F is in mm/min along the path, at least 1: GRBL refuses 0.
        """
        start, self._sent = {**self._positions, **self._sent}, dict(places)
        scales = {name: self.config.axes[name].scale for name in places}
        length = math.hypot(*((places[name] - start[name]) * scale for name, scale in scales.items()))
        axis_words = " ".join(
            f"{self.config.axes[name].axis}{places[name] * scale:.4f}" for name, scale in scales.items()
        )
        return f"$J=G90 G21 {axis_words} F{max(1.0, 60.0 * length / seconds):.1f}\n"

    def _jog(self) -> None:
        """Sends the pending targets as one straight jog, at the largest feed rate within all speed limits."""
        assert self._port is not None
        previous_targets = {**self._positions, **self._sent}
        steps = {name: abs(target - previous_targets[name]) for name, target in self._pending.items()}
        moving = {name: step for name, step in steps.items() if step > 0}
        self._sent |= self._pending
        axis_words = [
            f"{self.config.axes[name].axis}{target * self.config.axes[name].scale:.4f}"
            for name, target in self._pending.items()
        ]
        self._pending = {}
        if not moving:
            return
        # on the straight line each axis has its share of the feed rate: the slowest axis limits it
        machine_steps = {name: step * abs(self.config.axes[name].scale) for name, step in moving.items()}
        path_length = math.hypot(*machine_steps.values())
        feed = 60.0 * min(
            self.limits[name].max_speed * abs(self.config.axes[name].scale) * path_length / machine_steps[name]
            for name in moving
        )
        line = f"$J=G90 G21 {' '.join(axis_words)} F{feed:.1f}"
        self._unanswered_jog, self._jog_sent_s = line, time.monotonic()
        self._port.write(line.encode() + b"\n")

    def _cancel(self) -> None:
        """Cancels all jogs: the axes brake, and nothing is sent until they are at rest."""
        assert self._port is not None
        self._port.write(CANCEL)
        self._cancelled, self._sent = True, {}
        self.state = "Jog"  # until a later status shows that it is at rest

    def want(self, targets: Mapping[str, float]) -> None:
        """Sets new targets of some axes, which `read` sends; see `GrblActuators.command`."""
        with self.lock:
            self._need_ready()
            if self._course is not None:
                raise DeviceError(f"{self._where}: follows a trajectory; stop it before another command")
            self._pending |= targets

    def follow(self, course: Course, after_s: float) -> None:
        """Follows a trajectory until it is halted; see `GrblActuators.follow`."""
        with self.lock:
            self._need_ready()
            self._pending, self._sent = {}, {}
            self._course = CourseStream(course, self._course_line, time.monotonic() + after_s)

    def halt(self, axes: Sequence[str]) -> None:
        """Cancels the jog now; axes that are not to stop continue afterwards; see `GrblActuators.stop`."""
        with self.lock:
            if self._port is None:
                return
            if self._course is not None:
                self._course.end()
                self._pending, self._sent, self._stopping = {}, {}, True
                self._cancel()
                return
            targets = {**self._sent, **self._pending}
            self._pending = {name: target for name, target in targets.items() if name not in axes}
            self._stopping = not self._pending
            if self.state in ("Run", "Hold"):  # G-code of another program: only a hold and a reset end it
                self._port.write(HOLD)
            else:
                self._cancel()

    def position(self) -> Actuation:
        """Returns the positions of the axes at the last status; see `GrblActuators.read`."""
        with self.lock:
            self._need_ready(moving=False)
            return Actuation(self._position_ns, dict(self._positions))

    def unlock(self) -> None:
        """Ends the alarm of the controller (``$X``), after a person has inspected the stage."""
        with self.lock:
            if self._port is None:
                raise DeviceError(f"{self._where}: is not connected")
            self._port.write(b"$X\n")

    def now_ns(self) -> int:
        """Returns the time on the clock of the source. Raises DeviceError before it is connected."""
        if self._clock is None:
            raise DeviceError(f"{self._where}: is not connected")
        return self._clock.now_ns()

    def _need_ready(self, *, moving: bool = True) -> None:
        if self._port is None or not self.state:
            raise DeviceError(f"{self._where}: is not connected")
        if moving and self.alarm:
            raise DeviceError(f"{self._where}: {self.alarm}; look at the stage, then unlock it")

    def close(self) -> None:
        """Cancels the motion and releases the port."""
        with self.lock:
            port, self._port, self.state = self._port, None, ""
        if port is not None:
            try:
                port.write(CANCEL)
            except DeviceError as error:  # it was pulled out
                self.remark = str(error)
            port.close()

    @property
    def _where(self) -> str:
        return f"hardware.{self.name}"


class GrblActuators(ClosedAtExit):
    """The `Actuators` of a controller that a `HardwareSource` reads. Calls raise DeviceError while it is missing."""

    def __init__(self, stage: GrblStage) -> None:
        self._stage = stage

    @property
    def limits(self) -> Mapping[str, AxisLimits]:
        """The limits of each axis, in the unit of its name; empty before the controller was read."""
        return dict(self._stage.limits)

    def command(self, targets: Mapping[str, float]) -> Commanded:
        """Starts the motion of axes; see `Actuators.command`."""
        taken = Commanded.of(self._stage.now_ns(), targets, self._stage.limits)
        self._stage.want(taken.targets)
        return taken

    def follow(self, course: Course, after_s: float = 0.0) -> None:
        """Moves axes along a trajectory until `stop`, as one smooth motion; returns immediately.

        Args:
            course: time since the start in s -> position of each axis by name. The axes are at its beginning; it stays
                within their limits, and begins at rest.
            after_s: delay of its beginning from now, s.

        Raises:
            DeviceError: the controller is missing, or in alarm.
        """
        self._stage.follow(course, after_s)

    def read(self) -> Actuation:
        """Returns the positions of the axes at the last status."""
        return self._stage.position()

    def stop(self, *axes: str) -> None:
        """Brings these axes, or all, to rest; see `Actuators.stop`."""
        refuse_unknown(axes, self._stage.limits)
        self._stage.halt(axes or tuple(self._stage.limits))

    def close(self) -> None:
        """Stops all axes."""
        self._stage.halt(tuple(self._stage.limits))


def _stream(name: str) -> str:
    """Returns the stream of an axis: the axes of the tissue are no drives of the catheter."""
    return STAGE if name.startswith(f"{STAGE}_") else JOINTS
