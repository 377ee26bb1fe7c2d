"""Plain functions, one a job: what the command line calls."""

from ._describe import describe_recording
from ._import_session import import_session
from ._inspect_images import InspectionSheet, inspect_frames, inspect_image_file, inspect_sessions
from ._record import RecordingReport, record
from ._summary import RecordingSummary, plot_summary, summarise_recording

__all__ = [
    "InspectionSheet",
    "RecordingReport",
    "RecordingSummary",
    "describe_recording",
    "import_session",
    "inspect_frames",
    "inspect_image_file",
    "inspect_sessions",
    "plot_summary",
    "record",
    "summarise_recording",
]
