"""The model card: facts that a person needs before using a model."""

from collections.abc import Mapping
from typing import Any

from ...types import DEFAULT_VIEW, views_text
from .._base import Estimator
from .._facts import ModelFacts, count_of


def model_card(estimator: Estimator, manifest: Mapping[str, Any]) -> str:
    """Returns ``README.md`` of a model folder.

    Args:
        estimator: the fitted method.
        manifest: content of its ``model.json``.
    """
    training, facts = manifest["training"], estimator.describe()
    summary = facts.summary()
    low, high = training["force_range_n"]
    sessions = training["sessions"]
    inputs = f"{summary.inputs} " if summary.inputs else ""
    basis = f"The interval rests on: **{facts.interval_basis}**{_calibrated(training)}."
    simulated = "All of it was simulated: the model knows only the simulated bench, and no image of a real one."
    paragraphs = [
        f"# {manifest['method']}: force at a catheter's tip from images",
        (
            f"Learnt from {_samples_text(training['samples'], facts)} of **{training['title']}** "
            f"({count_of(len(sessions), 'session')}: {_listed(sessions)}), "
            f"forces from {low * 1e3:.0f} to {high * 1e3:.0f} mN."
        ),
        *([simulated] if training["simulated"] else []),
        "**Research use only.** Not for diagnosis or treatment.",
        "## Use",
        "```\ntipforce estimate THIS_FOLDER video.mp4 --bench bench.toml -o forces.csv\n```",
        _needs(estimator),
        "## Inputs",
        (
            f"{inputs}It reads {views_text(estimator.views)}. Forces are in newtons, on the axes: "
            f"{_axes(manifest['frame_of_forces'])}."
        ),
        "\n".join(["## Accuracy", "", *summary.performance]),
        basis if facts.interval_basis else "The method states no intervals.",
    ]
    if manifest["metrics"]:
        figures = manifest["metrics"].items()
        rows = [f"- {name}: {f'{value:.4g}' if isinstance(value, float) else value}" for name, value in figures]
        paragraphs += ["Measured on samples that were not used for training:", "\n".join(rows)]
    versions = ", ".join(f"{name} {number}" for name, number in manifest["versions"].items())
    paragraphs += [
        "## Limits",
        (
            "Another catheter, another camera view, larger forces or stronger bends than above: there the model has no "
            "training data. For a frame without an estimate the output states the reason, never an old number."
        ),
        "## Made with",
        (
            f"{versions}; seed {manifest['seed']}; training data {training['fingerprint'][:16]}. "
            "Every setting is in `model.json`.\n"
        ),
    ]
    return "\n\n".join(paragraphs)


def _needs(estimator: Estimator) -> str:
    """Returns the entries of `bench.toml` that this model needs."""
    required = list(estimator.required_metadata)
    if "knob_deg" in estimator.required_actuation or "actuation.knob_gain_per_m_deg" in required:
        required.append("the angle of the knob (actuation.constant.knob_deg, where it is not in the recording)")
    needs = f" This model needs of it: {', '.join(required)}." if required else ""
    return f"`bench.toml` describes the bench; `tipforce init-bench -o bench.toml` writes one.{needs}"


def _calibrated(training: Mapping[str, Any]) -> str:
    on = training.get("calibration")
    return "" if on is None else f", {count_of(len(on['sessions']), 'session')} of {on['title']}"


def _listed(names: list[str], max_names: int = 10) -> str:
    more = f" and {len(names) - max_names} more" if len(names) > max_names else ""
    return ", ".join(names[:max_names]) + more


def _axes(frame: str | list[str]) -> str:
    if frame == "base":
        return "x along the catheter's base, y to its left in the image"
    return f"{frame} (not this program's base frame)" if isinstance(frame, str) else ", ".join(frame)


def _samples_text(samples: int, facts: ModelFacts) -> str:
    left_out = sum(lost for lost, _ in facts.left_out.values())
    return f"{samples - left_out} of {samples} samples" if left_out else f"{samples} samples"


def training_lines(estimator: Estimator, manifest: Mapping[str, Any]) -> list[str]:
    """Returns the lines that are printed after a training.

    Args:
        estimator: the fitted method.
        manifest: content of its ``model.json``.
    """
    training, facts = manifest["training"], estimator.describe()
    summary = facts.summary()
    learnt = (
        f"Learnt from {_samples_text(training['samples'], facts)} of {training['title']} "
        f"({count_of(len(training['sessions']), 'session')})"
    )
    read = "" if estimator.views == (DEFAULT_VIEW,) else f", {views_text(estimator.views)}"
    lines = [
        (f"{learnt}, {summary.short_inputs}" if summary.short_inputs else learnt) + read,
        *(f"  {line}" for line in summary.training),
        *([f"  interval from: {facts.interval_basis}"] if facts.interval_basis else []),
    ]
    for name in ("magnitude", "fx", "fy", "fz"):
        rmse = manifest["metrics"].get(f"{name}_rmse_n")
        if rmse is not None:
            mae = manifest["metrics"][f"{name}_mae_n"]
            lines.append(f"  held out, {name}: RMSE {rmse * 1e3:.1f} mN, mean error {mae * 1e3:.1f} mN")
    return lines
