"""Annotates the catheter in frames that differ, and fine-tunes the detector on them."""

import os
from collections.abc import Generator, Mapping, Sequence
from contextlib import contextmanager
from datetime import date
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pydantic import BaseModel, ConfigDict

from .._system.locks import output_lock
from ..annotation import (
    DEFAULT_FRAMES,
    MAX_CANDIDATES,
    Annotation,
    AnnotationImages,
    AnnotationSession,
    AnnotationStore,
    Candidate,
    ImportReport,
    MarkedFrame,
    TrainedDetector,
    check_enough,
    check_marks_file,
    choose_frames,
    import_marks,
    uncertainty_of,
    views_at,
    write_marks,
)
from ..errors import InputError
from ..estimators import Progress, no_progress
from ..io import atomic_text
from ..types import DetectedShape, Image, SessionInfo, edited_bench
from ..vision import SessionDetector, VisionSettings
from ._estimate import session_info_from

if TYPE_CHECKING:
    from ..annotation import AnnotationServer

DETECTOR_FOLDER = "detector"
"""Folder of the fine-tuned detector, beside ``bench.toml`` or the recording."""
FACTS = "detector.json"
"""A folder of this name with this file in it is replaced by the next training; another one is not."""


class AnnotateSettings(BaseModel):
    """Settings of the detector whose lines are proposed."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    vision: VisionSettings = VisionSettings()


class AnnotationJob:
    """The annotations of one recording or folder: from the page or a file, to the training or a file.

    Args:
        path: a recording, video, folder of images, or folder of recordings.
        detector: folder of the fine-tuned detector.
        settings: settings of the detector whose lines are proposed.
        bench: metadata in place of those in the file.
        bench_file: the ``bench.toml`` that is to name the detector; None: no file is changed.

    Raises:
        InputError: there is no image, the annotations belong to other images, or ``detector`` is a folder with other
            contents.
    """

    def __init__(
        self,
        path: Path,
        detector: Path,
        *,
        settings: AnnotateSettings | Mapping[str, Any] | None = None,
        bench: SessionInfo | str | Path | None = None,
        bench_file: Path | None = None,
    ) -> None:
        self._bench_file = bench_file
        if detector.exists() and not (detector / FACTS).is_file():
            raise InputError(f"{detector}: exists already and is no detector of a training; choose another folder")
        stated = session_info_from(bench)
        vision = AnnotateSettings.model_validate(settings or {}).vision
        self._vision = vision.for_views(views_at(path, stated), path)
        self.path, self.detector = path, detector
        self.images = AnnotationImages(path, self._vision.view, stated)
        self.store = AnnotationStore(path, self._vision.view)
        lost = [name for name in self.store.frames if name not in self.images]
        if lost:
            raise InputError(
                f"{self.store.file}: {lost[0]} is not in {path}; the annotations belong to other images: move them "
                "away to start again"
            )
        self._detectors: dict[int, SessionDetector] = {}
        self._shapes: dict[str, DetectedShape] = {}

    @property
    def finished(self) -> list[MarkedFrame]:
        """The finished frames."""
        return self.store.finished

    def import_from(self, file: Path) -> ImportReport:
        """Takes the annotations of a file as finished frames; see `tipforce.annotation.read_marks` for the formats.

        Raises:
            InputError: the file or one of its annotations cannot be used.
        """
        return import_marks(file, self.images, self.store)

    def export(self, file: Path) -> int:
        """Writes the finished frames: a table (.csv) or COCO keypoints (.json).

        Returns:
            The number of frames.

        Raises:
            InputError: no frame is finished, or the file cannot be written.
        """
        check_marks_file(file)
        frames = self.finished
        if not frames:
            raise InputError(
                f"{self.store.file}: no frame is finished; mark some with `tipforce annotate {self.path}`, or take "
                f"those of a file with `tipforce annotate {self.path} --from FILE`"
            )
        sizes: dict[str, tuple[int, int]] = {}
        for name, image in self.images.each([frame.image for frame in frames]):
            self.store.check_image(name, image)
            sizes[name] = (image.shape[1], image.shape[0])
        write_marks(file, frames, sizes)
        return len(frames)

    def train(self, progress: Progress | None = None) -> TrainedDetector:
        """Fine-tunes the detector on the finished frames and stores it in the folder ``detector``.

        Args:
            progress: called with the current step and the share that is done.

        Returns:
            The folder of the detector, and lines before and after in frames that were left out.

        Raises:
            InputError: too few frames with a catheter are finished.
            MissingExtraError: torch is not installed.
        """
        frames = self.finished
        check_enough(frames)
        images = self._read([frame.image for frame in frames])
        return self._fine_tune([frame.annotation() for frame in frames], images, progress or no_progress)

    @contextmanager
    def serve(
        self, count: int = DEFAULT_FRAMES, *, host: str = "127.0.0.1", port: int = 0, progress: Progress | None = None
    ) -> "Generator[AnnotationServer]":
        """Chooses frames where there are fewer than ``count``, and serves the page until the end of the block.

        Inside the block no other process can change the annotations.

        Args:
            count: number of frames.
            host: name or address that the page listens on.
            port: its port; 0: any free port.
            progress: called with the current step and the share that is done.

        Yields:
            The running page.

        Raises:
            InputError: an image cannot be read, or nothing can listen there.
            OutputError: another process has the page of these annotations.
        """
        from ..annotation import serve_annotation

        report = progress or no_progress
        with output_lock(self.store.file):
            self._choose(count, report)
            names = list(self.store.frames)
            images = self._read(names)
            shapes: list[DetectedShape] = []
            for name, image in zip(names, images, strict=True):
                report("detecting the catheter in the chosen frames", len(shapes) / len(names))
                shapes.append(self._detect(name, image))
            groups = [self.images.session_of(name) for name in names]
            session = AnnotationSession(self.store, images, groups, shapes)
            with serve_annotation(session, self._fine_tune, title=self.path.name, host=host, port=port) as server:
                yield server

    def _choose(self, count: int, report: Progress) -> None:
        """Adds frames to the store until it has ``count``: frames that differ, and in which detection is uncertain.

        Args:
            count: number of frames.
            report: called with the current step and the share that is done.
        """
        lacking = count - len(self.store.frames)
        if lacking <= 0:
            return
        candidates: list[Candidate] = []
        total = min(len(self.images), MAX_CANDIDATES)
        for candidate in self.images.candidates():
            report("comparing frames", min(1.0, len(candidates) / total))
            if candidate.name not in self.store.frames:
                candidates.append(candidate)

        def uncertainty(pool: Sequence[Candidate]) -> list[float]:
            by_name: dict[str, float] = {}  # images are read in the order of the file
            for name, image in self.images.each([candidate.name for candidate in pool]):
                report("detecting the catheter in frames that differ", len(by_name) / len(pool))
                by_name[name] = uncertainty_of(self._detect(name, image))
            return [by_name[candidate.name] for candidate in pool]

        if candidates:
            self.store.add(MarkedFrame.empty(name) for name in choose_frames(candidates, lacking, uncertainty))

    def _read(self, names: Sequence[str]) -> list[Image]:
        """Returns the images of frames of the store. Raises InputError where one is not the image that was marked."""
        images = self.images.read(names)
        for name, image in zip(names, images, strict=True):
            self.store.check_image(name, image)
        return images

    def _detect(self, name: str, image: Image) -> DetectedShape:
        """Returns the shape in the frame ``name``; shapes, and the detector of each session, are kept."""
        if name in self._shapes:
            return self._shapes[name]
        session = self.images.session_of(name)
        if session not in self._detectors:
            info, images = self.images.session_info[session], self.images.beforehand(session)
            self._detectors[session] = SessionDetector(self._vision, info, images)
        shape = self._shapes[name] = self._detectors[session].detect(image)
        return shape

    def _fine_tune(
        self, annotations: Sequence[Annotation], images: Sequence[Image], progress: Progress
    ) -> TrainedDetector:
        """Fine-tunes the detector, and names its folder in ``bench.toml`` if there is one; see `fine_tune_locator`."""
        from ._fine_tune_locator import fine_tune_locator

        views = [info.view(self._vision.view) for info in self.images.session_info]
        xray = all(view.modality == "xray" for view in views)
        trained = fine_tune_locator(annotations, images, self.detector, xray=xray, on_progress=progress)
        if self._bench_file is not None:
            name_detector(self._bench_file, self._vision.view, self.detector)
        return trained


def name_detector(bench: Path, view: str, detector: Path) -> None:
    """Writes the folder of a fine-tuned detector into a ``bench.toml``; the rest of the file stays as it is.

    Args:
        bench: the ``bench.toml``.
        view: name of the view whose images the detector was trained on.
        detector: its folder.

    Raises:
        OutputError: the file cannot be written.
    """
    folder = Path(os.path.relpath(detector, bench.parent)).as_posix()
    note = f"tipforce annotate, {date.today().isoformat()}"
    text = edited_bench(bench.read_text(encoding="utf-8"), {f"views.{view}.detector": (folder, note)}, str(bench))
    with atomic_text(bench) as out:
        out.write(text)


def detector_beside(path: Path, bench: Path | None) -> Path:
    """Returns the folder for the fine-tuned detector: beside ``bench.toml``, else beside the recording or folder.

    >>> detector_beside(Path("runs/monday.mcap"), Path("lab/bench.toml")).as_posix()
    'lab/detector'
    """
    return (path if bench is None else bench).parent / DETECTOR_FOLDER
