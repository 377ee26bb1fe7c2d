"""Readers and writers: recordings (.mcap), images, videos, DICOM, tables, logs."""

from ._actuation import WAIT_S, ActuationSeries
from ._facts import ClockOffset, Inertia, Reads, SensorPose, Tare
from ._files import check_target, part_of
from ._folder import read_image
from ._force_log import ForceColumns, ForceLog, read_force_log, read_knob_log
from ._images import check_image_target, encode_image, is_image, save_image
from ._reader import RecordingInfo, RecordingReader, StreamInfo
from ._replacing import replacing_folder
from ._sources import FileSource, frame_count, open_source, require_actuation
from ._video import VideoWriter, write_video
from ._writer import RecordingWriter, write_force_csv

__all__ = [
    "WAIT_S",
    "ActuationSeries",
    "ClockOffset",
    "FileSource",
    "ForceColumns",
    "ForceLog",
    "Inertia",
    "Reads",
    "RecordingInfo",
    "RecordingReader",
    "RecordingWriter",
    "SensorPose",
    "StreamInfo",
    "Tare",
    "VideoWriter",
    "check_image_target",
    "check_target",
    "encode_image",
    "frame_count",
    "is_image",
    "open_source",
    "part_of",
    "read_force_log",
    "read_image",
    "read_knob_log",
    "replacing_folder",
    "require_actuation",
    "save_image",
    "write_force_csv",
    "write_video",
]
