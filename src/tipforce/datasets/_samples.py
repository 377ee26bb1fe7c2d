"""A dataset that grows session by session, from many processes, and outlives a kill."""

import json
import shutil
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ..types import BoolArray, FloatArray, IntArray, SessionInfo
from ._facts import FACTS, facts_text
from ._label_table import FORCES

__all__ = ["Growing", "SessionSamples"]


@dataclass(frozen=True, slots=True, eq=False)
class SessionSamples:
    """Labelled pictures of one session: n samples.

    ``frame`` (n,): their numbers in it; ``stamp_ns`` (n,), ``actuation``: name -> (n,); ``force_n`` (n, 3), NaN where
    ``known`` (3,) is False. ``pictures``: view -> n encoded pictures; ``suffix``: of their files. ``masks``: view ->
    n PNGs, or nothing.
    """

    session_info: SessionInfo
    frame: IntArray
    stamp_ns: IntArray
    actuation: Mapping[str, FloatArray]
    force_n: FloatArray
    known: BoolArray
    pictures: Mapping[str, Sequence[bytes]]
    suffix: str
    masks: Mapping[str, Sequence[bytes]] = field(default_factory=dict[str, Sequence[bytes]])

    def columns(self) -> dict[str, list[Any]]:
        """Name -> n values, of all columns but the pictures."""
        return {
            "session": [self.session_info.name] * len(self.frame),
            "stamp_ns": self.stamp_ns.tolist(),
            **{name: values.tolist() for name, values in self.actuation.items()},
            **{FORCES[axis]: self.force_n[:, axis].tolist() for axis in range(3) if self.known[axis]},
        }

    def names(self, view: str) -> list[str]:
        """Path of each picture of ``view``, from the dataset's folder."""
        return self._paths("images", view, self.suffix)

    def mask_names(self, view: str) -> list[str]:
        """Path of the mask of each picture of ``view``."""
        return self._paths("masks", view, ".png")

    def _paths(self, kind: str, view: str, suffix: str) -> list[str]:
        more = f"-{view}" if len(self.pictures) > 1 else ""
        return [f"{kind}/{self.session_info.name}/{number:05d}{more}{suffix}" for number in self.frame.tolist()]


class Growing(ABC):
    """A dataset in ``folder`` that becomes whole when ``sessions`` sessions are in it.

    Sessions are added in any order and by any process, each whole or not at all; `finish` gathers them in the order of
    their numbers, so the bytes hang on neither. What is not gathered yet lies in ``folder / PARTS``.
    """

    PARTS = ".parts"

    def __init__(self, folder: Path, sessions: int) -> None:
        self.folder, self.sessions = folder, sessions
        self.parts = folder / self.PARTS

    @property
    def whole(self) -> bool:
        """Whether all is there and gathered."""
        return (self.folder / FACTS).exists() and not self.parts.exists()

    @abstractmethod
    def has(self, number: int) -> bool:
        """Whether the session of this number was added."""

    @abstractmethod
    def add(self, number: int, samples: SessionSamples) -> None:
        """Add one session."""

    def finish(self, title: str) -> None:
        """Gather all sessions; a kill meanwhile loses nothing, it is begun again."""
        facts = self.parts / FACTS
        if not facts.exists():
            infos = [self.session_info(number) for number in range(self.sessions)]
            put(facts, facts_text(title, infos, self.view()).encode())
        self.gather()
        facts.replace(self.folder / FACTS)
        shutil.rmtree(self.parts)

    @abstractmethod
    def session_info(self, number: int) -> SessionInfo:
        """Of a session that was added."""

    @abstractmethod
    def view(self) -> str:
        """What the only view is called; "camera" where there are several."""

    @abstractmethod
    def gather(self) -> None:
        """Make the final files from those of the sessions."""


def put(path: Path, data: bytes) -> None:
    """Write a file whole or not at all."""
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_name(f"{path.name}.part")
    part.write_bytes(data)
    part.replace(path)


def about(samples: SessionSamples) -> dict[str, Any]:
    """What `context_of` and `view` need, as JSON values."""
    views = list(samples.pictures)
    return {"session_info": samples.session_info.values(), "view": views[0] if len(views) == 1 else "camera"}


def context_of(known: Mapping[str, Any]) -> SessionInfo:
    """The inverse of `about`."""
    return SessionInfo.from_values(known["session_info"])


def as_json(values: Mapping[str, Any]) -> bytes:
    """Compact and the same for the same values."""
    return json.dumps(values, ensure_ascii=False, separators=(",", ":")).encode()
