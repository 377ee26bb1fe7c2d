"""Names in stored graphs and arrays that differ from those in the code.

The graphs of the shipped models, and the arrays of `compact`, were made when some names were others. Both are read by
these tables. New files have the new names, which the tables leave unchanged.
"""

from collections.abc import Mapping
from typing import TypeVar

_Value = TypeVar("_Value")

_GRAPH = {
    "picture": "image",
    "sheet": "metadata",
    "contact": "contact_logit",
    "heat": "heatmap_logit",
    "familiar": "in_distribution_logit",
}
"""Inputs and outputs of a graph."""

_WEIGHTS = {
    "sheet.": "film.",
    "kept.": "grid_projection.",
    "again.": "hidden.",
    "answer.": "output_head.",
    "where.": "heatmap_head.",
    "familiar.": "distribution_head.",
}
"""Prefixes of parameters and buffers."""

_ARRAYS = {
    "doubt_untaught": "laplace_root_covariance",
    "limit_seen": "min_heatmap_px",
    "limit_sigma_n": "max_sigma_n",
    "limit_familiar": "min_in_distribution_logit",
    "usual_sigma_n": "typical_sigma_n",
    "lead_s": "rate_compensation_s",
    "lead_alone": "sigma_factor_without_history",
    "seen_side": "detected_base_side",
}
_OOD_ARRAYS = {"centre": "centre", "directions": "directions", "spread": "deviation", "rest_far": "scales"}
"""Arrays of the k-th distribution, with the prefix ``domain{k}_``, now ``ood{k}_``."""


def current_graph_name(name: str) -> str:
    """Returns the name in the code of an input or output of a stored graph.

    >>> current_graph_name("sheet"), current_graph_name("force_n")
    ('metadata', 'force_n')
    """
    return _GRAPH.get(name, name)


def current_weight_names(weights: Mapping[str, _Value]) -> dict[str, _Value]:
    """Returns the weights of a stored graph by their names in the code."""
    renamed: dict[str, _Value] = {}
    for name, value in weights.items():
        prefix = next((prefix for prefix in _WEIGHTS if name.startswith(prefix)), "")
        renamed[_WEIGHTS.get(prefix, "") + name.removeprefix(prefix)] = value
    return renamed


def current_array_names(arrays: Mapping[str, _Value]) -> dict[str, _Value]:
    """Returns the arrays of a stored model by their names in the code.

    >>> list(current_array_names({"domain0_rest_far": 1, "lead_s": 2, "ood1_centre": 3}))
    ['ood0_scales', 'rate_compensation_s', 'ood1_centre']
    """
    renamed: dict[str, _Value] = {}
    for name, value in arrays.items():
        prefix, _, kind = name.partition("_")
        if prefix.startswith("domain") and kind in _OOD_ARRAYS:
            renamed[f"ood{prefix.removeprefix('domain')}_{_OOD_ARRAYS[kind]}"] = value
        else:
            renamed[_ARRAYS.get(name, name)] = value
    return renamed
