"""How the protocols are called where people read of them."""

from dataclasses import dataclass

from ._evaluation import AS_SAVED

__all__ = ["WORDS", "Words"]


@dataclass(frozen=True, slots=True)
class Words:
    """One protocol.

    ``name``: of a line in a table; ``on``: begins a sentence; ``bar``: under a bar; ``of``: "samples of ..."; ``held``:
    what of a session was held out.
    """

    name: str
    on: str
    bar: str
    of: str
    held: str


WORDS = {
    "random": Words(
        "random frames",
        "On random frames",
        "random frames\n(the thesis's split)",
        "random frames",
        "the frames held out",
    ),
    "thesis": Words(
        "thesis protocol",
        "Under the thesis's protocol",
        "thesis protocol\n(random frames)",
        "the thesis's random split",
        "the frames held out",
    ),
    "blocked": Words(
        "blocks of time",
        "On blocks of time held out",
        "blocks of time\nwith a gap",
        "blocks of time held out",
        "the block held out",
    ),
    "session": Words(
        "sessions never seen",
        "On sessions never seen",
        "whole sessions\nnever seen",
        "sessions never seen",
        "all of its frames",
    ),
    "standard": Words(
        "standard protocol",
        "Under the standard protocol (sessions never seen)",
        "standard protocol\n(sessions never seen)",
        "sessions never seen",
        "all of its frames",
    ),
    "catheter": Words(
        "new sessions of a known catheter",
        "On new sessions of a catheter, trained on its first",
        "new sessions\nof a known catheter",
        "sessions never seen of a catheter known by one",
        "all of its frames",
    ),
    AS_SAVED: Words(
        "as saved, new sessions",
        "As saved, on new sessions",
        "model as saved,\nnew sessions",
        "sessions never seen",
        "all of its frames",
    ),
}
