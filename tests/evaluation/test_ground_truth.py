"""The true force and the Cramer-Rao bounds of samples, and errors over the bounds."""

import json

import numpy as np
import pytest

from tipforce.errors import InputError
from tipforce.evaluation import (
    BOUND_KINDS,
    CramerRaoBounds,
    EvaluationSettings,
    Method,
    Predictions,
    bound_at,
    bound_ratios,
    evaluate,
    report_lines,
    write_report,
)


def outcome(force, estimate, index=None):
    n = len(force)
    size = np.linalg.norm(force, axis=1)
    texts = np.full(n, "a")
    return Predictions(
        method="m", protocol="session", index=np.arange(n) if index is None else index, fold=texts, session=texts,
        names=texts, stamp_ns=np.arange(n), reference_n=force, reference_magnitude_n=size, contact=size > 0.01,
        force_n=estimate, magnitude_n=np.linalg.norm(estimate, axis=1), interval_n=np.zeros((n, 3, 2)),
        magnitude_interval_n=np.zeros((n, 2)), status=texts, detail=texts, shape=np.full(n, None),
    )  # fmt: skip


def made(count=4000, seed=0):
    rng = np.random.default_rng(seed)
    force = np.column_stack([rng.uniform(-0.3, -0.02, (count, 2)), np.zeros(count)])
    bound = np.column_stack([rng.uniform(5e-3, 5e-2, (count, 2)), np.full(count, np.nan)])
    way = force / np.linalg.norm(force, axis=1, keepdims=True)
    bound[:, 2] = np.sqrt(np.sum((way[:, :2] * bound[:, :2]) ** 2, axis=1))
    noise = np.column_stack([bound[:, :2], np.zeros(count)]) * rng.standard_normal((count, 3))
    return force, noise, bound, rng.uniform(0, 90, count)


def test_errors_as_large_as_their_bound_have_the_ratio_one_in_every_bin():
    force, noise, bound, angle = made()
    found = bound_ratios(outcome(force, force + noise), bound, angle)
    for quantity in ("x", "y"):
        assert found[quantity]["all"]["n"] == 4000
        assert found[quantity]["all"]["ratio"] == pytest.approx(1.0, abs=0.05)
        assert [row["ratio"] for row in found[quantity]["by_contact_angle"]] == pytest.approx([1.0] * 6, abs=0.15)
    assert found["magnitude"]["all"]["ratio"] == pytest.approx(1.0, abs=0.08)
    assert sum(row["n"] for row in found["x"]["by_contact_angle"]) == 4000
    twice = bound_ratios(outcome(force, force + 2 * noise), bound, angle)
    assert twice["x"]["all"]["ratio"] == pytest.approx(2 * found["x"]["all"]["ratio"])
    assert found["x"]["all"]["rms_ratio"] == pytest.approx(1.0, abs=0.05)


def test_a_few_large_errors_show_in_the_ratio_of_the_root_mean_squares():
    force, noise, bound, _ = made()
    noise[:40] *= 30
    found = bound_ratios(outcome(force, force + noise), bound)["y"]["all"]
    assert found["ratio"] == pytest.approx(1.0, abs=0.05)
    assert found["rms_ratio"] > 2


def test_only_answered_samples_in_contact_with_a_bound_count():
    force, noise, bound, _ = made(100)
    estimate = force + noise
    force[:10], estimate[10:30], bound[30:60] = 0.0, np.nan, np.nan
    found = bound_ratios(outcome(force, estimate), bound)
    assert found["y"]["all"]["n"] == 40
    assert "by_contact_angle" not in found["y"]
    nothing = bound_ratios(outcome(force, estimate), np.full_like(bound, np.nan))
    assert nothing["magnitude"]["all"]["n"] == 0
    assert np.isnan(nothing["magnitude"]["all"]["ratio"])


def test_bounds_are_those_of_the_outcomes_own_samples():
    force, noise, bound, _ = made(100)
    some = np.arange(20, 50)
    part = bound_ratios(outcome(force[some], (force + noise)[some], some), bound)
    assert part["x"]["all"]["median_bound_n"] == pytest.approx(np.median(bound[some, 0]))


def test_bounds_find_their_samples_by_session_and_stamp(make_bench):
    planar = make_bench()
    rows = np.flatnonzero(planar.session == planar.sessions[0])
    stamps = np.sort(planar.stamp_ns[rows])
    values = np.arange(3.0 * len(stamps)).reshape(-1, 3) + 1.0
    found = bound_at(planar, {planar.sessions[0]: (stamps + 100_000, values)})
    np.testing.assert_array_equal(found[rows[np.argsort(planar.stamp_ns[rows])]], values)
    assert np.isnan(np.delete(found, rows, axis=0)).all()
    with pytest.raises(InputError, match="has a bound"):
        bound_at(planar, {"elsewhere": (stamps, values)})


SAID = "Bound of these: everything is unknown, each to its own width."


def bounds_of(data, factor=1.0):
    """CramerRaoBounds that grow from sample to sample, so that a wrong choice of samples shows."""
    std = np.linspace(1e-3, 2e-3, 3 * len(data)).reshape(-1, 3)
    ways = {way: factor * (place + 1) * std for place, way in enumerate(BOUND_KINDS)}
    return CramerRaoBounds(ways, np.linspace(0, 89, len(data)), (SAID,), ("No bound for 2 sessions: for a reason.",))


@pytest.fixture(scope="module")
def judged(make_bench, make_ridge):
    data = make_bench(sessions=3, frames=60)
    truth = np.nan_to_num(data.force_n)
    return evaluate(
        data, [Method("ridge", make_ridge())], EvaluationSettings(every=2), truth_n=truth, bounds=bounds_of(data)
    )


def test_every_method_is_held_against_the_bounds_of_the_samples_it_was_scored_on(judged):
    own = judged.bounds
    for row in judged.results:
        held = row.bound_ratios["one_frame"]["magnitude"]["all"]
        places = row.predictions.index[row.predictions.contact]
        assert held["n"] == len(places)
        assert held["median_bound_n"] == pytest.approx(np.median(own.std_n["one_frame"][places, 2]))
        twice = row.bound_ratios["all_frames"]["magnitude"]["all"]
        assert twice["ratio"] == pytest.approx(held["ratio"] / 2)
    assert len(own.contact_angle_deg) == len(judged.dataset) == len(judged.everything) // 2


def test_the_report_tells_ratios_with_their_nuisances_in_page_figures_and_terminal(judged, tmp_path, no_method_figures):
    figures = write_report(judged, tmp_path / "report")
    stored = json.loads((tmp_path / "report" / "metrics.json").read_text(encoding="utf-8"))
    assert stored["cramer_rao_bound"] == {"kinds": BOUND_KINDS, "nuisances": [SAID]}
    assert set(stored["results"][0]["against_bound"]) == set(BOUND_KINDS)
    assert "No bound for 2 sessions: for a reason." in stored["notes"]
    page = (tmp_path / "report" / "report.html").read_text(encoding="utf-8")
    assert "Against the Cramér-Rao bound" in page
    assert SAID in page
    assert "0 to 15 deg" in page
    drawing = (tmp_path / "report" / "figures" / "bound.svg").read_text(encoding="utf-8")
    assert "ridge, all frames until then" in drawing
    lines = report_lines(figures)
    ratio = next(row for row in stored["results"] if (row["method"], row["protocol"]) == ("ridge", "session"))
    ratio = ratio["against_bound"]["one_frame"]["magnitude"]["all"]["ratio"]
    (line,) = [line for line in lines if "Cramer-Rao" in line]
    assert f"ridge {ratio:.2f} (one frame)" in line
    assert SAID not in "".join(lines)
    folded = page[page.index("<details>") :]
    assert SAID in folded[: folded.index("</details>")]


def test_a_report_without_bounds_is_silent_about_them_but_for_the_reason(
    make_bench, make_ridge, tmp_path, no_method_figures
):
    data = make_bench(sessions=2)
    none = CramerRaoBounds({}, np.full(len(data), np.nan), (), ("No bound for 2 sessions: for a reason.",))
    truth = np.nan_to_num(data.force_n)
    result = evaluate(
        data, [Method("ridge", make_ridge())], EvaluationSettings(protocols=["random"]), truth_n=truth, bounds=none
    )
    figures = write_report(result, tmp_path / "report")
    assert figures["cramer_rao_bound"] is None
    assert figures["results"][0]["against_bound"] is None
    assert figures["notes"] == ["No bound for 2 sessions: for a reason."]
    assert "Cramér-Rao" not in (tmp_path / "report" / "report.html").read_text(encoding="utf-8")
    assert not (tmp_path / "report" / "figures" / "bound.svg").exists()


def test_bounds_need_the_truth_and_all_samples(make_bench, make_ridge):
    data = make_bench(sessions=2)
    method = [Method("ridge", make_ridge())]
    with pytest.raises(ValueError, match="truth_n"):
        evaluate(data, method, bounds=bounds_of(data))
    some = bounds_of(data).at(np.arange(5))
    with pytest.raises(ValueError, match="all samples"):
        evaluate(data, method, truth_n=np.nan_to_num(data.force_n), bounds=some)
    with pytest.raises(ValueError, match="one_frame"):
        CramerRaoBounds({"mine": np.ones((4, 3))}, np.ones(4), ())
    with pytest.raises(ValueError, match=r"\(4, 3\)"):
        CramerRaoBounds({"one_frame": np.ones((4, 2))}, np.ones(4), ())
