"""From the truths beside recordings to the smallest possible errors of a dataset's samples."""

from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from ..datasets import Dataset
    from ..evaluation import CramerRaoBounds


def bounds_from(dataset: "Dataset", folder: Path, progress: Callable[[str, float], None]) -> "CramerRaoBounds":
    """Collects the Cramer-Rao bounds of simulated sessions.

    Args:
        dataset: n samples.
        folder: the folder of the sessions' truth, files NAME.truth.npz at any depth.
        progress: called with the current work and its finished share.

    Returns:
        The bounds of the samples, NaN where a sample has no bound, with notes on the reasons.
    """
    import numpy as np

    from ..evaluation import CramerRaoBounds, bound_at
    from ..limits import describe_nuisances, read_companion_bounds

    sessions = read_companion_bounds(sorted(folder.rglob("*.truth.npz")), dataset.sessions, progress=progress)
    bounded = [session for session in sessions if not session.rejection_reason]
    rejected = Counter(session.rejection_reason for session in sessions if session.rejection_reason)
    notes = [f"No bound for {count} session{'s' * (count > 1)}: {why}." for why, count in rejected.items()]
    unstable = sum(int(np.isnan(session.std_n["one_frame"][:, 0]).sum()) for session in bounded)
    if unstable:
        notes.append(f"No bound for {unstable} frames in which no stable shape under a dead force was found.")
    if not bounded:
        return CramerRaoBounds({}, np.full(len(dataset), np.nan), (), tuple(notes))
    # All values of a frame in one row: three components for each kind of bound (one frame, whole session, ...), and the
    # contact angle. `bound_at` picks the row of each sample; then the columns are taken apart again.
    kinds = list(bounded[0].std_n)
    rows = {
        session.session: (
            session.stamp_ns,
            np.column_stack([*(session.std_n[kind] for kind in kinds), session.contact_angle_deg]),
        )
        for session in bounded
    }
    *columns, angle = np.split(bound_at(dataset, rows), range(3, 3 * len(kinds) + 1, 3), axis=1)
    return CramerRaoBounds(
        dict(zip(kinds, columns, strict=True)), angle[:, 0], tuple(describe_nuisances(bounded)), tuple(notes)
    )
