import numpy as np
import pytest

from tipforce.plausibility import ForceFinding, ForcePlausibility, check_force_log

from .bench_log import BIAS_N, bench_log  # type: ignore[import-not-found]


def kinds(found: ForcePlausibility) -> set[tuple[str, str]]:
    return {(finding.kind, finding.axes) for finding in found.findings}


@pytest.mark.parametrize("rate_hz", [1000.0, 100.0, 30.0])
@pytest.mark.parametrize(("noise_n", "step_n"), [(3e-3, 5e-3), (3e-3, 0.0), (3e-4, 5e-3), (1e-3, 1e-4), (0.0, 5e-3)])
def test_a_clean_log_has_no_finding(rate_hz: float, noise_n: float, step_n: float) -> None:
    stamps, force = bench_log(rate_hz=rate_hz, noise_n=noise_n, step_n=step_n)
    found = check_force_log(stamps, force)
    assert found.lines() == []
    assert found.usable(stamps).all()
    np.testing.assert_array_equal(found.corrected(stamps, force), force)


def test_readings_with_an_error_status_are_not_used() -> None:
    stamps, force = bench_log()
    status = np.zeros(len(stamps), np.int64)
    force[5000:5300], status[5000:5300] = -13.0, 0x80010000
    found = check_force_log(stamps, force, status=status)
    assert [(f.kind, f.start_s, f.end_s, f.readings) for f in found.findings] == [("error status", 5.0, 5.299, 300)]
    assert "0x80010000" in found.lines()[0]
    assert np.flatnonzero(~found.usable(stamps)).tolist() == list(range(5000, 5300))


@pytest.mark.parametrize(("noise_n", "step_n"), [(3e-3, 5e-3), (3e-3, 0.0), (0.0, 5e-3)])
def test_a_plateau_at_the_end_of_the_range_is_clipping(noise_n: float, step_n: float) -> None:
    stamps, force = bench_log(noise_n=noise_n, step_n=step_n)
    clipped = force[:, 0] > BIAS_N[0] + 0.15
    force[clipped, 0] = BIAS_N[0] + 0.15
    found = check_force_log(stamps, force)
    assert kinds(found) == {("clipped", "x")}
    assert found.findings[0].size_n == pytest.approx(BIAS_N[0] + 0.15)
    assert not found.usable(stamps)[clipped].any()
    assert found.usable(stamps)[~clipped].mean() > 0.98


def test_readings_at_the_stated_range_are_clipped() -> None:
    stamps, force = bench_log()
    force[7000, 0] = 0.6
    assert kinds(check_force_log(stamps, force, range_n=(0.6, 0.6, 0.6))) == {("spike", "x"), ("clipped", "x")}
    force[7000, 0] = -0.6
    found = check_force_log(stamps, force, range_n=(0.6, 0.6, 0.6))
    assert [each.size_n for each in found.findings if each.kind == "clipped"] == [-0.6]


def test_single_readings_that_jump_are_spikes() -> None:
    stamps, force = bench_log()
    rows = [4100, 9000, 9001, 15000]
    force[rows, 1] += 2.0
    found = check_force_log(stamps, force)
    assert kinds(found) == {("spike", "y")}
    assert np.flatnonzero(~found.usable(stamps)).tolist() == rows


def test_an_axis_that_never_changes_gives_no_labels() -> None:
    stamps, force = bench_log()
    force[:, 2] = 0.0
    found = check_force_log(stamps, force)
    assert kinds(found) == {("dead axis", "z")}
    assert found.usable(stamps).all()
    corrected = found.corrected(stamps, force)
    assert np.isnan(corrected[:, 2]).all()
    np.testing.assert_array_equal(corrected[:, :2], force[:, :2])


def test_an_axis_that_dies_on_the_way_is_not_used_from_there_on() -> None:
    stamps, force = bench_log()
    force[14_000:, 1] = force[14_000, 1]
    found = check_force_log(stamps, force)
    assert kinds(found) == {("dead axis", "y")}
    assert np.flatnonzero(~found.usable(stamps))[0] == pytest.approx(14_000, abs=5)


@pytest.mark.parametrize("dropped", [True, False])
def test_short_gaps_are_bridged_and_long_ones_are_named(dropped: bool) -> None:
    stamps, force = bench_log()
    rows = np.r_[6000:6030, 9000:9400]
    if dropped:
        stamps, force = np.delete(stamps, rows), np.delete(force, rows, axis=0)
    else:
        force[rows] = np.nan
    found = check_force_log(stamps, force)
    assert (found.bridged, round(found.longest_bridged_s, 3)) == (1, 0.031)
    (gap,) = found.findings
    assert (gap.kind, gap.readings) == ("gap", 0 if dropped else 400)
    assert (gap.start_s, gap.end_s) == pytest.approx((8.999, 9.4))
    assert "1 gap of at most 50 ms bridged" in found.lines()[1]


def test_missing_readings_at_both_ends_are_named() -> None:
    stamps, force = bench_log()
    force[:200] = force[-300:] = np.nan
    assert [(f.kind, f.readings) for f in check_force_log(stamps, force).findings] == [("gap", 200), ("gap", 300)]


def test_findings_are_kept_in_a_record() -> None:
    stamps, force = bench_log()
    force[14_000:, 1] = force[14_000, 1]
    force[6000:6400] = np.nan
    found = check_force_log(stamps, force)
    found = ForcePlausibility(
        found.findings, found.unusable_ns, "z", {5_000_000_000: (0.1, 0.0, 0.0)}, bridged=2, longest_bridged_s=0.02
    )  # fmt: skip
    kept = ForcePlausibility.of(found.record())
    assert kept.record() == found.record()
    np.testing.assert_array_equal(kept.corrected(stamps, force), found.corrected(stamps, force))
    assert kept.corrected(stamps, force)[5500, 0] == pytest.approx(force[5500, 0] - 0.1)


@pytest.mark.parametrize(
    ("key", "text"),
    [
        ("findings", '[{"kind": "odd"}]'),
        ("findings", "[1]"),
        ("unusable_ns", "[[1, 2, 3]]"),
        ("dead_axes", "q"),
        ("zero_steps", "[[1, [1, 2]]]"),
        ("bridged", "some"),
    ],
)
def test_a_spoiled_record_is_refused(key: str, text: str) -> None:
    with pytest.raises((ValueError, TypeError)):
        ForcePlausibility.of(ForcePlausibility().record() | {key: text})


def test_a_finding_says_where_and_how_much() -> None:
    found = ForcePlausibility(tuple(ForceFinding("spike", k, k, "x", 2.0, 1) for k in range(6)))
    assert found.lines() == ["spike: 6 readings not used (0.000 s, 1.000 s, 2.000 s, 3.000 s and 2 more stretches)"]
