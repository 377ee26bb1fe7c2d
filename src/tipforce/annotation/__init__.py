"""Annotation of the catheter in some frames: choice of frames, marks of a person, page, files of other programs."""

from ..vision import Annotation
from ._choice import DEFAULT_FRAMES, choose_frames
from ._images import MAX_CANDIDATES, AnnotationImages, Candidate, views_at
from ._import import ImportReport, import_marks
from ._server import AnnotationServer, serve_annotation
from ._session import AnnotationSession, Proposal, check_enough, uncertainty_of
from ._spline import curve_through, handles_of
from ._store import AnnotationStore, MarkedFrame, store_path
from ._training import FineTune, TrainedDetector, TrainingRun
from .formats import check_marks_file, read_marks, write_marks

__all__ = [
    "DEFAULT_FRAMES",
    "MAX_CANDIDATES",
    "Annotation",
    "AnnotationImages",
    "AnnotationServer",
    "AnnotationSession",
    "AnnotationStore",
    "Candidate",
    "FineTune",
    "ImportReport",
    "MarkedFrame",
    "Proposal",
    "TrainedDetector",
    "TrainingRun",
    "check_enough",
    "check_marks_file",
    "choose_frames",
    "curve_through",
    "handles_of",
    "import_marks",
    "read_marks",
    "serve_annotation",
    "store_path",
    "uncertainty_of",
    "views_at",
    "write_marks",
]
