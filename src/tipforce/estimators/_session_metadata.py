"""Session metadata that a fitted method needs."""

from collections.abc import Iterable

from ..types import ForceEstimate, Observation, SessionInfo, Status


def missing_metadata(needed: Iterable[str], info: SessionInfo) -> str:
    """Returns a sentence on the needed keys that ``info`` does not state, and the remedy; empty where it states all.

    Args:
        needed: the keys.
        info: the session metadata.

    >>> missing_metadata(("views.camera.metres_per_px",), SessionInfo())
    'views.camera.metres_per_px is not stated, and the model needs it; add it to bench.toml'
    """
    lacking = info.missing(needed)
    if not lacking:
        return ""
    one = len(lacking) == 1
    return (
        f"{', '.join(lacking)} {'is' if one else 'are'} not stated, and the model needs {'it' if one else 'them'}; add "
        f"{'it' if one else 'them'} to bench.toml"
    )


class UninformedStream:
    """The stream of a session whose metadata lack a required fact: it abstains, ``detail`` is the reason."""

    def __init__(self, detail: str) -> None:
        self._detail = detail

    def update(self, observation: Observation) -> ForceEstimate:
        """Returns an abstention."""
        return ForceEstimate.invalid(observation.stamp_ns, Status.MISSING_INPUT, self._detail)
