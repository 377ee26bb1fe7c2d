"""Judging methods: metrics, protocols, the constant predictor, figures and the report."""

from ._bounds import CONTACT_ANGLE_BINS_DEG, FORCE_BOUND_BINS_N, WAYS, Bounds, bound_at, bound_figures
from ._candidates import candidates_from, truth_at
from ._constant import Constant
from ._evaluate import evaluate
from ._evaluation import AS_SAVED, PROTOCOLS, Candidate, Evaluation, Row
from ._features import ShowsFeatures
from ._lines import report_lines
from ._metrics import FORCE_BINS_N, error_figures, interval_figures, percent_of_true, score
from ._outcome import CONTACT_N, Outcome
from ._report import check_folder, write_report
from ._summary import summary, verdict

__all__ = [
    "AS_SAVED",
    "CONTACT_ANGLE_BINS_DEG",
    "CONTACT_N",
    "FORCE_BINS_N",
    "FORCE_BOUND_BINS_N",
    "PROTOCOLS",
    "WAYS",
    "Bounds",
    "Candidate",
    "Constant",
    "Evaluation",
    "Outcome",
    "Row",
    "ShowsFeatures",
    "bound_at",
    "bound_figures",
    "candidates_from",
    "check_folder",
    "error_figures",
    "evaluate",
    "interval_figures",
    "percent_of_true",
    "report_lines",
    "score",
    "summary",
    "truth_at",
    "verdict",
    "write_report",
]
