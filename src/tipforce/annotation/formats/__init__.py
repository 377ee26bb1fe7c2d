"""Files of annotations: our table, COCO keypoints, SLEAP's analysis CSV, DeepLabCut's CSV, Guide3D, and masks."""

from ._read import read_marks
from ._write import check_marks_file, write_marks

__all__ = ["check_marks_file", "read_marks", "write_marks"]
