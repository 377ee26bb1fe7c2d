"""`fusion`: how two estimates of one frame become one."""

import json
import math
from dataclasses import dataclass, replace

import numpy as np
import pytest

from tipforce.errors import ModelError
from tipforce.estimators import Fusion, FusionSettings
from tipforce.estimators._stretch import Stretch
from tipforce.estimators.fusion import FusionStream
from tipforce.estimators.uncertainty import GAUSS_90, Interval, gaussian_interval
from tipforce.types import ForceEstimate, Observation, Status

WIDE, NARROW = np.diag([0.04, 0.0004]), np.diag([0.0004, 0.04])


def estimate(force: tuple[float, float], covariance: np.ndarray) -> ForceEstimate:
    full, whole = np.full(3, np.nan), np.full((3, 3), np.nan)
    full[:2], whole[:2, :2] = force, covariance
    return ForceEstimate(
        stamp_ns=0,
        force_n=full,
        known=np.array([True, True, False]),
        covariance_n2=whole,
        interval_n=np.full((3, 2), np.nan),
        magnitude_n=float(np.hypot(*force)),
        magnitude_interval_n=np.array([0.0, 1.0]),
        contact=0.9,
    )


@dataclass
class Says:
    """A member that gives one estimate, and remembers whether an unsure one was asked for."""

    said: ForceEstimate
    unsure: bool = False

    def update(self, observation: Observation, *, unsure: bool = False) -> ForceEstimate:
        self.unsure = unsure
        return self.said


def interval(half: float) -> Interval:
    return Interval(np.full(3, half), half, np.full((3, 3), np.nan), False, "", 1, 1)


INTERVALS = {"both": interval(1.0), "rod": interval(2.0), "network": interval(3.0)}
NOTHING = ForceEstimate.invalid(0, Status.NO_CATHETER, "nothing dark at the left border")


STRAIGHT = ForceEstimate.invalid(0, Status.UNOBSERVABLE, "it is pushed along its own axis")


EQUAL = FusionSettings(rod_std_n=(0.0, 0.0), max_error_n=None)
ALWAYS = EQUAL.model_copy(update={"vouched_s": None})
SMALL = 1e-4 * np.eye(2)


def joined(rod: ForceEstimate, network: ForceEstimate, settings: FusionSettings = EQUAL) -> ForceEstimate:
    stream = FusionStream(Says(rod), Says(network), settings, INTERVALS)  # type: ignore[arg-type]
    return stream.update(Observation(0, {}, {}))


def test_an_interval_that_reaches_too_far_is_no_answer() -> None:
    both = estimate((0.3, 0.21), WIDE), estimate((0.28, 0.2), NARROW)
    free = joined(*both, FusionSettings(max_error_n=None))
    reach = float(free.magnitude_interval_n[1]) - free.magnitude_n
    assert joined(*both, FusionSettings(max_error_n=1.01 * reach)).valid
    refused = joined(*both, FusionSettings(max_error_n=0.99 * reach))
    assert refused.status is Status.UNOBSERVABLE
    assert "max_error_n" in refused.detail
    assert np.isnan(refused.magnitude_interval_n).all()
    assert refused.abstained_interval_n == tuple(free.magnitude_interval_n)
    assert refused.upper_n == free.upper_n


def test_a_contradiction_carries_the_interval_that_spans_both() -> None:
    rod = replace(estimate((0.5, 0.0), SMALL), magnitude_interval_n=np.array([0.45, 0.55]))
    network = replace(estimate((0.1, 0.0), SMALL), magnitude_interval_n=np.array([0.05, 0.15]))
    refused = joined(rod, network)
    assert refused.status is Status.OUT_OF_DISTRIBUTION
    assert refused.abstained_interval_n == (0.05, 0.55)


def test_each_gives_the_direction_that_it_knows():
    found = joined(estimate((0.3, 0.21), WIDE), estimate((0.12, 0.1), NARROW))
    assert found.valid
    assert abs(found.force_n[0] - 0.12) < 0.05
    assert abs(found.force_n[1] - 0.21) < 0.05
    assert np.isnan(found.force_n[2])
    assert found.magnitude_interval_n[0] < found.magnitude_n < found.magnitude_interval_n[1]


def test_a_contradiction_is_no_estimate():
    found = joined(estimate((0.3, 0.0), SMALL), estimate((0.1, 0.0), SMALL))
    assert found.status is Status.OUT_OF_DISTRIBUTION
    assert "0.30 N from the shape, 0.10 N from the image" in found.detail


@pytest.mark.parametrize(
    ("rod", "network", "source", "half"),
    [(estimate((0.2, 0.0), WIDE), NOTHING, "rod-track", 2.0), (STRAIGHT, estimate((0.2, 0.0), WIDE), "network", 3.0)],
    ids=["rod", "network"],
)
def test_one_carries_on_with_intervals_of_its_own(rod, network, source, half):
    found = joined(rod, network)
    assert found.valid
    assert found.detail == f"{source} alone"
    assert found.interval_n[0, 1] - found.force_n[0] == pytest.approx(half * 0.2)


def test_where_both_abstain_the_reasons_of_both_are_said():
    found = joined(NOTHING, ForceEstimate.invalid(0, Status.OUT_OF_DISTRIBUTION, "the catheter lies as nowhere"))
    assert found.status is Status.NO_CATHETER
    assert "nothing dark" in found.detail
    assert "lies as nowhere" in found.detail


def test_without_a_catheter_the_networks_answer_does_not_count():
    found = joined(NOTHING, estimate((0.2, 0.0), WIDE))
    assert found.status is Status.NO_CATHETER
    assert found.detail == NOTHING.detail


def test_the_rod_alone_may_reach_half_as_far_until_its_interval_was_checked():
    rod, limited = estimate((0.2, 0.0), 4e-4 * np.eye(2)), FusionSettings(max_error_n=0.05)
    unchecked = {**INTERVALS, "rod": gaussian_interval(np.array([True, True, False]), "the covariances alone")}
    reach = GAUSS_90 * 0.02
    assert 0.025 < reach < 0.05
    for intervals, valid in ((unchecked, False), ({**INTERVALS, "rod": interval(GAUSS_90)}, True)):
        stream = FusionStream(Says(rod), Says(NOTHING), limited, intervals)  # type: ignore[arg-type]
        assert stream.update(Observation(0, {}, {})).valid is valid


def test_a_network_alone_may_reach_half_as_far_where_the_tip_is_cut_off():
    cut_off = ForceEstimate.invalid(0, Status.CUT_OFF, "the tip cannot be told from what lies behind it")
    network = estimate((0.2, 0.0), SMALL)
    free = joined(cut_off, network, ALWAYS)
    limit = 1.5 * (float(free.magnitude_interval_n[1]) - free.magnitude_n)
    limited = ALWAYS.model_copy(update={"max_error_n": limit})
    assert joined(cut_off, network, limited).status is Status.UNOBSERVABLE
    assert joined(STRAIGHT, network, limited).valid
    assert joined(cut_off, network, ALWAYS.model_copy(update={"max_error_n": 2 * limit})).valid


def test_a_network_alone_counts_only_where_the_rod_has_vouched_for_it():
    network, cut_off = estimate((0.2, 0.0), SMALL), ForceEstimate.invalid(0, Status.CUT_OFF, "no end is seen")
    unlike = ForceEstimate.invalid(0, Status.OUT_OF_DISTRIBUTION, "no rod has this shape")
    apart = estimate((0.5, 0.0), SMALL)
    for rods, valid in (
        ([cut_off], False),
        ([network] * 5 + [cut_off], True),
        ([network] * 5 + [unlike] * 9, True),
        ([network] * 5 + [unlike] * 15, False),
        ([apart] * 5 + [cut_off], False),
        ([STRAIGHT] * 5 + [cut_off], True),
        ([unlike] * 300 + [network] * 150 + [cut_off], True),
    ):
        found = after(0.1, rods, network, EQUAL)
        assert found.valid is valid, len(rods)
        assert valid or found.status is rods[-1].status
        assert valid or "agreed with the network in too few" in found.detail
        assert after(0.1, rods, network, ALWAYS).valid


def test_a_contradiction_is_judged_by_what_is_believed_of_the_rod():
    small = 5e-5 * np.eye(2)
    both = estimate((0.3, 0.0), small), estimate((0.2, 0.0), small)
    assert not joined(*both).valid
    assert joined(*both, FusionSettings(rod_std_n=(0.05, 0.05), max_error_n=None)).valid


def after(seconds: float, rods: list[ForceEstimate], network: ForceEstimate, settings: FusionSettings) -> ForceEstimate:
    """The last answer, where the rod says one thing after another, ``seconds`` apart."""
    member = Says(rods[0])
    stream = FusionStream(member, Says(network), settings, INTERVALS)  # type: ignore[arg-type]
    found = stream.update(Observation(0, {}, {}))
    for index, rod in enumerate(rods):
        member.said = replace(rod, stamp_ns=round(index * seconds * 1e9))
        stream._network.said = replace(network, stamp_ns=member.said.stamp_ns)  # type: ignore[attr-defined]
        found = stream.update(Observation(member.said.stamp_ns, {}, {}))
    return found


def test_where_they_differ_by_more_than_they_promise_the_interval_is_wider():
    """Two standard deviations of their difference: the standard deviation of the joint answer doubles."""
    near, far = estimate((0.2, 0.0), SMALL), estimate((0.2 + 2 * 0.01 * 2**0.5, 0.0), SMALL)
    alike = joined(near, near).covariance_n2[:2, :2]
    assert alike == pytest.approx(0.5 * SMALL)
    assert joined(far, near).covariance_n2[:2, :2] == pytest.approx(4.0 * alike)
    assert joined(far, near).force_n[:2] == pytest.approx((near.force_n[:2] + far.force_n[:2]) / 2)
    silent = EQUAL.model_copy(update={"disagreement_s": None})
    assert joined(far, near, silent).covariance_n2[:2, :2] == pytest.approx(alike)


def test_what_is_added_along_the_axis_hides_no_disagreement():
    """There the rod's covariance promises too much, but of two that differ so far one is wrong all the same."""
    along = FusionSettings(rod_std_n=(0.0, 1.0), max_error_n=None)
    rod, network = estimate((0.3, 0.0), np.diag([2e-4, 1e-4])), estimate((0.2, 0.0), SMALL)
    found, alike = joined(rod, network, along), joined(replace(rod, force_n=network.force_n), network, along)
    assert found.covariance_n2[0, 0] == pytest.approx(0.1**2 / 3e-4 * alike.covariance_n2[0, 0])


@pytest.mark.parametrize("last", ["both", "network"])
def test_a_disagreement_is_remembered_for_a_moment(last):
    near, far = estimate((0.2, 0.0), SMALL), estimate((0.25, 0.0), SMALL)
    now = near if last == "both" else STRAIGHT
    usual = after(0.1, [near, now], near, EQUAL).covariance_n2[0, 0]
    soon = after(0.1, [near, *[far] * 9, now], near, EQUAL).covariance_n2[0, 0]
    later = after(0.1, [near, *[far] * 9, *[near] * 90, now], near, EQUAL).covariance_n2[0, 0]
    mean = 12.5 + (1.0 - 12.5) * math.exp(-0.9)
    assert soon / usual == pytest.approx(mean if last == "network" else mean * math.exp(-0.1))
    assert later == pytest.approx(usual)


@pytest.mark.parametrize(("rod", "unsure"), [(estimate((0.2, 0.0), WIDE), True), (STRAIGHT, True), (NOTHING, False)])
def test_an_unsure_network_counts_beside_the_rod_alone(rod, unsure):
    network = Says(NOTHING)
    FusionStream(Says(rod), network, EQUAL, INTERVALS).update(Observation(0, {}, {}))  # type: ignore[arg-type]
    assert network.unsure is unsure


def test_two_equal_answers_have_half_the_variance():
    found = joined(estimate((0.2, 0.1), WIDE), estimate((0.2, 0.1), WIDE))
    assert found.force_n[:2] == pytest.approx([0.2, 0.1])
    assert found.covariance_n2[:2, :2] == pytest.approx(0.5 * WIDE)


def test_the_rod_is_believed_least_where_it_tells_least():
    turned = np.array([[0.8, -0.6], [0.6, 0.8]])
    rod = estimate((0.2, 0.1), turned @ np.diag([1e-4, 9e-4]) @ turned.T)
    flat = estimate((0.2, 0.1), 1e6 * np.eye(2))
    found = joined(rod, flat, FusionSettings(rod_std_n=(0.01, 0.04), max_error_n=None))
    assert found.covariance_n2[:2, :2] == pytest.approx(turned @ np.diag([2e-4, 25e-4]) @ turned.T, rel=1e-3)


def test_a_stretch_is_of_what_the_network_has_a_part_in():
    network, rod = estimate((0.0, 0.2), SMALL), estimate((0.0, 0.2), SMALL)
    for pair, size in (((rod, network), 0.22), ((STRAIGHT, network), 0.22), ((rod, NOTHING), 0.2)):
        stream = FusionStream(*map(Says, pair), ALWAYS, INTERVALS, Stretch(0.2, 0.1))  # type: ignore[arg-type]
        found = stream.update(Observation(0, {}, {}))
        assert found.magnitude_n == pytest.approx(size)
        assert found.force_n[1] == pytest.approx(size)
        middle = 0.5 * found.interval_n[1].sum()
        assert middle == pytest.approx(size)


def test_what_was_never_calibrated_is_saved_and_read():
    """Its intervals are the network's; where the rod is alone, those of its covariances."""
    fresh = Fusion()
    fresh.stretch_ = Stretch(0.1, 0.05)
    values, arrays = fresh.state()
    again = Fusion.from_state(fresh.settings.model_dump(), json.loads(json.dumps(values)), arrays, fresh.files())
    assert again.describe() == fresh.describe()
    assert again.stretch_ == fresh.stretch_
    network = again.members.network.describe().interval_basis
    of_each = f"both: {network}; rod-track alone: the covariances alone; network alone: {network}"
    assert again.describe().interval_basis == of_each


def test_another_method_is_no_network():
    with pytest.raises(ModelError, match="is a model of dcfe; fusion needs one of compact"):
        Fusion(FusionSettings(network="pretrained/dcfe")).members  # noqa: B018 (read for its error)
