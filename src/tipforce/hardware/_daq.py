"""ATI force sensors whose gauges are read by a data acquisition card (NI-DAQmx), with the sensor's calibration file."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal
from xml.etree import ElementTree

import numpy as np
from pydantic import Field

from .._system.arrival_clock import ArrivalClock, ClockReport
from .._system.extras import import_extra
from ..errors import DeviceError, FileFormatError
from ..types import Clock, Event, FloatArray, Wrench
from ._driver import DeclaredStream, DeviceConfig, Driver, Setting
from ._net_ft import unit_in_newton_metres, unit_in_newtons

_AXES = ("Fx", "Fy", "Fz", "Tx", "Ty", "Tz")
_GAUGES = 6
_MAX_BYTES = 1 << 20
MAX_SILENCE_S = 1.0
_BLOCK_S = 0.01
"""Length of a block of samples, s."""
SATURATED_SHARE = 0.999
"""A gauge above this share of its input range is saturated, and the force is then unknown."""


@dataclass(frozen=True, slots=True, eq=False)
class DaqCalibration:
    """The calibration of a sensor (``.cal``).

    Attributes:
        matrix: (6, 6) from volts of the gauges to N and N m.
        range_v: input range of each gauge, V.
        serial: serial number of the sensor.
        part: its part number.
    """

    matrix: FloatArray
    range_v: tuple[float, float]
    serial: str
    part: str

    def wrench(self, volts: FloatArray, zero_v: FloatArray) -> FloatArray:
        """Converts volts to a wrench.

        Args:
            volts: (n, 6) readings of the gauges, V.
            zero_v: (6,) readings without load, V.

        Returns:
            (n, 6) forces in N and torques in N m.
        """
        return (volts - zero_v) @ self.matrix.T


def read_calibration(path: Path | str) -> DaqCalibration:
    """Reads an ATI calibration file (FTSensor, Family "DAQ").

    Its ``UserAxis`` rows hold the matrix from volts to the stated units. Older files have only ``Axis`` rows: the same
    values multiplied by ``scale``, before the tool transform (ATI's DAQ F/T C library, ``BasicMatrix = values /
    scale``).

    Args:
        path: the file.

    Returns:
        The matrix from volts to N and N m, and the card's input range.

    Raises:
        FileFormatError: it is no such file, or a value in it is missing or no number.
    """
    path = Path(path)
    try:
        raw = path.read_bytes()
    except OSError as error:
        raise FileFormatError(f"{path}: cannot be read: {error.strerror}") from None
    if len(raw) > _MAX_BYTES:
        raise FileFormatError(f"{path}: is too large for a calibration file")
    try:
        root = ElementTree.fromstring(raw)
    except (ElementTree.ParseError, ValueError, LookupError) as error:  # the last two: an encoding that Python lacks
        raise FileFormatError(f"{path}: is no XML: {error}") from None
    calibration = root.find("Calibration")
    if root.tag != "FTSensor" or calibration is None:
        raise FileFormatError(f"{path}: is no calibration of an ATI sensor: expected FTSensor with Calibration in it")
    if root.get("Family", "DAQ") != "DAQ" or root.get("NumGages", "6") != str(_GAUGES):
        raise FileFormatError(
            f"{path}: is of family {root.get('Family')} with {root.get('NumGages')} gauges; expected DAQ with {_GAUGES}"
        )
    rows = {node.get("Name"): _row(node, path, scaled=False) for node in calibration.iter("UserAxis")}
    if not rows:
        # a tool transform, a shift and rotation of the axes, is not in the rows of an older file
        transform = calibration.find("BasicTransform")
        keys = ("Dx", "Dy", "Dz", "Rx", "Ry", "Rz")
        if transform is not None and any(_number(transform, key, "0", path) for key in keys):
            raise FileFormatError(f"{path}: has a tool transform but no UserAxis rows; ask ATI for a newer file")
        rows = {node.get("Name"): _row(node, path, scaled=True) for node in calibration.iter("Axis")}
    missing = [name for name in _AXES if name not in rows]
    if missing:
        raise FileFormatError(f"{path}: has no row of {', '.join(missing)}")
    try:
        units = [unit_in_newtons(calibration.get("ForceUnits", ""))] * 3
        units += [unit_in_newton_metres(calibration.get("TorqueUnits", ""))] * 3
    except DeviceError as error:
        raise FileFormatError(f"{path}: {error}") from None
    output_range_v = _number(calibration, "OutputRange", "20", path)
    if output_range_v <= 0.0:
        raise FileFormatError(f"{path}: OutputRange is {output_range_v:g} V; expected more than 0")
    bipolar = calibration.get("OutputBipolar", "True").lower() == "true"
    limits = (-output_range_v / 2, output_range_v / 2) if bipolar else (0.0, output_range_v)
    matrix = np.array([rows[name] for name in _AXES]) * np.array(units)[:, None]
    return DaqCalibration(matrix, limits, root.get("Serial", ""), calibration.get("PartNumber", ""))


def _number(node: ElementTree.Element, key: str, usual: str, path: Path) -> float:
    """Returns the number ``key`` of a node, ``usual`` where it is not stated. Raises FileFormatError."""
    text = node.get(key, usual)
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise FileFormatError(f"{path}: {node.tag}: {key} is {text!r}; expected a number")
    return value


def _row(node: ElementTree.Element, path: Path, *, scaled: bool) -> list[float]:
    """Returns the six values of a row of the matrix, divided by its ``scale`` where ``scaled``."""
    scale = _number(node, "scale", "1", path) if scaled else 1.0
    try:
        values = [float(word) for word in node.get("values", "").split()]
    except ValueError as error:
        raise FileFormatError(f"{path}: {node.get('Name')}: {error}") from None
    if len(values) != _GAUGES or not scale or not np.isfinite(values).all():
        raise FileFormatError(f"{path}: {node.get('Name')}: expected {_GAUGES} numbers, got {node.get('values')!r}")
    return [value / scale for value in values]


class DaqForceConfig(DeviceConfig, frozen=True):
    """``[hardware.force]`` with ``driver = "daq"``.

    Attributes:
        channels: the six gauges in order, as "Dev1/ai0:5".
        zero_s: time after connecting without a load, s; the mean of the gauges in it becomes 0. 0 for none (the tare is
            found in any case).
        latency_ms: delay of the samples, which is subtracted from the stamps, ms.
    """

    driver: Literal["daq"] = "daq"
    channels: str
    calibration: Path
    rate_hz: Annotated[float, Field(ge=10.0, le=100_000.0)] = 1000.0
    terminal: Literal["DIFF", "RSE", "NRSE", "DEFAULT"] = "DIFF"
    zero_s: Annotated[float, Field(ge=0.0, le=60.0)] = 0.0
    latency_ms: Annotated[float, Field(ge=0.0, le=900.0)] = 0.0


class DaqForce(Driver):
    """Driver of one sensor.

    Args:
        config: settings of the device.
        name: name of the device in ``[hardware]``.
        nidaqmx: replaces the package of this name.
    """

    config_type = DaqForceConfig

    def __init__(self, config: DaqForceConfig, name: str = "force", nidaqmx: Any = None) -> None:
        super().__init__(name)
        self.config = config
        self.calibration = read_calibration(config.calibration)
        self._nidaqmx = nidaqmx
        self._task: Any = None
        self._clock: Clock | None = None
        self._map = ArrivalClock()
        self._rate_hz = config.rate_hz
        self._samples = 0
        self._heard_ns = 0
        self._zero = np.zeros(_GAUGES)
        self._at_zero: list[FloatArray] = []

    @property
    def streams(self) -> tuple[DeclaredStream, ...]:
        """The force."""
        late = f"minus latency_ms = {self.config.latency_ms:g}"
        clock = f"the card's sample count, brought to the host's by the least delay, {late}"
        return (DeclaredStream("force", "wrench", self.config.rate_hz, clock),)

    def connect(self, clock: Clock) -> tuple[Setting, ...]:
        """Starts to sample the gauges continuously."""
        module = self._nidaqmx or import_extra("nidaqmx", "hardware")
        low, high = self.calibration.range_v
        kinds = module.constants
        try:
            self._task = module.Task()
            self._task.ai_channels.add_ai_voltage_chan(
                self.config.channels,
                terminal_config=getattr(kinds.TerminalConfiguration, self.config.terminal),
                min_val=low,
                max_val=high,
            )
            count = len(self._task.ai_channels)
            if count != _GAUGES:
                raise DeviceError(
                    f"{self._where}: channels name {count} inputs; expected the {_GAUGES} gauges in order"
                )
            self._task.timing.cfg_samp_clk_timing(
                self.config.rate_hz,
                sample_mode=kinds.AcquisitionType.CONTINUOUS,
                samps_per_chan=int(self.config.rate_hz),
            )
            self._rate_hz = float(self._task.timing.samp_clk_rate)
            self._task.start()
        except (module.errors.Error, OSError) as error:
            raise DeviceError(f"{self._where}: {str(error).splitlines()[0]}") from None
        self._clock, self._map, self._samples = clock, ArrivalClock(), 0
        self._heard_ns = clock.now_ns()
        self._zero, self._at_zero = np.zeros(_GAUGES), []
        return (
            Setting("rate_hz", self.config.rate_hz, self._rate_hz),
            Setting("range_v", None, high - low),
            Setting("sensor", None, f"{self.calibration.serial} {self.calibration.part}".strip()),
        )

    def read(self, timeout_s: float) -> Sequence[Event]:
        """Returns a block of samples. Samples with a saturated gauge give no force and are counted."""
        assert self._clock is not None
        module = self._nidaqmx or import_extra("nidaqmx", "hardware")
        count = max(1, round(_BLOCK_S * self._rate_hz))
        try:
            rows = self._task.read(number_of_samples_per_channel=count, timeout=max(timeout_s, 2 * _BLOCK_S))
        except module.errors.DaqReadError as error:
            if self._clock.now_ns() - self._heard_ns <= MAX_SILENCE_S * 1e9:
                return ()
            raise DeviceError(f"{self._where}: has given no samples for {MAX_SILENCE_S:g} s: {error}") from None
        except (module.errors.Error, OSError) as error:
            raise DeviceError(f"{self._where}: is lost: {str(error).splitlines()[0]}") from None
        arrival = self._heard_ns = self._clock.now_ns()
        volts = np.asarray(rows, np.float64).T
        if volts.ndim != 2 or volts.shape[1] != _GAUGES:
            raise DeviceError(f"{self._where}: gave samples of shape {volts.shape}; expected (n, {_GAUGES})")
        self._samples += len(volts)
        period_ns = 1e9 / self._rate_hz
        last_ns = self._map.host_ns(round((self._samples - 1) * period_ns), arrival)  # time of the last sample
        if len(self._at_zero) < round(self.config.zero_s / _BLOCK_S):  # still without load, see the config
            self._at_zero.append(volts)
            self._zero = np.concatenate(self._at_zero).mean(axis=0)
            return ()
        return self._wrenches(volts, last_ns - round((len(volts) - 1) * period_ns), period_ns)

    def _wrenches(self, volts: FloatArray, first_ns: int, period_ns: float) -> Sequence[Event]:
        """Converts samples to readings; those with a saturated gauge are left out.

        Args:
            volts: (n, 6) voltages of the gauges.
            first_ns: time of the first sample on the clock of the host.
            period_ns: time between samples.
        """
        low, high = self.calibration.range_v
        centre_v, half_range_v = (low + high) / 2, (high - low) / 2
        is_unsaturated = (np.abs(volts - centre_v) < SATURATED_SHARE * half_range_v).all(axis=1)
        if not is_unsaturated.all():
            self.counts["saturated"] += int((~is_unsaturated).sum())
            self.remark = f"{self._where}: a gauge was saturated: the sensor is overloaded, or a cable is broken"
        values = self.calibration.wrench(volts, self._zero)
        latency_ns = round(self.config.latency_ms * 1e6)
        return [
            Wrench(first_ns + round(row * period_ns) - latency_ns, values[row, :3], values[row, 3:], "sensor")
            for row in np.flatnonzero(is_unsaturated).tolist()
        ]

    def close(self) -> None:
        """Releases the card."""
        if self._task is not None:
            module = self._nidaqmx or import_extra("nidaqmx", "hardware")
            try:
                self._task.close()
            except module.errors.Error as error:  # it was pulled out
                self.remark = f"{self._where}: {error}"
            self._task = None

    def clocks(self) -> Mapping[str, ClockReport]:
        """Returns the report on the clock of the card: its sample count compared with the clock of the host."""
        return {"force": self._map.report()}

    @property
    def _where(self) -> str:
        return f"hardware.{self.name}: {self.config.channels}"
