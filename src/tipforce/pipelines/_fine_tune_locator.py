"""Fine-tunes the detector on annotated images, and writes a folder with the result."""

import json
import math
import platform
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from .._system.atomic import replacing_folder
from .._system.extras import import_extra
from .._system.json_files import finite_values
from ..errors import FileFormatError, InputError
from ..types import FloatArray, Image
from ..vision import Annotation, fitted_log_odds, line_log_odds
from ..vision.locator import (
    CAMERA_GRAPHS,
    DETECTOR_FACTS,
    DETECTOR_GRAPHS,
    FULL_PRECISION,
    XRAY_DETECTOR,
    Located,
    Prompts,
    session_constants,
)

if TYPE_CHECKING:
    from ..training.locator import LabelledImage

DETECTOR_CARD = "README.md"
"""Card in a detector folder."""
MIN_ANNOTATED = 2
"""Fewest images with a catheter."""
MIN_ANNOTATED_TO_JUDGE, ANNOTATED_PER_JUDGED = 5, 5
"""With fewer images with a catheter none is left out of the training; otherwise one in five is."""
LINE_STEPS, LINE_BATCH, LINE_RATE, LINE_KEPT_WEIGHT = 100, 32, 5e-4, 1.0
"""Settings of the fine-tuning of the second network."""
BEGUN_SHARE, LOCATED_SHARE, TRAINED_SHARE = 0.02, 0.7, 0.96
"""Finished share of the work when the networks are read, when the first is trained, and when the second is."""
RIGHT_WITHIN_LENGTH_SHARE, RIGHT_SHARE = 0.03, 0.85
"""A line is right if ``RIGHT_SHARE`` of its points are within this share of the catheter's length of the annotated
line: 3 px where the network reads it."""
END_WITHIN_LENGTH_SHARE = 0.1
"""For the probability base and visible tip are within this share of the length too."""

Progress = Callable[[str, float], None]
"""Called with a description of the current work and its finished share (0..1)."""


@dataclass(frozen=True, slots=True)
class LocatorFineTuneSettings:
    """Settings of `fine_tune_locator`.

    Attributes:
        seed: seed of the choice of images and of the training.
        steps: steps of the training of each network; None: as many as were best in measurements.
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
        before_px: (n, 2) u, v px of the line that the detector found before, base to tip; (0, 2) without one.
        after_px: (n, 2) u, v px of the line of the fine-tuned one.
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
    xray: bool = False,
    settings: LocatorFineTuneSettings | None = None,
    on_progress: Progress | None = None,
) -> FineTuneResult:
    """Fine-tunes the detector on annotated images and writes the detector folder.

    Some of the images are left out of the training and judge it. Windows of other benches' images are learnt as
    well, so that the detector does not forget them.

    Args:
        annotations: the annotated images.
        images: their pixels, in the same order: (h, w, 3) RGB or (h, w).
        folder: the detector folder; it is created, or replaced when everything is done.
        init: folder of the detector to begin with; None: the one that comes with tipforce for these images.
        xray: whether they are X-ray images.
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
    from ..training.locator import (
        FineTuneSettings,
        fine_tune,
        fine_tune_line,
        graph_with_line_weights,
        graph_with_weights,
        line_network_from_graph,
        locator_from_graph,
        rehearsal_windows,
    )

    settings, began = settings or LocatorFineTuneSettings(), time.monotonic()
    report: Progress = on_progress or (lambda _text, _share: None)
    _check(annotations, images)
    report("reading the networks", 0.0)
    first = XRAY_DETECTOR if init is None and xray else init
    graphs = _graph_paths(first)
    locator, line_network = locator_from_graph(graphs[0]), line_network_from_graph(graphs[1])
    # images that are left out judge the training; the others, and windows of other benches, are its data
    left_out = _left_out(annotations, settings.seed)
    labelled = labelled_images(annotations, images)
    trained, rehearsal = [image for k, image in enumerate(labelled) if k not in left_out], rehearsal_windows()
    locator_settings = FineTuneSettings(seed=settings.seed, max_seconds=LOCATED_SHARE * settings.max_seconds)
    line_settings = replace(
        locator_settings, steps=LINE_STEPS, batch=LINE_BATCH, rate=LINE_RATE, kept_weight=LINE_KEPT_WEIGHT,
        max_seconds=settings.max_seconds - locator_settings.max_seconds,
    )  # fmt: skip
    if settings.steps is not None:
        locator_settings = replace(locator_settings, steps=settings.steps)
        line_settings = replace(line_settings, steps=settings.steps)
    locator_progress = _within(report, "training the first network", BEGUN_SHARE, LOCATED_SHARE)
    tuned_locator = fine_tune(locator, trained, rehearsal, locator_settings, locator_progress)
    line_progress = _within(report, "training the second network", LOCATED_SHARE, TRAINED_SHARE)
    tuned_line = fine_tune_line(line_network, trained, rehearsal, line_settings, line_progress)
    report("judging the images that were left out", TRAINED_SHARE)
    # detection gets the usual length of the catheter, as in a session; the judged images do not contribute to it
    usual_px = _median_length_px([each for k, each in enumerate(annotations) if k not in left_out])
    prompts = Prompts(length_px=usual_px, xray=xray)
    truth, judged = [annotations[k] for k in left_out], [labelled[k] for k in left_out]
    with replacing_folder(folder) as part:
        (part / DETECTOR_GRAPHS[0]).write_bytes(graph_with_weights(graphs[0].read_bytes(), tuned_locator.network))
        (part / DETECTOR_GRAPHS[1]).write_bytes(graph_with_line_weights(graphs[1].read_bytes(), tuned_line.network))
        old, new = ([_detected(image.image, prompts, network) for image in judged] for network in (first, part))
        before, after = (_figures(lines, judged, truth) for lines in (old, new))
        facts: dict[str, Any] = {
            "kind": "tipforce detector",
            "init": "shipped" if init is None else str(init),
            "frames": len(trained),
            "left_out": [annotation.image for annotation in truth],
            "settings": {"first": asdict(locator_settings), "second": asdict(line_settings)},
            "steps": [tuned_locator.steps, tuned_line.steps],
            "training_s": round(tuned_locator.seconds + tuned_line.seconds, 1),
            "log_odds": round(_log_odds(new, judged, truth), 3),
            "before": before and asdict(before),
            "after": after and asdict(after),
            "versions": {name: version(name) for name in ("tipforce", "torch", "onnx", "numpy")}
            | {"python": platform.python_version()},
        }
        (part / DETECTOR_FACTS).write_text(json.dumps(finite_values(facts), indent=2) + "\n", encoding="utf-8")
        (part / DETECTOR_CARD).write_text(_card(facts), encoding="utf-8")
        report("writing the detector", 1.0)  # the last report: an error that it raises leaves the folder as it was
    frames = tuple(
        LeftOutFrame(annotation.image, _points_px(line), _points_px(tuned), _present(line), _present(tuned))
        for annotation, line, tuned in zip(truth, old, new, strict=True)
    )
    return FineTuneResult(folder, time.monotonic() - began, before, after, frames)


def _detected(image: Image, prompts: Prompts, network: Path | None) -> Located | None:
    """Returns the line in ``image`` as detection reads a session of this one image; None where it refuses it."""
    try:
        return session_constants([image], prompts, moves=False, network=network).lines[0]
    except InputError:
        return None


def _log_odds(
    lines: Sequence[Located | None], labelled: "Sequence[LabelledImage]", truth: Sequence[Annotation]
) -> float:
    """Returns by how much the lines are right more often than their probability says; see `fitted_log_odds`.

    A line is right here if `_right` holds and its base, and its tip where that is visible, are near the annotated ones.

    Args:
        lines: lines that the fine-tuned detector found; None without one.
        labelled: the images left out, with their annotated lines.
        truth: their annotations.

    Returns:
        Difference of log-odds; detection adds it to the score of a line.
    """
    scores: list[float] = []
    right: list[bool] = []
    for line, image, annotation in zip(lines, labelled, truth, strict=True):
        if line is not None:
            ends_px = _ends_off_px(line.points, image.line_px)[: 1 if annotation.tip_hidden else 2]
            scores.append(line_log_odds(line))
            right.append(
                _right(line.points, image.line_px)
                and max(ends_px) < END_WITHIN_LENGTH_SHARE * _length_px(image.line_px)
            )
    return fitted_log_odds(scores, right)


def _within(report: Progress, text: str, first: float, last: float) -> Progress:
    """Returns a progress between the shares ``first`` and ``last`` of the whole work."""
    return lambda step, share: report(f"{text}, {step}", first + (last - first) * share)


def _points_px(line: Located | None) -> FloatArray:
    return np.empty((0, 2)) if line is None else line.points


def _present(line: Located | None) -> float:
    return 0.0 if line is None else line.present


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
        else:
            # The line only sets the size of the training windows: a horizontal one of the usual length, in the middle.
            horizontal = np.linspace(-0.5, 0.5, LABEL_POINTS)[:, None] * (length, 0.0)
            line, state = horizontal + 0.5 * np.array(size[::-1]), np.full(LABEL_POINTS, OUTSIDE, np.uint8)
            mask, side = np.zeros(size, np.bool_), -1
        labelled.append(LabelledImage(pixels, line, state, mask, side, math.nan, present=annotation.present))
    return labelled


def _check(annotations: Sequence[Annotation], images: Sequence[Image]) -> None:
    """Raises InputError if annotations and images do not match, or too few of them show a catheter."""
    if len(annotations) != len(images):
        raise InputError(f"{len(annotations)} annotations for {len(images)} images; expected one for each image")
    count = sum(each.present for each in annotations)
    if count < MIN_ANNOTATED:
        raise InputError(
            f"{count} annotated image{'' if count == 1 else 's'} with a catheter; fine-tuning needs at least "
            f"{MIN_ANNOTATED}, and 8 to 20 are best: annotate more images"
        )


def _graph_paths(init: Path | None) -> list[Path]:
    """Returns the ONNX files of both networks to begin with; those of tipforce before they were rounded to 8 bit."""
    if init is None or init == XRAY_DETECTOR:
        return [(init or CAMERA_GRAPHS[0].parent) / FULL_PRECISION, CAMERA_GRAPHS[1]]
    paths = [init / name for name in DETECTOR_GRAPHS]
    for path in paths:
        if not path.is_file():
            raise FileFormatError(f"{path}: there is no such file; expected a folder of a detector")
    return paths


def _left_out(annotations: Sequence[Annotation], seed: int) -> list[int]:
    """Returns the sorted indices of the images that judge the training: one in five of those with a catheter."""
    marked = [k for k, each in enumerate(annotations) if each.present]
    if len(marked) < MIN_ANNOTATED_TO_JUDGE:
        return []
    count = len(marked) // ANNOTATED_PER_JUDGED
    return sorted(np.random.default_rng([seed, 6]).choice(marked, count, replace=False).tolist())


def _median_length_px(annotations: Sequence[Annotation]) -> float:
    return float(np.median([_length_px(each.points_px) for each in annotations if each.present]))


def _length_px(line_px: FloatArray) -> float:
    return float(np.linalg.norm(np.diff(line_px, axis=0), axis=1).sum())


def _figures(
    found: Sequence[Located | None], labelled: "Sequence[LabelledImage]", truth: Sequence[Annotation]
) -> LocatorFigures | None:
    """Compares detected lines with annotated ones.

    Args:
        found: the detected line in each image; None where no line was found, which counts as infinitely far away.
        labelled: the images with their annotated lines.
        truth: their annotations, which state whether the tip is hidden.

    Returns:
        The figures; None without an image.
    """
    if not truth:
        return None
    right: list[bool] = []
    base_px: list[float] = []
    tip_px: list[float] = []
    for located, image, annotation in zip(found, labelled, truth, strict=True):
        right.append(located is not None and _right(located.points, image.line_px))
        ends_px = [math.inf] * 2 if located is None else _ends_off_px(located.points, image.line_px)
        base_px.append(ends_px[0])
        if not annotation.tip_hidden:
            tip_px.append(ends_px[1])
    tip = float(np.median(tip_px)) if tip_px else math.nan
    return LocatorFigures(len(truth), float(np.mean(right)), float(np.median(base_px)), tip)


def _right(points_px: FloatArray, line_px: FloatArray) -> bool:
    near = _distances_px(points_px, line_px) < RIGHT_WITHIN_LENGTH_SHARE * _length_px(line_px)
    return float(near.mean()) >= RIGHT_SHARE


def _ends_off_px(points_px: FloatArray, line_px: FloatArray) -> list[float]:
    return [float(np.linalg.norm(points_px[k] - line_px[k])) for k in (0, -1)]


def _distances_px(points_px: FloatArray, line_px: FloatArray) -> FloatArray:
    """Returns the distances (n,) of points (n, 2) from a line (k, 2) of straight pieces."""
    start, piece = line_px[:-1], np.diff(line_px, axis=0)
    from_start = points_px[:, None] - start  # (n, k - 1, 2)
    # position of each point's foot on each piece, 0 to 1; a foot beyond an end is moved to it
    share = (from_start * piece).sum(-1) / np.maximum((piece**2).sum(-1), 1e-12)
    return np.linalg.norm(from_start - np.clip(share, 0.0, 1.0)[..., None] * piece, axis=-1).min(axis=1)


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
        f"Fine-tuned from: {facts['init']}. Steps of its two networks: {facts['steps'][0]} and {facts['steps'][1]}. "
        f"Seed: {facts['settings']['first']['seed']}.\n"
        f"Images of other benches went along in the training, so that these are still found.\n"
        f"For research only; not for clinical use.\n"
    )
