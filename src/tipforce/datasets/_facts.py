"""``dataset.json``: what the samples of a dataset folder have in common, and what each session has of its own."""

import json
from collections.abc import Iterable, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from ..errors import FileFormatError
from ..types import Catheter, Context

__all__ = ["FACTS", "FolderFacts", "contexts_of", "facts_text", "read_facts"]

FACTS = "dataset.json"

_Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]


class CatheterFacts(BaseModel):
    """Nominal values of the catheter; see `tipforce.types.Catheter`."""

    model_config = ConfigDict(extra="forbid")

    name: str = "unnamed"
    diameter_m: _Positive | None = None
    flexible_length_m: _Positive | None = None
    rigid_length_m: _Positive | None = None
    bending_stiffness_nm2: _Positive | None = None


class SessionFacts(BaseModel):
    """What one session has of its own: scale, facts of its catheter, and notes under any other name."""

    model_config = ConfigDict(extra="allow")
    __pydantic_extra__: dict[str, str] = Field(init=False)  # pyright: ignore[reportIncompatibleVariableOverride]

    metres_per_px: _Positive | None = None
    catheter: CatheterFacts = CatheterFacts()
    """What is stated here stands in place of the same fact of the common catheter."""


class FolderFacts(BaseModel):
    """What all samples of a dataset folder have in common."""

    model_config = ConfigDict(extra="forbid")

    title: str = ""
    frame: str = "base"
    """Axes of the forces; "base" is the convention of this program."""
    view: str = "camera"
    """Of the column ``file_name`` (in shards: ``image``), or of shape columns."""
    metres_per_px: _Positive | None = None
    catheter: CatheterFacts = CatheterFacts()
    notes: dict[str, str] = Field(default_factory=dict)
    sessions: dict[str, SessionFacts] = Field(default_factory=dict)


def read_facts(path: Path) -> FolderFacts:
    """``path``, or nothing known where it is not there. Raises FileFormatError."""
    if not path.exists():
        return FolderFacts()
    try:
        return FolderFacts.model_validate(json.loads(path.read_text(encoding="utf-8")))
    except (json.JSONDecodeError, UnicodeDecodeError) as error:
        raise FileFormatError(f"{path}: is no JSON ({error})") from None
    except ValidationError as error:
        first = error.errors()[0]
        key = ".".join(str(part) for part in first["loc"])
        raise FileFormatError(
            f"{path}: {key or 'its content'}: {first['msg']}; it may hold {', '.join(FolderFacts.model_fields)}"
        ) from None


def contexts_of(facts: FolderFacts, sessions: Iterable[str]) -> dict[str, Context]:
    """Session -> what is publicly known of it."""
    shared = facts.notes if facts.frame == "base" else {**facts.notes, "force_frame": facts.frame}
    found: dict[str, Context] = {}
    for name in sessions:
        own = facts.sessions.get(name, SessionFacts())
        found[name] = Context(
            name,
            Catheter(**{**facts.catheter.model_dump(), **own.catheter.model_dump(exclude_unset=True)}),
            own.metres_per_px or facts.metres_per_px,
            {**shared, **own.__pydantic_extra__},
        )
    return found


def facts_text(title: str, contexts: Sequence[Context], view: str) -> str:
    """The inverse of `read_facts` and `contexts_of`: what all ``contexts`` share is stated once."""
    known = [_flat(context) for context in contexts]
    shared = {key: value for key, value in known[0].items() if all(other.get(key) == value for other in known)}
    facts: dict[str, Any] = {"title": title, "frame": shared.pop(("notes", "force_frame"), "base"), "view": view}
    facts |= _nested(shared)
    facts["sessions"] = {}
    for context, own in zip(contexts, known, strict=True):
        differing = _nested({key: value for key, value in own.items() if key not in shared})
        facts["sessions"][context.session] = {**differing.pop("notes"), **differing}
    for own in facts["sessions"].values():
        own.pop("force_frame", None)
    return json.dumps(facts, indent=1, ensure_ascii=False) + "\n"


def _flat(context: Context) -> dict[tuple[str, ...], Any]:
    return {
        ("metres_per_px",): context.metres_per_px,
        **{("catheter", key): value for key, value in asdict(context.catheter).items()},
        **{("notes", key): value for key, value in context.notes.items()},
    }


def _nested(flat: dict[tuple[str, ...], Any]) -> dict[str, Any]:
    nested: dict[str, Any] = {"notes": {}}
    for (first, *rest), value in flat.items():
        if rest:
            nested.setdefault(first, {})[rest[0]] = value
        elif value is not None:
            nested[first] = value
    return nested
