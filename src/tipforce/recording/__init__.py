"""Runs as files: the recording file (.mcap), videos and image folders, importers, time alignment."""

from ._describe import describe
from ._facts import ClockOffset, Inertia, Tare
from ._files import refuse_picture
from ._forcelog import logs_by_kind
from ._import import import_run
from ._labels import Labels, label_log, labels
from ._look import Look, frame_count, is_picture, look_at, look_over, look_through, save_picture
from ._observations import observations
from ._pairing import nearest_frames
from ._reader import RecordingInfo, RecordingReader, StreamInfo
from ._record import RunReport, record
from ._sources import open_source, require_actuation
from ._summary import RecordingSummary, plot_summary, summarise
from ._tare import find_tare, stated_tare
from ._timing import estimate_offset, shape_coordinates
from ._video import VideoWriter, write_video
from ._writer import RecordingWriter, encode, write_force_csv

__all__ = [
    "ClockOffset",
    "Inertia",
    "Labels",
    "Look",
    "RecordingInfo",
    "RecordingReader",
    "RecordingSummary",
    "RecordingWriter",
    "RunReport",
    "StreamInfo",
    "Tare",
    "VideoWriter",
    "describe",
    "encode",
    "estimate_offset",
    "find_tare",
    "frame_count",
    "import_run",
    "is_picture",
    "label_log",
    "labels",
    "logs_by_kind",
    "look_at",
    "look_over",
    "look_through",
    "nearest_frames",
    "observations",
    "open_source",
    "plot_summary",
    "record",
    "refuse_picture",
    "require_actuation",
    "save_picture",
    "shape_coordinates",
    "stated_tare",
    "summarise",
    "write_force_csv",
    "write_video",
]
