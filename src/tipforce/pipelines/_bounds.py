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

    found = read_companion_bounds(sorted(folder.rglob("*.truth.npz")), dataset.sessions, progress=progress)
    whole = [each for each in found if not each.rejection_reason]
    missing = Counter(each.rejection_reason for each in found if each.rejection_reason)
    notes = [f"No bound for {count} session{'s' * (count > 1)}: {why}." for why, count in missing.items()]
    unstable = sum(int(np.isnan(each.std_n["one_frame"][:, 0]).sum()) for each in whole)
    if unstable:
        notes.append(f"No bound for {unstable} frames in which no stable shape under a dead force was found.")
    if not whole:
        return CramerRaoBounds({}, np.full(len(dataset), np.nan), (), tuple(notes))
    ways = list(whole[0].std_n)
    rows = {
        each.session: (each.stamp_ns, np.column_stack([*(each.std_n[way] for way in ways), each.contact_angle_deg]))
        for each in whole
    }
    *columns, angle = np.split(bound_at(dataset, rows), range(3, 3 * len(ways) + 1, 3), axis=1)
    return CramerRaoBounds(
        dict(zip(ways, columns, strict=True)), angle[:, 0], tuple(describe_nuisances(whole)), tuple(notes)
    )
