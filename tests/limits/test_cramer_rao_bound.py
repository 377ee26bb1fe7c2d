"""The bound of the simulated bench's sessions: what it stands on, and how it answers to more and less knowledge."""

import pickle
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest

from tipforce.limits import (
    CENTRELINE_NOISE,
    CONTACT_FORCE_PRIORS_N2,
    SESSION_NOISE,
    CentrelineNoise,
    CramerRaoBound,
    IndentationReading,
    bound_inputs,
    centreline_jacobian,
    describe_nuisances,
    noise_preset,
    perturb_lens,
    read_companion_bounds,
)
from tipforce.simulation import PRESETS, SimulatedBench, SimulationSettings, collect_truth, truth_path, write_truth
from tipforce.simulation.world.settings import ClockSettings, MotionSettings, WorldSettings

SHORT = SimulationSettings(
    world=WorldSettings(
        seconds=9.0, tare_s=2.0, clock=ClockSettings(fps=8.0), motion=MotionSettings(peak_within_n=5e-3)
    )
)


@pytest.fixture(scope="module")
def bench():
    return SimulatedBench(SHORT, 3, 0)


@pytest.fixture(scope="module")
def session(bench):
    return CramerRaoBound.of(bench)


def test_the_truth_of_a_recording_gives_the_bound_of_the_bench(bench, session):
    from_truth = CramerRaoBound.of(collect_truth(bench))
    assert from_truth.parameters == session.parameters
    np.testing.assert_allclose(from_truth.jacobian, session.jacobian, rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(
        from_truth.sequential().covariance_n2, session.sequential().covariance_n2, rtol=1e-5, atol=1e-12
    )


def test_the_slopes_are_taken_at_the_true_shape(bench, session):
    assert session.stable.all()
    inputs = bound_inputs(bench)
    camera = inputs.lens.camera(SHORT.width, SHORT.height)
    np.testing.assert_allclose(camera.project(inputs.lines_m[5]), bench.image_truth(5).centreline_px, atol=1e-6)


def test_a_base_moved_in_the_image_moves_every_point_alike(bench):
    inputs = bound_inputs(bench)
    straight = replace(inputs, lens=replace(inputs.lens, distortion=(0.0,) * 5, yaw_rad=0.0, pitch_rad=0.0))
    rows, arc, _ = centreline_jacobian(straight)
    right, down = rows["base, right"], rows["base, down"]
    # a unit move: across and along the line at the tip it adds up to one
    np.testing.assert_allclose(np.hypot(right[:, -2], right[:, -1]), 1.0, atol=5e-3)
    np.testing.assert_allclose(right[:, -2] ** 2 + down[:, -2] ** 2, 1.0, atol=1e-2)
    assert arc[-1] == pytest.approx(inputs.bench_model.rod.length_m, abs=4e-3)


def test_a_changed_lens_has_one_number_changed(bench):
    lens = bound_inputs(bench).lens
    assert perturb_lens(lens, "scale", 0.01).scale_m_per_px == pytest.approx(1.01 * lens.scale_m_per_px)
    assert perturb_lens(lens, "lens, p2", 1e-4).distortion[3] == pytest.approx(lens.distortion[3] + 1e-4)


def test_frames_before_help_and_so_does_all_that_is_known(session):
    each, along = session.single_frame(), session.sequential()
    touching = session.touching
    assert touching.any()
    assert not touching.all()
    assert (along.std_n <= each.std_n * (1 + 1e-9)).all()
    assert (session.sequential(free_known="none").std_n[touching] >= along.std_n[touching] * (1 - 1e-9)).all()
    for group in {unknown.group for unknown in session.parameters} - {"force"} | {SESSION_NOISE}:
        assert (session.single_frame([group]).std_n <= each.std_n * (1 + 1e-9)).all(), group
        assert (session.sequential([group]).std_n <= along.std_n * (1 + 1e-9)).all(), group
    finer = replace(session, noise=CentrelineNoise(session.noise.fresh.scaled(0.5), session.noise.lasting))
    assert (finer.single_frame().std_n[touching] < each.std_n[touching]).all()


def test_the_indentation_tells_the_force_along_the_normal_where_the_tissue_is_known(session):
    touching = session.touching & (np.linalg.norm(session.force_n, axis=1) > 0.05)
    shape = session.single_frame().magnitude_std_n[touching]
    known, open_, blind = (
        session.with_indentation(IndentationReading(*each)).single_frame().magnitude_std_n[touching]
        for each in ((1e-5, 1e-3, 1e-6), (1e-5, 0.8, 1e-6), (1.0, 0.8, 1.0))
    )
    stiffness = session.wall.stiffness_n_per_m
    assert np.median(known) < 0.05 * np.median(shape)
    assert (known > 0.5 * 1e-5 * stiffness).all(), "not better than the reading itself"
    assert (open_ > known).all()
    assert (open_ < shape * (1 + 1e-9)).all()
    np.testing.assert_allclose(blind, shape, rtol=1e-3)
    assert (
        session.with_indentation(IndentationReading(1e-5, 0.8, 1e-6)).sequential().magnitude_std_n[touching] <= open_
    ).all()


def test_the_indentation_of_another_law_has_no_bound(session):
    other = replace(session, wall=replace(session.wall, hertz_depth_m=2e-3))
    with pytest.raises(ValueError, match="linear tissue"):
        other.with_indentation(IndentationReading(1e-4, 0.8, 1e-4))


def test_the_bound_lies_between_the_noise_and_what_was_known_before(session):
    in_contact = np.linalg.norm(session.force_n, axis=1) > 0.05
    for bound in (session.single_frame(), session.sequential()):
        found = bound.fx_fy_magnitude_n[in_contact]
        assert (found > 2e-4).all()
        assert (found < 0.3).all()
    assert np.median(session.single_frame().std_n[in_contact, 1]) < 0.03  # lateral, in the plane of bending


def test_who_knows_what_forces_there_are_knows_more(session):
    learnt = CONTACT_FORCE_PRIORS_N2["bench-2021"]
    for found, broad in (
        (session.single_frame((), learnt), session.single_frame()),
        (session.sequential((), learnt), session.sequential()),
    ):
        assert (found.std_n[:, :2] <= broad.std_n[:, :2] * (1 + 1e-9)).all()
        assert (found.std_n <= np.sqrt(np.diag(learnt)) * (1 + 1e-9)).all()
    assert not session.single_frame(["depth"], learnt).std_n[:, 2].any()


def test_without_contact_nothing_is_left_to_find_and_without_force_there_is_no_magnitude(session):
    bound = session.sequential()
    assert not bound.std_n[~session.touching].any()
    none = np.linalg.norm(bound.force_n, axis=1) == 0
    assert np.isnan(bound.magnitude_std_n[none]).all()
    assert (session.sequential(free_known="none").std_n > 0).all()


def test_what_is_known_is_named_by_its_group(session):
    with pytest.raises(ValueError, match=r"known: expected some of .*length"):
        session.single_frame(["lenght"])
    with pytest.raises(ValueError, match="known"):
        session.sequential(["force"])


def test_a_known_depth_leaves_two_components(session):
    assert not session.single_frame(["depth"]).std_n[:, 2].any()


def test_only_presets_that_were_measured_have_a_noise(bench):
    other = SimulatedBench(SHORT.model_copy(update={"preset": "mine"}), 3, 0)
    with pytest.raises(ValueError, match="preset 'mine'"):
        CramerRaoBound.of(other)
    assert set(CENTRELINE_NOISE) == set(CONTACT_FORCE_PRIORS_N2) == {"bench-2021", "generalise"} <= set(PRESETS)


def test_sessions_of_another_length_look_like_their_presets_and_all_other_changes_do_not():
    generalise = PRESETS["generalise"]
    short = generalise.model_copy(
        update={"preset": "generalise changed", "world": generalise.world.model_copy(update={"seconds": 20.0})}
    )
    assert noise_preset(short) == "generalise"
    assert noise_preset({**short.model_dump(mode="json"), "seed": 1, "number": 2}) == "generalise"
    assert noise_preset(short.model_copy(update={"scale_error": 0.02})) is None
    assert all(noise_preset(settings) is None for name, settings in PRESETS.items() if name not in CENTRELINE_NOISE)
    assert noise_preset({}) is None


@pytest.fixture(scope="module")
def truths(bench, tmp_path_factory):
    """One session that has a bound, one of an X-ray preset, one of settings from elsewhere."""
    folder, truth = tmp_path_factory.mktemp("truths"), collect_truth(bench)
    fluoro = {**PRESETS["fluoro"].model_dump(mode="json"), "seed": 0, "number": 0}
    others = {"xray": fluoro, "strange": {**truth.settings, "tilt": 3.0}, "unwanted": truth.settings}
    for name, settings in {"good": truth.settings, **others}.items():
        write_truth(replace(truth, session=name, settings=settings), truth_path(folder / f"{name}.mcap"))
    return sorted(folder.iterdir())


def test_the_truths_beside_recordings_give_the_bounds_or_say_why_not(session, truths):
    found = {each.session: each for each in read_companion_bounds(truths, ["good", "xray", "strange"], workers=1)}
    assert list(found) == ["good", "strange", "xray"]
    good = found["good"]
    assert (good.preset, good.rejection_reason) == ("bench-2021", "")
    np.testing.assert_array_equal(good.stamp_ns, session.stamp_ns)
    np.testing.assert_allclose(good.contact_angle_deg, session.contact_angle_deg, rtol=1e-6)
    learnt = CONTACT_FORCE_PRIORS_N2["bench-2021"]
    for way, wanted in {
        "one_frame": session.single_frame((), learnt),
        "all_frames": session.sequential((), learnt),
        "one_frame_broad": session.single_frame(),
        "all_frames_broad": session.sequential(),
    }.items():
        np.testing.assert_allclose(good.std_n[way], wanted.fx_fy_magnitude_n, rtol=1e-4, atol=1e-9)
    assert (
        "measured on images of bench-2021 and generalise only, not of preset 'fluoro'" in found["xray"].rejection_reason
    )
    assert "tilt" in found["strange"].rejection_reason
    assert not found["xray"].std_n


class Workers(ThreadPoolExecutor):
    """Threads in place of processes, which take seconds to start; what goes to and fro is sent as between processes."""

    def map(self, work, todo):
        work = pickle.loads(pickle.dumps(work))
        return map(pickle.loads, super().map(lambda path: pickle.dumps(work(path)), todo))


def test_several_processes_find_the_same_bounds_in_the_same_order(truths, monkeypatch):
    monkeypatch.setattr("tipforce.limits._companion.worker_pool", Workers)
    steps = []
    one = read_companion_bounds(truths, ["good", "xray"], workers=1)
    several = read_companion_bounds(
        truths * 2, ["good", "xray"], workers=2, progress=lambda _, share: steps.append(share)
    )
    assert [each.session for each in several] == 2 * [each.session for each in one]
    np.testing.assert_array_equal(several[0].std_n["all_frames"], one[0].std_n["all_frames"])
    assert steps == pytest.approx(np.arange(1, 9) / 8)


def test_a_bound_is_told_with_all_that_it_takes_for_unknown(session, truths):
    (said,) = describe_nuisances(read_companion_bounds(truths, ["good", "xray"], workers=1))
    assert "bench-2021" in said
    assert said.count(". ") == 0
    for unknown in session.parameters:
        assert (unknown.name.replace(",", "") in said) == (unknown.group != "force"), unknown.name
    assert "free length (0.58 mm)" in said
    assert "73, 56, 5.6 mN" in said


def test_a_knob_that_has_crossed_its_backlash_is_known_to_have(session):
    assert session.play_open.all()  # it stands still
    moved = replace(session, play_open=np.zeros_like(session.play_open))
    one, two = (which.sequential(free_known="none").std_n for which in (moved, session))
    assert (one <= two * (1 + 1e-9)).all()
    assert (one[0] < 0.99 * two[0]).any()
