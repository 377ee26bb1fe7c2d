"""Drivers and layouts of other packages are found by their entry points, as methods are (`test_add_a_method`)."""

import sys
from pathlib import Path

import pytest

from tipforce.datasets import open_dataset
from tipforce.datasets.layouts import LAYOUTS
from tipforce.errors import InputError
from tipforce.hardware import DRIVERS, read_devices

from .conftest import code_blocks, install  # type: ignore[import-not-found]

DRIVER = """
from tipforce.hardware import DeclaredStream, DeviceConfig, Driver


class MyConfig(DeviceConfig):
    gain: float = 1.0


class MySensor(Driver):
    config_type = MyConfig

    def __init__(self, config, name):
        super().__init__(name)
        self.config = config

    @property
    def streams(self):
        return (DeclaredStream("force", "wrench", None, "the host's"),)

    def connect(self, clock):
        return ()

    def read(self, timeout_s):
        return ()

    def close(self):
        pass
"""
LAYOUT = """
from tipforce.datasets import open_dataset


def recognises(folder):
    return (folder / "arm.csv").is_file()


def open_layout(folder):
    return open_dataset(folder / "arm.csv")
"""


def test_a_driver_of_another_package_is_named_in_bench_toml(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    page = (Path(__file__).parents[2] / "docs" / "how-to" / "add-a-method.md").read_text(encoding="utf-8")
    points, table = code_blocks(page, "toml")[1:3]
    (tmp_path / "my_lab").mkdir()
    (tmp_path / "my_lab" / "__init__.py").touch()
    (tmp_path / "my_lab" / "sensor.py").write_text(DRIVER)
    install(tmp_path, "my-lab", points, DRIVERS, monkeypatch)
    bench = tmp_path / "bench.toml"
    bench.write_text(f"{table}gain = 2.0\n")
    (driver,) = read_devices(bench).drivers()
    assert (type(driver).__name__, driver.name, driver.config.gain) == ("MySensor", "force", 2.0)
    bench.write_text(f"{table}gian = 2.0\n")
    with pytest.raises(InputError, match=r"hardware\.force\.gian is not known; hardware\.force may hold driver, gain"):
        read_devices(bench)
    bench.write_text(table.replace("my-sensor", "mysensor"))
    with pytest.raises(InputError, match="'mysensor' is refused: expected one of net-ft, daq, my-sensor"):
        read_devices(bench)


def test_a_layout_of_another_package_is_opened(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    page = (Path(__file__).parents[2] / "docs" / "how-to" / "add-a-dataset.md").read_text(encoding="utf-8")
    points = "\n".join(line.strip() for line in page.split("```toml")[1].split("```")[0].splitlines())
    (tmp_path / "my_lab").mkdir()
    (tmp_path / "my_lab" / "__init__.py").touch()
    (tmp_path / "my_lab" / "arm_layout.py").write_text(LAYOUT)
    install(tmp_path, "my-lab", points, LAYOUTS, monkeypatch)
    (tmp_path / "set").mkdir()
    (tmp_path / "set" / "arm.csv").write_text("shape_A1,session,stamp_ns,fx_n,fy_n\n0.1,monday,0,0.1,0.2\n")
    assert open_dataset(tmp_path / "set").sessions == ("monday",)
    assert "my_lab.arm_layout" in sys.modules
