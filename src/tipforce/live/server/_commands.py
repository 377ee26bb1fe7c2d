"""Commands that a page may send: small JSON texts, which are checked before they are executed."""

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, ValidationError

from ...errors import InputError

MAX_COMMAND_BYTES = 4096
"""Largest size of a command in bytes; the commands of the page are much shorter."""
_Id = Annotated[int, Field(ge=0, lt=1 << 53)]
_Milliseconds = Annotated[float, Field(ge=-1e15, le=1e15, allow_inf_nan=False)]
_Newtons = Annotated[float, Field(ge=-1000, le=1000, allow_inf_nan=False)]
"""Only checked to be a number here; `ContactSettings` checks the window and the limit."""


class _Command(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class Acknowledge(_Command):
    """The page has drawn update ``number``; ``age_ms``: age of its image at that time, as the page measured it."""

    command: Literal["ack"]
    number: Annotated[int, Field(ge=0, lt=1 << 32)]
    age_ms: _Milliseconds | None = None


class Ping(_Command):
    """The answer states the time of the engine's clock, and returns ``sent_ms`` unchanged."""

    command: Literal["ping"]
    sent_ms: _Milliseconds


class Display(_Command):
    """Sets the view that the page shows, and its width in pixels."""

    command: Literal["display"]
    view: Annotated[str, Field(max_length=100)] = ""
    width_px: Annotated[int, Field(ge=1, le=16384)]


class ZeroForce(_Command):
    """Subtracts the present force from then on.

    ``confirmed_n``: the magnitude that the operator agreed to subtract although the tip may be in contact.
    """

    command: Literal["zero"]
    id: _Id
    confirmed_n: _Newtons | None = None


class UndoZero(_Command):
    """Removes the zero: nothing is subtracted any more."""

    command: Literal["undo_zero"]
    id: _Id


class Integral(_Command):
    """Starts or stops the force-time integral."""

    command: Literal["integral"]
    id: _Id
    on: bool


class Record(_Command):
    """Starts or stops a recording."""

    command: Literal["record"]
    id: _Id
    on: bool


class Limits(_Command):
    """Sets force window and limit, in newtons."""

    command: Literal["limits"]
    id: _Id
    window_n: tuple[_Newtons, _Newtons]
    limit_n: _Newtons


class Loop(_Command):
    """Passes a command to the loop that holds a force."""

    command: Literal["loop"]
    id: _Id
    do: Literal["mark_start", "mark_goal", "start", "retract", "stop", "release"]


Command = Annotated[
    Acknowledge | Ping | Display | ZeroForce | UndoZero | Integral | Record | Limits | Loop,
    Field(discriminator="command"),
]
_ADAPTER: TypeAdapter[Command] = TypeAdapter(Command)


def read_command(text: str) -> Command:
    """Returns the command in ``text``.

    Raises:
        InputError: ``text`` is not a command; the message states the reason and quotes little of the text.
    """
    try:
        return _ADAPTER.validate_json(text)
    except ValidationError as error:
        first = error.errors(include_url=False, include_input=False, include_context=False)[0]
        where = ".".join(str(part) for part in first["loc"])
        raise InputError(f"not a command: {where + ': ' if where else ''}{first['msg'][:200]}") from None
