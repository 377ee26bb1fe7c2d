"""Chooses the frames that are worth annotating: those that differ most, and in which the detection is least certain."""

from collections.abc import Callable, Sequence

import numpy as np

from ..types import FloatArray, IntArray
from ._images import Candidate

DEFAULT_FRAMES = 12
POOL = 3
"""Frames per chosen frame in which the catheter is detected before the choice."""
CERTAIN_WEIGHT = 0.4
"""Weight of a frame in which the detection is certain; one in which nothing is detected has weight 1."""


def choose_frames(
    candidates: Sequence[Candidate], count: int, uncertainty: Callable[[Sequence[Candidate]], Sequence[float]]
) -> list[str]:
    """Returns the names of the frames to annotate, in the order of the candidates.

    A pool of frames that differ most is taken first (farthest-point sampling on the thumbnails). From this pool each
    next frame is the one with the largest product of its distance to the chosen frames and its weight.

    Args:
        candidates: the frames.
        count: number of frames to choose.
        uncertainty: called with the pool; returns for each frame how uncertain the detection is, 0 to 1.

    Returns:
        ``count`` names, or all if there are fewer candidates.
    """
    thumbnails = np.array([candidate.thumbnail for candidate in candidates])
    pool = farthest_points(thumbnails, min(POOL * count, len(candidates)), np.ones(len(candidates)))
    uncertain = np.asarray(uncertainty([candidates[k] for k in pool.tolist()]), np.float64)
    weights = CERTAIN_WEIGHT + (1.0 - CERTAIN_WEIGHT) * uncertain
    chosen = pool[farthest_points(thumbnails[pool], min(count, len(pool)), weights)]
    return [candidates[k].name for k in sorted(chosen.tolist())]


def farthest_points(vectors: FloatArray, count: int, weights: FloatArray) -> IntArray:
    """Returns the indices of vectors that are far from each other.

    Args:
        vectors: (n, d) vectors.
        count: number of vectors, at most n.
        weights: (n,) weights; the distance of a vector to the chosen ones counts in proportion.

    Returns:
        (count,) indices in the order of their choice; the first is the vector with the largest weight, and among those
        with equal weights the one next to the mean.

    >>> farthest_points(np.array([[0.0], [1.0], [9.0], [10.0]]), 3, np.ones(4)).tolist()
    [1, 3, 0]
    """
    to_mean = np.linalg.norm(vectors - vectors.mean(axis=0), axis=1)
    first = int(np.lexsort((to_mean, -weights))[0])
    chosen = [first]
    nearest = np.linalg.norm(vectors - vectors[first], axis=1)
    while len(chosen) < count:
        score = weights * nearest
        score[chosen] = -1.0
        chosen.append(int(np.argmax(score)))
        nearest = np.minimum(nearest, np.linalg.norm(vectors - vectors[chosen[-1]], axis=1))
    return np.array(chosen, dtype=np.int64)
