"""Status of a value: valid, or the reason why there is none."""

from enum import StrEnum


class Status(StrEnum):
    """Status of a value: valid, or the reason why there is none."""

    VALID = "valid"
    NO_CATHETER = "no_catheter"
    """No object in the image looks like the catheter."""
    CUT_OFF = "cut_off"
    """The catheter was found, but leaves the image or is lost before its tip."""
    NOT_A_FUNCTION = "not_a_function"
    """The shape bends past 90 degrees: no polynomial y(x) describes it."""
    MISSING_INPUT = "missing_input"
    """A reading of a drive with which the method was trained is missing."""
    OUT_OF_DISTRIBUTION = "out_of_distribution"
    UNOBSERVABLE = "unobservable"
    FOLD = "fold"
    STALE = "stale"
