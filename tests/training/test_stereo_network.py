"""The network of `stereo`: its size, its symmetry, and the pairs of images that it is trained on."""

import numpy as np
import pytest

from tipforce.training import Augmentation, StereoTask, TrainingSamples

torch = pytest.importorskip("torch", reason="training needs the extra [train]")

STILL = Augmentation(
    shift=0, turn_deg=0, zoom=0, contrast=0, tones=0, slope=0, blur_px=0, noise=0, inverted=0, strokes=0,
    out_of_distribution=0, mirror=1,
)  # fmt: skip


def task(size: int = 64, augmentation: Augmentation | None = None) -> StereoTask:
    return StereoTask(3, 6, size, augmentation=augmentation or Augmentation(), across=(1, 2))


def samples() -> TrainingSamples:
    draw = np.random.default_rng(0)
    images = draw.integers(0, 256, (2, 2, 64, 64), np.uint8)
    heatmap = draw.integers(0, 2, (2, 2, 16, 16), np.uint8) * np.uint8(255)
    inputs = {"metadata": np.arange(12, dtype=np.float32).reshape(2, 6)}
    force = np.array([[0.1, 0.2, 0.3], [0.4, 0.5, 0.6]], np.float32)
    return TrainingSamples(images, force, np.array(["s", "s"]), inputs, heatmap)


def test_it_has_less_than_half_a_million_weights_at_its_usual_size():
    assert sum(each.numel() for each in task(160).build().parameters()) < 500_000


def test_a_bench_turned_about_the_base_tangent_has_the_opposite_force_across():
    torch.manual_seed(0)
    network = task().build().eval()
    image = torch.randint(0, 256, (2, 2, 64, 64), dtype=torch.uint8)
    metadata = torch.randn(2, 6)
    turned = metadata * torch.tensor([1.0, 1.0, 1.0, -1.0, 1.0, 1.0])
    with torch.no_grad():
        force, *_ = network(image, metadata)
        other, *_ = network(image.flip(2), turned)
    assert torch.allclose(other, force * torch.tensor([1.0, -1.0, -1.0]), atol=1e-5)
    assert force.abs().max() > 1e-4


def test_mirrored_pairs_mirror_images_masks_and_labels_of_both_views():
    pairs = samples()
    found = task(augmentation=STILL).batch(pairs, np.array([0, 1]), [np.random.default_rng(k) for k in (0, 1)])
    assert np.array_equal(found["image"], pairs.images[:, :, ::-1])
    assert np.allclose(found["heatmap"], pairs.heatmap[:, :, ::-1] / 255.0)
    assert np.allclose(found["force_n"], pairs.force_n * [1.0, -1.0, -1.0])
    assert np.allclose(found["metadata"][:, 3], -pairs.inputs["metadata"][:, 3])
    plain = task(augmentation=STILL).batch(pairs, np.array([0, 1]), None)
    assert np.array_equal(plain["image"], pairs.images)
    assert np.allclose(plain["force_n"], pairs.force_n)


def test_masks_are_estimated_in_training_alone():
    network = task().build()
    image, metadata = torch.zeros((2, 2, 64, 64), dtype=torch.uint8), torch.zeros((2, 6))
    assert network(image, metadata)[3].shape == (2, 2, 16, 16)
    assert [tuple(each.shape) for each in network.eval()(image, metadata)][:4] == [(2, 3), (2, 3), (2,), (2,)]
