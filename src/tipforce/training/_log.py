"""The log of a training: one JSON line an epoch, and one line of text for whoever watches."""

import json
from pathlib import Path
from typing import Any

from ._recipe import TrainConfig

__all__ = ["LOG", "Log", "duration", "progress_line"]

LOG = "training.jsonl"


class Log:
    """The epochs so far, in ``rows`` and, where there is a ``folder``, in its file `LOG`.

    ``epochs``: so many are gone on from; later lines, of an epoch that was not finished, are dropped.
    """

    def __init__(self, folder: Path | None, epochs: int = 0) -> None:
        self._path = None if folder is None else folder / LOG
        self.rows: list[dict[str, Any]] = []
        if self._path is None:
            return
        if epochs:
            lines = self._path.read_text(encoding="utf-8").splitlines()[:epochs] if self._path.is_file() else []
            self.rows = [json.loads(line) for line in lines]
        part = self._path.with_name(f"{LOG}.part")
        part.write_text("".join(f"{json.dumps(row)}\n" for row in self.rows), encoding="utf-8")
        part.replace(self._path)

    def add(self, row: dict[str, Any]) -> None:
        """One epoch more."""
        self.rows.append(row)
        if self._path is not None:
            with self._path.open("a", encoding="utf-8") as stream:
                stream.write(json.dumps(row) + "\n")


def progress_line(row: dict[str, Any], recipe: TrainConfig) -> str:
    """The epoch ``row`` of ``recipe`` in a line.

    >>> progress_line({"epoch": 2, "loss": 0.05, "validation_error_n": 0.041, "training_error_n": 0.05,
    ...     "pictures_per_s": 61.2, "waiting_share": 0.021, "seconds": 90.0}, TrainConfig(epochs=10))
    'epoch 2/10: loss 0.0500, error 41.0 mN (training 50.0), 61 pictures/s, waiting 2 %, at most 6 min left'
    """
    left_s = row["seconds"] / row["epoch"] * (recipe.epochs - row["epoch"])
    if recipe.minutes is not None:
        left_s = min(left_s, max(0.0, 60 * recipe.minutes - row["seconds"]))
    error_n = row["validation_error_n"]
    error = "no bounds" if error_n is None else f"{error_n * 1e3:.1f} mN"
    return (
        f"epoch {row['epoch']}/{recipe.epochs}: loss {row['loss']:.4f}, error {error} "
        f"(training {row['training_error_n'] * 1e3:.1f}), {row['pictures_per_s']:.0f} pictures/s, "
        f"waiting {100 * row['waiting_share']:.0f} %, at most {duration(left_s)} left"
    )


def duration(seconds: float) -> str:
    """A time for people.

    >>> [duration(s) for s in (12.4, 400.0, 8000.0)]
    ['12 s', '7 min', '2 h 13 min']
    """
    minutes = round(seconds / 60)
    if seconds < 90:
        return f"{seconds:.0f} s"
    return f"{minutes} min" if minutes < 100 else f"{minutes // 60} h {minutes % 60} min"
