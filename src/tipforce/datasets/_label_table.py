"""Converts the columns of a table to a dataset, for CSV files with images and for Parquet shards."""

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
    """Columns of numbers and text; reading one raises TableError if a cell has the wrong type."""

    path: Path

    @property
    def columns(self) -> Sequence[str]:
        """Names of the columns."""
        ...

    def __len__(self) -> int: ...

    def text(self, name: str) -> list[str]:
        """Returns the cells of one column."""
        ...

    def numbers(self, name: str, *, may_be_empty: bool = False) -> FloatArray:
        """Returns the (n,) numbers of one column.

        Args:
            name: the column's name.
            may_be_empty: whether an empty cell is allowed; it is NaN then.
        """
        ...

    def time_columns(self) -> tuple[str, ...]:
        """Returns the names of the columns with the times of the samples."""
        ...

    def stamps_ns(self) -> IntArray | None:
        """Returns the (n,) stamps; None if the table has none."""
        ...

    def place(self, row: int) -> str:
        """Returns the name of a row for people."""
        ...


Stored = Callable[[IntArray, Mapping[str, FloatArray]], tuple[RowStore, Mapping[str, list[str]]]]
"""Function from stamps (n,) and actuation, in the order of the table, to the store of the views and view -> names. The
names of the first view are those of the samples."""


def dataset_of(table: LabelTable, facts: FolderFacts, name: str, views: Sequence[str], stored: Stored) -> Dataset:
    """Returns the samples of a table in the order of sessions and stamps.

    Args:
        table: the table.
        facts: content of ``dataset.json``.
        name: name of the session, and of the dataset, if no other is stated.
        views: columns that contain images or shape numbers.
        stored: makes the store of the views.

    Raises:
        TableError: a column is missing or a cell is not valid.
        TimeError: two samples of a session have the same stamp.
    """
    measured = np.array([column in table.columns for column in FORCES])
    if not measured.any():
        raise TableError(f"{table.path}: has no force column; expected at least one of {', '.join(FORCES)}")
    session = np.array(table.text("session") if "session" in table.columns else [name] * len(table))
    for row in np.flatnonzero(session == "").tolist():
        raise TableError(f"{table.path}, {table.place(row)}, column session: is empty")
    _, first_row, session_index = np.unique(session, return_index=True, return_inverse=True)
    stamps = table.stamps_ns()
    if stamps is None:
        stamps = _numbered(session_index)
    appearance = np.argsort(np.argsort(first_row))[session_index]  # sessions in the order of their first rows
    order = np.lexsort((stamps, appearance))
    sessions = [str(session[row]) for row in np.sort(first_row).tolist()]
    ends = np.searchsorted(appearance[order], np.arange(1, len(sessions)))
    for session_name, session_stamps in zip(sessions, np.split(stamps[order], ends), strict=True):
        check_stamps(str(table.path), session_name, session_stamps)
    force = np.full((len(table), 3), np.nan)
    for axis in np.flatnonzero(measured).tolist():
        force[:, axis] = table.numbers(FORCES[axis])
        row = FORCE_RANGE.outside(force[:, axis])
        if row is not None:
            raise TableError(
                f"{table.path}, {table.place(row)}, column {FORCES[axis]}: {force[row, axis]:g} is outside of "
                f"{FORCE_RANGE}; correct the row or remove it"
            )
    actuation = {column: table.numbers(column, may_be_empty=True) for column in _actuation(table, views)}
    for column, values in actuation.items():
        check_actuation(table, column, values)
    store, image_names = stored(stamps, actuation)
    names = {view: np.array(view_names)[order] for view, view_names in image_names.items()}
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
    """Returns (n,) stamps for still images: one second apart within each ``session`` (n,), in the order of the rows."""
    stamps = np.empty(len(session), np.int64)
    for number in range(int(session.max()) + 1):
        rows = np.flatnonzero(session == number)
        stamps[rows] = np.arange(len(rows)) * STILL_STEP_NS
    return stamps


def _actuation(table: LabelTable, views: Sequence[str]) -> list[str]:
    """Returns the columns with readings of drives; ``views`` are the columns of the views.

    Raises TableError for a column without a unit, and for a force that would be left out.
    """
    other_columns = {"session", *table.time_columns(), *FORCES, *views}
    names = [name for name in table.columns if name not in other_columns and name.split("_")[0] != "note"]
    for name in names:
        if is_force(name) and name[0].lower() == "f":
            raise TableError(
                f"{table.path}: the column {name!r} is a force, and forces are read in newtons from "
                f"{', '.join(FORCES)}; convert it, or begin its name with note_ so that it is not read"
            )
        if not is_actuation(name) and not is_force(name):
            raise TableError(
                f"{table.path}: the column {name!r} does not state its unit; an actuation column ends in one of "
                f"_{', _'.join(ACTUATION_UNITS)}, and a column that is not to be read starts with note_"
            )
    return [name for name in names if is_actuation(name)]


def check_stamps(where: str, session: str, stamps: IntArray) -> None:
    """Checks that the stamps of one session differ.

    Args:
        where: path of the table, for messages.
        session: name of the session.
        stamps: (n,) sorted stamps.

    Raises:
        TimeError: two samples have the same stamp.
    """
    repeats = np.flatnonzero(np.diff(stamps) == 0)
    if len(repeats):
        raise TimeError(
            f"{where}: session {session} has two samples with the stamp {int(stamps[repeats[0]])} ns; give each its own"
        )
