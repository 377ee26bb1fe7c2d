"""What the images of a session tell about its tissue, and the force that follows."""

import numpy as np
import pytest

from tipforce.estimators.networks._compact_estimates import AbstentionLimits, CompactEstimateBuilder, magnitude_sigma
from tipforce.estimators.networks._rate_compensation import History, RateCompensation
from tipforce.estimators.networks._tissue import TissueBelief, TissueEvidence, fit_tissue_evidence
from tipforce.estimators.uncertainty import Interval, LastLayerLaplace, fit_ood_detector
from tipforce.training import TISSUE_N_PER_M

CLASSES = len(TISSUE_N_PER_M)
EVEN = TissueEvidence(np.full(CLASSES, -np.log(CLASSES)), 0.1)
SECOND = 1_000_000_000


def towards(number: int, strength: float = 1.0) -> np.ndarray:
    return strength * (np.arange(CLASSES) == number).astype(np.float32)


def test_images_of_one_class_narrow_the_belief_and_forgetting_bounds_it():
    belief = TissueBelief(EVEN)
    shares = [belief.shares(k * SECOND, towards(2))[2] for k in range(200)]
    assert shares[0] == pytest.approx(np.e / (np.e + CLASSES - 1))  # the first is as the network says
    assert shares[0] < shares[20] < shares[60]
    assert 0.9 < shares[-1] < 0.9999


def test_near_frames_count_as_one():
    often, seldom = TissueBelief(EVEN), TissueBelief(EVEN)
    many = [often.shares(k * SECOND // 60, towards(2)) for k in range(601)][-1]
    few = [seldom.shares(k * SECOND // 4, towards(2)) for k in range(41)][-1]
    np.testing.assert_allclose(many, few, rtol=0.1)


def test_a_late_frame_adds_nothing():
    belief = TissueBelief(EVEN)
    belief.shares(SECOND, towards(2))
    now = belief.shares(SECOND, towards(5, 9.0))
    np.testing.assert_allclose(belief.shares(0, towards(5, 9.0)), now)


def test_a_stated_stiffness_is_where_the_belief_begins():
    shares = TissueBelief(EVEN, 60.0).shares(0, np.zeros(CLASSES, np.float32))
    assert float(shares @ np.log(TISSUE_N_PER_M)) == pytest.approx(np.log(60.0), abs=0.05)
    assert shares[1] + shares[2] > 0.9


def sessions(strength: float, shared: float) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """24 sessions of 30 images, whose errors are partly ``shared`` within a session."""
    draw = np.random.default_rng(0)
    number = draw.integers(0, CLASSES, 24)
    wrong = shared * draw.normal(size=(24, 1, CLASSES)) + draw.normal(size=(24, 30, CLASSES))
    logits = strength * (np.arange(CLASSES) == number[:, None, None]) + wrong
    stamps = np.tile(np.arange(30) * SECOND, 24)
    truth = np.repeat(np.log(TISSUE_N_PER_M)[number], 30)
    return np.repeat([f"s{k:02d}" for k in range(24)], 30), stamps, logits.reshape(-1, CLASSES), truth


def test_images_that_share_their_error_count_less():
    independent, alike = (fit_tissue_evidence(*sessions(1.0, shared), None) for shared in (0.0, 2.0))
    assert independent.weight > 2 * alike.weight
    assert np.exp(independent.log_share).sum() == pytest.approx(1.0)


def test_a_fine_tuned_network_keeps_the_weight_where_no_tissue_is_stated_and_expects_what_it_saw():
    session, stamps, logits, truth = sessions(4.0, 0.0)
    one = truth == truth[0]
    found = fit_tissue_evidence(session[one], stamps[one], logits[one], np.full(one.sum(), np.nan), EVEN)
    assert found.weight == EVEN.weight
    assert tuple(TISSUE_N_PER_M)[int(np.argmax(found.log_share))] == pytest.approx(np.exp(truth[0]))


def builder(tissue: TissueBelief | None) -> CompactEstimateBuilder:
    draw = np.random.default_rng(0)
    grids = draw.normal(size=(60, 8)).astype(np.float32)
    return CompactEstimateBuilder(
        known=np.array([True, True, False]),
        unit_n=0.1,
        laplace=LastLayerLaplace(np.zeros((4, 4))),
        ood=fit_ood_detector(grids[:30], grids[30:], grids[30:], None),
        limits=AbstentionLimits(0.0, 10.0, -np.inf),
        interval=Interval(np.array([1.6, 1.6, np.nan]), 1.6, np.full((3, 3), np.nan), True, "", 1, 1),
        compensation=RateCompensation(np.zeros((2, 2)), 1.0),
        history=History(),
        tissue=tissue,
    )


def outputs(depth: float) -> dict[str, np.ndarray]:
    """The force is what the tissue makes of ``depth``; the image does not say which tissue it is."""
    force = np.zeros((1, CLASSES, 2), np.float32)
    force[0, :, 1] = depth * np.array(TISSUE_N_PER_M)
    return {
        "heatmap_logit": np.zeros((1, 2, 2), np.float32),
        "in_distribution_logit": np.ones(1, np.float32),
        "contact_logit": np.ones(1, np.float32),
        "grid": np.zeros((1, 8), np.float32),
        "features": np.zeros((1, 4), np.float32),
        "force_n": force.mean(axis=1),
        "log_variance": np.zeros((1, 2), np.float32),
        "tissue_force_n": force,
        "tissue_log_variance": np.full((1, CLASSES, 2), -6.0, np.float32),
        "tissue_logits": np.zeros((1, CLASSES), np.float32),
    }


def test_a_dent_in_unknown_tissue_leaves_the_force_open_and_says_so():
    unknown = builder(TissueBelief(EVEN))(0, outputs(1e-3))
    stated = builder(TissueBelief(EVEN, 146.0))(0, outputs(1e-3))
    width = [float(np.diff(each.interval_n[1])[0]) for each in (unknown, stated)]
    assert stated.force_n[1] == pytest.approx(0.146, abs=0.015)
    assert width[0] > 3 * width[1]
    assert unknown.interval_n[1, 0] < 0.06 < 0.3 < unknown.interval_n[1, 1]


def test_the_classes_move_magnitude_and_force_together():
    """A covariance along the force is one of its magnitude, across it hardly."""
    force = np.array([0.3, 0.4])
    along, across = force / 0.5, np.array([-0.8, 0.6])
    assert magnitude_sigma(force, 0.01 * np.outer(along, along)) == pytest.approx(0.1, rel=0.02)
    assert magnitude_sigma(force, 0.01 * np.outer(across, across)) < 0.02
