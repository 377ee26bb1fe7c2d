"""How the hot loops that draw pictures are compiled."""

__all__ = ["STEADY"]

STEADY = {"nnan", "ninf", "nsz"}
"""The liberties of fast mathematics that change no result. The others let a loop round otherwise when it is compiled
anew than when it comes from the cache, and then the same seed would not give the same bytes."""
