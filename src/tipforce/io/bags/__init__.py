"""ROS bags (1 and 2) and MCAP files of other programs: their images, forces and drives."""

from ._bag import Bag, is_bag, open_bag

__all__ = ["Bag", "is_bag", "open_bag"]
