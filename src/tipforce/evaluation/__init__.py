"""Evaluation of methods: metrics, protocols, the constant predictor, robustness to perturbations, the report."""

from ._comparison import LOAD_BINS_N, SENSOR_MAE_N, comparison
from ._constant import Constant
from ._evaluate import Evaluation, EvaluationSettings, ShowsFeatures, evaluate
from ._ground_truth import BOUND_KINDS, FORCE_BOUND_BINS_N, CramerRaoBounds, bound_at, bound_ratios, truth_at
from ._kept_fits import KeptFits, kept_fits
from ._methods import Method, methods_from
from ._metrics import FORCE_BINS_N, error_metrics, interval_metrics, percent_of_true, score
from ._predictions import Predictions
from ._protocols import AS_SAVED, PROTOCOLS, FittedSplit, MethodResult
from ._robustness import UNPERTURBED
from ._statistics import (
    CONTACT_ANGLE_BINS_DEG,
    COVERAGE_FORCE_BINS_N,
    FEW_SAMPLES,
    MIN_SESSIONS,
    WRONG_N,
    bland_altman,
    bootstrap_mean,
    coverage_by_stratum,
    stratum_metrics,
)
from ._trust import AXIS_ANGLE_BINS_DEG, TRUST_FORCE_BINS_N, axis_angle_deg, retention, session_groups, trust_metrics
from .report import check_report_folder, report_lines, summary, verdict, write_report

__all__ = [
    "AS_SAVED",
    "AXIS_ANGLE_BINS_DEG",
    "BOUND_KINDS",
    "CONTACT_ANGLE_BINS_DEG",
    "COVERAGE_FORCE_BINS_N",
    "FEW_SAMPLES",
    "FORCE_BINS_N",
    "FORCE_BOUND_BINS_N",
    "LOAD_BINS_N",
    "MIN_SESSIONS",
    "PROTOCOLS",
    "SENSOR_MAE_N",
    "TRUST_FORCE_BINS_N",
    "UNPERTURBED",
    "WRONG_N",
    "Constant",
    "CramerRaoBounds",
    "Evaluation",
    "EvaluationSettings",
    "FittedSplit",
    "KeptFits",
    "Method",
    "MethodResult",
    "Predictions",
    "ShowsFeatures",
    "axis_angle_deg",
    "bland_altman",
    "bootstrap_mean",
    "bound_at",
    "bound_ratios",
    "check_report_folder",
    "comparison",
    "coverage_by_stratum",
    "error_metrics",
    "evaluate",
    "interval_metrics",
    "kept_fits",
    "methods_from",
    "percent_of_true",
    "report_lines",
    "retention",
    "score",
    "session_groups",
    "stratum_metrics",
    "summary",
    "trust_metrics",
    "truth_at",
    "verdict",
    "write_report",
]
