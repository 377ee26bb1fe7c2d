"""Opens a table: a text file, a workbook, or variables of MATLAB."""

from pathlib import Path

from ...errors import FileFormatError
from ...types import LogInfo
from ._layout import text_layout
from ._table import Table


def open_table(path: Path, *, comments: bool = True, log: LogInfo | None = None, key: str = "") -> Table:
    """Opens a table; finds separator, header and decimal sign by its first rows.

    Args:
        path: a text file; where ``log`` is given, also a workbook (.xlsx) or the variables of MATLAB (.mat).
        comments: whether lines that begin with # are skipped.
        log: the description of a log, which may have lines above the header; None for a table that begins with it.
        key: section of ``log`` in ``bench.toml``, for messages.

    Raises:
        FileFormatError: the file is no text.
        TableError: the header or the decimal sign cannot be determined.
    """
    if not path.exists():
        raise FileFormatError(f"{path}: there is no such file")
    if path.is_dir():
        raise FileFormatError(f"{path}: is a folder; name the table in it")
    if log is not None and path.suffix.lower() in (".xlsx", ".xlsm"):
        from ._workbook import open_workbook

        return open_workbook(path, log, key)
    if log is not None and path.suffix.lower() == ".mat":
        from ._matlab import open_variables

        return open_variables(path, log, key)
    return Table(path, text_layout(path, comments=comments, log=log, key=key), log, key)
