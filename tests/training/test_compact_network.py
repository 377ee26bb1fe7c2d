"""The network of `compact`: what it answers of a picture in a mirror."""

import numpy as np
import pytest

from tipforce.training._augment import CURVATURE, Augmentation
from tipforce.training._compact import CompactTask

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
    ids=["told not to", "another frame", "as it is"],
)
def test_a_network_that_was_not_taught_so_looks_at_the_picture_alone(task: CompactTask):
    force, other = (answers(task, mirrored=mirrored)[0] for mirrored in (False, True))
    assert np.abs(other - force * [1, -1, 1]).max() > 1e-4


def test_of_pictures_that_were_moved_only_that_is_learnt():
    torch.manual_seed(0)
    task = CompactTask(3, 4, SIZE, augmentation=Augmentation())
    network = task.build()
    outputs = network(torch.zeros(4, SIZE, SIZE, dtype=torch.uint8), torch.zeros(4, 4))
    batch = {
        "force_n": torch.full((4, 3), 0.1),
        "heat": torch.full((4, SIZE // 8, SIZE // 8), torch.nan),
        "familiar": torch.tensor([1.0, 0.0, 1.0, 0.0]),
    }
    for each in outputs:
        each.retain_grad()
    task.loss(outputs, batch).backward()
    force, log_variance, contact, _, familiar, *_ = (each.grad for each in outputs)
    for grad in (force, log_variance, contact[:, None]):
        assert (grad[[1, 3]] == 0).all()
        assert (grad[[0, 2]] != 0).all()
    assert (familiar[[0, 2]] < 0).all()
    assert (familiar[[1, 3]] > 0).all()
    outputs = [each.detach() for each in outputs]
    error = task.error_n(outputs, batch)
    plain = torch.linalg.vector_norm(outputs[0] - batch["force_n"], dim=1)
    assert float(error.mean()) == pytest.approx(float(plain[[0, 2]].mean()))
    assert not task.error_n(outputs, {**batch, "familiar": torch.zeros(4)}).any()
