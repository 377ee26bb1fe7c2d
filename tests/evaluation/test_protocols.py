from dataclasses import replace

import numpy as np
import pytest

from tipforce.datasets import splits
from tipforce.errors import InputError
from tipforce.evaluation import AS_SAVED, Constant, EvaluationSettings, Method, evaluate, write_report
from tipforce.evaluation.report._drawings import whole_session
from tipforce.types import Catheter


def magnitude(row):
    return row.metrics["quantities"]["magnitude"]


def test_training_and_test_samples_never_meet(make_bench, make_ridge):
    data = make_bench(sessions=5)
    result = evaluate(data, [Method("ridge", make_ridge())])
    assert result.protocols == ("random", "blocked", "session")
    for row in result.results:
        for fit in row.fits:
            assert not set(fit.split.train.tolist()) & set(fit.split.test.tolist())
            if row.method == "ridge":
                assert fit.estimator.trained_rows_.tolist() == fit.split.train.tolist()


def test_no_session_lies_on_both_sides_of_the_session_protocol(make_bench, make_ridge):
    data = make_bench(sessions=5)
    result = evaluate(data, [Method("ridge", make_ridge())], EvaluationSettings(protocols=["session"]))
    row = result.result("ridge", "session")
    assert sorted(row.predictions.index.tolist()) == list(range(len(data)))
    for fit in row.fits:
        assert not set(data.session[fit.split.train]) & set(data.session[fit.split.test])


def test_the_random_protocol_is_the_thesis_split(make_bench, make_ridge):
    data = make_bench(sessions=8, frames=60)
    result = evaluate(data, [Method("ridge", make_ridge())], EvaluationSettings(protocols=["random"], samples=220))
    (fit,) = result.result("ridge", "random").fits
    assert (len(fit.split.train), len(fit.split.test)) == (165, 55)


def test_a_better_method_beats_the_constant_that_stands_beside_it(make_bench, make_ridge):
    result = evaluate(make_bench(), [Method("ridge", make_ridge())])
    for protocol in result.protocols:
        assert result.results[-1].method == "constant"
        assert result.result("ridge", protocol).mae_n < 0.5 * result.result("constant", protocol).mae_n


def test_the_constant_answers_the_mean_of_its_training_part(make_bench, make_ridge):
    data = make_bench()
    result = evaluate(data, [Method("ridge", make_ridge())], EvaluationSettings(protocols=["random"]))
    row = result.result("constant", "random")
    train = row.fits[0].split.train
    assert row.predictions.magnitude_n == pytest.approx(data.magnitude_n[train].mean())
    assert row.predictions.force_n[:, 0] == pytest.approx(data.force_n[train, 0].mean())
    assert np.isnan(row.predictions.force_n[:, 2]).all()


def test_the_constant_survives_being_stored(make_bench):
    data = make_bench()
    fitted = Constant().fit(data)
    again = Constant.from_state({}, *fitted.state())
    assert again.predict(data)[3].magnitude_n == fitted.predict(data)[3].magnitude_n
    stream = again.start(data.session_info["s0"])
    assert stream.update(next(data.observations())).force_n[0] == fitted.predict(data)[0].force_n[0]


def test_held_out_sessions_are_harder_than_random_frames_when_sessions_differ(make_bench, make_ridge):
    data = make_bench(sessions=6, shift_n=0.05)
    result = evaluate(data, [Method("ridge", make_ridge())])
    assert result.result("ridge", "session").mae_n > result.result("ridge", "random").mae_n


def test_a_method_with_memory_sees_all_frames_of_a_session(make_bench, make_ridge):
    data = make_bench(sessions=2, frames=30)
    result = evaluate(
        data, [Method("ridge", make_ridge(uses_history=True))], EvaluationSettings(protocols=["random"], samples=20)
    )
    outcome = result.result("ridge", "random").predictions
    drawn = result.dataset
    for place, index in enumerate(outcome.index.tolist()):
        frame_of_session = drawn.rows[index] % 30
        assert outcome.detail[place] == f"frame {frame_of_session + 1} of its stream"


def test_a_saved_model_is_scored_on_sessions_it_never_saw(make_bench, make_ridge):
    data = make_bench(sessions=4)
    saved = make_ridge().fit(data.subset(data.session != "s3"))
    method = Method("ridge", saved.unfitted(), saved, frozenset({"s0", "s1", "s2"}))
    result = evaluate(data, [method])
    row = result.result("ridge", AS_SAVED)
    assert set(row.predictions.session.tolist()) == {"s3"}
    assert any("without 3 of 4 sessions" in note for note in result.notes)


def test_weights_that_knew_sessions_of_the_data_are_noted(make_bench, make_ridge):
    data = make_bench()
    begun = Method("ridge", make_ridge(), trained_sessions=frozenset({"s1", "elsewhere"}))
    (note,) = evaluate(data, [begun], EvaluationSettings(protocols=["session"])).notes
    assert note.startswith("ridge is fine-tuned from weights that were trained on 1 of 4 sessions of these data (s1)")
    new = Method("ridge", make_ridge(), trained_sessions=frozenset({"elsewhere"}))
    assert not evaluate(data, [new], EvaluationSettings(protocols=["session"])).notes


def test_a_saved_model_is_not_scored_on_what_it_was_trained_on(make_bench, make_ridge):
    data = make_bench(sessions=4)
    saved = make_ridge().fit(data)
    for method in (
        Method("ridge", saved.unfitted(), saved, frozenset(data.sessions)),
        Method("ridge", saved.unfitted(), saved, trained_fingerprint=data.fingerprint()),
    ):
        result = evaluate(data, [method], EvaluationSettings(protocols=["random"]))
        assert result.result("ridge", AS_SAVED) is None
        assert any("trained on all sessions" in note for note in result.notes)


class Untrainable:
    """Mixed into a method: it may not be trained anew."""

    def fit(self, dataset, progress=None):
        raise AssertionError("trained")


def test_saved_models_alone_are_scored_without_any_training(make_bench, ridge_class, tmp_path, no_head_figures):
    data = make_bench(sessions=4)
    learnt = ridge_class().fit(data.subset(data.session == "s0"))
    kept = type("Kept", (Untrainable, ridge_class), {})()
    kept.weights_, kept.sigma_ = learnt.weights_, learnt.sigma_
    other = ridge_class().fit(data.subset(data.session == "s2"))
    methods = [
        Method("kept", kept.unfitted(), kept, frozenset({"s0"})),
        Method("other", other.unfitted(), other, frozenset({"s2"})),
    ]
    result = evaluate(data, methods, EvaluationSettings(as_saved=True, perturbed_frames=None))
    assert (result.protocols, result.strictest) == ((AS_SAVED,), AS_SAVED)
    for row in result.results:
        assert set(row.predictions.session.tolist()) == {"s1", "s3"}
    assert [row.method for row in result.results] == ["kept", "other", "constant"]
    tested = data.magnitude_n[np.isin(data.session, ["s1", "s3"])]
    assert result.result("constant", AS_SAVED).predictions.magnitude_n == pytest.approx(tested.mean())
    assert result.results[0].mae_n < 0.5 * result.results[2].mae_n
    assert any("best that any constant could do" in note for note in result.notes)
    figures = write_report(result, tmp_path / "r")
    assert figures["verdict"][0].startswith("As saved, on new sessions, ")
    assert not (tmp_path / "r" / "figures" / "kept-fig24.svg").exists()


def test_without_training_a_method_or_a_model_that_knows_all_sessions_is_refused(make_bench, make_ridge):
    data = make_bench(sessions=3)
    with pytest.raises(InputError, match="ridge is a method that has to be fitted"):
        evaluate(data, [Method("ridge", make_ridge())], EvaluationSettings(as_saved=True))
    saved = make_ridge().fit(data)
    method = Method("ridge", saved.unfitted(), saved, trained_fingerprint=data.fingerprint())
    with pytest.raises(InputError, match="ridge learnt from all of its sessions"):
        evaluate(data, [method], EvaluationSettings(as_saved=True))


def test_a_method_that_needs_no_fit_is_scored_as_it_comes(make_bench, make_ridge, monkeypatch):
    data, known = make_bench(sessions=3), make_ridge()
    known.fit(data)
    monkeypatch.setattr(type(known), "needs_fit", False)
    monkeypatch.setattr(type(known), "training_sessions", frozenset())
    result = evaluate(data, [Method("ridge", known)], EvaluationSettings(as_saved=True, perturbed_frames=None))
    assert [row.method for row in result.results] == ["ridge", "constant"]
    assert result.results[0].mae_n < 0.5 * result.results[1].mae_n


def test_one_session_cannot_be_held_out(make_bench, make_ridge):
    with pytest.raises(InputError, match="needs at least two sessions, got 1"):
        evaluate(make_bench(sessions=1), [Method("ridge", make_ridge())], EvaluationSettings(protocols=["session"]))


def test_one_session_still_gets_the_other_protocols_and_a_note(make_bench, make_ridge):
    result = evaluate(make_bench(sessions=1), [Method("ridge", make_ridge())])
    assert result.protocols == ("random", "blocked")
    assert any("session was left out" in note for note in result.notes)


def test_a_protocol_that_a_method_cannot_be_trained_under_is_left_out_with_its_reason(make_bench, ridge_class):
    class Hungry(ridge_class):
        def fit(self, dataset, progress=None):
            if len(set(dataset.session.tolist())) < 4:
                raise InputError("hungry needs four sessions")
            return super().fit(dataset, progress)

    data = make_bench(sessions=4)
    result = evaluate(data, [Method("hungry", Hungry())])
    assert result.protocols == ("random", "blocked")
    assert "Protocol session was left out: hungry needs four sessions." in result.notes
    with pytest.raises(InputError, match="hungry needs four sessions"):
        evaluate(data, [Method("hungry", Hungry())], EvaluationSettings(protocols=["random", "session"]))
    with pytest.raises(InputError, match="hungry needs four sessions"):
        evaluate(make_bench(sessions=3), [Method("hungry", Hungry())])


def test_two_methods_of_one_name_are_refused(make_bench, make_ridge):
    twice = [Method("ridge", make_ridge()), Method("ridge", make_ridge())]
    with pytest.raises(InputError, match="must differ"):
        evaluate(make_bench(), twice)


def test_the_same_seed_gives_the_same_figures(make_bench, make_ridge):
    first, second = (
        evaluate(make_bench(), [Method("ridge", make_ridge())], EvaluationSettings(samples=60, seed=4))
        for _ in range(2)
    )
    assert [magnitude(row) for row in first.results] == [magnitude(row) for row in second.results]


def test_truth_is_scored_beside_the_sensor(make_bench, make_ridge):
    data = make_bench()
    truth = np.nan_to_num(data.force_n)
    truth[:, 0] -= 0.05
    result = evaluate(
        data, [Method("ridge", make_ridge())], EvaluationSettings(protocols=["random"], samples=100), truth_n=truth
    )
    row = result.result("ridge", "random")
    assert row.truth_metrics["quantities"]["x"]["bias_n"] == pytest.approx(
        row.metrics["quantities"]["x"]["bias_n"] + 0.05
    )


def test_progress_only_moves_forward(make_bench, make_ridge):
    seen = []
    evaluate(make_bench(), [Method("ridge", make_ridge())], progress=lambda what, share: seen.append(share))
    assert seen == sorted(seen)
    assert seen[-1] == pytest.approx(1.0)


def test_time_per_frame_is_reported(make_bench, make_ridge):
    timing = evaluate(make_bench(), [Method("ridge", make_ridge())], EvaluationSettings(protocols=["random"])).timing[
        "ridge"
    ]
    assert 0 < timing["min_us"] <= timing["p50_us"] <= timing["p99_us"]


def test_the_trace_shows_all_frames_of_a_held_out_session_even_if_few_were_drawn(make_bench, make_ridge):
    data = make_bench(sessions=4, frames=50)
    truth = np.nan_to_num(data.force_n) + 1.0
    result = evaluate(data, [Method("ridge", make_ridge())], EvaluationSettings(samples=40), truth_n=truth)
    row = result.result("ridge", "session")
    assert np.sum(row.predictions.session == "s2") < 50
    trace = whole_session(result, row, "s2")
    assert trace.index.tolist() == list(range(100, 150))
    assert trace.reference_n[:, 0].tolist() == data.force_n[100:150, 0].tolist()
    assert np.abs(trace.magnitude_n - trace.reference_magnitude_n).max() < 0.15
    assert result.truth_n[trace.index].tolist() == truth[100:150].tolist()
    held = whole_session(result, result.result("ridge", "random"), "s2")
    assert held.stamp_ns.tolist() == data.stamp_ns[held.index].tolist()
    assert set(data.session[held.index].tolist()) == {"s2"}


def test_the_thesis_protocol_draws_from_the_first_eight_sessions(make_bench, make_ridge):
    data = make_bench(sessions=10, frames=80)
    for samples, counts in ((None, (165, 55)), (615, (461, 154))):
        row = evaluate(
            data, [Method("ridge", make_ridge())], EvaluationSettings(protocols=["thesis"], samples=samples)
        ).results[0]
        (fit,) = row.fits
        assert (len(fit.split.train), len(fit.split.test)) == counts
        assert set(data.session[fit.split.train]) == {f"s{i}" for i in range(8)}
    with pytest.raises(InputError, match="draws 220 samples, and the first 2 sessions have 80"):
        evaluate(make_bench(sessions=2), [Method("ridge", make_ridge())], EvaluationSettings(protocols=["thesis"]))


def test_the_thesis_protocol_draws_what_the_thesis_has_for_the_method(make_bench, make_ridge, monkeypatch):
    data = make_bench(sessions=8, frames=80)
    monkeypatch.setattr(type(make_ridge()), "thesis_samples", 615)
    (fit,) = evaluate(data, [Method("ridge", make_ridge())], EvaluationSettings(protocols=["thesis"])).results[0].fits
    assert (len(fit.split.train), len(fit.split.test)) == (461, 154)


def test_the_standard_protocol_trains_calibrates_and_tests_on_sessions_apart(make_bench, make_ridge):
    data = make_bench(sessions=8)
    result = evaluate(data, [Method("ridge", make_ridge())], EvaluationSettings(protocols=["standard"], every=2))
    assert result.strictest == "standard"
    row = result.result("ridge", "standard")
    (fit,) = row.fits
    parts = [set(result.dataset.session[part]) for part in (fit.split.train, fit.split.calibrate, fit.split.test)]
    assert parts == [{"s0", "s1"}, {"s2", "s3"}, {"s4", "s5", "s6", "s7"}]
    assert fit.estimator.trained_rows_.tolist() == data.rows[:80:2].tolist()
    assert fit.estimator.calibrated_rows_.tolist() == data.rows[80:160:2].tolist()
    assert len(row.predictions) == 80
    assert len(whole_session(result, row, "s5")) == 40
    with pytest.raises(InputError, match="at least four sessions"):
        evaluate(make_bench(sessions=3), [Method("ridge", make_ridge())], EvaluationSettings(protocols=["standard"]))


def with_catheters(data, *names):
    """The sessions of ``data``, each of the catheter of that name."""
    infos = {
        session: replace(data.session_info[session], catheter=Catheter(name, flexible_length_m=0.06))
        for session, name in zip(data.sessions, names, strict=True)
    }
    return replace(data, session_info=infos)


def test_the_catheter_protocol_trains_on_a_catheters_first_session_and_tests_on_its_others(make_bench, make_ridge):
    data = with_catheters(make_bench(sessions=6), "a", "a", "b", "a", "b", "c")
    result = evaluate(data, [Method("ridge", make_ridge())], EvaluationSettings(protocols=["catheter"]))
    row = result.result("ridge", "catheter")
    first, second = row.fits
    assert first.estimator.trained_rows_.tolist() == list(range(40))
    assert second.estimator.trained_rows_.tolist() == list(range(80, 120))
    assert set(data.session[first.split.test]) == {"s1", "s3"}
    assert set(row.predictions.session[row.predictions.fold == second.split.name]) == {"s4"}
    assert len(row.predictions) == 120
    assert row.mae_n < result.result("constant", "catheter").mae_n
    assert result.notes == ("Protocol catheter passes over 40 samples of catheters with a single session.",)
    assert len(whole_session(result, row, "s3")) == 40


def test_catheters_of_other_nominal_values_are_others(make_bench):
    data = with_catheters(make_bench(sessions=3), "a", "a", "a")
    longer = Catheter("a", flexible_length_m=0.07)
    infos = {**data.session_info, "s1": replace(data.session_info["s1"], catheter=longer)}
    (split,) = splits("catheter", replace(data, session_info=infos))
    assert set(data.session[split.train]) == {"s0"}
    assert set(data.session[split.test]) == {"s2"}


def test_catheters_with_one_session_each_cannot_be_judged_one_by_one(make_bench):
    with pytest.raises(InputError, match="each of the 3 catheters has a single one; record more"):
        splits("catheter", with_catheters(make_bench(sessions=3), "a", "b", "c"))


def test_calibration_moves_the_constants_interval_and_not_its_answer(make_bench):
    near, far = make_bench(), make_bench(sessions=9, shift_n=0.2)
    fitted = Constant().fit(near)
    before = fitted.predict(far)[0]
    after = fitted.calibrate(far).predict(far)[0]
    assert after.magnitude_n == before.magnitude_n
    assert np.ptp(after.magnitude_interval_n) > np.ptp(before.magnitude_interval_n)
