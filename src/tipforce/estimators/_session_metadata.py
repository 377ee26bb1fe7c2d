"""Session metadata that a fitted method needs."""

from collections.abc import Iterable

import numpy as np

from ..types import FloatArray, ForceEstimate, Observation, SessionInfo, Status, ordered_views

MAX_TURN_DEG = 20.0
"""A planar rod is fitted in a view that is turned by at most this angle from the first view: the cosine makes a lateral
force 6 % too small. At 80 to 90 degrees, on four simulated biplane sessions, 91 % of its forces were off by more than
50 mN."""


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


def turned_view(view: str, info: SessionInfo) -> str:
    """Returns the reason why a planar rod cannot be fitted in a view; empty where it can, or nothing says it cannot.

    The base frame, in which the knob bends the catheter and the forces are stated, is that of the first view.

    Args:
        view: the view.
        info: the session metadata.
    """
    first = next(iter(ordered_views(info.views)), view)
    axes = [_viewing_axis(info, name) for name in (first, view)]
    if axes[0] is None or axes[1] is None:
        return ""
    turn_deg = float(np.degrees(np.arccos(np.clip(axes[0] @ axes[1], -1.0, 1.0))))
    if turn_deg <= MAX_TURN_DEG:
        return ""
    return (
        f"the view {view} is turned by {turn_deg:.0f} degrees from the view {first}, in whose plane the knob bends the "
        f"catheter and forces are stated; this method needs at most {MAX_TURN_DEG:.0f} degrees: use the view {first}"
    )


def _viewing_axis(info: SessionInfo, view: str) -> FloatArray | None:
    """Returns the direction (3,) from the camera into the image, where the view's projection is stated."""
    projection = info.view(view).projection
    if projection is None:
        return None
    matrix = np.array(projection)[:, :3]
    return matrix[2] * np.sign(np.linalg.det(matrix)) / np.linalg.norm(matrix[2])


class UninformedStream:
    """The stream of a session whose metadata do not allow an estimate: it abstains, ``detail`` is the reason."""

    def __init__(self, detail: str) -> None:
        self._detail = detail

    def update(self, observation: Observation) -> ForceEstimate:
        """Returns an abstention."""
        return ForceEstimate.invalid(observation.stamp_ns, Status.MISSING_INPUT, self._detail)
