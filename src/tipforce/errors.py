"""All errors that tipforce raises on purpose, in one tree.

::

    TipforceError                one sentence: the fault and its place, the expected value, the next command
    ├── InputError               a file or value given by the user cannot be used
    │   ├── FileFormatError      a file is missing, empty, truncated or of another type than its name
    │   ├── NoCatheterError      no catheter is found in images, or two objects could be it
    │   ├── TableError           a table lacks a column, or a cell is no number
    │   ├── TimeError            stamps are unsorted, repeated, or do not overlap
    │   ├── ModelError           a model folder is incomplete, altered, or newer than this program
    │   ├── OutputError          a file or folder cannot be written
    │   └── ZeroInContactError   the tip may be in contact: a zero must be confirmed
    ├── DeviceError              a device does not respond, or responds with an error
    ├── NotFittedError           an estimator was used before ``fit`` or ``load``
    └── MissingExtraError        an optional package is needed; the message holds the install line

The command line prints the message and ends with exit code 2; anything else that is raised is a bug.
"""

__all__ = [
    "DeviceError",
    "FileFormatError",
    "InputError",
    "MissingExtraError",
    "ModelError",
    "NoCatheterError",
    "NotFittedError",
    "OutputError",
    "TableError",
    "TimeError",
    "TipforceError",
    "ZeroInContactError",
]


class TipforceError(Exception):
    """Base of all errors that a user can correct."""


class InputError(TipforceError):
    """A file or a value given by the user cannot be used."""


class FileFormatError(InputError):
    """A file is missing, empty, truncated, or of another type than its name."""


class TableError(InputError):
    """A table lacks a column, or a cell holds no number."""


class TimeError(InputError):
    """Time stamps are unsorted, repeated, or two streams do not overlap."""


class ModelError(InputError):
    """A model folder is incomplete, altered, or newer than this program."""


class OutputError(InputError):
    """A file or folder cannot be written: no space, no permission, in use, or no regular file."""


class ZeroInContactError(InputError):
    """The operator's zero would subtract a force that may be real; it must be confirmed.

    Args:
        message: the sentence for the user.
        magnitude_n: magnitude of this force, N.
    """

    def __init__(self, message: str, magnitude_n: float) -> None:
        super().__init__(message)
        self.magnitude_n = magnitude_n


class NoCatheterError(InputError):
    """No catheter is found in images, or two objects could be it.

    Args:
        reason: the reason.
        remedy: the statement of the user that usually helps; "" where none is known.
        several: whether two objects could be it.
    """

    def __init__(self, reason: str, remedy: str = "", *, several: bool = False) -> None:
        super().__init__(f"{reason}: {remedy}" if remedy else reason)
        self.reason, self.several = reason, several


class DeviceError(TipforceError):
    """A device does not respond, refuses a command, or responds with an error."""


class NotFittedError(TipforceError):
    """An estimator was used before it was fitted or loaded."""


class MissingExtraError(TipforceError):
    """An optional package is missing.

    >>> str(MissingExtraError("torch", extra="train"))
    "torch is not installed; in the checkout of tipforce, run: pip install -e '.[train]'"
    """

    def __init__(self, package: str, *, extra: str) -> None:
        super().__init__(f"{package} is not installed; in the checkout of tipforce, run: pip install -e '.[{extra}]'")
