"""Clinical quantities of an ablation: contact state and class, force window and limit, force-time integral."""

from ._monitor import ClinicalState, ContactMonitor, Duration
from ._probability import probability_above
from ._settings import CONTACT_N, LIMIT_N, WINDOW_N, ContactSettings
from ._state import ContactClass, ContactState, contact_class, contact_state

__all__ = [
    "CONTACT_N",
    "LIMIT_N",
    "WINDOW_N",
    "ClinicalState",
    "ContactClass",
    "ContactMonitor",
    "ContactSettings",
    "ContactState",
    "Duration",
    "contact_class",
    "contact_state",
    "probability_above",
]
