"""Emulated devices with the real protocols on this machine: for tests, and to try a bench without devices.

``python -m tipforce.hardware.emulators`` starts a complete bench of them and writes its ``bench.toml``.
"""

from ._camera import CameraEmulator
from ._encoder import EncoderEmulator
from ._grbl import GrblEmulator
from ._net_ft import NetFtEmulator, NetFtFaults
from ._pty import PtyDevice

__all__ = ["CameraEmulator", "EncoderEmulator", "GrblEmulator", "NetFtEmulator", "NetFtFaults", "PtyDevice"]
