"""An evaluation as one nested dict of numbers and text: what ``metrics.json`` holds and the page is filled from."""

import platform
from collections.abc import Sequence
from datetime import UTC, datetime
from importlib.metadata import version
from typing import Any

import numpy as np

from .. import __version__
from ..types import ShapeFeatures
from ..units import newtons_to_grams
from ._bounds import WAYS
from ._constant import Constant
from ._evaluation import BY_SESSION, Evaluation, Row
from ._features import five_samples
from ._figures_beyond import THESIS_MAE_N
from ._metrics import plain
from ._wording import WORDS

__all__ = ["best_method", "summary", "verdict"]

THESIS_DIRECTIONS = {
    "x": {"min_error_n": 0.0001, "max_error_n": 0.066, "rmse_n": 0.028},
    "y": {"min_error_n": 0.0003, "max_error_n": 0.068, "rmse_n": 0.023},
}
"""Table 5 of the thesis: method 2 on its own 154 test samples."""

_LIBRARIES = ("numpy", "scipy", "scikit-learn", "opencv-python-headless", "numba", "matplotlib", "onnxruntime")


def best_method(evaluation: Evaluation) -> str:
    """The candidate with the smallest MAE under the strictest protocol, refused samples filled by the constant."""
    rows = [row for c in evaluation.candidates if (row := evaluation.row(c.label, evaluation.honest)) is not None]
    return min(rows, key=lambda row: (not row.outcome.answered.any(), row.figures["mae_filled_n"])).method


def verdict(evaluation: Evaluation) -> list[str]:
    """Sentences: the error where it counts, beside the random split and a constant answer; then the intervals."""
    method, honest = best_method(evaluation), evaluation.honest
    row, constant = evaluation.row(method, honest), evaluation.row(Constant.name, honest)
    assert row is not None
    assert constant is not None
    random = evaluation.row(method, "random")
    if not np.isfinite(row.mae_n):
        reasons = ", ".join(f"{reason} {count}" for reason, count in row.figures["refused"].items())
        return [f"{WORDS[honest].on}, {method} answered none of {len(row.outcome)} samples ({reasons})."]
    parts = [f"{WORDS[honest].on}, {method}: MAE {_both(row.mae_n)}"]
    if honest != "random" and random is not None and np.isfinite(random.mae_n):
        parts.append(f"random split: {_both(random.mae_n)}")
    parts.append(f"a constant: {_both(constant.mae_n)}")
    sentences = ["; ".join(parts) + "."]
    ratio = row.mae_n / constant.mae_n if constant.mae_n > 0 else float("inf")
    if ratio >= 0.95:
        sentences.append("That is no better than always answering the same force: nothing was read from the picture.")
    else:
        sentences.append(f"That is {100 * ratio:.0f} % of the constant’s error.")
    magnitude = row.figures["quantities"]["magnitude"]
    coverage = magnitude["coverage"]
    if magnitude["unbounded_share"] > 0.5:
        sentences.append("Its 90 % intervals exclude nothing: there were too few sessions to bound them.")
    elif np.isfinite(coverage):
        sentences.append(f"The 90 % intervals hold {100 * coverage:.0f} % of the measured forces.")
    refused = row.figures["refused_share"]
    if refused > 0:
        sentences.append(f"{100 * refused:.1f} % of the samples were refused.")
    if honest not in BY_SESSION:
        sentences.append("No session was held out, so how it does on a new session is not known.")
    return sentences


def summary(evaluation: Evaluation, command: str = "") -> dict[str, Any]:
    """Everything but the pictures; JSON-ready, no NaN."""
    data = evaluation.dataset
    return plain(
        {
            "tipforce": __version__,
            "made_utc": datetime.now(UTC).isoformat(timespec="seconds"),
            "command": command,
            "research_use_only": True,
            "verdict": verdict(evaluation),
            "best_method": best_method(evaluation),
            "strictest_protocol": evaluation.honest,
            "notes": [*evaluation.notes, *(evaluation.bounds.notes if evaluation.bounds else ())],
            "data": {
                "title": data.title,
                "samples": len(data),
                "samples_before_drawing": len(evaluation.everything),
                "sessions": data.sessions,
                "views": _views(evaluation),
                "known": [axis for axis, known in zip("xyz", data.known.tolist(), strict=True) if known],
                "force_min_n": data.magnitude_n.min(),
                "force_max_n": data.magnitude_n.max(),
                "force_mean_n": data.magnitude_n.mean(),
                "fingerprint": evaluation.everything.fingerprint(),
                "truth": evaluation.truth_n is not None,
            },
            "bound": _bound(evaluation),
            "disturbed": evaluation.disturbed or None,
            "seed": evaluation.seed,
            "samples": evaluation.samples,
            "folds": evaluation.folds,
            "every": evaluation.every,
            "rows": [_row(row, evaluation) for row in evaluation.rows],
            "methods": {
                candidate.label: {
                    "method": candidate.recipe.name,
                    "settings": candidate.recipe.settings.model_dump(mode="json"),
                    "saved_model": candidate.saved is not None,
                    "interval_basis": _interval_basis(evaluation, candidate.label),
                    "time_per_frame": evaluation.timing[candidate.label],
                    "samples_table": five_samples(evaluation, candidate.label),
                }
                for candidate in evaluation.candidates
            },
            "thesis": {"mae_n": THESIS_MAE_N, "force_min_n": 0.160, "force_max_n": 0.275, "force_mean_n": 0.218,
                       "min_error_n": 0.0016, "max_error_n": 0.059, "by_direction": THESIS_DIRECTIONS},
            "versions": {"python": platform.python_version(), **{name: version(name) for name in _LIBRARIES}},
            "machine": f"{platform.system()} {platform.machine()}",
        }
    )  # fmt: skip


def _bound(evaluation: Evaluation) -> dict[str, Any] | None:
    """What the bounds that errors were held against have seen, and what they take for unknown."""
    bounds = evaluation.bounds
    if bounds is None or not bounds.std_n:
        return None
    return {"ways": {way: WAYS[way] for way in bounds.std_n}, "nuisances": bounds.nuisances}


def _interval_basis(evaluation: Evaluation, method: str) -> str | None:
    """What the method says its intervals rest on, under the strictest protocol."""
    row = evaluation.row(method, evaluation.honest)
    basis = row.fits[0].facts.get("interval_basis") if row is not None and row.fits else None
    return None if basis is None else str(basis)


def _views(evaluation: Evaluation) -> str:
    """What the samples are, in words."""
    first = next(evaluation.dataset.subset(np.array([0])).observations(), None)
    views = [] if first is None else list(first.views.values())
    if not views:
        return "the drives' readings"
    return "ready-made shape numbers" if isinstance(views[0], ShapeFeatures) else "a picture"


def _row(row: Row, evaluation: Evaluation) -> dict[str, Any]:
    constant = evaluation.row(Constant.name, row.protocol)
    return {
        "method": row.method,
        "protocol": row.protocol,
        "protocol_text": WORDS[row.protocol].name,
        "mae_over_constant": row.mae_n / constant.mae_n if constant is not None and constant.mae_n > 0 else None,
        "splits": _splits(row),
        "against_sensor": row.figures,
        "against_truth": row.truth_figures,
        "against_bound": row.bound_figures,
    }


def _splits(row: Row) -> Sequence[dict[str, Any]]:
    return [
        {
            "name": fit.split.name,
            "train": len(fit.split.train),
            "calibrate": len(fit.split.calibrate),
            "test": len(fit.split.test),
            "fit_s": fit.seconds,
            "facts": fit.facts,
        }
        for fit in row.fits
    ]


def _both(newtons: float) -> str:
    return f"{newtons_to_grams(newtons):.1f} g ({1e3 * newtons:.0f} mN)"
