"""Reads ``[hardware]`` of ``bench.toml``: the devices of a bench, each with the config of its driver."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, cast, get_args

from pydantic import BaseModel, ValidationError

from .._system.registry import Registry
from ..errors import InputError
from ..types import Clock, bench_values, read_bench
from ._driver import DeviceConfig, Driver
from ._source import HardwareSource

DRIVERS: Registry[type[Driver]] = Registry(
    "tipforce.drivers",
    "driver",
    {
        "cameras.opencv": "tipforce.hardware._opencv:OpenCvCamera",
        "cameras.genicam": "tipforce.hardware._genicam:GenICamCamera",
        "cameras.video": "tipforce.hardware._video:Video",
        "force.net-ft": "tipforce.hardware._net_ft:NetFt",
        "force.daq": "tipforce.hardware._daq:DaqForce",
        "stage.grbl": "tipforce.hardware._grbl:GrblStage",
        "knob.serial": "tipforce.hardware._knob:SerialKnob",
        "knob.log": "tipforce.hardware._knob:LogKnob",
        "knob.constant": "tipforce.hardware._knob:ConstantKnob",
    },
    Driver,
)
"""Table of ``[hardware]`` and name of the driver, as "force.net-ft" -> its class."""

_TABLES = ("cameras", "force", "stage", "knob")


@dataclass(frozen=True, slots=True)
class BenchDevices:
    """Configs of the devices of a bench.

    Attributes:
        cameras: config of each camera by view.
        force: config of the force sensor, or None.
        stage: config of the stage, or None.
        knob: config of the knob's encoder, or None.
    """

    cameras: Mapping[str, DeviceConfig] = field(default_factory=dict[str, DeviceConfig])
    force: DeviceConfig | None = None
    stage: DeviceConfig | None = None
    knob: DeviceConfig | None = None

    def drivers(self) -> list[Driver]:
        """Returns a driver for each device, not connected. Raises FileFormatError where a calibration is unreadable."""
        others = (("force", self.force), ("stage", self.stage), ("knob", self.knob))
        return [
            *(_driver("cameras", config, view) for view, config in self.cameras.items()),
            *(_driver(name, config, name) for name, config in others if config is not None),
        ]

    def values(self) -> dict[str, Any]:
        """Returns the configs as JSON values, in the form of ``bench.toml``."""
        single = {"force": self.force, "stage": self.stage, "knob": self.knob}
        return {
            "cameras": {view: config.model_dump(mode="json") for view, config in self.cameras.items()},
            **{name: config.model_dump(mode="json") for name, config in single.items() if config is not None},
        }


def _driver(table: str, config: DeviceConfig, name: str) -> Driver:
    make = cast(Callable[[DeviceConfig, str], Driver], DRIVERS[f"{table}.{config.driver}"])
    return make(config, name)


def read_devices(path: Path | str) -> BenchDevices:
    """Reads the devices in the ``bench.toml`` at ``path``; files are named relative to it.

    Raises:
        FileFormatError: there is no such file, or it is no TOML.
        InputError: a key is unknown, or a value refused; the message names it.
    """
    values = bench_values(path).get("hardware", {})
    where = str(path)
    if not isinstance(values, dict):
        raise InputError(f"{where}: hardware is no table")
    table: dict[str, Any] = dict(values)  # pyright: ignore[reportUnknownArgumentType]
    _refuse_strangers(where, "hardware", table, _TABLES)
    cameras = table.pop("cameras", {})
    if not isinstance(cameras, dict):
        raise InputError(f"{where}: hardware.cameras is no table of views, as [hardware.cameras.camera]")
    folder = Path(path).parent
    return BenchDevices(
        {
            str(view): _config(where, "cameras", f"hardware.cameras.{view}", each, folder)
            for view, each in cameras.items()  # pyright: ignore[reportUnknownVariableType]
        },
        **{name: _config(where, name, f"hardware.{name}", each, folder) for name, each in table.items()},
    )


def _config(where: str, section: str, key: str, values: object, folder: Path) -> DeviceConfig:
    """Returns the config of one device from the ``values`` of its table.

    ``section`` is "cameras", "force", "stage" or "knob"; ``where`` and ``key`` name file and table in messages. Files
    of the device are relative to ``folder``. Raises InputError for a key or value that is refused.
    """
    if not isinstance(values, dict):
        raise InputError(f"{where}: {key} is no table")
    stated: dict[str, Any] = dict(values)  # pyright: ignore[reportUnknownArgumentType]
    driver = stated.get("driver")
    if f"{section}.{driver}" not in DRIVERS:
        known = [name.removeprefix(f"{section}.") for name in DRIVERS if name.startswith(f"{section}.")]
        raise InputError(f"{where}: {key}.driver = {driver!r} is refused: expected one of {', '.join(known)}")
    kind = DRIVERS[f"{section}.{driver}"].config_type
    try:
        return kind.model_validate(stated).located(folder)
    except ValidationError as error:
        fault = error.errors()[0]
        path = [str(part) for part in fault["loc"]]  # names of inner tables and of the value
        if fault["type"] == "extra_forbidden":
            table = ".".join([key, *path[:-1]])
            known_keys = ", ".join(_fields_at(kind, path[:-1]))
            raise InputError(f"{where}: {table}.{path[-1]} is not known; {table} may hold {known_keys}") from None
        name = ".".join([key, *path])
        if fault["type"] == "missing":
            raise InputError(f"{where}: {name} is missing") from None
        message = str(fault["msg"])
        raise InputError(
            f"{where}: {name} = {repr(fault['input'])[:200]} is refused: {message[0].lower()}{message[1:]}"
        ) from None


def _fields_at(kind: type[DeviceConfig], path: list[str]) -> tuple[str, ...]:
    """Returns the names that the table at ``path`` within a config may hold."""
    model = _model_in(kind.model_fields[path[0]].annotation) if path else kind
    return tuple((model or kind).model_fields)


def _model_in(annotation: Any) -> type[BaseModel] | None:
    """Returns the model in the type of a field, as in ``dict[str, AxisConfig]``; None where there is none."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return annotation
    return next((found for each in get_args(annotation) if (found := _model_in(each)) is not None), None)


def _refuse_strangers(where: str, key: str, values: Mapping[str, Any], known: tuple[str, ...]) -> None:
    for name in values:
        if name not in known:
            raise InputError(f"{where}: {key}.{name} is not known; {key} may hold {', '.join(known)}")


def open_bench(path: Path | str, *, newest_only: bool = False, clock: Clock | None = None) -> HardwareSource:
    """Opens the devices in ``bench.toml`` as one source.

    Args:
        path: the ``bench.toml``; its other tables become the session's metadata.
        newest_only: see `HardwareSource`.
        clock: see `HardwareSource`.

    Raises:
        FileFormatError, InputError: see `read_devices`; also where the bench has no device.
    """
    devices = read_devices(path)
    drivers = devices.drivers()
    if not drivers:
        raise InputError(f'{path}: describes no device; add [hardware.cameras.camera] with driver = "opencv"')
    info = read_bench(path)
    return HardwareSource(drivers, info, newest_only=newest_only, clock=clock, described=devices.values())
