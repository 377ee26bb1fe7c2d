"""Reads a log, a table whose rows have times in any form, and lists the assumptions."""

import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ...errors import TableError, TimeError
from ...types import FloatArray, IntArray, LogInfo
from ._columns import listed
from ._dates import is_time_of_day, is_time_text
from ._layout import MISSING
from ._open import open_table
from ._stamps import TIME_UNITS, TimeUnit, dates_ns, named_unit, numbers_ns, time_columns, unit_since_1970
from ._table import Table
from ._ticks import UnevenRows, at_rate, spread_within_ticks

MAX_DISORDER_S = 0.1
"""Rows that are out of order by at most this time were swapped in transfer; if the clock was set back it is more."""
MAX_DISORDER_ROWS = 20
"""The same limit as a number of median steps between rows; the smaller of the two limits counts."""
MAX_RATE_STDERRS, MAX_RATE_SHARE = 4, 1e-3
"""A stated rate may differ from that of the clock by this number of standard errors, or by this share of itself."""

MAX_PAUSE_S = 86_400
"""A longer pause between two rows means that the clock was set."""

_DATE_NAMES = ("date", "datum")
_SECONDS, _NANOSECONDS = "sec", "nanosec"
"""Names of the two columns of a stamp of ROS."""
_SEQUENCE = re.compile(r"^rdt ?sequence$", re.IGNORECASE)
_RATES = ("rdt sample rate", "sample rate", "sampling rate", "sampling frequency", "frequency", "rate")
_INTERVALS = ("delta_x", "delta x", "sample interval", "sampling interval")
_RATE_UNITS = {"": 1.0, "hz": 1.0, "khz": 1e3, "samples/s": 1.0, "s/s": 1.0, "1/s": 1.0, "samples per second": 1.0}
_INTERVAL_UNITS = {"": 1.0, "s": 1.0, "sec": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6}


@dataclass(frozen=True, slots=True, eq=False)
class Log:
    """The rows of a log in the order of their times.

    Attributes:
        table: the table.
        stamp_ns: (n,) strictly rising stamps.
        rows: (n,) row of the table of each.
        time: the columns that were taken as the time, as text.
        time_names: names of these columns.
        remarks: the assumptions about the times, in sentences.
    """

    table: Table
    stamp_ns: IntArray
    rows: IntArray
    time: str
    time_names: tuple[str, ...]
    remarks: tuple[str, ...]

    @property
    def path(self) -> Path:
        """Path of the file."""
        return self.table.path

    def place(self, row: int) -> str:
        """Returns the position of a row in the file, for messages."""
        return self.table.place(int(self.rows[row]))

    def readings(self, names: list[str]) -> FloatArray:
        """Returns (n, len(names)) readings; NaN where there is none. Raises TableError for a cell with another text."""
        return self.table.readings(names)[self.rows]

    def codes(self, name: str) -> IntArray:
        """Returns the (n,) status codes. Raises TableError."""
        return self.table.codes(name)[self.rows]


class _RowTimes(NamedTuple):
    """Times of those rows of a table that have one, in the order of the table.

    Attributes:
        stamp_ns: (n,) stamps in ns.
        rows: (n,) numbers of these rows in the table.
        source: the columns of the times, with the unit of a column of numbers, as text: "t (ms)", "date and time".
    """

    stamp_ns: IntArray
    rows: IntArray
    source: str


@dataclass(slots=True)
class _Reader:
    """Finds the times of the rows of one log."""

    table: Table
    info: LogInfo
    key: str
    remarks: list[str] = field(default_factory=list[str])

    def read(self) -> Log:
        """Returns the log with the time of each row, by the best source that there is.

        These are: a sequence number and the rate in the header; the rate in ``bench.toml``; the times in the table. A
        log without times has the rate only.
        """
        rate_hz, stated = self._rate_hz()
        names = self._names(rate_hz)
        if not any(True for _ in self.table.lines()):
            raise self.table.no_rows()
        if not names:
            assert rate_hz is not None
            count = len(self.table)
            stamps = np.rint(np.arange(count) * (1e9 / rate_hz)).astype(np.int64)
            self.remarks.append(
                f"its rows have no times; they are taken as {rate_hz:g} rows per second, as {stated}, from 0 s on"
            )
            return Log(self.table, stamps, np.arange(count), f"row / {rate_hz:g} per second", (), tuple(self.remarks))
        stamps, rows, time_source = self._row_times(names)
        if not len(rows):
            raise TableError(f"{self.table.path}: no row has a time in {names[0]}; state {self.key}.time in bench.toml")
        sequence = next((name for name in self.table.columns if _SEQUENCE.match(name)), None)
        if rate_hz is not None and sequence and self.info.rate_hz is None:
            stamps, rows = self._by_sequence(stamps, rows, sequence, rate_hz, stated)
            time_source = f"{sequence} / {rate_hz:g} per second"
        elif rate_hz is not None and self.info.rate_hz is not None:
            # a sequence number, where there is one, counts the lost rows, too
            numbers = rows if sequence is None else _unwrapped(self.table.whole_numbers(sequence), rows)
            try:
                stamps = at_rate(stamps, numbers, rate_hz)
            except UnevenRows:
                raise TimeError(
                    f"{self.table.path}: its stamps are not those of {rate_hz:g} rows per second, as "
                    f"{self.key}.rate_hz states: its {len(rows)} rows last "
                    f"{(stamps[-1] - stamps[0]) * 1e-9:.3f} s; correct {self.key}.rate_hz, or leave it out"
                ) from None
            self.remarks.append(f"its rows are taken as {rate_hz:g} per second, as {self.key}.rate_hz states")
        else:
            stamps, rows = self._in_order(stamps, rows)
            stamps, rows = self._without_repeats(stamps, rows)
        self._check_pauses(stamps, rows)
        return Log(self.table, stamps, rows, f"time = {time_source}", names, tuple(self.remarks))

    def _check_pauses(self, stamps: IntArray, rows: IntArray) -> None:
        """Raises TimeError where the clock was set forward in the log: no session has a pause of a day.

        ``stamps`` (n,) are in ns; ``rows`` (n,) are their rows in the table.
        """
        after = int(np.argmax(np.diff(stamps))) + 1 if len(stamps) > 1 else 0
        if after and stamps[after] - stamps[after - 1] > MAX_PAUSE_S * 1_000_000_000:
            line, end = (self.table.place(int(row)).split()[-1] for row in (rows[after], rows[-1]))
            days = (stamps[after] - stamps[after - 1]) / 86_400e9
            raise TimeError(
                f"{self.table.path}, {self.table.place(int(rows[after]))}: is stamped {days:.0f} days after the row "
                f"above it; if the clock was set there, import the rows from it on: {self.key}.lines = [{line}, {end}] "
                "in bench.toml"
            )

    def _rate_hz(self) -> tuple[float | None, str]:
        """Returns the rows per second that ``bench.toml``, else the lines above the table state, and the source.

        An averaging level of 10 means that one row is the mean of ten samples, so the sample rate is divided by it.
        """
        if self.info.rate_hz is not None:
            return self.info.rate_hz, f"{self.key}.rate_hz states"
        for name in (*_RATES, *_INTERVALS):
            text = self.table.facts.get(name, "")
            rate_hz = _rate_of(text, interval=name in _INTERVALS)
            if rate_hz:
                averaged = self.table.facts.get("averaging level", "")
                samples_per_row = int(averaged) if averaged.isdigit() and int(averaged) else 1
                quoted = f"{name} {text}" + (f", averaging level {averaged}" if averaged else "")
                return rate_hz / samples_per_row, f"its header states ({quoted})"
        return None, ""

    def _names(self, rate_hz: float | None) -> tuple[str, ...]:
        """Returns the columns of the times; none for a log that has only a rate."""
        table, info = self.table, self.info
        if info.time is not None:
            if info.time not in table.columns:
                raise TableError(
                    f"{table.path}: has no column {info.time!r}, as {self.key}.time states; it has "
                    f"{listed(table.columns)}"
                )
            return (info.time,)
        fitting = time_columns(table.columns)
        if len(fitting) == 1 or fitting == (_SECONDS, _NANOSECONDS):
            return fitting
        if len(fitting) > 1:
            raise TableError(
                f"{table.path}: has several columns that may be the time ({listed(fitting)}); state {self.key}.time "
                "in bench.toml"
            )
        dates = [name for name in table.columns if name.lower() in _DATE_NAMES]
        if len(dates) == 1 and ":" in table.first(dates[0]):
            return (dates[0],)
        if rate_hz is None:
            raise TableError(
                f"{table.path}: has no column that is called a time ({listed(table.columns)}); state {self.key}.time "
                f"in bench.toml, or {self.key}.rate_hz for a log without times"
            )
        return ()

    def _row_times(self, names: tuple[str, ...]) -> _RowTimes:
        """Reads the times of the rows, which are whole numbers, other numbers or texts.

        Args:
            names: the columns of the times: the pair "sec" and "nanosec", or one column.

        Returns:
            The times. A row with an empty cell is left out, with a remark. A column of whole numbers has no empty cell
            and is converted exactly: a float has 53 bits, and a stamp in ns since 1970 needs 61.

        Raises:
            TableError: the unit is unknown, or a cell is no time.
            TimeError: a time is past the year 2038.
        """
        table, path = self.table, self.table.path
        if names == (_SECONDS, _NANOSECONDS):
            return self._second_pairs()
        name = names[0]
        if is_time_text(table.first(name)):
            return self._text_times(name)
        unit = "ns" if name == "stamp_ns" else self._unit(name)
        numbers = self._numbers(name)
        rows = np.arange(len(numbers))
        if not _are_whole(numbers):
            rows = np.flatnonzero(np.isfinite(numbers))
            self._remark_rows_without_time(len(numbers) - len(rows))
        return _RowTimes(numbers_ns(path, numbers[rows], unit, self._unit_remedy()), rows, f"{name} ({unit})")

    def _second_pairs(self) -> _RowTimes:
        """Reads times in two columns, seconds and the nanoseconds to add; see `_row_times`."""
        path, source = self.table.path, f"{_SECONDS} + {_NANOSECONDS}"
        seconds, nanoseconds = self._numbers(_SECONDS), self._numbers(_NANOSECONDS)
        if _are_whole(seconds) and _are_whole(nanoseconds):
            stamps = numbers_ns(path, seconds, "s", self._unit_remedy()) + nanoseconds.astype(np.int64)
            return _RowTimes(stamps, np.arange(len(stamps)), source)
        pairs = self.table.readings([_SECONDS, _NANOSECONDS])
        rows = np.flatnonzero(np.isfinite(pairs).all(axis=1))
        self._remark_rows_without_time(len(pairs) - len(rows))
        stamps = numbers_ns(path, pairs[rows, 0] * 1e9 + pairs[rows, 1], "ns", self._unit_remedy())
        return _RowTimes(stamps, rows, source)

    def _text_times(self, name: str) -> _RowTimes:
        """Reads times of day and dates that are texts in the column ``name``; see `_row_times`.

        Times of day are joined with the dates of a second column: the stated one, or one with the name of a date.
        """
        table, info = self.table, self.info
        date_name = info.date or next((each for each in table.columns if each.lower() in _DATE_NAMES), None)
        if info.date is not None:
            table.column(info.date)  # raises where there is no such column
        missing = MISSING | {text.lower() for text in info.missing}
        all_cells = table.cells(name)
        rows = np.array([row for row, cell in enumerate(all_cells) if cell.lower() not in missing], np.int64)
        self._remark_rows_without_time(len(all_cells) - len(rows))
        cells = [all_cells[row] for row in rows.tolist()]
        dates = None
        if date_name is not None and date_name != name and cells and is_time_of_day(cells[0]):
            column = table.cells(date_name)
            dates = [column[row] for row in rows.tolist()]
        stamps = dates_ns(
            table,
            name,
            cells,
            info.date_order,
            f'if the row has no time, state {self.key}.missing = ["{{}}"] in bench.toml',
            order_remedy=f'state {self.key}.date_order = "dmy", "mdy" or "ymd" in bench.toml',
            dates=dates,
            rows=rows,
        )
        return _RowTimes(stamps, rows, name if dates is None else f"{date_name} and {name}")

    def _numbers(self, name: str) -> FloatArray | IntArray:
        """Returns the (n,) numbers of a column; whole numbers are exact."""
        whole = self.table.whole_numbers(name)
        return self.table.readings([name])[:, 0] if whole is None else whole

    def _unit(self, name: str) -> TimeUnit:
        """Returns the unit of a column of numbers: stated, in its name, in the row of units, or by times since 1970."""
        unit = self.info.time_unit or named_unit(name) or named_unit(self.table.units.get(name, ""))
        if unit is None:
            numbers = self._numbers(name).astype(np.float64)
            unit = unit_since_1970(numbers[np.isfinite(numbers)])
            if unit is not None:
                self.remarks.append(f"{name} is taken as {unit} since 1970")
        if unit is None:
            raise TableError(
                f"{self.table.path}: the column {name!r} does not name its unit; state {self.key}.time_unit = "
                f"{' or '.join(f'{each!r}' for each in TIME_UNITS)} in bench.toml".replace("'", '"')
            )
        return unit

    def _unit_remedy(self) -> str:
        return f"check {self.key}.time_unit"

    def _remark_rows_without_time(self, count: int) -> None:
        if count:
            self.remarks.append(f"{count} rows without a time are left out")

    def _in_order(self, stamps: IntArray, rows: IntArray) -> tuple[IntArray, IntArray]:
        """Returns stamps (n,) in ns and their rows (n,) of the table, sorted by stamp.

        Rows that were swapped in transfer are sorted; where ``LogInfo.sort`` is true, all rows. Raises TimeError for a
        row that is too late for a swap: the clock was set back.
        """
        steps = np.diff(stamps)
        if not np.any(steps < 0):
            return stamps, rows
        late_ns = np.maximum.accumulate(stamps) - stamps
        first_late = int(np.flatnonzero(steps < 0)[0]) + 1
        back_s = float(late_ns.max()) * 1e-9
        median_step_s = float(np.median(np.abs(steps))) * 1e-9
        if not self.info.sort and back_s > min(MAX_DISORDER_S, MAX_DISORDER_ROWS * median_step_s):
            line, before = self.table.place(int(rows[first_late])), self.table.place(int(rows[first_late - 1]))
            step_s = float(stamps[first_late - 1] - stamps[first_late]) * 1e-9
            raise TimeError(
                f"{self.table.path}, {line}: is stamped before the row above it, by {step_s:.6g} s; if the clock was "
                f"set back there, import the rows before it: {self.key}.lines = [1, {before.split()[-1]}] in bench.toml"
                f"; if the rows are only out of order: {self.key}.sort = true"
            )
        order = np.argsort(stamps, kind="stable")
        self.remarks.append(
            f"{int(np.sum(late_ns > 0))} rows were out of order, by up to {back_s:.3g} s, and were sorted"
        )
        return stamps[order], rows[order]

    def _without_repeats(self, stamps: IntArray, rows: IntArray) -> tuple[IntArray, IntArray]:
        """Makes the stamps strictly rising where several rows have one stamp.

        A clock that is coarser than the rows gives most stamps to several rows: these are spread within its ticks.
        Where only few rows repeat a stamp, or ``LogInfo.repeated_stamps`` demands it, the first row of each is kept.
        Takes and returns stamps (n,) in ns and their rows (n,). Raises TimeError for rows without a constant rate.
        """
        repeats = np.flatnonzero(np.diff(stamps) == 0) + 1
        if not len(repeats):
            return stamps, rows
        different = len(stamps) - len(repeats)
        rows_per_stamp = np.diff(np.flatnonzero(np.diff(stamps, prepend=stamps[0] - 1, append=stamps[-1] + 1)))
        # two stamps or one have no typical number of rows
        few_repeat = different > 2 and float(np.median(rows_per_stamp)) < 2
        if self.info.repeated_stamps == "first" or few_repeat:
            keep = np.diff(stamps, prepend=stamps[0] - 1) > 0
            self.remarks.append(
                f"{len(repeats)} rows repeat the stamp of the row above them and are left out (of each stamp the first "
                "row is kept)"
            )
            return stamps[keep], rows[keep]
        try:
            spread = spread_within_ticks(stamps)
        except UnevenRows:
            first_repeat = int(repeats[0])
            raise TimeError(
                f"{self.table.path}, {self.table.place(int(rows[first_repeat]))}: repeats the stamp of the row before "
                f"({stamps[first_repeat] * 1e-9:.6f} s); {len(stamps)} rows have {different} different stamps, with "
                f"{rows_per_stamp.min()} to {rows_per_stamp.max()} rows each, which are no rows at a constant rate; if "
                f"the sensor sends at a constant rate, state {self.key}.rate_hz in bench.toml; else keep one row of "
                f'each stamp: {self.key}.repeated_stamps = "first"'
            ) from None
        gaps = f", {spread.gaps} pause{'s' * (spread.gaps > 1)}" if spread.gaps else ""
        self.remarks.append(
            f"its clock has steps of {spread.tick_ns * 1e-9:g} s with {len(stamps) / different:.1f} rows in each{gaps}"
            f"; the rows are taken as {spread.rate_hz:.6g} +- {spread.rate_stderr_hz:.2g} per second"
        )
        return spread.stamp_ns, rows

    def _by_sequence(
        self, stamps: IntArray, rows: IntArray, sequence: str, rate_hz: float, stated: str
    ) -> tuple[IntArray, IntArray]:
        """Returns times in ns by sequence number and rate, which are finer than the log's clock, and their rows.

        Args:
            stamps: (n,) stamps in ns of the log's clock, which must show the same rate; else TimeError.
            rows: (n,) row of the table of each.
            sequence: the column of sequence numbers; repeated numbers are left out.
            rate_hz: rows per second.
            stated: source of the rate, for messages.
        """
        numbers = _unwrapped(self.table.whole_numbers(sequence), rows)
        if np.any(np.diff(numbers) <= 0):
            order = np.argsort(numbers, kind="stable")
            numbers, rows, stamps = numbers[order], rows[order], stamps[order]
            keep = np.diff(numbers, prepend=numbers[0] - 1) > 0
            numbers, rows, stamps = numbers[keep], rows[keep], stamps[keep]
            self.remarks.append(f"the rows were put in the order of {sequence}")
        ticks = np.unique(stamps)
        if len(ticks) > 3:
            slope = np.polyfit(numbers - numbers[0], (stamps - stamps[0]) * 1e-9, 1)[0]
            tick_s = float(np.median(np.diff(ticks))) * 1e-9
            span_s = (ticks[-1] - ticks[0]) * 1e-9
            clock_hz = 1 / slope if slope > 0 else 0.0
            stderr_hz = clock_hz * tick_s / (span_s * np.sqrt(len(ticks)))  # one rounding error for each tick
            if abs(clock_hz - rate_hz) > max(MAX_RATE_STDERRS * stderr_hz, MAX_RATE_SHARE * rate_hz):
                raise TimeError(
                    f"{self.table.path}: {stated}, so {rate_hz:g} rows per second, but by the column of its clock they "
                    f"are {clock_hz:.5g} +- {stderr_hz:.2g}; state the rate in bench.toml: {self.key}.rate_hz"
                )
        lost = int(numbers[-1] - numbers[0] + 1 - len(numbers))
        self.remarks.append(
            f"times are {sequence} / {rate_hz:g} per second, as {stated}"
            + (f"; {lost} rows were lost on the way" if lost else "")
        )
        times = np.rint((numbers - numbers[0]) * (1e9 / rate_hz)).astype(np.int64) + stamps[0]
        return times, rows


def _rate_of(text: str, *, interval: bool) -> float | None:
    """Returns the rows per second of "1000", "1 kHz" or, as an interval, "1 ms"; None for another text or with groups.

    >>> [_rate_of("2.5 kHz", interval=False), _rate_of("1 ms", interval=True), _rate_of("1,000", interval=False)]
    [2500.0, 1000.0, None]
    """
    match = re.fullmatch(r"(\d+(?:[.,]\d+)?(?:[eE][+-]?\d+)?)\s*(\D*)", text.strip())
    if match is None or re.fullmatch(r"[1-9]\d{0,2}[.,]\d{3}", match[1]):
        return None
    factor = (_INTERVAL_UNITS if interval else _RATE_UNITS).get(match[2].strip().lower())
    value = float(match[1].replace(",", ".")) * (factor or 0.0)
    if not value:
        return None
    return 1.0 / value if interval else value


def _are_whole(numbers: FloatArray | IntArray) -> bool:
    """Returns whether a column holds whole numbers only: `_Reader._numbers` returns all other columns as floats."""
    return numbers.dtype == np.int64


def _unwrapped(numbers: IntArray | None, rows: IntArray) -> IntArray:
    """Continues numbers of 32 bits after their overflow; returns the rows themselves where there are no numbers."""
    return rows if numbers is None else np.unwrap(numbers[rows], period=1 << 32).astype(np.int64)


def open_log(path: Path, info: LogInfo, key: str) -> Log:
    """Opens a log and reads the times of its rows.

    Args:
        path: a text table, a workbook (.xlsx) or variables of MATLAB (.mat).
        info: description of the log.
        key: section of ``info`` in ``bench.toml``, for messages.

    Returns:
        The table with the times of its rows in nanoseconds.

    Raises:
        FileFormatError: the file is no table.
        TableError: the times cannot be read; the message names line and column.
        TimeError: the times are not those of a log.
    """
    return _Reader(open_table(path, log=info, key=key), info, key).read()
