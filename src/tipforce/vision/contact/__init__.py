"""The geometry of the contact at the tip, read from the image by a network: contact, indentation, direction."""

from ._crop import BEHIND_M, PIXEL_M, SIDE_PX, crop_tip
from ._reader import ContactReader, tip_axis
from ._reading import DEPTH_M, ContactReading

__all__ = ["BEHIND_M", "DEPTH_M", "PIXEL_M", "SIDE_PX", "ContactReader", "ContactReading", "crop_tip", "tip_axis"]
