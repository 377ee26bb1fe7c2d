"""A growing dataset as a folder of images with ``metadata.csv``."""

import csv
import json
import shutil
from functools import lru_cache
from pathlib import Path
from typing import Any

from ..types import SessionInfo
from ._folder import FILE, METADATA, cell
from ._samples import Growing, SessionSamples, about, as_json, context_of, put

__all__ = ["GrowingImages"]


class GrowingImages(Growing):
    """``images/SESSION/FRAME.jpg``, where there are masks ``masks/SESSION/FRAME.png``; FRAME-VIEW for several views."""

    def _part(self, number: int) -> Path:
        return self.parts / f"{number:07d}.json"

    def has(self, number: int) -> bool:
        """Whether the session of this number was added."""
        return self._part(number).exists()

    def add(self, number: int, samples: SessionSamples) -> None:
        """Write its pictures, then its rows, which say that it is whole."""
        files: dict[str, bytes] = {}
        for view, pictures in samples.pictures.items():
            files.update(zip(samples.names(view), pictures, strict=True))
        for view, masks in samples.masks.items():
            files.update(zip(samples.mask_names(view), masks, strict=True))
        for place in {Path(name).parent for name in files}:
            self._fill(place, {Path(name).name: data for name, data in files.items() if Path(name).parent == place})
        heads = [FILE] if len(samples.pictures) == 1 else [f"{view}_{FILE}" for view in samples.pictures]
        columns = dict(zip(heads, map(samples.names, samples.pictures), strict=True)) | samples.columns()
        rows = [[cell(value) for value in row] for row in zip(*columns.values(), strict=True)]
        put(self._part(number), as_json({**about(samples), "columns": list(columns), "rows": rows}))

    def _fill(self, place: Path, files: dict[str, bytes]) -> None:
        """The folder ``place`` with ``files``, whole or not at all."""
        part = self.parts / f"{place.parent.name}-{place.name}"
        shutil.rmtree(part, ignore_errors=True)
        part.mkdir(parents=True)
        for name, data in files.items():
            (part / name).write_bytes(data)
        target = self.folder / place
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.rmtree(target, ignore_errors=True)  # of a session whose rows were not written any more
        part.replace(target)

    @lru_cache(maxsize=2)  # noqa: B019  the set is gone when its command ends
    def _read(self, number: int) -> dict[str, Any]:
        return json.loads(self._part(number).read_text(encoding="utf-8"))

    def session_info(self, number: int) -> SessionInfo:
        """Of a session that was added."""
        return context_of(self._read(number))

    def view(self) -> str:
        """What the only view is called; "camera" where there are several."""
        return self._read(0)["view"]

    def gather(self) -> None:
        """All rows into ``metadata.csv``."""
        part = self.parts / METADATA
        with part.open("w", newline="", encoding="utf-8") as stream:
            writer = csv.writer(stream)
            writer.writerow(self._read(0)["columns"])
            for number in range(self.sessions):
                writer.writerows(self._read(number)["rows"])
        part.replace(self.folder / METADATA)
