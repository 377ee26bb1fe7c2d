"""Judging methods: metrics, protocols, the constant predictor, figures and the report."""

from ._constant import Constant
from ._evaluate import AS_SAVED, PROTOCOLS, Candidate, Evaluation, Row, evaluate
from ._metrics import FORCE_BINS_N, error_figures, interval_figures, percent_of_true, score
from ._outcome import CONTACT_N, Outcome

__all__ = [
    "AS_SAVED",
    "CONTACT_N",
    "FORCE_BINS_N",
    "PROTOCOLS",
    "Candidate",
    "Constant",
    "Evaluation",
    "Outcome",
    "Row",
    "error_figures",
    "evaluate",
    "interval_figures",
    "percent_of_true",
    "score",
]
