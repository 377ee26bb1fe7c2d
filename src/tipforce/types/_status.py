"""Whether there is a value, and if not, why not."""

from enum import StrEnum


class Status(StrEnum):
    """Whether there is a value, and if not, why not."""

    VALID = "valid"
    NO_CATHETER = "no_catheter"
    """Nothing in the image looks like the catheter."""
    CUT_OFF = "cut_off"
    """The catheter was found, but leaves the image or is lost before its tip."""
    NOT_A_FUNCTION = "not_a_function"
    """The shape bends past 90 degrees: no polynomial y(x) describes it."""
    MISSING_INPUT = "missing_input"
    """An actuation value that the method was trained with is absent."""
    OUT_OF_DISTRIBUTION = "out_of_distribution"
    UNOBSERVABLE = "unobservable"
    FOLD = "fold"
    STALE = "stale"
