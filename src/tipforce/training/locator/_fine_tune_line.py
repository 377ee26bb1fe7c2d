"""Fine-tunes the line network on annotated images, without forgetting others; see `fine_tune`.

A person's line is right to some px, the network's axis to a fraction of one. So the axis and its error are learnt from
the network before, where it is within `MARK_ERROR_DIAMETERS` of the annotated line; visibility, both ends, and which
line is the catheter's are learnt from the person.
"""

import copy
import math
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import torch
import torch.nn.functional as F
from torch import Tensor

from ...vision.locator import straightened, strip_input
from ._fine_tune import FineTuned, FineTuneSettings, Progress, Windows, ahead, trained
from ._labels import SEEN, LabelledImage
from ._line_network import LineNetwork, line_loss
from ._strips import STRIP_FIELDS, StripSource, strip_target

MARK_ERROR_DIAMETERS = 0.3
"""Error of an annotated line across the shaft."""
MIN_LOG_SPREAD = -2.5
"""An offset that the network before is surer of is not held more tightly."""
DIAMETER_ROUNDS, GUESSED_ASPECT = 3, 16.0
"""The diameter is read this often, at first from a strip in which the length is this number of diameters."""
MIN_DIAMETER_PX = 2.0
MIN_SEEN_SHARE = 0.4
"""A window of which less is seen teaches nothing about strips."""


def fine_tune_line(
    network: LineNetwork,
    annotated: Sequence[LabelledImage],
    rehearsal: Windows,
    settings: FineTuneSettings,
    on_progress: Progress | None = None,
) -> FineTuned[LineNetwork]:
    """Returns a line network that was fine-tuned on annotated images; ``network`` itself is not changed.

    Args:
        network: the network to begin with.
        annotated: images with their catheter, or without one, as a person marked them; at least one with a catheter.
        rehearsal: windows of other benches, with the fields of `rehearsal_windows`.
        settings: how to train.
        on_progress: called at every step. An error that it raises ends the training.
    """
    before = copy.deepcopy(network).eval().requires_grad_(False)
    tuned = copy.deepcopy(network).eval().requires_grad_(True)
    marked = [_source(each, before) for each in annotated if each.present]
    others = [
        StripSource(image, line.astype(np.float64), state, float(facts[1]))
        for image, line, state, facts in zip(*(rehearsal[n] for n in ("image", "line", "state", "facts")), strict=True)
        if facts[0] > 0.5 and (state == SEEN).mean() > MIN_SEEN_SHARE and math.isfinite(facts[1])
    ]
    half = settings.batch // 2

    def draw(step: int) -> dict[str, Tensor]:
        rng = np.random.default_rng([settings.seed, step])
        sources = [own[k] for own in (marked, others) for k in rng.integers(len(own), size=half).tolist()]
        strips = [strip_target(each, rng) for each in sources]
        return {name: torch.from_numpy(np.stack([getattr(each, name) for each in strips])) for name in STRIP_FIELDS}

    with ThreadPoolExecutor(1) as pool:
        batches = ahead(pool, draw, settings.steps)

        def loss() -> Tensor:
            batch = next(batches)
            found, shipped = tuned(batch["strip"]), before(batch["strip"])
            own = {name: values[:half] for name, values in batch.items()}
            learnt = _annotated_loss(tuple(x[:half] for x in found), tuple(x[:half] for x in shipped), own)
            return 0.5 * learnt + settings.kept_weight * _change(
                tuple(x[half:] for x in found), tuple(x[half:] for x in shipped)
            )

        return trained(tuned, loss, settings, on_progress)


@torch.no_grad()
def _source(image: LabelledImage, network: LineNetwork) -> StripSource:
    """Returns an annotated image with the diameter that ``network`` reads along its line, where none is known."""
    diameter_px = image.diameter_px
    if not math.isfinite(diameter_px):
        length_px = float(np.linalg.norm(np.diff(image.line_px, axis=0), axis=1).sum())
        diameter_px = max(length_px / GUESSED_ASPECT, MIN_DIAMETER_PX)
        for _ in range(DIAMETER_ROUNDS):
            strip = straightened(image.image, image.line_px, diameter_px)
            values = torch.from_numpy(strip_input(strip.values, strip.inside))[None]
            diameter_px = max(diameter_px * math.exp(float(network(values)[6])), MIN_DIAMETER_PX)
    return StripSource(image.image, image.line_px, image.state, diameter_px)


def _annotated_loss(found: tuple[Tensor, ...], shipped: tuple[Tensor, ...], wanted: Mapping[str, Tensor]) -> Tensor:
    """Returns the loss on strips of annotated images; ``shipped``: the outputs of the network before."""
    low, high = wanted["offset"] - MARK_ERROR_DIAMETERS, wanted["offset"] + MARK_ERROR_DIAMETERS
    axis = torch.minimum(torch.maximum(shipped[0], low), high)
    spread = shipped[1].clamp_min(MIN_LOG_SPREAD)
    kept = (found[1] - shipped[1]).abs() * wanted["asked"]
    return line_loss((found[0], spread, *found[2:]), {**wanted, "offset": axis}) + kept.mean()


def _change(found: tuple[Tensor, ...], shipped: tuple[Tensor, ...]) -> Tensor:
    """Returns how far the outputs are from the ``shipped`` ones, in the units of `line_loss`."""
    offset, spread, base, tip, seen, right, width = found
    total = ((offset - shipped[0]).abs() * torch.exp(-shipped[1].clamp_min(MIN_LOG_SPREAD))).mean()
    total = total + (spread - shipped[1]).abs().mean() + (width - shipped[6]).abs().mean()
    for ends, old in ((base, shipped[2]), (tip, shipped[3])):
        log_new, log_old = F.log_softmax(ends, -1), F.log_softmax(old, -1)
        total = total + 0.3 * F.kl_div(log_new, log_old, reduction="batchmean", log_target=True)
    for weight, logits, old in ((0.7, seen, shipped[4]), (0.5, right.mean(-1), shipped[5].mean(-1))):
        share = torch.sigmoid(old)
        total = total + weight * (F.binary_cross_entropy_with_logits(logits, share))
    return total
