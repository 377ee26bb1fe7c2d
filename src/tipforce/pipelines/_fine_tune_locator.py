"""Fine-tunes the detector on annotated images, and writes a folder with the result."""

import json
import math
import platform
import time
from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_COMPLETED, ThreadPoolExecutor, wait
from dataclasses import asdict, dataclass, replace
from importlib import resources
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from .._system.atomic import replacing_folder
from .._system.extras import import_extra
from ..errors import FileFormatError, InputError
from ..types import FloatArray, Image
from ..vision import Annotation
from ._locator_images import PRESET_IMAGE_SHARES, PRESET_IMAGES_SEED, preset_images

if TYPE_CHECKING:
    from ..training.locator import LabelledImage, LocatedPoints, Locator

DETECTOR_GRAPH, DETECTOR_FACTS, DETECTOR_CARD = "detector.onnx", "detector.json", "README.md"
"""Files of a detector folder."""
MIN_ANNOTATED = 2
"""Fewest images with a catheter."""
MIN_ANNOTATED_TO_JUDGE, ANNOTATED_PER_JUDGED = 5, 5
"""With fewer images with a catheter none is left out of the training; otherwise one in five is."""
REHEARSAL_IMAGES = 120
"""Images of the presets that are drawn for a training."""
PROGRESS_S = 0.5
"""Longest time between two calls of the progress while images are drawn."""
DRAWN_SHARE, TRAINED_SHARE = 0.12, 0.96
"""Finished share of the work when the images are drawn, and when the training ends."""
RIGHT_WITHIN_LENGTH_SHARE, RIGHT_SHARE = 0.03, 0.85
"""A line is right if ``RIGHT_SHARE`` of its points are within this share of the catheter's length of the annotated
line: 3 px where the network reads it."""

Progress = Callable[[str, float], None]
"""Called with a description of the current work and its finished share (0..1)."""


@dataclass(frozen=True, slots=True)
class LocatorFineTuneSettings:
    """Settings of `fine_tune_locator`.

    Attributes:
        seed: seed of the choice of images and of the training.
        steps: steps of the training; None: as many as were best in measurements.
        max_seconds: time that the training takes at most; it has fewer steps on a slow computer.
    """

    seed: int = 0
    steps: int | None = None
    max_seconds: float = 150.0


@dataclass(frozen=True, slots=True)
class LocatorFigures:
    """How well the detector finds the annotated lines.

    Attributes:
        frames: number of images with a catheter.
        line_right: share of the images where 85 % of the points are within 3 % of the length from the annotated line.
        base_px: median distance of the base.
        tip_px: median distance of the tip, where it is not hidden; NaN if it is hidden in all images.
    """

    frames: int
    line_right: float
    base_px: float
    tip_px: float


@dataclass(frozen=True, slots=True, eq=False)
class LeftOutFrame:
    """An annotated image that was left out of the training.

    Attributes:
        image: name of its annotation.
        before_px: (16, 2) u, v px found by the detector before, base to tip.
        after_px: (16, 2) u, v px found by the fine-tuned one.
        before_present: probability of a catheter in the image, before.
        after_present: the same, after.
    """

    image: str
    before_px: FloatArray
    after_px: FloatArray
    before_present: float
    after_present: float


@dataclass(frozen=True, slots=True, eq=False)
class FineTuneResult:
    """A fine-tuned detector.

    Attributes:
        folder: the folder that was written.
        seconds: time of the whole work.
        before: figures of the detector before, on the images left out; None if none was.
        after: figures of the fine-tuned one.
        left_out: the images left out.
    """

    folder: Path
    seconds: float
    before: LocatorFigures | None
    after: LocatorFigures | None
    left_out: tuple[LeftOutFrame, ...]


def fine_tune_locator(
    annotations: Sequence[Annotation],
    images: Sequence[Image],
    folder: Path,
    *,
    init: Path | None = None,
    settings: LocatorFineTuneSettings | None = None,
    on_progress: Progress | None = None,
) -> FineTuneResult:
    """Fine-tunes the detector on annotated images and writes the detector folder.

    Some of the images are left out of the training and judge it. Images of the simulation's presets are trained with
    the annotated ones, so that the detector does not forget other benches.

    Args:
        annotations: the annotated images.
        images: their pixels, in the same order: (h, w, 3) RGB or (h, w).
        folder: the detector folder; it is created, or replaced when everything is done.
        init: the detector to begin with: a detector folder or its graph; None: the one that comes with tipforce.
        settings: how to train.
        on_progress: called at least at every step. An error that it raises ends the work; ``folder`` stays.

    Returns:
        The result, with figures and lines before and after.

    Raises:
        InputError: too few images with a catheter are annotated, or annotations and images do not match.
        FileFormatError: there is no detector at ``init``.
        ModelError: ``init`` is not a detector.
        MissingExtraError: torch or onnx is not installed.
    """
    for package in ("torch", "onnx"):
        import_extra(package, "train")
    from ..training.locator import FineTuneSettings, fine_tune, graph_with_weights, locator_from_graph

    settings, began = settings or LocatorFineTuneSettings(), time.monotonic()
    report: Progress = on_progress or (lambda _text, _share: None)
    _check(annotations, images)
    source = _graph_path(init)
    network = locator_from_graph(source)
    judged = _left_out(annotations, settings.seed)
    labelled = labelled_images(annotations, images)
    annotated = [each for k, each in enumerate(labelled) if k not in judged]
    rehearsal = rehearsal_images(settings.seed, REHEARSAL_IMAGES, lambda text, share: report(text, DRAWN_SHARE * share))
    chosen = FineTuneSettings(seed=settings.seed, max_seconds=settings.max_seconds)
    if settings.steps is not None:
        chosen = replace(chosen, steps=settings.steps)
    tuned = fine_tune(
        network,
        annotated,
        rehearsal,
        chosen,
        lambda text, share: report(text, DRAWN_SHARE + (TRAINED_SHARE - DRAWN_SHARE) * share),
    )
    report("judging the images that were left out", TRAINED_SHARE)
    length = _median_length_px([each for k, each in enumerate(annotations) if k not in judged])
    found = [[_locate(each, labelled[k], length) for k in judged] for each in (network, tuned.network)]
    truth = [annotations[k] for k in judged]
    before, after = (_figures(lines, [labelled[k] for k in judged], truth) for lines in found)
    left_out = tuple(
        LeftOutFrame(annotation.image, old.points_px, new.points_px, old.present, new.present)
        for annotation, old, new in zip(truth, *found, strict=True)
    )
    facts: dict[str, Any] = {
        "kind": "tipforce detector",
        "init": "shipped" if init is None else str(init),
        "frames": len(annotated),
        "left_out": [each.image for each in left_out],
        "settings": asdict(chosen),
        "steps": tuned.steps,
        "training_s": round(tuned.seconds, 1),
        "before": before and asdict(before),
        "after": after and asdict(after),
        "versions": {name: version(name) for name in ("tipforce", "torch", "onnx", "numpy")}
        | {"python": platform.python_version()},
    }
    with replacing_folder(folder) as part:
        (part / DETECTOR_GRAPH).write_bytes(graph_with_weights(source.read_bytes(), tuned.network))
        (part / DETECTOR_FACTS).write_text(json.dumps(_without_nan(facts), indent=2) + "\n", encoding="utf-8")
        (part / DETECTOR_CARD).write_text(_card(facts), encoding="utf-8")
    report("done", 1.0)
    return FineTuneResult(folder, time.monotonic() - began, before, after, left_out)


def labelled_images(annotations: Sequence[Annotation], images: Sequence[Image]) -> "list[LabelledImage]":
    """Returns the annotated images as training material.

    Args:
        annotations: the annotated images; at least one has a catheter.
        images: their pixels, in the same order: (h, w, 3) RGB or (h, w).
    """
    from ..training.locator import LABEL_POINTS, OUTSIDE, LabelledImage, border_behind, labelled_line

    length, labelled = _median_length_px(annotations), list["LabelledImage"]()
    for annotation, image in zip(annotations, images, strict=True):
        pixels = np.ascontiguousarray(np.repeat(image[..., None], 3, axis=2) if image.ndim == 2 else image)
        size = (pixels.shape[0], pixels.shape[1])
        if annotation.present:
            line, state = labelled_line(annotation.points_px, size, annotation.tip_hidden)
            mask, side = None, border_behind(line, size)
        else:  # windows as large as those of the other images, at any position
            across = np.linspace(-0.5, 0.5, LABEL_POINTS)[:, None] * (length, 0.0)
            line, state = across + 0.5 * np.array(size[::-1]), np.full(LABEL_POINTS, OUTSIDE, np.uint8)
            mask, side = np.zeros(size, np.bool_), -1
        labelled.append(LabelledImage(pixels, line, state, mask, side, math.nan, present=annotation.present))
    return labelled


def rehearsal_images(seed: int, count: int, on_progress: Progress) -> "list[LabelledImage]":
    """Returns images of the presets; the same seed returns the same images.

    Args:
        seed: seed of their choice.
        count: number of images, at least.
        on_progress: called whenever a session is drawn.
    """
    rng = np.random.default_rng([seed, 5])
    names, shares = list(PRESET_IMAGE_SHARES), np.array(list(PRESET_IMAGE_SHARES.values()))
    sessions = -(-count // 10)
    presets = [str(name) for name in rng.choice(names, sessions, p=shares / shares.sum())]
    with ThreadPoolExecutor(2) as pool:
        drawn = [
            pool.submit(_session_images, PRESET_IMAGES_SEED + seed, number, preset)
            for number, preset in enumerate(presets)
        ]
        pending = set(drawn)
        try:
            while pending:
                done = sessions - len(pending)
                on_progress(f"drawing images of other benches, session {done + 1} of {sessions}", done / sessions)
                _, pending = wait(pending, timeout=PROGRESS_S, return_when=FIRST_COMPLETED)
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise
    return [image for session in drawn for image in session.result()]


def _session_images(seed: int, number: int, preset: str) -> "list[LabelledImage]":
    return list(preset_images(seed, number, preset))


def _check(annotations: Sequence[Annotation], images: Sequence[Image]) -> None:
    if len(annotations) != len(images):
        raise InputError(f"{len(annotations)} annotations for {len(images)} images; expected one for each image")
    count = sum(each.present for each in annotations)
    if count < MIN_ANNOTATED:
        raise InputError(
            f"{count} annotated image{'' if count == 1 else 's'} with a catheter; fine-tuning needs at least "
            f"{MIN_ANNOTATED}, and 8 to 20 are best: annotate more images"
        )


def _graph_path(init: Path | None) -> Path:
    if init is None:
        return Path(str(resources.files("tipforce.vision.locator") / "locator.onnx"))
    path = init / DETECTOR_GRAPH if init.is_dir() else init
    if not path.is_file():
        raise FileFormatError(f"{path}: there is no such file; expected the graph of a detector, {DETECTOR_GRAPH}")
    return path


def _left_out(annotations: Sequence[Annotation], seed: int) -> list[int]:
    """Returns the indices of the images that judge the training, sorted."""
    marked = [k for k, each in enumerate(annotations) if each.present]
    if len(marked) < MIN_ANNOTATED_TO_JUDGE:
        return []
    count = len(marked) // ANNOTATED_PER_JUDGED
    return sorted(np.random.default_rng([seed, 6]).choice(marked, count, replace=False).tolist())


def _median_length_px(annotations: Sequence[Annotation]) -> float:
    return float(np.median([_length_px(each.points_px) for each in annotations if each.present]))


def _length_px(line_px: FloatArray) -> float:
    return float(np.linalg.norm(np.diff(line_px, axis=0), axis=1).sum())


def _locate(network: "Locator", labelled: "LabelledImage", length_px: float) -> "LocatedPoints":
    from ..training.locator import NOMINAL_LENGTH_PX, locate_points

    return locate_points(network, labelled.image, NOMINAL_LENGTH_PX / length_px, sizes=(length_px, math.nan))


def _figures(
    found: "Sequence[LocatedPoints]", labelled: "Sequence[LabelledImage]", truth: Sequence[Annotation]
) -> LocatorFigures | None:
    """Returns the figures of found lines beside the annotated ones; None without a line."""
    if not truth:
        return None
    right: list[bool] = []
    base_px: list[float] = []
    tip_px: list[float] = []
    for located, image, annotation in zip(found, labelled, truth, strict=True):
        distance = _distances_px(located.points_px, image.line_px)
        right.append(float(np.mean(distance < RIGHT_WITHIN_LENGTH_SHARE * _length_px(image.line_px))) >= RIGHT_SHARE)
        base_px.append(float(np.linalg.norm(located.points_px[0] - image.line_px[0])))
        if not annotation.tip_hidden:
            tip_px.append(float(np.linalg.norm(located.points_px[-1] - image.line_px[-1])))
    tip = float(np.median(tip_px)) if tip_px else math.nan
    return LocatorFigures(len(truth), float(np.mean(right)), float(np.median(base_px)), tip)


def _distances_px(points_px: FloatArray, line_px: FloatArray) -> FloatArray:
    """Returns the distances (n,) of points (n, 2) from a line (k, 2) of straight pieces."""
    start, piece = line_px[:-1], np.diff(line_px, axis=0)
    from_start = points_px[:, None] - start
    share = (from_start * piece).sum(-1) / np.maximum((piece**2).sum(-1), 1e-12)
    return np.linalg.norm(from_start - np.clip(share, 0.0, 1.0)[..., None] * piece, axis=-1).min(axis=1)


def _without_nan(value: Any) -> Any:
    if isinstance(value, dict):
        return {name: _without_nan(each) for name, each in value.items()}
    return None if isinstance(value, float) and math.isnan(value) else value


def _card(facts: dict[str, Any]) -> str:
    """Returns the card of the detector (Markdown)."""
    rows = ""
    for name in ("before", "after"):
        values = facts[name]
        if values:
            tip = "hidden" if math.isnan(values["tip_px"]) else f"{values['tip_px']:.1f}"
            rows += f"| {name} | {values['line_right']:.0%} | {values['base_px']:.1f} | {tip} |\n"
    judged = (
        f"Images left out of the training: {len(facts['left_out'])}.\n\n"
        f"| fine-tuning | lines right | base, px (median) | tip, px (median) |\n|---|---|---|---|\n{rows}\n"
        f"A line is right if {RIGHT_SHARE:.0%} of its points are within {RIGHT_WITHIN_LENGTH_SHARE:.0%} of the "
        f"catheter's length from the annotated line.\n"
        if rows
        else f"No image was left out to judge it: that needs {MIN_ANNOTATED_TO_JUDGE} annotated images.\n"
    )
    return (
        f"# Detector, fine-tuned on {facts['frames']} annotated images\n\n"
        f"It finds the catheter in images of the bench that these images are from. `bench.toml` names this folder.\n\n"
        f"{judged}\n"
        f"Fine-tuned from: {facts['init']}. Steps: {facts['steps']}. Seed: {facts['settings']['seed']}.\n"
        f"Half of the training images were of simulated benches, so that others are still found.\n"
        f"For research only; not for clinical use.\n"
    )
