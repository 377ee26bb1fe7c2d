"""Machine and versions with which figures were measured."""

import platform
from importlib.metadata import version
from pathlib import Path
from typing import Any

import tipforce

_PACKAGES = ("numpy", "scipy", "numba", "opencv-python-headless", "scikit-learn", "scikit-image")


def machine() -> dict[str, Any]:
    """Returns processor, system and versions."""
    cpu = platform.processor() or platform.machine()
    try:
        with Path("/proc/cpuinfo").open(encoding="utf-8") as lines:
            cpu = next((line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")), cpu)
    except OSError:
        pass  # not Linux: the processor's name as Python knows it
    return {
        "cpu": cpu,
        "system": platform.platform(),
        "python": platform.python_version(),
        "tipforce": tipforce.__version__,
        **{name: version(name) for name in _PACKAGES},
    }
