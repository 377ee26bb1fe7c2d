"""Session metadata that a fitted method needs."""

from collections.abc import Iterable

from ..types import ForceEstimate, Observation, SessionInfo, Status


def missing_metadata(needed: Iterable[str], info: SessionInfo) -> str:
    """Which of the ``needed`` keys ``info`` does not state, and how they are stated; empty where it states all.

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
    """The stream of a session that does not state what the method needs: no estimate, and ``detail`` says why."""

    def __init__(self, detail: str) -> None:
        self._detail = detail

    def update(self, observation: Observation) -> ForceEstimate:
        """No estimate."""
        return ForceEstimate.invalid(observation.stamp_ns, Status.MISSING_INPUT, self._detail)
