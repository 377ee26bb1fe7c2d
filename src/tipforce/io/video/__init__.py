"""Video files: images with true stamps in, H.264 that plays in a browser out."""

from ._reader import VideoFile
from ._writer import VideoWriter, write_video

__all__ = ["VideoFile", "VideoWriter", "write_video"]
