"""The locator: two trained networks that find the catheter, with all that is stated as their prompts."""

from ._line_probability import (
    MARKED_LOG_ODDS,
    fitted_log_odds,
    line_log_odds,
    probability,
)
from ._locate import Located, as_colour, locate, read_points, rough_line
from ._networks import CAMERA_GRAPHS, DETECTOR_FACTS, DETECTOR_GRAPHS, FULL_PRECISION, XRAY_DETECTOR, RoughPoints
from ._prompts import Prompts
from ._reading import Known
from ._session import MIN_FRAMES, SessionConstants, object_prompts, session_constants
from ._strip import ACROSS, ALONG, HALF_WIDTH, straightened, strip_input

__all__ = [
    "ACROSS",
    "ALONG",
    "CAMERA_GRAPHS",
    "DETECTOR_FACTS",
    "DETECTOR_GRAPHS",
    "FULL_PRECISION",
    "HALF_WIDTH",
    "MARKED_LOG_ODDS",
    "MIN_FRAMES",
    "XRAY_DETECTOR",
    "Known",
    "Located",
    "Prompts",
    "RoughPoints",
    "SessionConstants",
    "as_colour",
    "fitted_log_odds",
    "line_log_odds",
    "locate",
    "object_prompts",
    "probability",
    "read_points",
    "rough_line",
    "session_constants",
    "straightened",
    "strip_input",
]
