"""Fine-tunes both networks of the locator on a few annotated images, without forgetting others.

Each batch has windows of the annotated images, whose lines are learnt, and stored windows of other benches
(`rehearsal_windows`), for which the outputs are to stay those of the network before (distillation: Li & Hoiem 2016,
"Learning without Forgetting"). The early half of the encoder and all statistics of batch normalisation stay as they
are: a handful of images would replace them by those of one bench.
"""

import copy
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

import numpy as np
import numpy.typing as npt
import torch
import torch.nn.functional as F
from torch import Tensor, nn

from .._device import cpu_has_bf16
from ._inputs import network_input, prompt_channels
from ._labels import LabelledImage
from ._loss import LOSS_WEIGHTS, linear_rate, locator_loss
from ._network import Locator, LocatorOutputs
from ._windows import PROMPT_FIELDS, WINDOW_FIELDS, WINDOW_PX, random_scene, window

Progress = Callable[[str, float], None]
"""Called with a description of the current work and its finished share (0..1)."""
Network = TypeVar("Network", bound=nn.Module)
Batch = TypeVar("Batch")
Windows = Mapping[str, npt.NDArray[Any]]
"""Fields of windows by name, (n, ...) each."""

TRAINED_PREFIXES = tuple(f"encoder._blocks.{k}." for k in range(11, 16))
"""Parameters of the encoder that are trained, its deep half; those of the decoder always are."""


@dataclass(frozen=True, slots=True)
class FineTuneSettings:
    """How a network of the locator is fine-tuned.

    Attributes:
        steps: number of steps.
        batch: examples of a step; half of them show the annotated images.
        rate: learning rate at the beginning; it falls linearly to 0.
        kept_weight: weight of the loss on other benches; the loss on the annotated images has weight 0.5.
        seed: seed of the examples.
        max_seconds: the number of steps is reduced where they would take longer.
    """

    steps: int = 60
    batch: int = 16
    rate: float = 1e-4
    kept_weight: float = 3.0
    seed: int = 0
    max_seconds: float = 100.0


@dataclass(frozen=True, slots=True, eq=False)
class FineTuned(Generic[Network]):
    """A fine-tuned network.

    Attributes:
        network: the network, in eval mode.
        steps: number of steps that were made.
        seconds: time that they took.
    """

    network: Network
    steps: int
    seconds: float


MEASURED_STEPS = 8
"""The time of the remaining steps is estimated after each of these numbers of steps."""
MAX_GRADIENT_NORM = 3.0
WARMUP_STEPS = 10


def fine_tune(
    network: Locator,
    annotated: Sequence[LabelledImage],
    rehearsal: Windows,
    settings: FineTuneSettings,
    on_progress: Progress | None = None,
) -> FineTuned[Locator]:
    """Returns a locator that was fine-tuned on annotated images; ``network`` itself is not changed.

    The result depends on the seed alone, unless the time limit shortens the training.

    Args:
        network: the locator to begin with.
        annotated: images with their catheter, or without one, as a person marked them; at least one.
        rehearsal: windows of other benches, with the fields of `rehearsal_windows`; at least one.
        settings: how to train.
        on_progress: called at every step. An error that it raises ends the training.
    """
    tuned = copy.deepcopy(network).eval()
    for name, parameter in tuned.named_parameters():
        parameter.requires_grad_(not name.startswith("encoder.") or name.startswith(TRAINED_PREFIXES))
    half = settings.batch // 2
    kept = {name: torch.from_numpy(rehearsal[name]) for name in ("image", *PROMPT_FIELDS)}
    rng = np.random.default_rng([settings.seed, 1])

    def draw(step: int) -> dict[str, Tensor]:
        own = np.random.default_rng([settings.seed, step])
        chosen = [annotated[k] for k in own.integers(len(annotated), size=settings.batch - half)]
        windows = [window(random_scene(each, own), own, 2 if each.xray else 1) for each in chosen]
        return {name: torch.from_numpy(np.stack([getattr(each, name) for each in windows])) for name in WINDOW_FIELDS}

    with ThreadPoolExecutor(1) as pool:
        shipped = _outputs(network, kept)
        batches = ahead(pool, draw, settings.steps)

        def loss() -> Tensor:
            batch, others = next(batches), torch.from_numpy(rng.integers(len(kept["image"]), size=half))
            joined = {name: torch.cat([batch[name], values[others]]) for name, values in kept.items()}
            outputs = _run(tuned, joined)
            count = settings.batch - half
            own, _ = locator_loss(
                LocatorOutputs(*(each[:count] for each in outputs)),
                *(batch[n] for n in ("line", "state", "kind", "facts")),
            )
            change = _change(outputs, count, [each[others] for each in shipped])
            return 0.5 * own + settings.kept_weight * change

        return trained(tuned, loss, settings, on_progress)


def trained(
    network: Network, loss: Callable[[], Tensor], settings: FineTuneSettings, on_progress: Progress | None
) -> FineTuned[Network]:
    """Trains the parameters of ``network`` that require a gradient.

    Args:
        network: the network; it is changed.
        loss: returns the loss of the next batch.
        settings: how to train.
        on_progress: called at every step.
    """
    parameters = [parameter for parameter in network.parameters() if parameter.requires_grad]
    optimiser = torch.optim.AdamW(parameters, lr=settings.rate, weight_decay=0.0)
    steps, step, began = settings.steps, 0, time.monotonic()
    while step < steps:
        if on_progress:
            on_progress(f"step {step + 1} of {steps}", step / steps)
        for group in optimiser.param_groups:
            group["lr"] = settings.rate * linear_rate(step, steps, 1.0, warmup=WARMUP_STEPS)
        optimiser.zero_grad(set_to_none=True)
        loss().backward()
        nn.utils.clip_grad_norm_(parameters, MAX_GRADIENT_NORM)
        optimiser.step()
        step += 1
        if step % MEASURED_STEPS == 0:
            possible = int(settings.max_seconds * step / max(time.monotonic() - began, 1e-9))
            steps = min(steps, max(possible, MEASURED_STEPS))
    return FineTuned(network.requires_grad_(True), steps, time.monotonic() - began)


def ahead(pool: ThreadPoolExecutor, draw: Callable[[int], Batch], count: int) -> Iterator[Batch]:
    """Yields ``count`` batches; the next one is drawn in the thread of ``pool`` while the network learns from this one.

    Args:
        pool: a thread.
        draw: returns the batch of a step.
        count: number of batches.
    """
    waiting = pool.submit(draw, 0)
    for step in range(1, count + 1):
        drawn = waiting.result()
        waiting = pool.submit(draw, step)
        yield drawn


@torch.no_grad()
def _outputs(network: Locator, windows: Mapping[str, Tensor]) -> list[Tensor]:
    """Returns the kept outputs of all windows."""
    parts = [
        _run(network, {name: values[first : first + 16] for name, values in windows.items()})
        for first in range(0, len(windows["image"]), 16)
    ]
    return [torch.cat(each) for each in zip(*(_distilled(part) for part in parts), strict=True)]


def _distilled(outputs: LocatorOutputs) -> tuple[Tensor, Tensor, Tensor]:
    return outputs.heat, outputs.states, outputs.present


def _run(network: Locator, windows: Mapping[str, Tensor]) -> LocatorOutputs:
    channels = prompt_channels((WINDOW_PX, WINDOW_PX), *(windows[name] for name in PROMPT_FIELDS))
    image = network_input(windows["image"], channels).contiguous(memory_format=torch.channels_last)
    with torch.autocast("cpu", torch.bfloat16, enabled=cpu_has_bf16()):
        return network(image)


def _change(outputs: LocatorOutputs, first: int, shipped: Sequence[Tensor]) -> Tensor:
    """Returns how far the outputs of the windows from ``first`` on are from the ``shipped`` ones: Kullback-Leibler."""
    heat, states, present = (each[first:].float() for each in _distilled(outputs))
    nowhere = heat.new_zeros(*heat.shape[:2], 1)
    parts = {
        "heat": (torch.cat([heat.flatten(2), nowhere], -1), torch.cat([shipped[0].flatten(2), nowhere], -1)),
        "states": (states, shipped[1]),
        "present": (F.pad(present[:, None], (0, 1)), F.pad(shipped[2][:, None], (0, 1))),
    }
    total = heat.new_zeros(())
    for name, (new, old) in parts.items():
        log_new, log_old = F.log_softmax(new, -1).flatten(0, -2), F.log_softmax(old.float(), -1).flatten(0, -2)
        total = total + LOSS_WEIGHTS[name] * F.kl_div(log_new, log_old, reduction="batchmean", log_target=True)
    return total
