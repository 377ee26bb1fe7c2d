"""Video: images with true stamps in, H.264 that plays in a browser out."""

from ._fields import FieldEvidence
from ._pixels import shown_image
from ._reader import VideoFile
from ._writer import VideoWriter, write_video

__all__ = ["FieldEvidence", "VideoFile", "VideoWriter", "shown_image", "write_video"]
