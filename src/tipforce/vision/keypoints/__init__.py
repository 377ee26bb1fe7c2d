"""The catheter by trained networks, where its size is stated: rough points in the whole image, then the line."""

from ._locate import Located, locate
from ._probability import Signs, consensus, probability, signs
from ._strip import ACROSS, ALONG, HALF_WIDTH, evenly, straightened, strip_input
from ._upright import LENGTH_PX, STRIDE, normalised, upright

__all__ = [
    "ACROSS",
    "ALONG",
    "HALF_WIDTH",
    "LENGTH_PX",
    "STRIDE",
    "Located",
    "Signs",
    "consensus",
    "evenly",
    "locate",
    "normalised",
    "probability",
    "signs",
    "straightened",
    "strip_input",
    "upright",
]
