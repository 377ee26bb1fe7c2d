"""`fusion`: `rod-track` with the geometry of the contact, from images."""

import json
from dataclasses import replace

import numpy as np
import pytest

from tipforce.estimators import Fusion, FusionSettings, RodTrack
from tipforce.simulation import PRESETS, SimulatedBench
from tipforce.types import ForceEstimate, Frame, Observation, Status

SECONDS, EVERY = 12.0, 8


@pytest.fixture(scope="module")
def bench() -> SimulatedBench:
    settings = PRESETS["bench-2021"]
    world = settings.world.model_copy(update={"seconds": SECONDS})
    return SimulatedBench(settings.model_copy(update={"world": world}), 4, 0)


@pytest.fixture(scope="module")
def frames(bench: SimulatedBench) -> list[Frame]:
    """Every `EVERY`-th image, drawn once."""
    return [bench.frame(k) for k in range(0, len(bench.frame_s), EVERY)]


def estimates(
    method: RodTrack, bench: SimulatedBench, frames: list[Frame], *, x_ray: bool = False
) -> list[ForceEstimate]:
    info = bench.session_info
    if x_ray:
        info = replace(info, views={"camera": replace(info.view("camera"), modality="xray")})
    stream, (stamps, knob) = method.start(info), bench.knob_log()
    found: list[ForceEstimate] = []
    for frame in frames:
        newest = max(0, int(np.searchsorted(stamps, frame.stamp_ns, side="right")) - 1)
        actuation = {"knob_deg": float(knob[newest])}
        found.append(stream.update(Observation(frame.stamp_ns, {"camera": frame.image}, actuation)))
    return found


def test_the_image_at_the_tip_narrows_the_intervals_and_they_hold(bench: SimulatedBench, frames: list[Frame]) -> None:
    with_image = estimates(Fusion(FusionSettings(max_error_n=None)), bench, frames)
    shape_alone = estimates(RodTrack(), bench, frames)
    truth = bench.interpolator.at(bench.trajectory.contact.force_n, bench.frame_s[::EVERY])
    size = np.linalg.norm(truth[:, :2], axis=1)
    both = [k for k in range(len(size)) if size[k] > 0.02 and with_image[k].valid and shape_alone[k].valid]
    assert len(both) > 10
    widths = [
        float(np.median([np.ptp(each[k].magnitude_interval_n) for k in both])) for each in (with_image, shape_alone)
    ]
    assert widths[0] < 0.8 * widths[1]
    assert np.mean([abs(with_image[k].magnitude_n - size[k]) for k in both]) < 0.04
    held = [with_image[k].magnitude_interval_n[0] <= size[k] <= with_image[k].magnitude_interval_n[1] for k in both]
    assert np.mean(held) > 0.75


def test_under_x_ray_it_is_the_shape_alone(bench: SimulatedBench, frames: list[Frame]) -> None:
    fusion, rod = (
        estimates(method, bench, frames, x_ray=True)
        for method in (Fusion(FusionSettings(max_error_n=None)), RodTrack())
    )
    assert [each.status for each in fusion] == [each.status for each in rod]
    for one, other in zip(fusion, rod, strict=True):
        np.testing.assert_array_equal(one.force_n, other.force_n)


def test_a_wide_interval_is_no_answer(bench: SimulatedBench, frames: list[Frame]) -> None:
    found = estimates(Fusion(FusionSettings(max_error_n=0.01)), bench, frames)
    refused = [each for each in found if each.status is Status.UNOBSERVABLE]
    assert refused
    assert all("max_error_n" in each.detail and np.isnan(each.magnitude_n) for each in refused)


def test_it_is_saved_and_read() -> None:
    fresh = Fusion()
    values, arrays = fresh.state()
    again = Fusion.from_state(fresh.settings.model_dump(), json.loads(json.dumps(values)), arrays, fresh.files())
    assert again.describe() == fresh.describe()
    assert again.describe().summary().short_inputs == "image, centreline and knob"
    assert again.settings.contact.read
