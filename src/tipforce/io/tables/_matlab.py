"""Reads variables of MATLAB (.mat) as tables: version 5 (scipy) and 7.3 (HDF5, h5py).

The compiled readers of both can crash on a damaged file. Therefore a child process reads the file: it runs this module
as a program (``FILE TARGET.npz``).
"""

import importlib
import importlib.util
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from scipy.io import loadmat

from ..._system.processes import run_child
from ...errors import FileFormatError, MissingExtraError, TableError
from ...types import LogInfo
from ._cells import ColumnTable
from ._columns import listed

_HDF5 = b"\x89HDF\r\n\x1a\n"
_MAX_READING_S = 120.0
_REFUSED = 3
"""Exit code of the child process that has written a sentence about the file to standard error."""
_TABLE_REMEDY = (
    'save a table as a struct of its columns: S = table2struct(T, "ToScalar", true); save("log.mat", "-struct", "S")'
)


def open_variables(path: Path, log: LogInfo, key: str) -> ColumnTable:
    """Reads the variables of a file of MATLAB as a table.

    A vector is a column with its name. A field of a struct is a column STRUCT.FIELD, or FIELD if there is only one
    struct. A matrix has columns NAME_1, NAME_2, ..., or those that ``log.columns`` names. Shorter vectors are left out.

    Args:
        path: the file.
        log: description of the log.
        key: section of ``log`` in ``bench.toml``, for messages.

    Returns:
        The table of the longest vectors, at least two rows.

    Raises:
        FileFormatError: the file is not of MATLAB, or holds an object of a class (a table, a timetable).
        TableError: it has no columns, or ``log.columns`` does not fit.
        MissingExtraError: the file is of version 7.3 and h5py is not installed.
    """
    columns: dict[str, Any] = {}
    for name, array in _read_in_child(path).items():
        if array.ndim == 1:
            columns[name] = array
        else:
            columns |= {f"{name}_{index + 1}": array[:, index] for index in range(array.shape[1])}
    longest = max((len(array) for array in columns.values()), default=0)
    columns = {name: array for name, array in columns.items() if len(array) == longest}
    if longest < 2:
        raise TableError(f"{path}: holds no vectors; {_TABLE_REMEDY}")
    if log.columns:
        if len(log.columns) != len(columns):
            raise TableError(
                f"{path}: {key}.columns in bench.toml names {len(log.columns)} columns, the file has {len(columns)} "
                f'({listed(list(columns))}); name all of them in this order, "" for one that is not read'
            )
        columns = {name: array for name, array in zip(log.columns, columns.values(), strict=True) if name}
    return ColumnTable(path, columns, log, key)


def _is_hdf5(path: Path) -> bool:
    with path.open("rb") as stream:
        head = stream.read(1024)
    return _HDF5 in (head[:8], head[512:520])


def _read_in_child(path: Path) -> dict[str, Any]:
    """Returns vectors (n,) and matrices (n, m) of the file by name."""
    if _is_hdf5(path) and importlib.util.find_spec("h5py") is None:
        raise MissingExtraError("h5py", extra="tables")
    with tempfile.TemporaryDirectory(prefix="tipforce-") as folder:
        target = Path(folder) / "variables.npz"
        try:
            child = run_child(
                [sys.executable, "-m", __name__, str(path), str(target)], capture=True, timeout_s=_MAX_READING_S
            )
        except subprocess.TimeoutExpired:
            raise FileFormatError(f"{path}: is not read within {_MAX_READING_S:g} s; export it as CSV") from None
        if child.returncode == _REFUSED:
            raise FileFormatError(child.stderr.strip().rpartition("\n")[2])
        if child.returncode:
            raise FileFormatError(f"{path}: is damaged: the reader of MATLAB files crashes on it; export it as CSV")
        with np.load(target) as stored:
            return {name: stored[f"arr_{index}"] for index, name in enumerate(stored["names"].tolist())}


def _variables(path: Path) -> dict[str, Any]:
    """Returns name -> value: an array, a text, or a struct (an object of scipy, or a dictionary for version 7.3)."""
    if _is_hdf5(path):
        return _hdf5_variables(path)
    try:
        loaded = loadmat(path, squeeze_me=True, struct_as_record=False)
    except Exception as error:  # a damaged file raises errors of many kinds
        raise FileFormatError(f"{path}: is no file of MATLAB that can be read ({error}); export it as CSV") from None
    return {name: value for name, value in loaded.items() if not name.startswith("__")}


def _hdf5_variables(path: Path) -> dict[str, Any]:
    """Returns name -> value of a file of version 7.3: a struct is a dictionary, and an unknown kind of value is None.

    A group of HDF5 is a struct. Arrays are transposed because MATLAB stores them column by column.
    """
    h5py: Any = importlib.import_module("h5py")

    def value(node: Any) -> Any:
        if isinstance(node, h5py.Group):
            return {name: value(child) for name, child in node.items()}
        kind = node.attrs.get("MATLAB_class", b"")
        if kind == b"char":
            return "".join(map(chr, np.ravel(node[()])))
        return np.squeeze(np.transpose(node[()])) if node.dtype.kind in "fiub" else None

    try:
        with h5py.File(path, "r") as file:
            opaque = "#subsystem#" in file  # the part in which MATLAB keeps objects of its classes
            variables = {} if opaque else {name: value(node) for name, node in file.items() if not name.startswith("#")}
    except Exception as error:  # a damaged file raises errors of many kinds
        raise FileFormatError(f"{path}: is no file of MATLAB that can be read ({error}); export it as CSV") from None
    if opaque:
        raise FileFormatError(f"{path}: holds an object of a class of MATLAB; {_TABLE_REMEDY}")
    return variables


def _flat(variables: Mapping[str, Any], before: str = "") -> Iterator[tuple[str, Any]]:
    """Yields name and vector (n,) or matrix (n, m), of numbers or texts, of all variables and fields of structs.

    Args:
        variables: name -> value.
        before: names of the structs that hold these variables, each with a point after it.
    """
    structs = [name for name, value in variables.items() if _fields(value) is not None]
    for name, value in variables.items():
        fields = _fields(value)
        if fields is not None:
            yield from _flat(fields, "" if len(structs) == 1 and not before else f"{before}{name}.")
        elif isinstance(value, np.ndarray) and value.ndim in (1, 2) and _is_readable(value):
            yield f"{before}{name}", value


def _is_readable(array: "np.ndarray") -> bool:  # type: ignore[type-arg]
    """Returns whether an array holds numbers or texts."""
    return array.dtype.kind in "fiubU" or all(isinstance(each, str) for each in array.ravel())


def _fields(value: Any) -> dict[str, Any] | None:
    """Returns the fields of a struct; None for another value."""
    if isinstance(value, dict):
        return value
    names = getattr(value, "_fieldnames", None)
    return None if names is None else {name: getattr(value, name) for name in names}


def main() -> None:
    """Reads the file that the first argument names and stores its arrays in the second (.npz)."""
    try:
        variables = dict(_flat(_variables(Path(sys.argv[1]))))
    except FileFormatError as error:
        sys.stderr.write(f"{error}\n")
        sys.exit(_REFUSED)
    arrays = [array.astype(np.str_) if array.dtype == object else array for array in variables.values()]
    with Path(sys.argv[2]).open("wb") as file:
        np.savez(file, *arrays, names=np.array(list(variables), np.str_))


if __name__ == "__main__":
    main()
