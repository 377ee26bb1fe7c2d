"""A growing dataset as Parquet shards."""

import json
from pathlib import Path
from typing import Any

from ..types import SessionInfo
from ._parquet import IMAGE, SUFFIX, arrow
from ._samples import Growing, SessionSamples, about, as_json, context_of

__all__ = ["GrowingShards"]

_ABOUT = b"tipforce"
_PER_SHARD = 2000
"""Samples: some 150 MB of pictures of 640x480."""


class GrowingShards(Growing):
    """``samples-00000-of-00005.parquet`` and so on: a row group a session, whole sessions in each shard."""

    def __init__(self, folder: Path, sessions: int, per_session: int) -> None:
        super().__init__(folder, sessions)
        arrow()  # says at once what is missing
        self._each = max(1, _PER_SHARD // per_session)
        self._shards = -(-sessions // self._each)

    def _part(self, number: int) -> Path:
        return self.parts / f"{number:07d}{SUFFIX}"

    def _shard(self, shard: int) -> Path:
        return self.folder / f"samples-{shard:05d}-of-{self._shards:05d}{SUFFIX}"

    def has(self, number: int) -> bool:
        """Whether the session of this number was added."""
        return self._part(number).exists() or self._shard(number // self._each).exists()

    def add(self, number: int, samples: SessionSamples) -> None:
        """Write one session as a file of its own."""
        pa, parquet = arrow()
        labels = samples.columns()
        kinds = {"session": pa.string(), "stamp_ns": pa.int64()}
        arrays: dict[str, Any] = {}
        features: dict[str, Any] = {}
        for view, pictures in samples.pictures.items():
            column = IMAGE if len(samples.pictures) == 1 else view
            cells = [{"bytes": data, "path": name} for data, name in zip(pictures, samples.names(view), strict=True)]
            arrays[column] = pa.array(cells, pa.struct([("bytes", pa.binary()), ("path", pa.string())]))
            features[column] = {"_type": "Image"}
        for name, values in labels.items():
            kind = kinds.get(name, pa.float64())
            arrays[name] = pa.array(values, kind)
            features[name] = {"dtype": "float64" if kind == pa.float64() else str(kind), "_type": "Value"}
        table = pa.table(arrays).replace_schema_metadata(
            {b"huggingface": as_json({"info": {"features": features}}), _ABOUT: as_json(about(samples))}
        )
        self.parts.mkdir(parents=True, exist_ok=True)
        part = self._part(number).with_suffix(".part")
        parquet.write_table(table, part, compression="NONE", use_dictionary=["session"], write_statistics=False)
        part.replace(self._part(number))

    def _about(self, number: int) -> dict[str, Any]:
        return json.loads(arrow()[1].read_schema(self._part(number)).metadata[_ABOUT])

    def session_info(self, number: int) -> SessionInfo:
        """Of a session that was added."""
        return context_of(self._about(number))

    def view(self) -> str:
        """What the only view is called; "camera" where there are several."""
        return self._about(0)["view"]

    def gather(self) -> None:
        """Shard by shard; the sessions' own files go as soon as theirs is whole."""
        _, parquet = arrow()
        for shard in range(self._shards):
            parts = [self._part(n) for n in range(shard * self._each, min((shard + 1) * self._each, self.sessions))]
            target = self._shard(shard)
            if not target.exists():
                part = self.parts / f"{target.name}.part"
                schema = parquet.read_schema(parts[0])
                schema = schema.with_metadata({b"huggingface": schema.metadata[b"huggingface"]})
                options = {"compression": "NONE", "use_dictionary": ["session"], "write_statistics": False}
                with parquet.ParquetWriter(part, schema, **options) as writer:
                    for path in parts:
                        writer.write_table(parquet.read_table(path).replace_schema_metadata(schema.metadata))
                part.replace(target)
            for path in parts:
                path.unlink(missing_ok=True)
