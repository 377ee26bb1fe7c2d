"""Contact at one instant (state) and over the last seconds (class)."""

from collections.abc import Sequence
from enum import StrEnum

from ._settings import ContactSettings


class ContactState(StrEnum):
    """State of the contact by the force of one instant."""

    UNKNOWN = "unknown"
    """There is no valid estimate."""
    NO_CONTACT = "no_contact"
    UNSTABLE = "unstable"
    """Contact below the window: too little for a lesion, and easily lost."""
    EFFECTIVE = "effective"
    """From the window's lower end to the limit."""
    EXCESSIVE = "excessive"
    """Above the limit."""


class ContactClass(StrEnum):
    """Class of the contact over the last seconds."""

    UNKNOWN = "unknown"
    """The time was too short, or too much of it had no valid estimate."""
    NONE = "none"
    INTERMITTENT = "intermittent"
    """Contact was lost and made again."""
    VARIABLE = "variable"
    """Always in contact, with a large swing of the force."""
    CONSTANT = "constant"


def contact_state(magnitude_n: float, settings: ContactSettings) -> ContactState:
    """Returns the state of the contact for a force.

    Args:
        magnitude_n: magnitude of the force in newtons; NaN: unknown.
        settings: force window, limit and contact threshold.

    >>> [str(contact_state(force, ContactSettings())) for force in (0.0, 0.05, 0.2, 0.41, float("nan"))]
    ['no_contact', 'unstable', 'effective', 'excessive', 'unknown']
    """
    if magnitude_n != magnitude_n:
        return ContactState.UNKNOWN
    if magnitude_n <= settings.contact_n:
        return ContactState.NO_CONTACT
    if magnitude_n > settings.limit_n:
        return ContactState.EXCESSIVE
    return ContactState.UNSTABLE if magnitude_n < settings.window_n[0] else ContactState.EFFECTIVE


def contact_class(magnitudes_n: Sequence[float], settings: ContactSettings) -> ContactClass:
    """Returns the class of the contact over a stretch of frames.

    Args:
        magnitudes_n: magnitude of the force in each frame in newtons; NaN where there is no valid estimate.
        settings: contact threshold, the swing of a constant contact, and the largest share of unknown frames.

    >>> [str(contact_class(forces, ContactSettings())) for forces in ([0.0, 0.0], [0.0, 0.2], [0.1, 0.35], [0.2, 0.21])]
    ['none', 'intermittent', 'variable', 'constant']
    """
    known = [force for force in magnitudes_n if force == force]
    if not known or len(known) < (1.0 - settings.max_unknown_share) * len(magnitudes_n):
        return ContactClass.UNKNOWN
    least, most = min(known), max(known)
    if most <= settings.contact_n:
        return ContactClass.NONE
    if least <= settings.contact_n:
        return ContactClass.INTERMITTENT
    return ContactClass.VARIABLE if most - least > settings.swing_n else ContactClass.CONSTANT
