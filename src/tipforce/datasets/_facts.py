"""``dataset.json``: the metadata that all sessions of a dataset folder share, and the metadata of single sessions.

The keys are those of ``bench.toml``, and ``title``, ``view``, ``files`` and ``sessions`` (name -> the same keys again).
"""

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

from .._system.json_files import read_json
from ..errors import FileFormatError
from ..types import SessionInfo, merged_values

FACTS = "dataset.json"
MAX_NAME_LETTERS = 1000


@dataclass(frozen=True, slots=True)
class FolderFacts:
    """Content of ``dataset.json``.

    Attributes:
        title: name of the dataset.
        view: view of the column ``file_name`` (in shards: ``image``), or of the shape columns.
        shared: metadata of all sessions.
        sessions: name -> metadata that replace the shared ones in one session.
        path: path of the file, for messages.
        files: name -> size and checksum of each shard.
    """

    title: str = ""
    view: str = "camera"
    shared: Mapping[str, Any] = field(default_factory=dict[str, Any])
    sessions: Mapping[str, Mapping[str, Any]] = field(default_factory=dict[str, Mapping[str, Any]])
    path: str = FACTS
    files: Mapping[str, Any] = field(default_factory=dict[str, Any])


def read_facts(path: Path) -> FolderFacts:
    """Returns the content of ``path``; empty if it does not exist. Raises FileFormatError."""
    if not path.exists():
        return FolderFacts(path=str(path))
    values = read_json(path, remedy="correct it there")
    if not isinstance(values, dict):
        raise FileFormatError(f"{path}: expected an object with keys like title, view, catheter, views, sessions")
    shared = dict[str, Any](values)
    title, view, sessions = shared.pop("title", ""), shared.pop("view", "camera"), shared.pop("sessions", {})
    files = shared.pop("files", {})
    if not (isinstance(title, str) and isinstance(view, str)):
        raise FileFormatError(f"{path}: title and view must be text")
    for key, text in (("title", title), ("view", view)):
        # messages name a dataset by its title, and an image by its view
        if text.startswith("/") or not text.isprintable() or len(text) > MAX_NAME_LETTERS:
            raise FileFormatError(
                f"{path}: {key} is {text[:80]!r}, expected a name in up to {MAX_NAME_LETTERS} characters that can be "
                "printed, and no path; correct it there"
            )
    if not isinstance(files, dict):
        raise FileFormatError(f"{path}: files must be an object: name of a shard -> its size and checksum")
    if not isinstance(sessions, dict) or not all(isinstance(own, dict) for own in sessions.values()):
        raise FileFormatError(f"{path}: sessions must be an object: name -> its metadata")
    allowed = {each.name for each in fields(SessionInfo)} - {"name"}
    for key in shared:
        if key not in allowed:
            raise FileFormatError(
                f"{path}: {key} is not known; it may hold title, view, sessions, files, {', '.join(sorted(allowed))}"
            )
    facts = FolderFacts(title, view, shared, sessions, str(path), files)
    session_info_of(facts, sessions or [""])  # reports wrong values here
    return facts


def session_info_of(facts: FolderFacts, sessions: Iterable[str]) -> dict[str, SessionInfo]:
    """Returns session -> public metadata.

    Args:
        facts: content of ``dataset.json``.
        sessions: names of the sessions.

    Raises:
        InputError: a value has the wrong type or range.
    """
    infos: dict[str, SessionInfo] = {}
    for name in sessions:
        values = merged_values(facts.shared, facts.sessions.get(name, {}))
        infos[name] = SessionInfo.from_values({**values, "name": name}, facts.path)
    return infos


def facts_text(title: str, infos: Sequence[SessionInfo], view: str) -> str:
    """Returns the text of ``dataset.json``, the inverse of `read_facts` and `session_info_of`.

    Args:
        title: name of the dataset.
        infos: metadata of each session; values that all of them share are stated once.
        view: view of the column ``file_name``.
    """
    stated = [{key: value for key, value in info.values().items() if key != "name"} for info in infos]
    shared = stated[0]
    for values in stated[1:]:
        shared = _common(shared, values)
    single = {info.name: _beyond(values, shared) for info, values in zip(infos, stated, strict=True)}
    content = {"title": title, "view": view, **shared, "sessions": single}
    return json.dumps(content, indent=1, ensure_ascii=False) + "\n"


def _common(first: Mapping[str, Any], second: Mapping[str, Any]) -> dict[str, Any]:
    """Returns the entries of two nested mappings that both have with the same value."""
    common: dict[str, Any] = {}
    for key, value in first.items():
        second_value = second.get(key)
        if isinstance(value, dict) and isinstance(second_value, dict):
            if inner := _common(value, second_value):
                common[key] = inner
        elif key in second and value == second_value:
            common[key] = value
    return common


def _beyond(values: Mapping[str, Any], shared: Mapping[str, Any]) -> dict[str, Any]:
    """Returns the entries of ``values`` that ``shared`` does not have."""
    rest: dict[str, Any] = {}
    for key, value in values.items():
        if isinstance(value, dict) and isinstance(shared.get(key), dict):
            if inner := _beyond(value, shared[key]):
                rest[key] = inner
        elif key not in shared:
            rest[key] = value
    return rest
