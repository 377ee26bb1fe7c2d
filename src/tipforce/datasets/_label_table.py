"""From the columns of a table to a dataset: the same for a CSV file beside images and for Parquet shards."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Protocol

import numpy as np

from ..errors import TableError, TimeError
from ..io import ACTUATION_UNITS, STILL_STEP_NS, check_actuation, is_actuation, is_force
from ..types import FORCE_RANGE, FloatArray, IntArray
from ._dataset import Dataset, RowStore
from ._facts import FolderFacts, session_info_of

FORCES = ("fx_n", "fy_n", "fz_n")


class LabelTable(Protocol):
    """Columns of numbers and text; reading one raises TableError where a cell is none."""

    path: Path

    @property
    def columns(self) -> Sequence[str]:
        """Names of the columns."""
        ...

    def __len__(self) -> int: ...

    def text(self, name: str) -> list[str]:
        """The cells of one column."""
        ...

    def numbers(self, name: str, *, may_be_empty: bool = False) -> FloatArray:
        """(n,) of one column, NaN for an empty cell where that is allowed."""
        ...

    def time_columns(self) -> tuple[str, ...]:
        """The columns that hold the samples' times."""
        ...

    def stamps_ns(self) -> IntArray | None:
        """(n,) stamps; None where the table has none."""
        ...

    def place(self, row: int) -> str:
        """What a person calls the ``row``-th row."""
        ...


Stored = Callable[[IntArray, Mapping[str, FloatArray]], tuple[RowStore, Mapping[str, list[str]]]]
"""Stamps (n,) and actuation in the table's own order -> where the views are, and view -> names; the first's are the
samples' too."""


def dataset_of(table: LabelTable, facts: FolderFacts, name: str, views: Sequence[str], stored: Stored) -> Dataset:
    """The samples of ``table`` in the order of sessions and stamps. ``views``: columns that hold what is seen.

    ``name``: of the session and the dataset where they have no other. Raises TableError and TimeError.
    """
    measured = np.array([column in table.columns for column in FORCES])
    if not measured.any():
        raise TableError(f"{table.path}: has no force column; expected at least one of {', '.join(FORCES)}")
    session = np.array(table.text("session") if "session" in table.columns else [name] * len(table))
    for row in np.flatnonzero(session == "").tolist():
        raise TableError(f"{table.path}, {table.place(row)}, column session: is empty")
    _, first, number = np.unique(session, return_index=True, return_inverse=True)
    stamps = table.stamps_ns()
    if stamps is None:
        stamps = _numbered(number)
    appearance = np.argsort(np.argsort(first))[number]  # sessions in the order in which they appear
    order = np.lexsort((stamps, appearance))
    sessions = [str(session[row]) for row in np.sort(first).tolist()]
    ends = np.searchsorted(appearance[order], np.arange(1, len(sessions)))
    for own, part in zip(sessions, np.split(stamps[order], ends), strict=True):
        check_stamps(str(table.path), own, part)
    force = np.full((len(table), 3), np.nan)
    for axis in np.flatnonzero(measured).tolist():
        force[:, axis] = table.numbers(FORCES[axis])
        row = FORCE_RANGE.outside(force[:, axis])
        if row is not None:
            raise TableError(
                f"{table.path}, {table.place(row)}, column {FORCES[axis]}: {force[row, axis]:g} lies outside of "
                f"{FORCE_RANGE}; correct the row or remove it"
            )
    actuation = {column: table.numbers(column, may_be_empty=True) for column in _actuation(table, views)}
    for column, values in actuation.items():
        check_actuation(table, column, values)
    store, named = stored(stamps, actuation)
    names = {view: np.array(own)[order] for view, own in named.items()}
    return Dataset(
        store=store,
        session=session[order],
        stamp_ns=stamps[order],
        actuation={column: values[order] for column, values in actuation.items()},
        force_n=force[order],
        known=measured,
        names=next(iter(names.values())),
        session_info=session_info_of(facts, sessions),
        rows=order,
        title=facts.title or name,
        view_names=names if len(names) > 1 else {},
    )


def _numbered(session: IntArray) -> IntArray:
    """(n,) stamps of still images: one second apart within each ``session`` (n,), in the order of the rows."""
    stamps = np.empty(len(session), np.int64)
    for number in range(int(session.max()) + 1):
        rows = np.flatnonzero(session == number)
        stamps[rows] = np.arange(len(rows)) * STILL_STEP_NS
    return stamps


def _actuation(table: LabelTable, views: Sequence[str]) -> list[str]:
    taken = {"session", *table.time_columns(), *FORCES, *views}
    names = [name for name in table.columns if name not in taken and name.split("_")[0] != "note"]
    for name in names:
        if is_force(name) and name[0].lower() == "f":
            raise TableError(
                f"{table.path}: the column {name!r} is a force, and forces are read in newtons from "
                f"{', '.join(FORCES)}; convert it, or begin its name with note_ so that it is not read"
            )
        if not is_actuation(name) and not is_force(name):
            raise TableError(
                f"{table.path}: the column {name!r} does not say its unit; an actuation column ends in one of "
                f"_{', _'.join(ACTUATION_UNITS)}, and a column that is not to be read starts with note_"
            )
    return [name for name in names if is_actuation(name)]


def check_stamps(where: str, session: str, stamps: IntArray) -> None:
    """Raises TimeError where two samples of one session have the same stamp; ``stamps`` sorted."""
    same = np.flatnonzero(np.diff(stamps) == 0)
    if len(same):
        raise TimeError(
            f"{where}: session {session} has two samples with the stamp {int(stamps[same[0]])} ns; give each its own"
        )
