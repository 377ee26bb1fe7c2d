"""Methods that turn what is seen into a force: one file a method, all with the same face."""

from ._base import Estimator, Progress, Stream

__all__ = ["Estimator", "Progress", "Stream"]
