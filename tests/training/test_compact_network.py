"""The network of `compact`: its output for a mirrored image."""

import math

import numpy as np
import pytest

from tipforce.training._augmentation import CURVATURE, Augmentation
from tipforce.training._compact import COMPACT_OUTPUTS, TISSUE_N_PER_M, TISSUE_OUTPUTS, CompactTask
from tipforce.training._task import load_weights, network_weights

torch = pytest.importorskip("torch", reason="networks need the extra [train]")

SIZE = 64


def answers(task: CompactTask, *, mirrored: bool) -> list[np.ndarray]:
    torch.manual_seed(0)
    network = task.build().eval()
    draw = np.random.default_rng(0)
    image = draw.integers(0, 256, (5, SIZE, SIZE), np.uint8)
    metadata = draw.normal(size=(5, 4)).astype(np.float32)
    if mirrored:
        image, metadata[:, CURVATURE] = image[:, ::-1].copy(), -metadata[:, CURVATURE]
    with torch.no_grad():
        return [each.numpy() for each in network(torch.from_numpy(image), torch.from_numpy(metadata))]


def test_a_mirrored_image_has_the_mirrored_force():
    task = CompactTask(3, 4, SIZE, augmentation=Augmentation())
    force, log_variance, contact, heatmap, in_distribution, *_ = answers(task, mirrored=False)
    other = answers(task, mirrored=True)
    np.testing.assert_allclose(other[0], force * [1, -1, 1], atol=1e-6)
    assert np.abs(force[:, 1]).min() > 1e-5
    np.testing.assert_allclose(other[1], log_variance, atol=1e-5)
    np.testing.assert_allclose(other[2], contact, atol=1e-5)
    np.testing.assert_allclose(other[3], heatmap[:, ::-1], atol=1e-5)
    np.testing.assert_allclose(other[4], in_distribution, atol=1e-5)


@pytest.mark.parametrize(
    "task",
    [
        CompactTask(3, 4, SIZE, augmentation=Augmentation(mirror=0.0)),
        CompactTask(3, 4, SIZE, planar=None, augmentation=Augmentation()),
        CompactTask(3, 4, SIZE),
    ],
    ids=["not wanted", "another frame", "as it is"],
)
def test_without_mirroring_in_training_only_the_image_itself_is_evaluated(task: CompactTask):
    force, other = (answers(task, mirrored=mirrored)[0] for mirrored in (False, True))
    assert np.abs(other - force * [1, -1, 1]).max() > 1e-4


def test_out_of_distribution_images_train_their_detection_alone():
    torch.manual_seed(0)
    task = CompactTask(3, 4, SIZE, augmentation=Augmentation())
    network = task.build()
    outputs = network(torch.zeros(4, SIZE, SIZE, dtype=torch.uint8), torch.zeros(4, 4))
    batch = {
        "force_n": torch.full((4, 3), 0.1),
        "heatmap": torch.full((4, SIZE // 8, SIZE // 8), torch.nan),
        "in_distribution": torch.tensor([1.0, 0.0, 1.0, 0.0]),
    }
    for each in outputs:
        each.retain_grad()
    task.loss(outputs, batch).backward()
    force, log_variance, contact, _, in_distribution, *_ = (each.grad for each in outputs)
    for grad in (force, log_variance, contact[:, None]):
        assert (grad[[1, 3]] == 0).all()
        assert (grad[[0, 2]] != 0).all()
    assert (in_distribution[[0, 2]] < 0).all()
    assert (in_distribution[[1, 3]] > 0).all()
    outputs = [each.detach() for each in outputs]
    error = task.error_n(outputs, batch)
    plain = torch.linalg.vector_norm(outputs[0] - batch["force_n"], dim=1)
    assert float(error.mean()) == pytest.approx(float(plain[[0, 2]].mean()))
    assert not task.error_n(outputs, {**batch, "in_distribution": torch.zeros(4)}).any()


def test_a_network_without_classes_of_tissue_becomes_one_with_that_knows_the_usual_tissue():
    """Its force is then that of bending plus that of the indentation in proportion to the stiffness."""
    before, after = CompactTask(2, 4, SIZE), CompactTask(2, 4, SIZE, tissue=True)
    torch.manual_seed(0)
    old, new = before.build(), after.build()
    assert load_weights(new, after.adapted(network_weights(old)), after.head) == []
    image, metadata = torch.randint(0, 256, (3, SIZE, SIZE), dtype=torch.uint8), 0.1 * torch.randn(3, 4)
    with torch.no_grad():
        force_n = old.eval()(image, metadata)[0]
        outputs = dict(zip((*COMPACT_OUTPUTS, *TISSUE_OUTPUTS), new.eval()(image, metadata), strict=True))
    by_class_n = outputs["tissue_force_n"]
    ratio = torch.tensor(TISSUE_N_PER_M)[:, None] / math.sqrt(TISSUE_N_PER_M[0] * TISSUE_N_PER_M[-1])
    pressing_n = (by_class_n[:, 1] - by_class_n[:, 0]) / (ratio[1] - ratio[0])
    assert torch.allclose(by_class_n, force_n[:, None] + (ratio - 1.0) * pressing_n[:, None], atol=1e-6)
    assert float(pressing_n.abs().max()) > 1e-3
