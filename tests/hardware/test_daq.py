"""ATI's DAQ sensors: the arithmetic of a calibration file in ATI's format, and a task that stands for the card's."""

import types

import numpy as np
import pytest

from tipforce.errors import DeviceError, FileFormatError
from tipforce.hardware import DaqForce, DaqForceConfig, read_calibration
from tipforce.types import SystemClock

SCALES = {"Fx": 5.0, "Fy": 5.0, "Fz": 2.5, "Tx": 0.9, "Ty": 0.9, "Tz": 0.8}
ROWS = np.array([
    [-0.11, 0.44, -0.47, -38.7, -0.22, 38.4], [1.98, 44.1, -0.07, -22.1, -0.08, -22.0],
    [22.4, -0.42, 22.0, -0.27, 22.2, -0.11], [-0.63, 0.20, 38.3, -0.33, -38.0, 0.04],
    [-44.3, 0.67, 21.9, 0.22, 21.7, -0.52], [0.87, 22.1, 0.17, 21.5, -0.03, 22.4],
])  # fmt: skip


def calibration_file(path, *, user_axes=True, unit="N", torque="N-mm", transform="0", bipolar="True"):
    """As ATI writes it: Axis rows scaled for its own library, UserAxis rows in the stated units."""
    axes = "".join(
        f'<Axis Name="{name}" values="{" ".join(f"{value:.5f}" for value in row)}" max="50" scale="{scale}"/>'
        for (name, scale), row in zip(SCALES.items(), ROWS, strict=True)
    )
    user = "".join(
        f'<UserAxis Name="{name}" values="{" ".join(f"{value / scale:.9f}" for value in row)}" max="50"/>'
        for (name, scale), row in zip(SCALES.items(), ROWS, strict=True)
    )
    path.write_text(
        '<?xml version="1.0" encoding="utf-8"?>\n<FTSensor Serial="FT00000" BodyStyle="Nano17" Family="DAQ" '
        f'NumGages="6" CalFileVersion="1.1"><Calibration PartNumber="SI-50-0.5" CalDate="1/1/2021" ForceUnits="{unit}" '
        f'TorqueUnits="{torque}" DistUnits="mm" OutputMode="Ground Referenced Differential" OutputRange="20" '
        f'HWTempComp="True" GainMultiplier="1" CableLossDetection="False" OutputBipolar="{bipolar}">{axes}'
        f'<BasicTransform Dx="0" Dy="0" Dz="{transform}" Rx="0" Ry="0" Rz="0"/>{user if user_axes else ""}'
        "</Calibration></FTSensor>\n"
    )
    return path


EXPECTED = ROWS / np.array(list(SCALES.values()))[:, None] * np.array([1, 1, 1, 1e-3, 1e-3, 1e-3])[:, None]


@pytest.mark.parametrize("user_axes", [True, False])
def test_volts_become_newtons_as_the_calibration_says(tmp_path, user_axes):
    calibration = read_calibration(calibration_file(tmp_path / "a.cal", user_axes=user_axes))
    np.testing.assert_allclose(calibration.matrix, EXPECTED, rtol=1e-6)
    assert calibration.range_v == (-10.0, 10.0)
    volts, zero = np.array([[0.1, -0.2, 0.3, 0.05, 0.0, 0.15]]), np.full(6, 0.02)
    np.testing.assert_allclose(calibration.wrench(volts, zero)[0], EXPECTED @ (volts[0] - zero), rtol=1e-6)


def test_units_of_the_file_are_brought_to_newtons(tmp_path):
    pounds = read_calibration(calibration_file(tmp_path / "a.cal", unit="lbf", torque="lbf-in", bipolar="False"))
    np.testing.assert_allclose(pounds.matrix[:3], 4.4482216 * EXPECTED[:3], rtol=1e-5)
    np.testing.assert_allclose(pounds.matrix[3:], 0.1129848 * 1e3 * EXPECTED[3:], rtol=1e-5)
    assert pounds.range_v == (0.0, 20.0)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("FTSensor", "Sensor"), "is no calibration of an ATI sensor"),
        (('Name="Fz"', 'Name="Fq"'), "has no row of Fz"),
        (('values="-0.02', 'values="nan -0.02'), "Fx: expected 6 numbers"),
        (('ForceUnits="N"', 'ForceUnits="stone"'), "the force unit 'stone' is not known"),
        (('Family="DAQ"', 'Family="TWE"'), "is of family TWE"),
        (("</Calibration>", ""), "is no XML"),
        (('encoding="utf-8"', 'encoding="foo"'), "is no XML"),
        (('OutputRange="20"', 'OutputRange="nan"'), "OutputRange is 'nan'; expected a number"),
        (('OutputRange="20"', 'OutputRange="-5"'), "OutputRange is -5 V; expected more than 0"),
    ],
)
def test_a_calibration_that_cannot_be_used_is_refused(tmp_path, change, message):
    path = calibration_file(tmp_path / "a.cal")
    path.write_text(path.read_text().replace(*change))
    with pytest.raises(FileFormatError, match=message):
        read_calibration(path)


def test_an_old_file_with_a_tool_transform_is_refused(tmp_path):
    with pytest.raises(FileFormatError, match="tool transform but no UserAxis"):
        read_calibration(calibration_file(tmp_path / "a.cal", user_axes=False, transform="4.9"))
    path = calibration_file(tmp_path / "c.cal", user_axes=False)
    path.write_text(path.read_text().replace('scale="', 'scale="nan', 1))
    with pytest.raises(FileFormatError, match=r"scale is 'nan.*; expected a number"):
        read_calibration(path)
    with pytest.raises(FileFormatError, match="'4,9'; expected a number"):
        read_calibration(calibration_file(tmp_path / "b.cal", user_axes=False, transform="4,9"))


class Card:
    """The part of nidaqmx (1.7) that the driver uses. ``rows``: what each read gives, volts (6, n) or an error."""

    class Error(Exception):
        pass

    class ReadError(Error):
        pass

    def __init__(self, rows):
        self.rows, self.channel = list(rows), None
        self.errors = types.SimpleNamespace(Error=self.Error, DaqReadError=self.ReadError)
        self.constants = types.SimpleNamespace(
            TerminalConfiguration=types.SimpleNamespace(DIFF="diff"),
            AcquisitionType=types.SimpleNamespace(CONTINUOUS=1),
        )
        card = self

        class Channels(list):
            def add_ai_voltage_chan(self, names, *, terminal_config, min_val, max_val):
                card.channel = names, terminal_config, min_val, max_val
                self.extend(range(int(names[-1]) + 1))

        class Timing:
            def cfg_samp_clk_timing(self, rate, *, sample_mode, samps_per_chan):
                self.samp_clk_rate = rate * 1.001  # a card divides its clock by whole numbers

        class Task:
            def __init__(self):
                self.ai_channels, self.timing = Channels(), Timing()

            def start(self):
                pass

            close = start

            def read(self, *, number_of_samples_per_channel, timeout):
                row = card.rows.pop(0)
                if isinstance(row, Exception):
                    raise row
                return np.repeat(np.asarray(row)[:, None], number_of_samples_per_channel, axis=1).tolist()

        self.Task = Task


def sensor(tmp_path, rows, **more):
    card = Card(rows)
    config = DaqForceConfig(channels="Dev1/ai0:5", calibration=calibration_file(tmp_path / "a.cal"), **more)
    return DaqForce(config, nidaqmx=card), card


def test_samples_of_the_card_become_a_force_at_its_own_rate(tmp_path):
    volts = np.array([0.1, -0.2, 0.3, 0.05, 0.0, 0.15])
    driver, card = sensor(tmp_path, [np.full(6, 0.02), np.full(6, 0.02), volts, volts], zero_s=0.02)
    settings = {each.name: each for each in driver.connect(SystemClock(10**9))}
    assert settings["rate_hz"].actual == pytest.approx(1001.0)
    assert card.channel == ("Dev1/ai0:5", "diff", -10.0, 10.0)
    assert [*driver.read(0.1), *driver.read(0.1)] == []  # the zero
    events = [*driver.read(0.1), *driver.read(0.1)]
    assert len(events) == 20
    np.testing.assert_allclose(events[0].force_n, (EXPECTED @ (volts - 0.02))[:3], rtol=1e-6)
    np.testing.assert_allclose(np.diff([event.stamp_ns for event in events[:10]]), 1e9 / 1001, atol=2)


def test_a_saturated_gauge_gives_no_force(tmp_path):
    driver, _ = sensor(tmp_path, [np.array([0.1, 9.999, 0.0, 0.0, 0.0, 0.0]), np.zeros(6)])
    driver.connect(SystemClock(10**9))
    assert driver.read(0.1) == []
    assert driver.counts["saturated"] == 10
    assert "saturated" in driver.remark
    assert len(driver.read(0.1)) == 10


def test_a_card_that_is_silent_or_gone_is_lost(tmp_path, monkeypatch):
    driver, card = sensor(tmp_path, [Card.ReadError("no samples"), Card.ReadError("no samples"), Card.Error("gone")])
    driver.connect(SystemClock(10**9))
    assert driver.read(0.1) == ()
    monkeypatch.setattr("tipforce.hardware._daq.MAX_SILENCE_S", 0.0)
    with pytest.raises(DeviceError, match="has given no samples"):
        driver.read(0.1)
    with pytest.raises(DeviceError, match="is lost: gone"):
        driver.read(0.1)
    few = DaqForce(driver.config.model_copy(update={"channels": "Dev1/ai0:3"}), nidaqmx=card)
    with pytest.raises(DeviceError, match="name 4 inputs"):
        few.connect(SystemClock())
