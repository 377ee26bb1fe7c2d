import math
from itertools import islice

import cv2
import numpy as np
import pytest
from pydantic import ValidationError

from tipforce.errors import InputError
from tipforce.twin.small import SmallBench, SmallBenchSettings
from tipforce.types import Actuation, Frame, Source, Wrench

SHORT = SmallBenchSettings(seconds=9, tare_s=3)


@pytest.fixture(scope="module", params=[0, 3])
def bench(request):
    return SmallBench(SHORT, seed=5, session=request.param)


def test_it_is_a_source_whose_streams_are_in_order(bench):
    assert isinstance(bench, Source)
    with bench as events:
        seen = list(islice(events, 3000))
    for kind in (Frame, Wrench, Actuation):
        stamps = [event.stamp_ns for event in seen if isinstance(event, kind)]
        assert len(stamps) > 40
        assert (np.diff(stamps) > 0).all()
    assert next(e for e in seen if isinstance(e, Actuation)).values == {"knob_deg": 10.0}
    assert {e.frame for e in seen if isinstance(e, Wrench)} == {"sensor"}
    assert bench.clock.now_ns() >= max(e.stamp_ns for e in seen if isinstance(e, Frame))


def test_the_same_arguments_give_the_same_bytes_and_others_do_not():
    one, two = (SmallBench(SHORT, seed=5) for _ in range(2))
    np.testing.assert_array_equal(one.picture(100), two.picture(100))
    np.testing.assert_array_equal(one.force_log().force_n, two.force_log().force_n)
    for other in (SmallBench(SHORT, seed=6), SmallBench(SHORT, seed=5, session=1)):
        assert (other.picture(100) != one.picture(100)).any()
        assert other.truth().values != one.truth().values
    assert (one.picture(100) != one.picture(101)).any()


def test_forces_and_free_time_are_what_the_settings_ask_for(bench):
    truth = bench.truth()
    size = np.linalg.norm(truth.force_n, axis=1)
    seconds = truth.stamp_ns * 1e-9
    assert 0.13 < size.max() < 0.37
    assert not size[seconds < 3].any()
    assert 0.0 < 1 - truth.touching[seconds > 4.5].mean() < 0.3
    assert not truth.force_n[:, 2].any()


def test_the_force_pushes_the_tip_away_from_the_wall(bench):
    truth = bench.truth()
    angle = truth.values["wall_angle_rad"]
    into, along = (
        truth.force_n[truth.touching, :2] @ d for d in ([np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)])
    )
    assert (into < 0).all()
    assert (np.abs(along) <= truth.values["friction"] * -into + 1e-9).all()


def test_the_sensor_reads_the_opposite_in_its_own_frame_and_on_its_own_clock(bench):
    truth, log, facts = bench.truth(), bench.force_log(), bench.public()
    assert facts["reads"] == "tip-on-tissue"
    angle = math.radians(facts["sensor_angle_deg"])
    tared = log.force_n - log.force_n[100:2800].mean(axis=0)
    c, s = math.cos(angle), math.sin(angle)
    base = -tared[:, :2] @ np.array([[c, s], [-s, c]])
    at_frames = truth.stamp_ns * 1e-9 - truth.clock_offset_s
    good = (at_frames > 0.02) & (at_frames < log.time_s[-1] - 0.02)
    smooth = cv2.blur(base, (1, 5), borderType=cv2.BORDER_REFLECT)
    read = np.stack([np.interp(at_frames[good], log.time_s, smooth[:, k]) for k in range(2)], axis=1)
    miss = read - truth.force_n[good, :2]
    assert np.abs(np.median(miss, axis=0)).max() < 3e-3
    assert np.sqrt((miss**2).mean()) < 6e-3  # noise, steps, and a pose that is off by up to a degree
    np.testing.assert_allclose(log.force_n[:, :2] / 5e-3, np.round(log.force_n[:, :2] / 5e-3), atol=1e-9)
    assert abs(truth.clock_offset_s) <= 0.08
    without = np.stack([np.interp(truth.stamp_ns[good] * 1e-9, log.time_s, smooth[:, k]) for k in range(2)], axis=1)
    if abs(truth.clock_offset_s) > 0.02:  # taking the two clocks for one is visibly worse
        assert ((without - truth.force_n[good, :2]) ** 2).mean() > 2 * (miss**2).mean()


def test_the_true_centreline_runs_in_the_middle_of_the_catheter(bench):
    # Without noise and motion the flanks, found where the grey level crosses halfway, lie half a diameter to each side.
    still = SHORT.model_copy(update={"noise_grey": 0.0, "exposure_s": 0.0})
    bench = SmallBench(still, seed=bench.seed, session=bench.number)
    truth = bench.truth()
    radius = 0.5 * still.diameter_m / truth.metres_per_px
    middles, widths = [], []
    for index in (20, 120, 150):
        grey = cv2.cvtColor(bench.picture(index), cv2.COLOR_RGB2GRAY).astype(np.float32)
        line = truth.centreline_px(index)
        for k in range(12, 36, 2):  # the shaft before the rings
            tangent = line[k + 1] - line[k - 1]
            normal = np.array([-tangent[1], tangent[0]]) / np.linalg.norm(tangent)
            reach = np.arange(-2.2 * radius, 2.2 * radius, 0.05)
            points = (line[k] + reach[:, None] * normal).astype(np.float32)
            profile = cv2.remap(grey, points[:, :1], points[:, 1:], cv2.INTER_CUBIC).ravel()
            edges = []
            for side in (-1, 1):
                half = reach * side > 0
                x, y = np.abs(reach[half]), profile[half]
                order = np.argsort(x)
                x, y = x[order], y[order]
                near = (x > radius - 3) & (x < radius + 3)
                x, y = x[near], y[near]
                inside, outside = y[x < radius - 2].mean(), y[x > radius + 2].mean()
                edges.append(side * x[np.argmax(y > 0.5 * (inside + outside))])
            middles.append(sum(edges) / 2)
            widths.append(edges[1] - edges[0])
    assert abs(np.median(middles)) < 0.1
    assert np.abs(middles).max() < 0.5
    assert np.median(widths) == pytest.approx(2 * radius, abs=0.35)


def test_the_pictures_noise_is_as_loud_as_stated():
    settings = SHORT.model_copy(update={"noise_grey": 3.0, "light": (1.0, 1.0)})
    noisy, clean = SmallBench(settings, 5), SmallBench(settings.model_copy(update={"noise_grey": 0.0}), 5)
    for level, wanted in ((190, 3.0 * (0.55 + 0.45 * 190 / 128)), (35, 3.0 * (0.55 + 0.45 * 35 / 128))):
        spot = clean.picture(30).astype(int)
        miss = noisy.picture(30).astype(float) - spot
        mask = np.abs(spot.mean(axis=2) - level) < 12
        grey = (miss @ [0.299, 0.587, 0.114])[mask]
        assert grey.std() == pytest.approx(wanted, rel=0.12)
        assert abs(grey.mean()) < 0.1
    two = [noisy.picture(k).astype(float) - clean.picture(k) for k in (30, 31)]
    assert abs(np.corrcoef(two[0].ravel(), two[1].ravel())[0, 1]) < 0.01


def test_motion_during_the_exposure_smears_the_tip():
    still = SmallBench(SHORT.model_copy(update={"noise_grey": 0.0, "exposure_s": 0.0}), 5)
    moving = SmallBench(SHORT.model_copy(update={"noise_grey": 0.0, "exposure_s": 0.02}), 5)
    line = still.truth().centreline_px
    steps = [np.linalg.norm(line(k + 1)[-1] - line(k)[-1]) for k in range(still.frames - 1)]
    fast = int(np.argmax(steps))
    sharpness = [cv2.Laplacian(b.picture(fast), cv2.CV_64F).std() for b in (still, moving)]
    assert sharpness[1] < 0.97 * sharpness[0]
    np.testing.assert_array_equal(
        still.picture(5)[:, :60], moving.picture(5)[:, :60]
    )  # nothing moves there in the tare


def test_public_facts_are_near_the_truth_but_not_the_truth(bench):
    facts, truth = bench.public(), bench.truth()
    assert facts["metres_per_px"] == pytest.approx(truth.metres_per_px, rel=0.0105)
    assert facts["metres_per_px"] != truth.metres_per_px
    assert facts["sensor_angle_deg"] == pytest.approx(truth.values["sensor_angle_deg"], abs=1.0)
    hidden = {"clock_offset_s", "friction", "wall_stiffness_n_per_m", "contact_angle_deg"}
    assert not hidden & (set(facts) | set(bench.context.notes))


def test_settings_that_allow_no_session_are_refused_with_the_remedy(monkeypatch):
    monkeypatch.setattr("tipforce.twin.small._session._DRAWS", 3)
    with pytest.raises(InputError, match=r"no session with a peak force .* widen"):
        SmallBench(SHORT.model_copy(update={"peak_force_n": (5.0, 5.0)})).truth()


@pytest.mark.parametrize("wrong", [{"seconds": 1}, {"friction": (0.3, 0.1)}, {"no_such": 1}])
def test_wrong_settings_are_refused(wrong):
    with pytest.raises(ValidationError):
        SmallBenchSettings(**wrong)
