"""An evaluation as nested dicts of numbers and text: the content of ``metrics.json`` and of the page."""

import platform
from collections.abc import Sequence
from datetime import UTC, datetime
from importlib.metadata import version
from typing import Any

import numpy as np

from ... import __version__
from ...types import ShapeFeatures
from ...units import newtons_to_grams
from .._comparison import comparison
from .._constant import Constant
from .._evaluate import Evaluation, ShowsFeatures
from .._ground_truth import BOUND_KINDS
from .._metrics import json_ready
from .._protocols import BY_SESSION, PROTOCOL_WORDS, MethodResult
from .._statistics import MIN_SESSIONS
from .._thesis import THESIS_FIGURES, beside_thesis

_NO_BETTER_RATIO = 0.95
"""From this multiple of the constant predictor's error on, a method has read nothing from the image."""
_LIBRARIES = ("numpy", "scipy", "scikit-learn", "opencv-python-headless", "numba", "matplotlib", "onnxruntime")


def best_method(evaluation: Evaluation) -> str:
    """Returns the method with the smallest MAE under the strictest protocol; the constant fills where it abstained."""
    found = [evaluation.result(method.label, evaluation.strictest) for method in evaluation.methods]
    results = [each for each in found if each is not None]
    return min(results, key=lambda each: (not each.predictions.valid.any(), each.metrics["mae_filled_n"])).method


def verdict(evaluation: Evaluation) -> list[str]:
    """Returns the result in sentences: the error on held-out sessions, its confidence interval, the 90 % intervals."""
    method, strictest = best_method(evaluation), evaluation.strictest
    result, constant = evaluation.result(method, strictest), evaluation.result(Constant.name, strictest)
    assert result is not None
    assert constant is not None
    random = evaluation.result(method, "random")
    if not np.isfinite(result.mae_n):
        reasons = ", ".join(f"{reason} {count}" for reason, count in result.metrics["abstained"].items())
        on = PROTOCOL_WORDS[strictest].on
        return [f"{on}, {method} gave no estimate for any of {len(result.predictions)} samples ({reasons})."]
    parts = [f"{PROTOCOL_WORDS[strictest].on}, {method}: MAE {_both(result.mae_n)}"]
    if strictest != "random" and random is not None and np.isfinite(random.mae_n):
        parts.append(f"random split: {_both(random.mae_n)}")
    parts.append(f"a constant: {_both(constant.mae_n)}")
    sentences = ["; ".join(parts) + "."]
    ratio = result.mae_n / constant.mae_n if constant.mae_n > 0 else float("inf")
    if ratio >= _NO_BETTER_RATIO:
        sentences.append("That is no better than always answering the same force: nothing was read from the image.")
    else:
        sentences.append(f"That is {100 * ratio:.0f} % of the constant’s error.")
    magnitude = result.metrics["quantities"]["magnitude"]
    sentences.append(_confidence(magnitude["mae_ci95_n"], magnitude["mae_ci95_sessions"]))
    coverage = magnitude["coverage"]
    if magnitude["unbounded_share"] > 0.5:
        sentences.append("Its 90 % intervals exclude nothing: too little was held out to bound them.")
    elif np.isfinite(coverage):
        sentences.append(f"The 90 % intervals hold {100 * coverage:.0f} % of the measured forces.")
    abstained = result.metrics["abstained_share"]
    if abstained > 0:
        sentences.append(f"It abstained on {100 * abstained:.1f} % of the samples.")
    if strictest not in BY_SESSION:
        sentences.append("No session was held out, so how it does on a new session is not known.")
    return sentences


def summary(evaluation: Evaluation, command: str = "") -> dict[str, Any]:
    """Returns everything but the figures, ready for JSON: no NaN.

    Args:
        evaluation: The evaluation.
        command: The command that makes it.

    Returns:
        The content of ``metrics.json``: verdict, notes, data, ``results`` (see `score`) and the methods.
    """
    data = evaluation.dataset
    return json_ready(
        {
            "tipforce": __version__,
            "made_utc": datetime.now(UTC).isoformat(timespec="seconds"),
            "command": command,
            "research_use_only": True,
            "verdict": verdict(evaluation),
            "best_method": best_method(evaluation),
            "strictest_protocol": evaluation.strictest,
            "notes": [*evaluation.notes, *(evaluation.bounds.notes if evaluation.bounds else ())],
            "data": {
                "title": data.title, "samples": len(data), "samples_before_drawing": len(evaluation.everything),
                "sessions": data.sessions, "views": _views(evaluation),
                "known": [axis for axis, known in zip("xyz", data.known.tolist(), strict=True) if known],
                "force_min_n": data.magnitude_n.min(), "force_max_n": data.magnitude_n.max(),
                "force_mean_n": data.magnitude_n.mean(), "fingerprint": evaluation.everything.fingerprint(),
                "truth": evaluation.truth_n is not None,
            },
            "cramer_rao_bound": _bound(evaluation),
            "comparison": comparison(evaluation) if evaluation.settings.compare else None,
            "perturbed": evaluation.perturbed or None,
            "seed": evaluation.settings.seed, "samples": evaluation.settings.samples,
            "folds": evaluation.settings.folds, "every": evaluation.settings.every,
            "confidence": {"method": "percentile bootstrap of whole sessions, 95 %", "sessions_at_least": MIN_SESSIONS},
            "results": [_result(each, evaluation) for each in evaluation.results],
            "methods": {
                method.label: {
                    "method": method.estimator.name, "settings": method.estimator.settings.model_dump(mode="json"),
                    "saved_model": method.saved is not None,
                    "interval_basis": _interval_basis(evaluation, method.label),
                    "time_per_frame": evaluation.timing[method.label],
                    "samples_table": _five_samples(evaluation, method.label),
                }
                for method in evaluation.methods
            },
            "thesis": THESIS_FIGURES,
            "beside_thesis": beside_thesis(evaluation),
            "versions": {"python": platform.python_version(), **{name: version(name) for name in _LIBRARIES}},
            "machine": f"{platform.system()} {platform.machine()}",
        }
    )  # fmt: skip


def _bound(evaluation: Evaluation) -> dict[str, Any] | None:
    """Returns the kinds of Cramer-Rao bound that errors were compared with, and their unknown quantities."""
    bounds = evaluation.bounds
    if bounds is None or not bounds.std_n:
        return None
    return {"kinds": {kind: BOUND_KINDS[kind] for kind in bounds.std_n}, "nuisances": bounds.nuisances}


def _interval_basis(evaluation: Evaluation, method: str) -> str:
    """Returns the basis of the method's intervals under the strictest protocol; empty if it is not stated."""
    result = evaluation.result(method, evaluation.strictest)
    return result.fits[0].facts.interval_basis if result is not None and result.fits else ""


def _views(evaluation: Evaluation) -> str:
    """Returns the description of a sample in words."""
    first = next(evaluation.dataset.subset(np.array([0])).observations(), None)
    views = [] if first is None else list(first.views.values())
    if not views:
        return "the drives' readings"
    return "ready-made shape numbers" if isinstance(views[0], ShapeFeatures) else "an image"


def _result(result: MethodResult, evaluation: Evaluation) -> dict[str, Any]:
    """Returns one method under one protocol, an item of ``results``; see `summary`."""
    constant = evaluation.result(Constant.name, result.protocol)
    return {
        "method": result.method,
        "protocol": result.protocol,
        "protocol_text": PROTOCOL_WORDS[result.protocol].name,
        "mae_over_constant": result.mae_n / constant.mae_n if constant is not None and constant.mae_n > 0 else None,
        "splits": _splits(result),
        "against_sensor": result.metrics,
        "against_truth": result.truth_metrics,
        "against_bound": result.bound_ratios,
    }


def _splits(result: MethodResult) -> Sequence[dict[str, Any]]:
    """Returns for each split the numbers of its samples, the time of the fit and facts of the fitted method."""
    return [
        {
            "name": fit.split.name,
            "train": len(fit.split.train),
            "calibrate": len(fit.split.calibrate),
            "test": len(fit.split.test),
            "fit_s": fit.seconds,
            "facts": fit.facts.model_dump(mode="json"),
        }
        for fit in result.fits
    ]


def _confidence(ends: Sequence[float], sessions: int) -> str:
    """States how far the MAE over these sessions can be trusted."""
    if not np.isfinite(ends).all():
        few = "1 session is" if sessions == 1 else f"{sessions} sessions are"
        return f"{few} too few for a confidence interval of the MAE (at least {MIN_SESSIONS})."
    low, high = (1e3 * end for end in ends)
    return f"95 % confidence interval of the MAE over {sessions} sessions: {low:.0f} to {high:.0f} mN."


def _both(newtons: float) -> str:
    return f"{newtons_to_grams(newtons):.1f} g ({1e3 * newtons:.0f} mN)"


def _five_samples(evaluation: Evaluation, method: str) -> dict[str, Any] | None:
    """Returns thesis table 3: five scaled samples of the first training part, from largest to smallest force."""
    first = next(each for each in evaluation.results if each.method == method).fits[0]
    if not isinstance(first.estimator, ShowsFeatures) or not len(first.split.train):
        return None
    names, values, targets, force = first.estimator.normalised(evaluation.dataset.subset(first.split.train))
    order = np.argsort(-np.linalg.norm(force, axis=1), kind="stable")
    chosen = order[np.unique(np.linspace(0, len(order) - 1, 5).round().astype(int))]
    return {"names": [*names, *targets], "rows": np.column_stack([values, force])[chosen]}
