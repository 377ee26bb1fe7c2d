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
            distance = (np.clip(np.log(stated_n_per_m), _CENTRES[0], _CENTRES[-1]) - _CENTRES) / _STATED_SHARE
            self._prior = log_softmax(-0.5 * distance * distance)
        self._log, self._last_ns = self._prior, None

    def shares(self, stamp_ns: int, logits: npt.NDArray[np.floating]) -> FloatArray:
        """Returns the shares of the classes by a new image, which counts in full, and by earlier ones.

        For later images the new one counts with the weight of the evidence alone, and less if it soon follows another.

        Args:
            stamp_ns: stamp of the image.
            logits: (c,) outputs of the network for it.

        Returns:
            (c,) shares, which sum to 1.
        """
        last_ns = self._last_ns
        if last_ns is None or stamp_ns > last_ns:
            elapsed_s = SPACING_S if last_ns is None else 1e-9 * (stamp_ns - last_ns)
            keep = np.exp(-elapsed_s / FORGOTTEN_S)
            log_likelihood = log_softmax(logits.astype(np.float64)) - self._evidence.log_share
            log_posterior = log_softmax(self._log + log_likelihood)
            # forgetting: a mixture of the present shares and the session's prior
            log_kept = np.logaddexp(np.log(keep) + log_softmax(self._log), np.log1p(-keep) + self._prior)
            weight = self._evidence.weight * min(1.0, elapsed_s / SPACING_S)
            self._log = log_softmax(log_kept + weight * log_likelihood)
            self._last_ns = stamp_ns
        else:  # a late frame adds nothing
            log_posterior = log_softmax(self._log)
        return np.exp(log_posterior)


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
    samples = session[stated], stamp_ns[stated], logits[stated], log_stiffness[stated]
    likelihoods = np.array([_log_shares(TissueEvidence(log_share, weight), *samples) for weight in _WEIGHTS])
    best = likelihoods[np.argmax(likelihoods.mean(axis=1))]
    loss = best - likelihoods  # (weights, sessions)
    close = loss.mean(axis=1) <= loss.std(axis=1) / np.sqrt(likelihoods.shape[1])
    return TissueEvidence(log_share, _WEIGHTS[int(np.argmax(close))])


def _log_shares(
    evidence: TissueEvidence,
    session: npt.NDArray[np.str_],
    stamp_ns: IntArray,
    logits: npt.NDArray[np.floating],
    log_stiffness: FloatArray,
) -> FloatArray:
    """Returns (sessions,) mean log likelihoods of the stated tissue, by the shares of `TissueBelief` at each image.

    ``evidence`` has the weight to judge; for the n samples see `fit_tissue_evidence`.
    """
    likelihoods: list[float] = []
    for name in np.unique(session):
        rows = np.flatnonzero(session == name)
        rows = rows[np.argsort(stamp_ns[rows], kind="stable")]
        belief = TissueBelief(evidence)
        shares = np.array([belief.shares(int(stamp_ns[row]), logits[row]) for row in rows])
        likelihoods.append(float(np.log((shares * tissue_shares(log_stiffness[rows])).sum(axis=1)).mean()))
    return np.array(likelihoods)
