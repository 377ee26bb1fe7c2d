"""The thesis's network, held to fig. 29."""

from typing import Any

import numpy as np
import pytest

from tipforce.training import ResnetTask, TrainingSamples, network_from_weights, network_weights

torch = pytest.importorskip("torch", reason="training needs the extra [train]")
pytest.importorskip("monai", reason="training needs the extra [train]")


@pytest.fixture(scope="module")
def network() -> Any:
    torch.manual_seed(0)
    return ResnetTask(2).build().eval()


def test_it_is_resnet_18_as_published(network: Any) -> None:
    """He et al. 2016, with two outputs for the thousand classes: 11,177,538 weights."""
    assert sum(value.numel() for value in network.parameters()) == 11_177_538
    sizes: dict[str, tuple[int, ...]] = {}
    for name in ("conv1", "maxpool", "layer1", "layer2", "layer3", "layer4", "avgpool"):
        getattr(network.body, name).register_forward_hook(
            lambda _, __, out, name=name: sizes.__setitem__(name, tuple(out.shape[1:]))
        )
    force, pooled = network(torch.zeros((1, 224, 224, 3), dtype=torch.uint8))
    assert (force.shape, pooled.shape) == ((1, 2), (1, 512))
    assert sizes == {
        "conv1": (64, 112, 112),
        "maxpool": (64, 56, 56),
        "layer1": (64, 56, 56),
        "layer2": (128, 28, 28),
        "layer3": (256, 14, 14),
        "layer4": (512, 7, 7),
        "avgpool": (512, 1, 1),
    }
    assert network.body.conv1.kernel_size == (7, 7)
    assert network.body.maxpool.kernel_size == 3


def test_images_are_made_0_to_1_and_nothing_else(network: Any) -> None:
    seen: list[Any] = []
    handle = network.body.register_forward_pre_hook(lambda _, given: seen.append(given[0]))
    image = torch.randint(0, 256, (1, 32, 32, 3), dtype=torch.uint8)
    network(image)
    handle.remove()
    assert torch.equal(seen[0], image.permute(0, 3, 1, 2) / 255)


def test_the_loss_is_the_thesis_s(network: Any) -> None:
    """Eq. (19) by hand: differences 0.03 and 0.04 N."""
    found, wanted = torch.tensor([[0.13, 0.04], [0.1, 0.1]]), torch.tensor([[0.1, 0.0], [0.1, 0.1]])
    task, batch = ResnetTask(2), {"force_n": wanted}
    assert task.error_n((found, None), batch).tolist() == pytest.approx([np.sqrt(0.0025 / 2), 0.0], abs=2e-6)
    assert float(task.loss((found, None), batch)) == pytest.approx(np.sqrt(0.0025 / 2) / 2, abs=2e-6)
    exact = found.clone().requires_grad_()
    task.loss((exact, None), {"force_n": found}).backward()
    assert torch.isfinite(exact.grad).all()


def test_actuation_joins_before_the_dense_layer() -> None:
    task = ResnetTask(1, ((20.0, 10.0),))
    network = task.build().eval()
    assert network.dense.in_features == 513
    with torch.no_grad():
        network.dense.weight[:, :512] = 0.0
        network.dense.weight[:, 512] = 1.0
        knob = torch.tensor([[10.0], [20.0], [50.0]])
        found, _ = network(torch.zeros((3, 32, 32, 3), dtype=torch.uint8), knob)
    assert found[:, 0].tolist() == pytest.approx([-1.0, 0.0, 3.0])  # less the mean, over the deviation
    again = network_from_weights(task, network_weights(network))
    assert again.actuation_mean.tolist() == [20.0]


def test_a_batch_holds_what_belongs_to_its_samples() -> None:
    samples = TrainingSamples(
        np.arange(6, dtype=np.uint8).repeat(12).reshape(6, 2, 2, 3),
        np.arange(6, dtype=np.float32)[:, None],
        np.repeat(["a", "b"], 3),
        {"actuation": np.arange(6, dtype=np.float32)[:, None]},
    )
    batch = ResnetTask(1, ((0.0, 1.0),)).batch(samples, np.array([4, 1]), None)
    assert batch["image"][:, 0, 0, 0].tolist() == [4, 1]
    assert batch["force_n"].tolist() == batch["actuation"].tolist() == [[4.0], [1.0]]
