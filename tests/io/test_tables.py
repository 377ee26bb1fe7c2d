import gzip
from pathlib import Path

import numpy as np
import pytest

from tipforce.errors import FileFormatError, InputError, TableError, TimeError, TipforceError
from tipforce.io import read_drive_log, read_force_log
from tipforce.types import ForceLogInfo
from tipforce.units import GRAM_N

COUNTS = ForceLogInfo(time="clock", fx="-a", fy="b", time_unit="ns", force_unit="counts", counts_per_n=10.0)


def log(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "force.csv"
    path.write_text(text, encoding="utf-8")
    return path


@pytest.mark.parametrize(
    ("text", "columns", "newtons"),
    [
        ("time_s,fx_n,fy_n,fz_n\n0.5,1,2,3\n0.501,4,5,6\n", ForceLogInfo(), [[1, 2, 3], [4, 5, 6]]),
        (
            "# logger 3\nstamp_ns\tFx (mN)\tFy (mN)\n500000000\t1000\t2000\n501000000\t4000\t5000\n",
            ForceLogInfo(),
            None,
        ),
        ("t;Fx;Fy\n0,5;1,0;2,0\n0,501;4,0;5,0\n", ForceLogInfo(time_unit="s", force_unit="N"), None),
        ("time_ms fx_n fy_n\n500  1.0 2.0\n501 4.0 5.0\n", ForceLogInfo(), None),
        ('"sec","nanosec","fx_n","fy_n"\n0,500000000,1,2\n0,501000000,4,5\n', ForceLogInfo(), None),
        ("clock,a,b\n5e8,-10,20\n5.01e8,-40,50\n", COUNTS, None),
    ],
    ids=[
        "names tell all",
        "tabs and milli",
        "decimal commas",
        "blanks",
        "seconds and nanoseconds",
        "counts, turned axis",
    ],
)
def test_logs_of_many_kinds_hold_the_same_forces(
    tmp_path: Path, text: str, columns: ForceLogInfo, newtons: list[list[float]] | None
) -> None:
    found = read_force_log(log(tmp_path, text), columns)
    assert found.stamp_ns.tolist() == [500_000_000, 501_000_000]
    np.testing.assert_allclose(found.force_n, newtons or [[1, 2, np.nan], [4, 5, np.nan]])


def test_grams_become_newtons(tmp_path: Path) -> None:
    found = read_force_log(log(tmp_path, "time_s,fx\n0,20\n1,30\n"), ForceLogInfo(force_unit="g"))
    np.testing.assert_allclose(found.force_n[:, 0], [20 * GRAM_N, 30 * GRAM_N])


def test_stamps_since_1970_in_nanoseconds_are_exact(tmp_path: Path) -> None:
    found = read_force_log(log(tmp_path, "stamp_ns,fx_n\n1723092491697277832,1\n1723092491697277833,2\n"))
    assert found.stamp_ns.tolist() == [1723092491697277832, 1723092491697277833]


@pytest.mark.parametrize(
    ("text", "columns", "error", "said"),
    [
        ("", ForceLogInfo(), FileFormatError, "is empty"),
        ("0.1,2,3\n0.2,3,4\n", ForceLogInfo(), TableError, "line 1: expected the names of the columns"),
        ("time_s,fx_n\n", ForceLogInfo(), TableError, "has a header but no rows"),
        ("time_s,load\n0,1\n", ForceLogInfo(), TableError, "sensor.log.fx, fy and fz"),
        ("time_s,fx_n\n0,1\n", ForceLogInfo(fy="Fy"), TableError, "has no column 'Fy'; it has time_s, fx_n"),
        ("clock,fx_n\n0,1\n", ForceLogInfo(), TableError, "state sensor.log.time in"),
        ("time,fx_n\n0,1\n", ForceLogInfo(), TableError, "state sensor.log.time_unit"),
        ("time_s,fx\n0,1\n", ForceLogInfo(), TableError, "state sensor.log.force_unit"),
        ("time_s,fx_counts\n0,1\n", ForceLogInfo(), TableError, "sensor.log.counts_per_n"),
        ("time_s,fx_n\n0,1\n", ForceLogInfo(counts_per_n=5), InputError, "leave counts_per_n out"),
        (
            "time_s,fx_n\n0,1\n# x\n1,two\n",
            ForceLogInfo(),
            TableError,
            "line 4, column fx_n: expected a number, got 'two'",
        ),
        ("time_s,fx_n\n0,1\n1,inf\n", ForceLogInfo(), TableError, "line 3, column fx_n: expected a number, got 'inf'"),
        ("time_s,fx_n\n0,1,5,2\n", ForceLogInfo(), TableError, "both decimal sign and separator"),
        ("time_s;fx_n\n0;1.5\n1;2,5\n", ForceLogInfo(), TableError, "line 3, column fx_n: '2,5' has a decimal comma"),
        ("time_s,fx_n,fx_n\n0,1,2\n", ForceLogInfo(), TableError, "appears twice"),
        ("time_s,fx_n\n0,1\n\n5,1\n1,1\n", ForceLogInfo(), TimeError, "line 5: is stamped before"),
        ("time_s,fx_n\n0,1\n0,1\n", ForceLogInfo(), TimeError, "line 3: repeats the stamp"),
        ("time_s,fx_n\n0,1\n\n1,1e300\n", ForceLogInfo(), TableError, "line 4, column fx_n: 1e+300 is 1e+300 N"),
        ("time_ms,fx_n\n1723092491697277832,1\n", ForceLogInfo(), TimeError, "check sensor.log.time_unit"),
        ("time_s,fx_n\n1e15,1\n", ForceLogInfo(), TimeError, "check sensor.log.time_unit"),
        (
            "time,fx_n\n2024-05-03T10:00:00,1\n2024-05-33T10:00:01,1\n",
            ForceLogInfo(),
            TableError,
            "line 3, column time: expected a date",
        ),
        (
            "time_s," + ",".join(f"a{k}" for k in range(300)) + "\n0" + 300 * ",1" + "\n",
            ForceLogInfo(),
            TableError,
            "and 281 more",
        ),
    ],
)
def test_a_bad_log_is_told_in_one_sentence(
    tmp_path: Path, text: str, columns: ForceLogInfo, error: type[TipforceError], said: str
) -> None:
    with pytest.raises(error) as caught:
        read_force_log(log(tmp_path, text), columns)
    assert said in str(caught.value)
    assert "force.csv" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_file_of_bytes_is_no_table(tmp_path: Path) -> None:
    path = tmp_path / "force.csv"
    path.write_bytes(bytes(range(128, 256)))
    with pytest.raises(FileFormatError, match="no text table"):
        read_force_log(path)
    with pytest.raises(FileFormatError, match="no such file"):
        read_force_log(tmp_path / "other.csv")


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "latin-1"])
def test_a_log_of_a_german_windows_is_read(tmp_path: Path, encoding: str) -> None:
    rows = "".join(f"{k},{k % 7}\n" for k in range(3000))
    path = tmp_path / "Prüfstand [3].csv"
    path.write_text(f"zeit_ms,Kraft ä_mN\n{rows}# Prüfstand\n", encoding=encoding)
    found = read_force_log(path, ForceLogInfo(fx="Kraft ä_mN"))
    assert len(found.stamp_ns) == 3000
    assert found.force_n[6, 0] == pytest.approx(6e-3)


def test_an_umlaut_far_down_in_a_log_does_no_harm(tmp_path: Path) -> None:
    path = tmp_path / "force.csv"
    rows = "".join(f"{k},{k % 7}\n" for k in range(300_000))
    path.write_text(f"time_ms,fx_n\n{rows}# Prüfstand\n", encoding="latin-1")
    assert len(read_force_log(path).stamp_ns) == 300_000


@pytest.mark.parametrize(
    ("first", "second"),
    [
        ("2024-05-03T10:00:00", "2024-05-03T10:00:00.25"),
        ("2024-05-03 10:00:00.000000Z", "2024-05-03 10:00:00.250000Z"),
        ("2024-05-03T12:00:00+02:00", "2024-05-03T12:00:00.250+02:00"),
        ("2024-05-03T05:30:00.0-0430", "2024-05-03T05:30:00.25-0430"),
    ],
)
def test_dates_are_stamps_since_1970(tmp_path: Path, first: str, second: str) -> None:
    found = read_force_log(log(tmp_path, f"timestamp,fx_n\n{first},1\n{second},2\n"))
    assert found.stamp_ns.tolist() == [1714730400_000_000_000, 1714730400_250_000_000]


def test_a_knob_log_names_its_drives_with_their_units(tmp_path: Path) -> None:
    found = read_drive_log(log(tmp_path, "time_s,knob_deg,wire_mm\n0,1,2\n0.5,3,4\n"))
    assert found.stamp_ns.tolist() == [0, 500_000_000]
    assert {name: column.tolist() for name, column in found.values.items()} == {"knob_deg": [1, 3], "wire_mm": [2, 4]}
    with pytest.raises(TableError, match="end in their unit"):
        read_drive_log(log(tmp_path, "time_s,knob\n0,1\n"))


def test_a_long_log_is_read_fast_enough(tmp_path: Path) -> None:
    """A minute at 1 kHz: the fast way must be taken, not the one that looks for mistakes."""
    import time

    rows = [f"{k // 1000},{k % 1000:03d};0,{k % 97:02d};-0,5" for k in range(60_000)]
    path = log(tmp_path, "time_s;fx_n;fy_n\n" + "\n".join(rows) + "\n")
    start = time.perf_counter()
    found = read_force_log(path)
    assert len(found.stamp_ns) == 60_000
    assert time.perf_counter() - start < 2.0


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (",".join(f"c{k}" for k in range(100_000)).encode() + b"\n", "has 100000 columns, at most 10000 are read"),
        (b"time_s,fx_n\n0,1\n" + b"1" * (3 << 20), "has a line of more than 1 MiB"),
        (b'"' * 300_000, "is no table that can be read"),
        (b'time_s,fx_n\n"' + b"\n0,1" * 100_000, "is no table that can be read"),
        (b"time_s,fx_n\n" + b"0,1\n" * 300_000 + b"1,\0\n", r"byte 1200014 is 0"),
        (gzip.compress(b"time_s,fx_n\n", mtime=0), "is compressed"),
    ],
)
def test_what_only_looks_like_a_table_is_refused_at_once(tmp_path: Path, content: bytes, said: str) -> None:
    path = tmp_path / "log.csv"
    path.write_bytes(content)
    with pytest.raises(InputError, match=rf"log\.csv.*: .*{said}"):
        read_force_log(path)


@pytest.mark.parametrize("year", ["1969", "2038", "9999"])
def test_a_date_that_no_clock_showed_is_refused(tmp_path: Path, year: str) -> None:
    path = tmp_path / "log.csv"
    path.write_text(f"time,fx_n\n2026-01-01 00:00:00,0.1\n{year}-01-01 00:00:01,0.2\n")
    with pytest.raises(TimeError, match=rf"line 3, column time: '{year}.*no date from 1970 to 2037"):
        read_force_log(path)
