"""Opens labelled samples of every kind."""

from dataclasses import replace
from pathlib import Path

from ..errors import FileFormatError
from ..io import open_table
from ._dataset import Dataset
from ._folder import METADATA, open_folder
from ._label_table import FORCES
from ._parquet import SUFFIX, open_shards
from ._recordings import open_recordings
from .layouts import LAYOUTS

_PART = ".mcap.part"
_UNFINISHED = "is still being written, or was cut off, and is left out"


def holds_samples(path: Path) -> bool:
    """Returns whether ``path`` is a dataset folder or its table, Parquet shards, or a published layout."""
    if path.is_file():
        return path.suffix.lower() in (SUFFIX, ".csv")
    if (path / METADATA).is_file():
        return bool(set(FORCES) & set(open_table(path / METADATA, comments=False).columns))
    return path.is_dir() and (any(path.glob(f"*{SUFFIX}")) or is_published_layout(path))


def is_published_layout(path: Path) -> bool:
    """Returns whether ``path`` is a folder with the layout of a published data set."""
    return path.is_dir() and any(layout.recognises(path) for layout in LAYOUTS.values())


def open_dataset(path: str | Path, view: str | None = None) -> Dataset:
    """Opens labelled samples of any kind; images are read when they are used.

    Args:
        path: a dataset folder or its table (.csv), Parquet shards, one or many recordings, or a published layout.
        view: the view whose frames are the samples of recordings with several; by default their first one.

    Returns:
        The samples in the order of their sessions and stamps.

    Raises:
        FileFormatError: ``path`` has none of these formats.
        TableError: the table cannot be used.
        TimeError: two samples of a session have the same stamp.
    """
    path = Path(path)
    cut_off = path.suffix == ".mcap" and not path.exists() and path.with_name(f"{path.name}.part").exists()
    if cut_off or path.name.endswith(_PART):
        return open_recordings([path], path.name.removesuffix(".part").removesuffix(".mcap"), view=view)
    if not path.exists():
        raise FileFormatError(f"{path}: there is no such file or folder")
    if path.is_file():
        if path.suffix == ".mcap":
            return open_recordings([path], path.stem, view=view)
        if path.suffix.lower() == ".csv":
            return open_folder(path.parent, path.name)
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
        return open_shards(shards, path.resolve().name, whole=True)
    recordings, parts = sorted(path.glob("*.mcap")), sorted(path.glob(f"*{_PART}"))
    if recordings:
        dataset = open_recordings(recordings, path.resolve().name, view=view)
        return replace(dataset, remarks=(*dataset.remarks, *(f"{part.name}: {_UNFINISHED}" for part in parts)))
    if parts:
        raise FileFormatError(f"{parts[0]}: {_UNFINISHED}; open it by its own name to recover it")
    for layout in LAYOUTS.values():
        if layout.recognises(path):
            return layout.open_layout(path)
    raise FileFormatError(
        f"{path}: holds no samples; expected {METADATA} beside images, Parquet shards, recordings (.mcap), or a "
        f"published layout ({', '.join(LAYOUTS)})"
    )
