"""The locator: two trained networks that find the catheter, with all that is stated as their prompts."""

from ._locate import Located, locate, read_points, rough_line
from ._prompts import Prompts
from ._reading import Known
from ._session import MIN_FRAMES, SessionConstants, session_constants
from ._strip import ACROSS, ALONG, HALF_WIDTH, evenly, straightened, strip_input

__all__ = [
    "ACROSS",
    "ALONG",
    "HALF_WIDTH",
    "MIN_FRAMES",
    "Known",
    "Located",
    "Prompts",
    "SessionConstants",
    "evenly",
    "locate",
    "read_points",
    "rough_line",
    "session_constants",
    "straightened",
    "strip_input",
]
