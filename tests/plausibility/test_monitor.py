import numpy as np

from tipforce.plausibility import ForceMonitor

from .bench_log import bench_log  # type: ignore[import-not-found]


def watched(stamps: np.ndarray, force: np.ndarray) -> ForceMonitor:
    monitor = ForceMonitor()
    for stamp, reading in zip(stamps.tolist(), force, strict=True):
        monitor.add(stamp, reading)
        if stamp % 1_000_000_000 == 0:
            assert monitor.findings is not None
    return monitor


def test_a_clean_stream_has_no_remark() -> None:
    monitor = ForceMonitor()
    stamps, force = bench_log(15.0)
    for stamp, reading in zip(stamps.tolist(), force, strict=True):
        monitor.add(stamp, reading)
        if stamp % 500_000_000 == 0:
            assert monitor.remark == ""


def test_clipping_is_named_while_it_lasts() -> None:
    stamps, force = bench_log(30.0)
    force[:10_000, 0] = np.minimum(force[:10_000, 0], 0.25)
    assert "clipped" in watched(stamps[:9_500], force[:9_500]).remark
    assert watched(stamps, force).remark == ""


def test_a_step_of_the_zero_stays_named() -> None:
    stamps, force = bench_log(30.0)
    force[9000:] += [0.2, 0.1, 0.0]
    (step,) = watched(stamps, force).findings
    assert (step.kind, round(step.start_s, 2)) == ("step of the zero", 9.0)
    assert "the readings jump by fx +0." in step.detail
