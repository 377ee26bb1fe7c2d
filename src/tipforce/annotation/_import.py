"""Takes annotations of a file into the store: finds the image of each, and checks that the points are in it."""

from dataclasses import dataclass, replace
from pathlib import Path, PurePosixPath

import numpy as np

from .._system.rows import evenly_spread
from ..errors import InputError
from ..types import Image
from ._images import AnnotationImages
from ._store import MAX_POINTS, AnnotationStore, MarkedFrame
from .formats import read_marks

MAX_OUTSIDE_SHARE = 0.05
"""Points may be beyond the border of the image by this share of its size: the base may enter from outside."""
MAX_IMPORTED = 200
"""Frames that are taken from one file; of more, as a network predicts for a whole video, evenly spread ones."""


@dataclass(frozen=True, slots=True)
class ImportReport:
    """Result of an import.

    Attributes:
        taken: number of frames that were taken.
        remarks: frames that were left out, one line for each reason.
    """

    taken: int
    remarks: tuple[str, ...] = ()


def import_marks(file: Path, images: AnnotationImages, store: AnnotationStore) -> ImportReport:
    """Takes the annotations of ``file`` into ``store``, as finished frames, and saves them.

    Args:
        file: see `read_marks`.
        images: the images that the file refers to.
        store: receives the frames.

    Returns:
        The number of frames, and remarks on those that were left out.

    Raises:
        InputError: no image of the file is there, an image has another size than the file states, or a point is outside
            of its image.
    """
    marks = read_marks(file)
    remarks = _grouped(marks.left_out)
    by_name: dict[str, MarkedFrame] = {}  # name of the image here -> its marks
    missing: list[str] = []
    # both views of a biplane set may have the same names of files: then the folder of the images decides
    folders = {PurePosixPath(frame.image).parent.name for frame in marks.frames}
    only_folder = images.path.name if images.path.name in folders else None
    for frame in marks.frames:
        if only_folder is not None and PurePosixPath(frame.image).parent.name not in ("", only_folder):
            continue
        name = images.resolve(frame.image)
        if name is None:
            missing.append(frame.image)
        elif name in by_name:
            raise InputError(f"{file}: {frame.image} and another row mean the same image, {name}; remove one of them")
        else:
            by_name[name] = replace(frame, image=name)
    if missing and not by_name:
        raise InputError(
            f"{file}: none of its images is in {images.path}: it has {_examples(missing)}, there is "
            f"{_examples(images.examples)}; name images by their files, or frames by their numbers from 0"
        )
    if not by_name:
        raise InputError(f"{file}: holds no annotation that can be used{'; ' if remarks else ''}{'; '.join(remarks)}")
    if missing:
        remarks.append(f"{len(missing)} images are not in {images.path} ({_examples(missing)}): left out")
    names = list(by_name)
    if len(names) > MAX_IMPORTED:
        remarks.append(
            f"{len(names)} frames are more than {MAX_IMPORTED}: every {len(names) / MAX_IMPORTED:.1f}th used"
        )
        names = [names[row] for row in evenly_spread(len(names), MAX_IMPORTED).tolist()]
    sizes = {images.resolve(name): size for name, size in marks.sizes_px.items()}
    for name, image in zip(names, images.read(names), strict=True):
        _check(file, by_name[name], image, sizes.get(name))
        by_name[name] = by_name[name].seen_in(image)
    store.add(by_name[name] for name in names)
    return ImportReport(len(names), tuple(remarks))


def _check(file: Path, frame: MarkedFrame, image: Image, stated_px: tuple[int, int] | None) -> None:
    """Checks that marks fit their image.

    Args:
        file: file of the marks, for messages.
        frame: the marks.
        image: (h, w) or (h, w, 3) image that they are for.
        stated_px: width and height that the file states; None: it states none.

    Raises:
        InputError: the sizes differ, there are too many points, a point is outside, or two neighbours are the same.
    """
    height, width = image.shape[:2]
    if stated_px is not None and stated_px != (width, height):
        raise InputError(
            f"{file}: {frame.image} has {stated_px[0]} x {stated_px[1]} px there, the image here has {width} x {height}"
            "; export the annotations for images of this size"
        )
    if len(frame.points_px) > MAX_POINTS:
        raise InputError(f"{file}: {frame.image} has {len(frame.points_px)} points; at most {MAX_POINTS} are read")
    margin = MAX_OUTSIDE_SHARE * np.array([width, height])
    outside = ((frame.points_px < -margin) | (frame.points_px > np.array([width, height]) - 1 + margin)).any(axis=1)
    if outside.any():
        u, v = frame.points_px[int(np.argmax(outside))].tolist()
        raise InputError(
            f"{file}: {frame.image}: the point ({u:g}, {v:g}) is outside of the image, {width} x {height} px; were "
            "they marked in images of another size? scale the points to this size"
        )
    try:
        frame.annotation()
    except InputError as error:  # two points in a row are the same
        raise InputError(f"{file}: {error}") from None


def _grouped(left_out: dict[str, str]) -> list[str]:
    """Returns one line for each reason, with the number of images that were left out for it, and two examples."""
    names_of: dict[str, list[str]] = {reason: [] for reason in sorted(set(left_out.values()))}
    for name, reason in left_out.items():
        names_of[reason].append(name)
    return [f"{len(names)} images are left out, {reason} ({_examples(names)})" for reason, names in names_of.items()]


def _examples(names: list[str]) -> str:
    shown = ", ".join(name[-60:] for name in names[:2])
    return f"{shown}, ..." if len(names) > 2 else shown
