"""The thesis's own figures beside a method under its protocol, and whether they are like for like."""

from dataclasses import replace
from typing import ClassVar

import numpy as np
import pytest

from tipforce.evaluation import EvaluationSettings, Method, evaluate, report_lines
from tipforce.evaluation._thesis import beside_thesis
from tipforce.evaluation.report import _summary
from tipforce.types import SessionInfo


@pytest.fixture(scope="module")
def method_class(ridge_class):
    class Thesis(ridge_class):
        """Stands for method 1."""

        name = "svr"
        thesis_settings: ClassVar[dict[str, float]] = {"alpha": 1e-6}

    return Thesis


@pytest.fixture(scope="module")
def under_its_conditions(make_bench):
    """Eight simulated sessions that never leave 0.160 to 0.275 N."""
    data = make_bench(sessions=8, noise_n=0.0, shift_n=0.0)
    magnitude = np.hypot(data.force_n[:, 0], data.force_n[:, 1])
    share = (magnitude - magnitude.min()) / np.ptp(magnitude)
    wanted = 0.160 + 0.115 * share
    infos = {name: SessionInfo(name=name, simulated=True) for name in data.sessions}
    return replace(data, force_n=data.force_n * (wanted / magnitude)[:, None], session_info=infos)


def beside(data, method):
    result = evaluate(data, [Method("mine", method)], EvaluationSettings(protocols=["thesis"]))
    return result, beside_thesis(result)["mine"]


def test_under_the_thesis_s_conditions_the_bench_alone_differs(under_its_conditions, method_class):
    result, found = beside(under_its_conditions, method_class())
    assert found["text"] == "Like for like but for the bench: this is a simulated bench."
    mine, constant, thesis = found["rows"].values()
    assert mine["mae_n"] == result.results[0].mae_n
    assert mine["mae_n"] < constant["mae_n"] < thesis["mae_n"] == 0.042
    lines = report_lines(_summary.summary(result))
    thesis_line = lines[lines.index("Beside the thesis:") + 4]
    assert thesis_line.split()[-6:] == ["0.160-0.275", "42", "1.6", "59", "–", "–"]
    assert found["text"] in lines


def test_each_condition_that_differs_is_named(make_bench, method_class, ridge_class):
    changed = method_class(ridge_class.settings_type(alpha=0.5))
    _, found = beside(make_bench(sessions=8, noise_n=0.0), changed)
    assert found["text"].startswith("Not like for like: another bench; forces of 0.0")
    assert "(thesis: 0.160 to 0.275 N)" in found["text"]
    assert found["text"].endswith("alpha=0.5 (to the letter: 1e-06).")


def test_other_methods_and_protocols_have_nothing_beside_them(under_its_conditions, method_class, make_ridge):
    for method, protocol in ((method_class(), "random"), (make_ridge(), "thesis")):
        result = evaluate(under_its_conditions, [Method("mine", method)], EvaluationSettings(protocols=[protocol]))
        assert beside_thesis(result) == {}
