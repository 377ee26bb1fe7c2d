"""Readers and writers: recordings (.mcap), images, videos, DICOM, tables, logs."""

from .._system.atomic import atomic_path, atomic_text, check_folder, check_output_file, replacing_folder, write_atomic
from ._actuation import WAIT_S, ActuationSeries
from ._cdr import COMPRESSED_IMAGE, ESTIMATE, FORCE_ESTIMATE, SCHEMAS, pack_estimate, pack_image, unpack_estimate
from ._dicom import is_dicom
from ._dicom_view import ASSUMED_SHIFT_M, ASSUMED_TURN_DEG
from ._facts import SUBTRACTED_FORCE, ClockMap, Fact, Inertia, Tare
from ._folder import InFolder
from ._force_log import DriveLog, ForceLog, logs_by_kind, read_drive_log, read_force_log
from ._images import StreamDepth, check_image_target, decode_image, encode_image, is_image, read_image, save_image
from ._reader import RecordingInfo, RecordingReader, StreamInfo, open_recording
from ._recover import check_target, recover_recording
from ._sources import (
    FilesOfViews,
    FileSource,
    any_reading,
    can_be_read_again,
    frame_count,
    images_beforehand,
    open_source,
    require_actuation,
    spread_images,
    spread_rows,
    steady_reading,
)
from ._writer import RecordingWriter, write_force_csv
from .bags import Bag, is_bag, open_bag
from .tables import ACTUATION_UNITS, STILL_STEP_NS, Table, check_actuation, is_actuation, is_force, open_table
from .video import FieldEvidence, VideoWriter, shown_image, write_video

__all__ = [
    "ACTUATION_UNITS",
    "ASSUMED_SHIFT_M",
    "ASSUMED_TURN_DEG",
    "COMPRESSED_IMAGE",
    "ESTIMATE",
    "FORCE_ESTIMATE",
    "SCHEMAS",
    "STILL_STEP_NS",
    "SUBTRACTED_FORCE",
    "WAIT_S",
    "ActuationSeries",
    "Bag",
    "ClockMap",
    "DriveLog",
    "Fact",
    "FieldEvidence",
    "FileSource",
    "FilesOfViews",
    "ForceLog",
    "InFolder",
    "Inertia",
    "RecordingInfo",
    "RecordingReader",
    "RecordingWriter",
    "StreamDepth",
    "StreamInfo",
    "Table",
    "Tare",
    "VideoWriter",
    "any_reading",
    "atomic_path",
    "atomic_text",
    "can_be_read_again",
    "check_actuation",
    "check_folder",
    "check_image_target",
    "check_output_file",
    "check_target",
    "decode_image",
    "encode_image",
    "frame_count",
    "images_beforehand",
    "is_actuation",
    "is_bag",
    "is_dicom",
    "is_force",
    "is_image",
    "logs_by_kind",
    "open_bag",
    "open_recording",
    "open_source",
    "open_table",
    "pack_estimate",
    "pack_image",
    "read_drive_log",
    "read_force_log",
    "read_image",
    "recover_recording",
    "replacing_folder",
    "require_actuation",
    "save_image",
    "shown_image",
    "spread_images",
    "spread_rows",
    "steady_reading",
    "unpack_estimate",
    "write_atomic",
    "write_force_csv",
    "write_video",
]
