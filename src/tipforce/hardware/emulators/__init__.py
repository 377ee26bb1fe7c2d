"""Devices on this machine that speak the real protocols: for tests, and to try a bench without one."""

from ._net_ft import NetFtEmulator, NetFtFaults

__all__ = ["NetFtEmulator", "NetFtFaults"]
