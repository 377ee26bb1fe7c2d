"""One door for everything that holds labelled samples."""

from pathlib import Path

from ..errors import FileFormatError
from ._dataset import Dataset
from ._folder import METADATA, open_folder
from ._parquet import SUFFIX, open_shards
from ._recordings import open_recordings
from .layouts import LAYOUTS

__all__ = ["open_dataset"]


def open_dataset(path: str | Path) -> Dataset:
    """The samples in ``path``: a dataset folder, Parquet shards, one or many recordings, or a published layout.

    Images are read when they are used. Raises FileFormatError for a path that is none of these, TableError and
    TimeError for a table that cannot be used.
    """
    path = Path(path)
    if not path.exists():
        raise FileFormatError(f"{path}: there is no such file or folder")
    if path.is_file():
        if path.suffix == ".mcap":
            return open_recordings([path], path.stem)
        if path.name == METADATA:
            return open_folder(path.parent)
        if path.suffix == SUFFIX:
            return open_shards([path], path.stem)
        raise FileFormatError(
            f"{path}: is no dataset; expected a recording (.mcap) or a folder; make a recording of a video and a force "
            "log with `tipforce import`"
        )
    if (path / METADATA).exists():
        return open_folder(path)
    shards = sorted(path.glob(f"*{SUFFIX}"))
    if shards:
        return open_shards(shards, path.resolve().name)
    recordings = sorted(path.glob("*.mcap"))
    if recordings:
        return open_recordings(recordings, path.resolve().name)
    for recognises, open_layout in LAYOUTS.values():
        if recognises(path):
            return open_layout(path)
    raise FileFormatError(
        f"{path}: holds no samples; expected {METADATA} beside images, Parquet shards, recordings (.mcap), or a "
        f"published layout ({', '.join(LAYOUTS)})"
    )
