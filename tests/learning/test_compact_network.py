"""The network of `compact`: what it answers of a picture in a mirror."""

import numpy as np
import pytest

from tipforce.learning._augment import CURVATURE, Augmentation
from tipforce.learning._compact import CompactTask

torch = pytest.importorskip("torch", reason="networks need the extra [train]")

SIZE = 64


def answers(task: CompactTask, *, mirrored: bool) -> list[np.ndarray]:
    torch.manual_seed(0)
    network = task.build().eval()
    draw = np.random.default_rng(0)
    picture = draw.integers(0, 256, (5, SIZE, SIZE), np.uint8)
    sheet = draw.normal(size=(5, 4)).astype(np.float32)
    if mirrored:
        picture, sheet[:, CURVATURE] = picture[:, ::-1].copy(), -sheet[:, CURVATURE]
    with torch.no_grad():
        return [each.numpy() for each in network(torch.from_numpy(picture), torch.from_numpy(sheet))]


def test_what_points_to_the_left_points_to_the_right_in_a_mirror():
    task = CompactTask(3, 4, SIZE, augmentation=Augmentation())
    force, log_variance, contact, heat, familiar, *_ = answers(task, mirrored=False)
    other = answers(task, mirrored=True)
    np.testing.assert_allclose(other[0], force * [1, -1, 1], atol=1e-6)
    assert np.abs(force[:, 1]).min() > 1e-5
    np.testing.assert_allclose(other[1], log_variance, atol=1e-5)
    np.testing.assert_allclose(other[2], contact, atol=1e-5)
    np.testing.assert_allclose(other[3], heat[:, ::-1], atol=1e-5)
    np.testing.assert_allclose(other[4], familiar, atol=1e-5)


@pytest.mark.parametrize(
    "task",
    [
        CompactTask(3, 4, SIZE, augmentation=Augmentation(mirror=0.0)),
        CompactTask(3, 4, SIZE, planar=None, augmentation=Augmentation()),
        CompactTask(3, 4, SIZE),
    ],
)
def test_a_network_that_was_not_taught_so_looks_at_the_picture_alone(task: CompactTask):
    force, other = (answers(task, mirrored=mirrored)[0] for mirrored in (False, True))
    assert np.abs(other - force * [1, -1, 1]).max() > 1e-4
