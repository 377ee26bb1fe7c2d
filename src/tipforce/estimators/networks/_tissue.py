"""The stiffness of a session's tissue, from its images.

The depth of the indentation determines the force only where the tissue is known. `compact` estimates for each image
how likely each class of tissue is. Over a session these likelihoods add up, but with a weight below that of independent
images, because neighbouring frames share the same errors of catheter and bench. The weight is learnt from whole
sessions: it is the smallest that is not clearly worse than the best, because a wrong class with a high share makes a
wrong force with a narrow interval.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.special import log_softmax, softmax

from ...training import TISSUE_N_PER_M, tissue_shares
from ...types import FloatArray, IntArray
from .._values import stored_array, stored_number
from ._preparation import Arrays

SPACING_S = 0.25
"""Frames that follow each other by this time or more count in full, nearer ones in proportion."""
FORGOTTEN_S = 120.0
"""Time constant with which the evidence is forgotten: the tip may touch another tissue by then."""
_STATED_SHARE = 0.2
"""Standard deviation of a stated stiffness's logarithm: it holds for one place and one speed."""
_WEIGHTS = (0.0, 0.02, 0.05, 0.1, 0.2, 0.35, 0.5, 0.7, 1.0)
"""Candidates for `TissueEvidence.weight`."""
_USUAL_WEIGHT = 0.1
"""Weight if no held-out session states its tissue."""
MIN_CLASS_SHARE = 0.01
_CENTRES = np.log(TISSUE_N_PER_M)


@dataclass(frozen=True, eq=False)
class TissueEvidence:
    """Evidence of the images on the tissue.

    Attributes:
        log_share: (c,) log shares of the classes in training.
        weight: weight of an image.
    """

    log_share: FloatArray
    weight: float

    def arrays(self) -> Arrays:
        """Returns arrays for the model store."""
        return {"tissue_log_share": self.log_share, "tissue_weight": np.array(self.weight)}

    @classmethod
    def of(cls, arrays: Arrays) -> "TissueEvidence | None":
        """Makes the evidence from `arrays`; None for a network without classes of tissue."""
        if "tissue_log_share" not in arrays:
            return None
        share = stored_array(arrays, "tissue_log_share", (len(TISSUE_N_PER_M),), high=0.0)
        return cls(share, stored_number(arrays, "tissue_weight", low=0.0, high=1.0))


class TissueBelief:
    """Shares of the tissue classes in one session, updated image by image.

    Args:
        evidence: weight of the images.
        stated_n_per_m: the tissue's stiffness as the session states it; None: not known, as in training.
    """

    def __init__(self, evidence: TissueEvidence, stated_n_per_m: float | None = None) -> None:
        self._evidence = evidence
        self._prior = evidence.log_share
        if stated_n_per_m is not None:
            apart = (np.clip(np.log(stated_n_per_m), _CENTRES[0], _CENTRES[-1]) - _CENTRES) / _STATED_SHARE
            self._prior = log_softmax(-0.5 * apart * apart)
        self._log, self._before_ns = self._prior, None

    def shares(self, stamp_ns: int, logits: npt.NDArray[np.floating]) -> FloatArray:
        """Returns the shares of the classes with a new image, which is counted in full, and earlier ones.

        Args:
            stamp_ns: stamp of the image.
            logits: (c,) outputs of the network for it.

        Returns:
            (c,) shares, which sum to 1.
        """
        before = self._before_ns
        if before is None or stamp_ns > before:
            step = SPACING_S if before is None else 1e-9 * (stamp_ns - before)
            kept = np.exp(-step / FORGOTTEN_S)
            told = log_softmax(logits.astype(np.float64)) - self._evidence.log_share
            now = log_softmax(self._log + told)
            known = np.logaddexp(np.log(kept) + log_softmax(self._log), np.log1p(-kept) + self._prior)
            self._log = log_softmax(known + self._evidence.weight * min(1.0, step / SPACING_S) * told)
            self._before_ns = stamp_ns
        else:  # a late frame adds nothing
            now = log_softmax(self._log)
        return np.exp(now)


def fit_tissue_evidence(
    session: npt.NDArray[np.str_],
    stamp_ns: IntArray,
    logits: npt.NDArray[np.floating],
    log_stiffness: FloatArray,
    initial: TissueEvidence | None,
) -> TissueEvidence:
    """Finds the shares of the classes in training, which the network expects, and the weight of an image.

    Args:
        session: (n,) sessions of samples that the network was not trained on.
        stamp_ns: (n,) stamps.
        logits: (n, c) outputs of the network.
        log_stiffness: (n,) logarithm of the stiffness in N/m as the sessions state it, NaN where they do not.
        initial: evidence of the initial model; its weight is kept where fewer than two sessions state their tissue.

    Returns:
        The evidence; the smallest weight whose likelihood is within one standard error of the best.
    """
    share = np.maximum(softmax(logits.astype(np.float64), axis=1).mean(axis=0), MIN_CLASS_SHARE)
    log_share = np.log(share / share.sum())
    stated = np.isfinite(log_stiffness)
    if len(np.unique(session[stated])) < 2:
        return TissueEvidence(log_share, _USUAL_WEIGHT if initial is None else initial.weight)
    found = np.array(
        [
            _log_shares(
                TissueEvidence(log_share, weight),
                session[stated],
                stamp_ns[stated],
                logits[stated],
                log_stiffness[stated],
            )
            for weight in _WEIGHTS
        ]
    )
    best = found[np.argmax(found.mean(axis=1))]
    worse = best - found
    close = worse.mean(axis=1) <= worse.std(axis=1) / np.sqrt(found.shape[1])
    return TissueEvidence(log_share, _WEIGHTS[int(np.argmax(close))])


def _log_shares(
    evidence: TissueEvidence,
    session: npt.NDArray[np.str_],
    stamp_ns: IntArray,
    logits: npt.NDArray[np.floating],
    log_stiffness: FloatArray,
) -> FloatArray:
    """Returns (sessions,) mean logarithms of the true class's share, image by image as `TissueBelief` has it."""
    found: list[float] = []
    for name in np.unique(session):
        rows = np.flatnonzero(session == name)
        rows = rows[np.argsort(stamp_ns[rows], kind="stable")]
        belief = TissueBelief(evidence)
        shares = np.array([belief.shares(int(stamp_ns[row]), logits[row]) for row in rows])
        found.append(float(np.log((shares * tissue_shares(log_stiffness[rows])).sum(axis=1)).mean()))
    return np.array(found)
