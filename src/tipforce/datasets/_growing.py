"""A dataset to which many processes add sessions, and which is not lost when a process is killed."""

import csv
import json
import shutil
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any

from .._system.json_files import parse_json, read_json
from ..errors import FileFormatError
from ..types import BoolArray, FloatArray, IntArray, SessionInfo
from ._checks import crc_column, crc_text, shard_facts
from ._facts import FACTS, facts_text
from ._folder import FILE, METADATA, cell
from ._label_table import FORCES
from ._parquet import IMAGE, SUFFIX, arrow

_MAX_PART_BYTES = 256 << 20
"""Largest file with the labels of one session: about 300 bytes per sample."""
_REMEDY = "remove it, and the same command makes its session again"


@dataclass(frozen=True, slots=True, eq=False)
class SessionSamples:
    """Labelled images of one session: n samples.

    Attributes:
        session_info: metadata of the session.
        frame: (n,) numbers of the frames in the session.
        stamp_ns: (n,) stamps.
        actuation: name -> (n,) readings.
        force_n: (n, 3) forces; NaN where ``known`` is False.
        known: (3,) the components of the force that are known.
        images: view -> n encoded images.
        suffix: suffix of the image files.
        masks: view -> n PNG files; empty without masks.
    """

    session_info: SessionInfo
    frame: IntArray
    stamp_ns: IntArray
    actuation: Mapping[str, FloatArray]
    force_n: FloatArray
    known: BoolArray
    images: Mapping[str, Sequence[bytes]]
    suffix: str
    masks: Mapping[str, Sequence[bytes]] = field(default_factory=dict[str, Sequence[bytes]])

    def columns(self) -> dict[str, list[Any]]:
        """Returns name -> n values of all columns except the images."""
        return {
            "session": [self.session_info.name] * len(self.frame),
            "stamp_ns": self.stamp_ns.tolist(),
            **{name: values.tolist() for name, values in self.actuation.items()},
            **{FORCES[axis]: self.force_n[:, axis].tolist() for axis in range(3) if self.known[axis]},
        }

    def names(self, view: str) -> list[str]:
        """Returns the path of each image of ``view``, relative to the dataset's folder."""
        return self._paths("images", view, self.suffix)

    def mask_names(self, view: str) -> list[str]:
        """Returns the path of the mask of each image of ``view``, relative to the dataset's folder."""
        return self._paths("masks", view, ".png")

    def _paths(self, kind: str, view: str, suffix: str) -> list[str]:
        more = f"-{view}" if len(self.images) > 1 else ""
        return [f"{kind}/{self.session_info.name}/{number:05d}{more}{suffix}" for number in self.frame.tolist()]


class Growing(ABC):
    """A dataset that is written session by session.

    Sessions are added in any order and by any process, each completely or not at all. `finish` joins them in the order
    of their numbers, so the result depends on neither. Sessions that are not joined yet are in ``folder / PARTS``.

    Args:
        folder: the dataset folder.
        sessions: number of sessions of the complete dataset.
    """

    PARTS = ".parts"

    def __init__(self, folder: Path, sessions: int) -> None:
        self.folder, self.sessions = folder, sessions
        self.parts = folder / self.PARTS

    @property
    def whole(self) -> bool:
        """Whether all sessions were added and joined."""
        return (self.folder / FACTS).exists() and not self.parts.exists()

    @abstractmethod
    def has(self, number: int) -> bool:
        """Returns whether the session of this number was added."""

    @abstractmethod
    def add(self, number: int, samples: SessionSamples) -> None:
        """Adds one session.

        Args:
            number: number of the session, from 0.
            samples: its images, masks and labels.
        """

    def finish(self, title: str) -> None:
        """Joins all sessions; after a kill it can be called again, and nothing is lost."""
        facts = self.parts / FACTS
        if not facts.exists():
            infos = [self.session_info(number) for number in range(self.sessions)]
            put(facts, facts_text(title, infos, self.view()).encode())
        self.gather()
        if files := self.files():
            put(facts, (json.dumps({**read_json(facts), "files": files}, indent=1, ensure_ascii=False) + "\n").encode())
        facts.replace(self.folder / FACTS)
        shutil.rmtree(self.parts)

    @abstractmethod
    def _part(self, number: int) -> Path:
        """Returns the file whose existence shows that a session is complete."""

    def _checked(self, values: Any, number: int, *more: str) -> dict[str, Any]:
        """Returns the content of a session's file, with the keys of `about` and ``more``. Raises FileFormatError."""
        if not isinstance(values, dict) or not {"session_info", "view", *more} <= values.keys():
            raise FileFormatError(f"{self._part(number)}: is damaged, parts of the session are missing; {_REMEDY}")
        return values  # pyright: ignore[reportUnknownVariableType]

    @abstractmethod
    def _about(self, number: int) -> Mapping[str, Any]:
        """Returns the values of `about` for a session that was added. Raises FileFormatError."""

    def session_info(self, number: int) -> SessionInfo:
        """Returns the metadata of a session that was added."""
        return SessionInfo.from_values(self._about(number)["session_info"])

    def view(self) -> str:
        """Returns the name of the only view; "camera" if there are several."""
        return self._about(0)["view"]

    @abstractmethod
    def gather(self) -> None:
        """Makes the final files from those of the sessions."""

    def files(self) -> dict[str, dict[str, Any]]:
        """Returns size and checksum of the final files, for ``dataset.json``."""
        return {}


def put(path: Path, data: bytes) -> None:
    """Writes a file completely or not at all.

    Args:
        path: the file; its folder is made where it does not exist.
        data: its content.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_name(f"{path.name}.part")
    part.write_bytes(data)
    part.replace(path)


def about(samples: SessionSamples) -> dict[str, Any]:
    """Returns metadata and view of a session, as JSON values."""
    views = list(samples.images)
    return {"session_info": samples.session_info.values(), "view": views[0] if len(views) == 1 else "camera"}


def as_json(values: Mapping[str, Any]) -> bytes:
    """Returns compact JSON, which is the same for the same values."""
    return json.dumps(values, ensure_ascii=False, separators=(",", ":")).encode()


class GrowingImages(Growing):
    """Files ``images/SESSION/FRAME.jpg`` and, with masks, ``masks/SESSION/FRAME.png``; FRAME-VIEW for several views."""

    def _part(self, number: int) -> Path:
        return self.parts / f"{number:07d}.json"

    def has(self, number: int) -> bool:
        """Returns whether the session of this number was added."""
        return self._part(number).exists()

    def add(self, number: int, samples: SessionSamples) -> None:
        """Writes the images of a session, then its rows, which show that it is complete; see `Growing.add`."""
        files: dict[str, bytes] = {}
        for view, images in samples.images.items():
            files.update(zip(samples.names(view), images, strict=True))
        for view, masks in samples.masks.items():
            files.update(zip(samples.mask_names(view), masks, strict=True))
        for subfolder in {Path(name).parent for name in files}:
            content = {Path(name).name: data for name, data in files.items() if Path(name).parent == subfolder}
            self._fill(subfolder, content)
        heads = [FILE] if len(samples.images) == 1 else [f"{view}_{FILE}" for view in samples.images]
        columns = dict(zip(heads, map(samples.names, samples.images), strict=True)) | samples.columns()
        for view, images in samples.images.items():
            columns[crc_column(view if len(heads) > 1 else "")] = [crc_text(data) for data in images]
        rows = [[cell(value) for value in row] for row in zip(*columns.values(), strict=True)]
        put(self._part(number), as_json({**about(samples), "columns": list(columns), "rows": rows}))

    def _fill(self, subfolder: Path, files: dict[str, bytes]) -> None:
        """Writes the folder ``subfolder`` with ``files``, completely or not at all."""
        part = self.parts / f"{subfolder.parent.name}-{subfolder.name}"
        shutil.rmtree(part, ignore_errors=True)
        part.mkdir(parents=True)
        for name, data in files.items():
            (part / name).write_bytes(data)
        target = self.folder / subfolder
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.rmtree(target, ignore_errors=True)  # left by a process that was killed before it wrote the rows
        part.replace(target)

    @lru_cache(maxsize=2)  # noqa: B019  the object does not outlive its command
    def _read(self, number: int) -> dict[str, Any]:
        return self._checked(
            read_json(self._part(number), max_bytes=_MAX_PART_BYTES, remedy=_REMEDY), number, "columns", "rows"
        )

    def _about(self, number: int) -> Mapping[str, Any]:
        return self._read(number)

    def gather(self) -> None:
        """Writes all rows into ``metadata.csv``."""
        part = self.parts / METADATA
        with part.open("w", newline="", encoding="utf-8") as stream:
            writer = csv.writer(stream)
            writer.writerow(self._read(0)["columns"])
            for number in range(self.sessions):
                writer.writerows(self._read(number)["rows"])
        part.replace(self.folder / METADATA)


_ABOUT_KEY = b"tipforce"
_LAYOUT: dict[str, Any] = {
    "compression": "NONE",
    "use_dictionary": ["session"],
    "write_statistics": False,
    "write_page_checksum": True,
}
MAX_SHARD_SAMPLES = 2000
"""Largest number of samples in a shard: about 150 MB of images of 640x480."""


class GrowingShards(Growing):
    """``samples-00000-of-00005.parquet`` and so on: one row group per session, complete sessions in each shard.

    Args:
        folder: the dataset folder.
        sessions: number of sessions of the complete dataset.
        per_session: number of samples of each session.

    Raises:
        MissingExtraError: pyarrow is not installed.
    """

    def __init__(self, folder: Path, sessions: int, per_session: int) -> None:
        super().__init__(folder, sessions)
        arrow()  # a missing package is reported now
        self._per_shard = max(1, MAX_SHARD_SAMPLES // per_session)
        self._shards = -(-sessions // self._per_shard)  # rounded up

    def _part(self, number: int) -> Path:
        return self.parts / f"{number:07d}{SUFFIX}"

    def _shard(self, shard: int) -> Path:
        return self.folder / f"samples-{shard:05d}-of-{self._shards:05d}{SUFFIX}"

    def has(self, number: int) -> bool:
        """Returns whether the session of this number was added."""
        return self._part(number).exists() or self._shard(number // self._per_shard).exists()

    def add(self, number: int, samples: SessionSamples) -> None:
        """Writes one session as a file of its own; see `Growing.add`."""
        pa, parquet = arrow()
        labels = samples.columns()
        kinds = {"session": pa.string(), "stamp_ns": pa.int64()}
        arrays: dict[str, Any] = {}
        features: dict[str, Any] = {}
        for view, images in samples.images.items():
            column = IMAGE if len(samples.images) == 1 else view
            cells = [{"bytes": data, "path": name} for data, name in zip(images, samples.names(view), strict=True)]
            arrays[column] = pa.array(cells, pa.struct([("bytes", pa.binary()), ("path", pa.string())]))
            features[column] = {"_type": "Image"}
        for name, values in labels.items():
            kind = kinds.get(name, pa.float64())
            arrays[name] = pa.array(values, kind)
            features[name] = {"dtype": "float64" if kind == pa.float64() else str(kind), "_type": "Value"}
        table = pa.table(arrays).replace_schema_metadata(
            {b"huggingface": as_json({"info": {"features": features}}), _ABOUT_KEY: as_json(about(samples))}
        )
        self.parts.mkdir(parents=True, exist_ok=True)
        part = self._part(number).with_suffix(".part")
        parquet.write_table(table, part, **_LAYOUT)
        part.replace(self._part(number))

    def _about(self, number: int) -> dict[str, Any]:
        path = self._part(number)
        metadata: Mapping[bytes, bytes] = arrow()[1].read_schema(path).metadata or {}
        return self._checked(parse_json(metadata.get(_ABOUT_KEY, b""), str(path), _REMEDY), number)

    def gather(self) -> None:
        """Writes shard by shard; the files of the sessions are removed when their shard is complete."""
        _, parquet = arrow()
        for shard in range(self._shards):
            first = shard * self._per_shard
            parts = [self._part(number) for number in range(first, min(first + self._per_shard, self.sessions))]
            target = self._shard(shard)
            if not target.exists():
                part = self.parts / f"{target.name}.part"
                schema = parquet.read_schema(parts[0])
                schema = schema.with_metadata({b"huggingface": schema.metadata[b"huggingface"]})
                with parquet.ParquetWriter(part, schema, **_LAYOUT) as writer:
                    for path in parts:
                        table = parquet.read_table(path, page_checksum_verification=True)
                        writer.write_table(table.replace_schema_metadata(schema.metadata))
                part.replace(target)
            for path in parts:
                path.unlink(missing_ok=True)

    def files(self) -> dict[str, dict[str, Any]]:
        """Returns size and checksum of each shard."""
        return shard_facts(self._shard(shard) for shard in range(self._shards))
