"""Reads dates and times of day of loggers: ISO, German, American, with names of months, with or without a zone."""

import datetime
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from ...types import DateOrder, IntArray

FIRST_YEAR, LAST_YEAR = 1970, 2037
"""Years of stamps: ROS messages hold seconds since 1970 in 32 bits with a sign."""

_DAY_NS = 86_400_000_000_000
_EPOCH = datetime.date(1970, 1, 1).toordinal()
_NUMBERS = r"\d{1,4}(?P<sign>[./-])\d{1,2}(?P=sign)\d{1,4}"
_NAMED = r"\d{1,2}[. -]+[^\W\d_]{3,9}\.?[ -]+\d{2,4}|[^\W\d_]{3,9}\.? \d{1,2},? \d{4}"
_CLOCK = r"(\d{1,2}):(\d\d)(?::(\d\d)(?:[.,:](\d{1,9}))?)?(?:\s*([AaPp])\.?[Mm]\.?)?"
_STAMP = re.compile(rf"^(?:(?P<day>{_NUMBERS}|{_NAMED})(?:T|,?\s+))?{_CLOCK}\s*(?:Z|([+-]\d\d):?(\d\d))?$")
_DATE = re.compile(rf"^(?:{_NUMBERS}|{_NAMED})$")
_OTHER_BLANKS = str.maketrans({"\u202f": " ", "\xa0": " "})
_ENGLISH_MONTHS = "jan feb mar apr may jun jul aug sep oct nov dec"
_GERMAN_MONTHS = {"mär": 3, "mrz": 3, "mai": 5, "okt": 10, "dez": 12}
_MONTHS = _GERMAN_MONTHS | {name: number for number, name in enumerate(_ENGLISH_MONTHS.split(), start=1)}


class NoDate(ValueError):
    """The text of the row ``row`` is no time."""

    def __init__(self, row: int) -> None:
        super().__init__(row)
        self.row = row


class DateOutside(NoDate):
    """A date is outside of the years that a recording can hold."""


class AmbiguousDates(ValueError):
    """The order of day and month is ambiguous.

    Args:
        example: one of the dates.
        orders: the orders that fit.
    """

    def __init__(self, example: str, orders: Sequence[str]) -> None:
        super().__init__(example)
        self.example, self.orders = example, orders


@dataclass(frozen=True, slots=True, eq=False)
class Times:
    """Times of the rows of a log.

    Attributes:
        stamp_ns: (n,) ns since 1970, or since the first midnight for times of day; local time where no zone is stated.
        kind: "date" or "time of day".
        order: order of day, month and year, where the dates are numbers.
    """

    stamp_ns: IntArray
    kind: str
    order: DateOrder | None


def is_time_text(text: str) -> bool:
    """Returns whether ``text`` is a time of day, a date with a time, or a date.

    >>> [is_time_text(text) for text in ("10:23:45,125", "31.12.2026 23:59:59", "Aug 1, 2018 10:23:45 AM", "12.5")]
    [True, True, True, False]
    """
    text = text.translate(_OTHER_BLANKS)
    return bool(_STAMP.match(text) or _DATE.match(text))


def is_time_of_day(text: str) -> bool:
    """Returns whether ``text`` is a time without a date."""
    found = _STAMP.match(text.translate(_OTHER_BLANKS))
    return found is not None and found["day"] is None


def parse_times(cells: Sequence[str], order: DateOrder | None, dates: Sequence[str] | None = None) -> Times:
    """Reads the times of the rows of a log.

    Args:
        cells: (n,) texts, as "31.12.2026 23:59:59,123", or "23:59:59,123" without a date.
        order: order of day, month and year; None: found from the dates, where only one fits.
        dates: (n,) texts of the dates, where they are in another column; they replace the dates in ``cells``.

    Returns:
        The stamps in ns: since 1970 with dates, else since the first midnight, increasing beyond 24 h after the next
        one. A time zone in a cell is subtracted; without one the stamps are in local time.

    Raises:
        NoDate: a cell is no time.
        DateOutside: a date is before 1970 or after 2037.
        AmbiguousDates: two orders of day and month fit, or none fits all dates.
    """
    clock_ns = np.empty(len(cells), np.int64)
    days: list[str] = []
    for row, cell in enumerate(cells):
        match = _STAMP.match(cell if cell.isascii() else cell.translate(_OTHER_BLANKS))
        time_ns = None if match is None else _time_of_day_ns(match)
        if match is None or time_ns is None:
            raise NoDate(row)
        clock_ns[row] = time_ns
        days.append(match["day"] or "")
    if dates is not None:
        days = [date.translate(_OTHER_BLANKS) for date in dates]
    if not any(days):  # a fall from 23:59 to 0:00 is the next day, not a clock that was set back
        return Times(np.unwrap(clock_ns, period=_DAY_NS).astype(np.int64), "time of day", None)
    found_order = order or _order_of(set(days))
    ordinals: dict[str, int] = {}  # text of a date -> days since 1970; a log has few dates and many rows
    day_ns = np.empty(len(cells), np.int64)
    for row, day in enumerate(days):
        if day not in ordinals:
            try:
                date = _date(day, found_order)
            except ValueError:
                raise NoDate(row) from None
            if not FIRST_YEAR <= date.year <= LAST_YEAR:
                raise DateOutside(row)
            ordinals[day] = date.toordinal() - _EPOCH
        day_ns[row] = ordinals[day]
    return Times(day_ns * _DAY_NS + clock_ns, "date", found_order)


def _time_of_day_ns(match: re.Match[str]) -> int | None:
    """Returns the ns since midnight (UTC if a zone is stated) of a match of `_STAMP`; None for an impossible time."""
    _, _, hour, minute, second, fraction, am_or_pm, zone_hour, zone_minute = match.groups()
    hours, minutes, seconds = int(hour), int(minute), int(second or 0)
    if am_or_pm:  # 12 AM is 0 h, 12 PM is 12 h
        hours = hours % 12 + (12 if am_or_pm in "Pp" else 0)
    if hours > 23 or minutes > 59 or seconds > 60:  # 60: a leap second
        return None
    ns = ((hours * 60 + minutes) * 60 + seconds) * 1_000_000_000
    if fraction:
        ns += int(fraction) * 10 ** (9 - len(fraction))
    if zone_hour:  # its sign is also that of the minutes
        zone_minutes = int(zone_hour) * 60 + int(zone_hour[0] + zone_minute)
        ns -= zone_minutes * 60_000_000_000
    return ns


def _parts(day: str) -> tuple[str, str, str] | None:
    """Returns the numbers of a date in the order of the text; None for a date with the name of a month."""
    found = re.fullmatch(r"(\d{1,4})[./-](\d{1,2})[./-](\d{1,4})", day)
    return None if found is None else (found[1], found[2], found[3])


def _order_of(days: Iterable[str]) -> DateOrder | None:
    """Returns the only order of day, month and year that fits all dates; a date with points is German.

    Raises AmbiguousDates where two orders fit, or none.
    """
    numbers = {day: parts for day in days if (parts := _parts(day)) is not None}
    if not numbers:
        return None
    example = next(iter(numbers))
    if all(len(parts[0]) == 4 for parts in numbers.values()):
        return "ymd"
    dmy_fits = all(1 <= int(first) <= 31 and 1 <= int(second) <= 12 for first, second, _ in numbers.values())
    mdy_fits = all(1 <= int(first) <= 12 and 1 <= int(second) <= 31 for first, second, _ in numbers.values())
    if dmy_fits and (not mdy_fits or all("." in day for day in numbers)):
        return "dmy"
    if mdy_fits and not dmy_fits:
        return "mdy"
    raise AmbiguousDates(example, ("dmy", "mdy") if dmy_fits else ())


def _date(day: str, order: DateOrder | None) -> datetime.date:
    """Returns the date of ``day``: numbers in this order, or the name of a month with day and year ("31 Dec 2026").

    Raises ValueError where it is no such date.
    """
    parts = _parts(day)
    if parts is not None:
        values = dict(zip(order or "ymd", parts, strict=True))
        return datetime.date(_year(values["y"]), int(values["m"]), int(values["d"]))
    words = re.findall(r"\d+|[^\W\d_]+", day)
    month = _MONTHS.get(next((word for word in words if not word.isdigit()), "")[:3].lower())
    numbers = [word for word in words if word.isdigit()]  # day and year, in this order also in "Aug 1, 2018"
    if len(numbers) != 2 or month is None:
        raise ValueError(day)
    return datetime.date(_year(numbers[1]), month, int(numbers[0]))


def _year(text: str) -> int:
    return int(text) + (2000 if len(text) <= 2 else 0)
