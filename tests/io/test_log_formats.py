"""Logs as loggers and laboratories write them: each is made here in the documented format and read."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from tipforce.errors import FileFormatError, InputError, MissingExtraError
from tipforce.io import ForceLog, read_drive_log, read_force_log
from tipforce.io.tables import _matlab as matlab
from tipforce.types import ForceLogInfo, info_from_facts
from tipforce.units import FORCE_UNITS, GRAM_N, POUND_N

RATE_HZ = 1000
ROWS = 3000
MIDNIGHT_2026_NS = 1767225600 * 10**9


def true_force(count: int = ROWS) -> np.ndarray:
    """(count, 3) newtons, rounded to a millinewton."""
    seconds = np.arange(count) / RATE_HZ
    return np.round(np.stack([0.2 * np.sin(3 * seconds), -0.1 + 0 * seconds, 0.3 * np.cos(seconds)], axis=1), 3)


def written(tmp_path: Path, text: str, name: str = "force.csv", encoding: str = "utf-8") -> Path:
    path = tmp_path / name
    path.write_text(text, encoding=encoding)
    return path


def times_of_day(count: int, start_s: float, digits: int = 3, step_s: float = 1 / RATE_HZ) -> list[str]:
    """Rounded down to ``digits``, as clocks are."""
    ticks = [int((start_s + k * step_s) * 10**digits + 1e-6) for k in range(count)]
    whole = [divmod(tick, 10**digits) for tick in ticks]
    return [
        f"{s // 3600 % 24:02d}:{s // 60 % 60:02d}:{s % 60:02d}" + (f".{part:0{digits}d}" if digits else "")
        for s, part in whole
    ]


def net_ft_demo(counts: bool, date: Callable[[str], str], rate_hz: float = RATE_HZ, count: int = 5000) -> str:
    """The CSV log of ATI's Net F/T Java demo: its source writes eight lines, then quoted cells."""
    values = true_force(count) / FORCE_UNITS["lbf"]
    head = (
        "Start Time: 8/1/26 10:23 AM\nRDT Sample Rate: 1000\n"
        '"PLEASE NOTE: The sample rate is read from the Net F/T when the program starts.  If you have changed the '
        'sample rate since the program started, this will be incorrect."\n'
        "Force Units: lbf\nCounts per Unit Force: 1000000.0\nTorque Units: lbf-in\nCounts per Unit Torque: 1000000.0\n"
        "Status (hex), RDT Sequence, F/T Sequence, Fx, Fy, Fz, Tx, Ty, Tz, Time\n"
    )
    clock = times_of_day(count, 10 * 3600 + 23 * 60 + 45.4, 0, 1 / rate_hz)
    rows: list[str] = []
    for k, row in enumerate(values.tolist()):
        cells = [str(round(value * 1e6)) if counts else repr(value) for value in (*row, 0.001, 0.002, 0.003)]
        status = "0x80010000" if 100 <= k < 110 else "0x0"
        rows.append(",".join(f'"{cell}"' for cell in (status, str(k + 1), str(7 * k + 90), *cells, date(clock[k]))))
    return head + "\n".join(rows) + "\n"


@pytest.mark.parametrize("counts", [True, False], ids=["counts", "units"])
@pytest.mark.parametrize(
    "date",
    [
        lambda clock: f"Aug 1, 2026 {clock} AM",
        lambda clock: f"Aug 1, 2026, {clock}\u202fAM",
        lambda clock: f"01.08.2026 {clock}",
        lambda clock: f"1 Aug 2026, {clock}",
    ],
    ids=["us", "us, newer Java", "german", "british"],
)
def test_the_log_of_the_net_ft_demo_is_read_in_newtons_with_its_status(
    tmp_path: Path, counts: bool, date: Callable[[str], str]
) -> None:
    found = read_force_log(written(tmp_path, net_ft_demo(counts, date)))
    np.testing.assert_allclose(found.force_n, true_force(5000), atol=1e-5)
    np.testing.assert_array_equal(np.diff(found.stamp_ns), 1_000_000)
    assert found.status is not None
    assert np.flatnonzero(found.status).tolist() == list(range(100, 110))
    assert found.status[100] == 0x80010000
    said = " ".join(found.remarks)
    assert "RDT Sequence / 1000 per second, as its header states" in said
    assert ("counts, 1e+06 per lbf" in said) == counts
    assert ("they are taken as lbf" in said) == (not counts)


def test_a_rate_in_the_header_that_the_clock_contradicts_is_refused_until_the_rate_is_stated(tmp_path: Path) -> None:
    path = written(tmp_path, net_ft_demo(True, lambda clock: f"Aug 1, 2026 {clock} AM", rate_hz=500, count=6000))
    with pytest.raises(
        InputError, match=r"1000 rows per second, but by the column of its clock .* sensor\.log\.rate_hz"
    ):
        read_force_log(path)
    found = read_force_log(path, ForceLogInfo(rate_hz=500))
    assert float(np.mean(np.diff(found.stamp_ns))) == pytest.approx(2e6)


def test_rows_that_the_network_lost_leave_a_gap(tmp_path: Path) -> None:
    lines = net_ft_demo(True, lambda clock: f"Aug 1, 2026 {clock} AM").splitlines()
    del lines[1008:1058]
    found = read_force_log(written(tmp_path, "\n".join(lines)))
    assert np.diff(found.stamp_ns).max() == 51_000_000
    assert any("50 rows were lost" in remark for remark in found.remarks)


@pytest.mark.parametrize("comma", [False, True], ids=["point", "comma"])
@pytest.mark.parametrize("delay", ["", "Paused for 500 milliseconds before saving data.\n"], ids=["at once", "paused"])
def test_the_log_of_the_daq_ft_demo_has_a_rate_and_no_times(tmp_path: Path, comma: bool, delay: str) -> None:
    header = [f"Force {axis} (N)" for axis in "XYZ"] + [f"Torque {axis} (N-mm)" for axis in "XYZ"]
    header += ["Frequency = 4000", "Averaging Level = 4", "F/T Serial Number = FT05382"]
    header += ["Time Started = 8/1/2026 10:23:45 AM"]
    rows = [",".join(f'"{value!r}"' for value in (*row, 1.5, 2.25, 3.125)) for row in true_force().tolist()]
    body = "\n".join(",".join(cell.replace(".", ",") for cell in row.split('","')) for row in rows) if comma else ""
    body = "\n".join('","'.join(cell.replace(".", ",") for cell in row.split('","')) for row in rows) if comma else body
    text = delay + ",".join(f'"{name}"' for name in header) + "\n" + (body or "\n".join(rows)) + "\n"
    found = read_force_log(written(tmp_path, text))
    np.testing.assert_allclose(found.force_n, true_force())
    np.testing.assert_array_equal(found.stamp_ns, np.arange(ROWS) * 1_000_000)
    assert any("1000 rows per second, as its header states" in remark for remark in found.remarks)


def test_a_labview_measurement_file_is_read_below_its_two_headers(tmp_path: Path) -> None:
    head = (
        "LabVIEW Measurement\t\nWriter_Version\t2\nReader_Version\t2\nSeparator\tTab\nDecimal_Separator\t.\n"
        "Time_Pref\tRelative\nDate\t2026/08/01\nTime\t10:23:45.1\n***End_of_Header***\t\n\t\n"
        "Channels\t2\t\t\nSamples\t3\t3\t\nX_Dimension\tTime\tTime\t\nX0\t0.0\t0.0\t\nDelta_X\t0.001\t0.001\t\n"
        "***End_of_Header***\t\t\t\nX_Value\tFx\tFy\tComment\n"
    )
    rows = "".join(f"{k / 1000:.6f}\t{k / 100}\t0.5\t\n" for k in range(50))
    found = read_force_log(written(tmp_path, head + rows, "log.lvm"), ForceLogInfo(force_unit="N", time_unit="s"))
    assert found.stamp_ns.tolist() == [k * 1_000_000 for k in range(50)]
    assert found.force_n[7, 0] == pytest.approx(0.07)


@pytest.mark.parametrize(
    ("unit", "newtons"),
    [
        *(("N", 1.0), ("kN", 1e3), ("cN", 1e-2), ("mN", 1e-3), ("gf", GRAM_N), ("g", GRAM_N), ("kgf", 1e3 * GRAM_N)),
        *(("lbf", POUND_N), ("lb", POUND_N), ("ozf", POUND_N / 16)),
    ],
)
def test_a_unit_is_read_from_name_row_of_units_header_or_bench(tmp_path: Path, unit: str, newtons: float) -> None:
    texts = [
        f"time_s,Fx [{unit}]\n0,2\n0.001,2\n",
        f"time,Fx\ns,{unit}\n0,2\n0.001,2\n",
        f"time [s];Fx\n[s];[{unit}]\n0;2\n0,001;2\n",
        f"Logger 7\nForce Unit: {unit}\n\ntime_s,Fx\n0,2\n0.001,2\n",
    ]
    for text in texts:
        found = read_force_log(written(tmp_path, text))
        assert found.force_n[:, 0] == pytest.approx(2 * newtons), text
    if unit != "lb":
        found = read_force_log(
            written(tmp_path, "time_s,Fx\n0,2\n0.001,2\n"),
            info_from_facts([f"sensor.log.force_unit={unit}"]).sensor.log,
        )
        assert found.force_n[0, 0] == pytest.approx(2 * newtons)


STAMPS_S = [86390.0 + k / RATE_HZ for k in range(20_000)]


@pytest.mark.parametrize(
    "column",
    [
        lambda clock, day: clock,
        lambda clock, day: clock.replace(".", ","),
        lambda clock, day: f"{31 if day == 0 else 1:02d}.{12 if day == 0 else 1:02d}.{2025 + day} {clock}".replace(
            ".", ",", 0
        ),
        lambda clock, day: f"{'12/31/2025' if day == 0 else '01/01/2026'} {clock}",
        lambda clock, day: f"{'2025-12-31' if day == 0 else '2026-01-01'}T{clock}+00:00",
        lambda clock, day: f"{'31-Dez-2025' if day == 0 else '01-Jan-2026'} {clock}",
    ],
    ids=["time of day", "decimal comma", "german", "american", "iso", "month's name"],
)
def test_times_go_on_over_midnight(tmp_path: Path, column: Callable[[str, int], str]) -> None:
    clock = times_of_day(len(STAMPS_S), STAMPS_S[0])
    rows = [f"{column(text, int(s >= 86400))};0,5" for text, s in zip(clock, STAMPS_S, strict=True)]
    found = read_force_log(written(tmp_path, "Time;Fx [N]\n" + "\n".join(rows) + "\n"))
    np.testing.assert_array_equal(np.diff(found.stamp_ns), 1_000_000)
    dated = found.stamp_ns[0] > 10**15
    assert found.stamp_ns[0] == (MIDNIGHT_2026_NS - 86400 * 10**9 if dated else 0) + round(86390e9)


def test_a_date_may_have_a_column_of_its_own(tmp_path: Path) -> None:
    rows = "".join(f"01.02.2026;10:00:00,{k:03d};0,5\n" for k in range(20))
    found = read_force_log(written(tmp_path, "Datum;Uhrzeit;Fx [N]\n" + rows))
    assert found.stamp_ns[3] == (1769904000 + 36000) * 10**9 + 3_000_000


def test_hours_of_twelve_are_those_of_the_half_day(tmp_path: Path) -> None:
    text = "time,fx_n\n12/31/2026 11:59:59.5 PM,1\n1/1/2027 12:00:00.5 AM,1\n1/1/2027 1:00:00 pm,1\n"
    stamps = read_force_log(written(tmp_path, text)).stamp_ns
    assert np.diff(stamps).tolist() == [10**9, 46_799_500_000_000]


@pytest.mark.parametrize("unit_ns", [10**9, 10**6, 10**3, 1], ids=["s", "ms", "us", "ns"])
def test_times_since_1970_need_no_unit(tmp_path: Path, unit_ns: int) -> None:
    start = 1_800_000_000 * 10**9
    stamps = [start + k * (10**9 if unit_ns == 10**9 else 10**6) for k in range(50)]
    text = "timestamp,fx_n\n" + "".join(f"{stamp // unit_ns},1\n" for stamp in stamps)
    assert read_force_log(written(tmp_path, text)).stamp_ns.tolist() == stamps


def test_nanoseconds_since_the_start_of_a_machine_are_no_milliseconds_since_1970(tmp_path: Path) -> None:
    text = "timestamp,fx_n\n" + "".join(f"{1_700_000_000_000 + k * 1_000_000},1\n" for k in range(50))
    with pytest.raises(InputError, match=r"state sensor\.log\.time_unit"):
        read_force_log(written(tmp_path, text))


@pytest.mark.parametrize(
    ("digits", "rate_hz"),
    [(2, 1000.0), (2, 997.3), (0, 1000.0), (0, 231.7), (1, 62.5)],
)
def test_rows_of_a_coarse_clock_are_spread_within_its_ticks(tmp_path: Path, digits: int, rate_hz: float) -> None:
    count = round(30 * rate_hz)
    clock = times_of_day(count, 36000.123, digits, 1 / rate_hz)
    found = read_force_log(written(tmp_path, "time,fx_n\n" + "".join(f"{text},1\n" for text in clock)))
    true_ns = (36000.123 + np.arange(count) / rate_hz) * 1e9
    assert np.abs(found.stamp_ns - true_ns).max() < 0.3 * 10 ** (9 - digits)
    found_hz = 1e9 * (count - 1) / (found.stamp_ns[-1] - found.stamp_ns[0])
    said = next(remark for remark in found.remarks if "rows are taken as" in remark)
    stderr_hz = float(said.split("+- ")[1].split()[0])
    assert abs(found_hz - rate_hz) < 2 * stderr_hz < 0.02 * rate_hz


def test_a_pause_of_a_coarse_clock_stays_a_pause(tmp_path: Path) -> None:
    times = [k // 10 / 100 for k in range(500)] + [2.0 + k // 10 / 100 for k in range(500)]
    found = read_force_log(written(tmp_path, "time_s,fx_n\n" + "".join(f"{time:.2f},1\n" for time in times)))
    assert np.diff(found.stamp_ns)[499] == pytest.approx(1.501e9, abs=5e6)
    assert any(", 1 pause;" in remark for remark in found.remarks)


def test_cells_without_a_reading_are_kept_as_such(tmp_path: Path) -> None:
    rows = ["0,1,2", "0.001,,2", "0.002,NaN,2", "0.003,1,n/a", "0.004,1", "0.005,1,2", ",,"]
    found = read_force_log(written(tmp_path, "time_s,fx_n,fy_n\n" + "\n".join(rows) + "\n"))
    assert len(found.stamp_ns) == 6
    assert np.isnan(found.force_n[:, 0]).tolist() == [False, True, True, False, False, False]
    assert np.isnan(found.force_n[:, 1]).tolist() == [False, False, False, True, True, False]


def test_the_separator_may_be_stated_in_the_first_line(tmp_path: Path) -> None:
    found = read_force_log(
        written(tmp_path, 'sep=;\n"time_s";"fx_n, raw";"fx_n"\n"0,5";"3,5";"1,25"\n"0,6";"3";"1,5"\n')
    )
    assert found.force_n[:, 0].tolist() == [1.25, 1.5]
    assert found.stamp_ns.tolist() == [500_000_000, 600_000_000]


def test_rows_that_were_swapped_on_their_way_are_sorted(tmp_path: Path) -> None:
    order = [0, 1, 3, 2, 4, 5, 6, 8, 7, 9]
    found = read_force_log(written(tmp_path, "time_ms,fx_n\n" + "".join(f"{k},{k / 10}\n" for k in order)))
    assert found.stamp_ns.tolist() == [k * 1_000_000 for k in range(10)]
    np.testing.assert_allclose(found.force_n[:, 0], np.arange(10) / 10)
    assert any("2 rows were out of order" in remark for remark in found.remarks)


def test_a_row_that_repeats_a_stamp_is_left_out(tmp_path: Path) -> None:
    rows = [*range(20), 19, *range(20, 40)]
    found = read_force_log(written(tmp_path, "time_ms,fx_n\n" + "".join(f"{k},{k / 10}\n" for k in rows)))
    assert len(found.stamp_ns) == 40
    assert any("1 rows repeat" in remark for remark in found.remarks)


def columns_of(path: Path) -> ForceLog:
    return read_force_log(path, ForceLogInfo(force_unit="N", time_unit="s"))


def test_a_workbook_is_a_table(tmp_path: Path) -> None:
    openpyxl = pytest.importorskip("openpyxl")
    book = openpyxl.Workbook()
    sheet = book.active
    sheet.append(["Test bench 3", None, None])
    sheet.append(["Force Units", "mN", None])
    sheet.append([None, None, None])
    sheet.append(["Time [s]", "Fx", "Fy"])
    for k in range(100):
        sheet.append([k / 1000, float(k), None if k == 7 else 5])
    book.create_sheet("Notes")
    path = tmp_path / "force.xlsx"
    book.save(path)
    found = read_force_log(path)
    assert found.stamp_ns.tolist() == [k * 1_000_000 for k in range(100)]
    np.testing.assert_allclose(found.force_n[:, 0], np.arange(100) * 1e-3)
    assert np.flatnonzero(np.isnan(found.force_n[:, 1])).tolist() == [7]


def test_times_of_a_workbook_may_be_dates(tmp_path: Path) -> None:
    import datetime

    openpyxl = pytest.importorskip("openpyxl")
    book = openpyxl.Workbook()
    book.active.append(["Time", "Fx [N]"])
    for k in range(10):
        book.active.append([datetime.datetime(2026, 1, 1, 0, 0, k), 0.5])
    path = tmp_path / "force.xlsx"
    book.save(path)
    assert read_force_log(path).stamp_ns.tolist() == [MIDNIGHT_2026_NS + k * 10**9 for k in range(10)]


def save_v5(path: Path, variables: dict[str, object]) -> None:
    from scipy.io import savemat

    savemat(path, variables)


def save_v73(path: Path, variables: dict[str, object]) -> None:
    """As MATLAB writes them: HDF5 behind 512 bytes, arrays transposed, structs as groups."""
    h5py = pytest.importorskip("h5py")

    def put(group: object, values: dict[str, object]) -> None:
        for name, value in values.items():
            if isinstance(value, dict):
                put(group.create_group(name), value)  # type: ignore[attr-defined]
            else:
                array = np.atleast_2d(np.asarray(value, np.float64))
                group.create_dataset(name, data=array.T).attrs[  # type: ignore[attr-defined]
                    "MATLAB_class"
                ] = np.bytes_("double")

    with h5py.File(path, "w", userblock_size=512) as file:
        put(file, variables)


@pytest.mark.parametrize("save", [save_v5, save_v73], ids=["v5", "v7.3"])
def test_variables_of_matlab_are_columns(tmp_path: Path, save: Callable[[Path, dict[str, object]], None]) -> None:
    time, force, path = np.arange(50) / 1000, true_force(50), tmp_path / "force.mat"
    save(path, {"t": time, "Fx": force[:, 0], "Fy": force[:, 1], "rate": 1000.0})
    found = columns_of(path)
    np.testing.assert_allclose(found.force_n[:, :2], force[:, :2])
    assert found.stamp_ns.tolist() == [k * 1_000_000 for k in range(50)]
    save(path, {"log": {"time": time, "Fx": force[:, 0], "Fz": force[:, 2]}})
    np.testing.assert_allclose(columns_of(path).force_n[:, 2], force[:, 2])
    save(path, {"data": np.column_stack([time, force])})
    stated = ForceLogInfo(columns=("time_s", "fx_n", "fy_n", "fz_n"))
    np.testing.assert_allclose(read_force_log(path, stated).force_n, force)


def test_a_file_that_crashes_the_reader_of_matlab_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "force.mat"
    save_v5(path, {"t": np.arange(50) / 1000, "Fx": np.ones(50)})
    crash = "import os, signal; os.kill(os.getpid(), signal.SIGSEGV)"
    run_child = matlab.run_child
    monkeypatch.setattr(matlab, "run_child", lambda command, **how: run_child([command[0], "-c", crash], **how))
    with pytest.raises(FileFormatError, match=r"force\.mat: is damaged: the reader of MATLAB files crashes on it"):
        read_force_log(path)


def test_a_log_of_the_stage_has_the_same_formats(tmp_path: Path) -> None:
    rows = "".join(f"01.02.2026 10:00:0{k // 100},{k % 100:02d};{k / 10}\n".replace(".", ",", 0) for k in range(300))
    text = "Stage\nSN 7\nZeit;forward_mm\n" + "".join(
        line.rpartition(";")[0] + ";" + line.rpartition(";")[2].replace(".", ",") + "\n" for line in rows.splitlines()
    )
    found = read_drive_log(written(tmp_path, text, "stage.csv"))
    assert np.diff(found.stamp_ns).tolist() == [10_000_000] * 299
    np.testing.assert_allclose(found.values["forward_mm"], np.arange(300) / 10)


def test_a_missing_library_is_named_with_its_install_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import sys

    monkeypatch.setitem(sys.modules, "openpyxl", None)
    with pytest.raises(MissingExtraError, match=r"pip install -e '\.\[tables\]'"):
        read_force_log(written(tmp_path, "", "force.xlsx"))


def messages() -> list[tuple[str, str, str, str, list[str]]]:
    """(file's name, text, part of the message, its advice, what is then stated in bench.toml)."""
    head, regular = "time_s,fx_n\n", "".join(f"{k / 1000:.3f},0.5\n" for k in range(60))
    uneven = "".join(f"{tick},0.5\n" for tick in range(8) for _ in range(1 + 37 * tick % 11))
    return [
        (
            "no header",
            regular,
            "line 1: expected the names of the columns",
            "sensor.log.columns",
            ['sensor.log.columns=["time_s", "fx_n"]'],
        ),
        (
            "unknown time",
            "clock," + head.split(",")[1] + regular,
            "no column that is called a time",
            "sensor.log.time",
            ["sensor.log.time=clock", "sensor.log.time_unit=s"],
        ),
        (
            "two times",
            "time_s,elapsed,fx_n\n" + "".join(f"{k},{k},1\n" for k in range(9)),
            "several columns",
            "sensor.log.time",
            ["sensor.log.time=time_s"],
        ),
        (
            "no time",
            "fx_n,fy_n\n" + "1,2\n" * 9,
            "no column that is called a time",
            "sensor.log.rate_hz",
            ["sensor.log.rate_hz=1000"],
        ),
        (
            "no unit of time",
            "time,fx_n\n" + regular,
            "does not name its unit",
            "sensor.log.time_unit",
            ["sensor.log.time_unit=s"],
        ),
        (
            "no unit of force",
            "time_s,fx\n" + regular,
            "does not name its unit",
            "sensor.log.force_unit",
            ["sensor.log.force_unit=ozf"],
        ),
        (
            "unknown axes",
            "time_s,load\n" + regular,
            "cannot determine which columns",
            "sensor.log.fx, fy and fz",
            ["sensor.log.fx=load", "sensor.log.force_unit=N"],
        ),
        (
            "counts",
            "time_s,fx_counts\n" + regular,
            "holds counts",
            "sensor.log.counts_per_n",
            ["sensor.log.counts_per_n=1000"],
        ),
        (
            "a text",
            head + regular + "0.060,OVL\n",
            "line 62, column fx_n: expected a number, got 'OVL'",
            'missing = ["OVL"]',
            ['sensor.log.missing=["OVL"]'],
        ),
        ("infinite", head + regular + "0.060,inf\n", "got 'inf'", 'missing = ["inf"]', ['sensor.log.missing=["inf"]']),
        (
            "a number for nothing",
            head + regular + "0.060,9.91e37\n",
            "which no sensor",
            'missing = ["9.91e+37"]',
            ['sensor.log.missing=["9.91e+37"]'],
        ),
        (
            "wrong unit",
            "time_s,fx_n\n" + regular.replace("0.5", "5e5"),
            "which no sensor",
            "check sensor.log.force_unit",
            ["sensor.log.force_unit=mN"],
        ),
        (
            "no time in a row",
            "time,fx_n\n10:00:00.1,1\nreset,1\n10:00:00.2,1\n",
            "expected a date",
            'missing = ["reset"]',
            ['sensor.log.missing=["reset"]'],
        ),
        (
            "day or month",
            "time,fx_n\n01/02/2026 10:00:00,1\n01/02/2026 10:00:01,1\n",
            "may be dmy or mdy",
            "sensor.log.date_order",
            ["sensor.log.date_order=mdy"],
        ),
        (
            "comma for both",
            "time_s,fx_n\n0,0,0,5\n0,1,0,5\n",
            "both decimal sign and separator",
            "sensor.log.decimal_sign",
            ['sensor.log.decimal_sign=","'],
        ),
        (
            "thousands",
            'time_ms;fx_n\n"1.234,5";0,5\n"1.235,5";0,5\n',
            "grouped thousands",
            "sensor.log.decimal_sign",
            ['sensor.log.decimal_sign=","'],
        ),
        (
            "thousands or decimals",
            'time_ms,fx_n\n"1,234","1,500"\n"1,235","1,500"\n',
            "decimal comma or grouped",
            "decimal_sign",
            ['sensor.log.decimal_sign=","'],
        ),
        (
            "clock set back",
            head + regular + "0.010,0.5\n0.011,0.5\n0.012,0.5\n-9,1\n",
            "is stamped before the row above",
            "sensor.log.lines = [1, 61]",
            ["sensor.log.lines=[1, 61]"],
        ),
        (
            "clock set forward",
            head + "0,1\n0.001,1\n1800000000,1\n1800000000.001,1\n",
            "line 4: is stamped 20833 days after the row above it",
            "sensor.log.lines = [4, 5]",
            ["sensor.log.lines=[4, 5]"],
        ),
        (
            "out of order",
            head + "0,1\n5,1\n2,1\n3,1\n4,1\n",
            "only out of order",
            "sensor.log.sort = true",
            ["sensor.log.sort=true"],
        ),
        (
            "uneven ticks",
            head + uneven,
            "no rows at a constant rate",
            "sensor.log.repeated_stamps",
            ["sensor.log.repeated_stamps=first"],
        ),
        (
            "few ticks",
            head + "0,1\n" * 500 + "1,1\n" * 500,
            "repeats the stamp of the row before",
            "sensor.log.rate_hz",
            ["sensor.log.rate_hz=500"],
        ),
        (
            "a column twice",
            "time_s,fx_n,fx_n\n0,1,2\n1,1,2\n",
            "appears twice",
            "sensor.log.columns",
            ['sensor.log.columns=["time_s", "fx_n", ""]'],
        ),
        (
            "too wide",
            head + regular + "0,060,0,5\n",
            "line 62: has 4 cells, the header has 2",
            "sensor.log.lines = [1, 61]",
            ["sensor.log.lines=[1, 61]"],
        ),
        (
            "too wide, far below",
            head + "".join(f"{k / 1000:.3f},0.5\n" for k in range(400)) + "0,400,0,5\n",
            "line 402: has 4 cells, the header has 2",
            "sensor.log.lines = [1, 401]",
            ["sensor.log.lines=[1, 401]"],
        ),
        (
            "footer",
            head + regular + "End of data\n",
            "line 62, column time_s: expected a number, got 'End of data'",
            'sensor.log.missing = ["End of data"]',
            ['sensor.log.missing=["End of data"]'],
        ),
        (
            "status that is none",
            "time_s,fx_n,status\n0,1,ok\n1,1,bad\n",
            "expected a status code, got 'ok'",
            'sensor.log.columns = ["time_s", "fx_n", ""]',
            ['sensor.log.columns=["time_s", "fx_n", ""]'],
        ),
    ]


@pytest.mark.parametrize(
    ("text", "said", "advice", "stated"), [each[1:] for each in messages()], ids=[each[0] for each in messages()]
)
def test_the_advice_of_a_message_leads_to_an_import(
    tmp_path: Path, text: str, said: str, advice: str, stated: list[str]
) -> None:
    path = written(tmp_path, text)
    if said:
        with pytest.raises(InputError) as caught:
            read_force_log(path)
        message = str(caught.value)
        assert str(path) in message
        assert said in message
        assert advice in message
        assert "\n" not in message
    found = read_force_log(path, info_from_facts(stated).sensor.log)
    assert len(found.stamp_ns) > 1
    assert np.all(np.diff(found.stamp_ns) > 0)


REGULAR = "time_s,fx_n\n" + "".join(f"{k / 1000:.3f},0.5\n" for k in range(2000))
STATED_WRONG: dict[str, tuple[str, list[str], str, list[str]]] = {
    "rate": (REGULAR, ["sensor.log.rate_hz=900"], "not those of 900 rows per second", []),
    "axis": (REGULAR, ["sensor.log.fx=Fq"], "has no column 'Fq'; it has time_s, fx_n", ["sensor.log.fx=fx_n"]),
    "time": (
        REGULAR,
        ["sensor.log.time=clock"],
        "as sensor.log.time states; it has time_s",
        ["sensor.log.time=time_s"],
    ),
    "columns": (
        REGULAR,
        ['sensor.log.columns=["time_s", "fx_n", ""]'],
        "names 3 columns, the rows have 2 cells",
        ['sensor.log.columns=["time_s", "fx_n"]'],
    ),
    "counts": (REGULAR, ["sensor.log.counts_per_n=5"], "or leave counts_per_n out", []),
    "lines": (REGULAR, ["sensor.log.lines=[5000, 6000]"], "see sensor.log.lines", ["sensor.log.lines=[500, 600]"]),
    "order of a date": (
        "time,fx_n\n31/12/2026 10:00:00,1\n31/12/2026 10:00:01,1\n",
        ["sensor.log.date_order=mdy"],
        "or check the stated order mdy",
        ["sensor.log.date_order=dmy"],
    ),
    "status": (REGULAR, ["sensor.log.status=state"], "has no column 'state'", []),
}


@pytest.mark.parametrize("name", STATED_WRONG)
def test_a_value_that_does_not_go_with_the_log_is_named(tmp_path: Path, name: str) -> None:
    text, wrong, said, right = STATED_WRONG[name]
    path = written(tmp_path, text)
    with pytest.raises(InputError) as caught:
        read_force_log(path, info_from_facts(wrong).sensor.log)
    assert said in str(caught.value)
    found = read_force_log(path, info_from_facts(right).sensor.log if right else None)
    assert len(found.stamp_ns) > 1


def test_a_sheet_is_chosen_where_several_hold_tables(tmp_path: Path) -> None:
    openpyxl = pytest.importorskip("openpyxl")
    book = openpyxl.Workbook()
    for sheet in (book.active, book.create_sheet("Run 2")):
        sheet.append(["time_s", "fx_n"])
        for k in range(9):
            sheet.append([k, 0.5 if sheet.title == "Run 2" else 0.1])
    path = tmp_path / "force.xlsx"
    book.save(path)
    with pytest.raises(
        InputError, match=r'several sheets \(Sheet, Run 2\); state one .*: sensor\.log\.sheet = "Sheet"'
    ):
        read_force_log(path)
    assert read_force_log(path, ForceLogInfo(sheet="Run 2")).force_n[0, 0] == 0.5


def test_a_remark_beside_a_row_is_no_reading(tmp_path: Path) -> None:
    found = read_force_log(written(tmp_path, "time_s,fx_n\n0,1\n1,1,touched the bench\n2,1\n"))
    assert found.force_n[:, 0].tolist() == [1, 1, 1]


@pytest.mark.parametrize("name", ["force.xlsx", "force.mat"])
def test_a_damaged_file_is_refused_in_one_sentence(tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    if name == "force.mat":
        save_v5(path, {"t": np.arange(9.0), "Fx": np.arange(9.0)})
    else:
        book = pytest.importorskip("openpyxl").Workbook()
        book.active.append(["time_s", "fx_n"])
        book.save(path)
    whole = path.read_bytes()
    damaged = [b"", b"PK\x03\x04", whole[:40], whole[: len(whole) // 2], whole[:200] + b"\xff" * 200]
    if name == "force.mat":  # each is read in a process of its own
        damaged = [b"", *damaged[3:]]
    for content in damaged:
        path.write_bytes(content)
        with pytest.raises(InputError) as caught:
            read_force_log(path, ForceLogInfo(force_unit="N", time_unit="s"))
        assert str(caught.value).startswith(str(path))
        assert "\n" not in str(caught.value)


def test_a_table_of_matlab_is_refused_with_the_line_that_saves_its_columns(tmp_path: Path) -> None:
    path = tmp_path / "force.mat"
    save_v5(path, {"log": "an object"})
    with pytest.raises(InputError, match=r"table2struct\(T, \"ToScalar\", true\)"):
        read_force_log(path)
    save_v5(path, {"t": np.arange(9.0), "Fx": np.arange(9.0)})
    assert len(columns_of(path).stamp_ns) == 9


@pytest.mark.parametrize(
    ("stated", "step_ns"),
    [("Sample Rate: 2 kHz", 500_000), ("Sample interval\t4 ms", 4_000_000), ("rate = 50", 20_000_000)],
)
def test_a_rate_in_the_header_has_its_unit(tmp_path: Path, stated: str, step_ns: int) -> None:
    found = read_force_log(written(tmp_path, f"Logger\n{stated}\nfx_n\tfy_n\n" + "1\t2\n" * 9))
    assert np.diff(found.stamp_ns).tolist() == [step_ns] * 8


def test_a_rate_that_may_be_one_or_a_thousand_is_asked_for(tmp_path: Path) -> None:
    path = written(tmp_path, "Sample Rate: 1,000 Hz\nfx_n;fy_n\n" + "1;2\n" * 9)
    with pytest.raises(InputError, match=r"sensor\.log\.rate_hz for a log without times"):
        read_force_log(path)
    assert read_force_log(path, ForceLogInfo(rate_hz=1000)).stamp_ns[1] == 1_000_000
