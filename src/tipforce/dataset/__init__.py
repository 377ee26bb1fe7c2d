"""Labelled samples, sessions and splits."""

from ._dataset import Dataset, RowStore

__all__ = ["Dataset", "RowStore"]
