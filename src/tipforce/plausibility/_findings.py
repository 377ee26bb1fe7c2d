"""Findings of the plausibility check, and the readings that must not be used."""

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Literal, get_args

import numpy as np

from .._system.json_files import parse_json
from ..types import BoolArray, FloatArray, IntArray

MAX_GAP_S = 0.05
"""Readings farther apart give no force to the images between them. Over 50 ms a straight line deviates by less than
5 mN from the beats of the simulated bench (0.3 N, 90 beats a minute)."""

MAX_JOINED_GAP_S = 0.1
"""Unusable readings of one kind that are nearer to each other than this are one finding."""
MIN_REPORTED_STEP_N = 5e-3
"""A smaller step of an axis is not reported."""
MAX_SHOWN_STRETCHES = 4
"""Largest number of stretches that a line for people lists."""

FindingKind = Literal[
    "error status",
    "clipped",
    "spike",
    "dead axis",
    "gap",
    "step of the zero",
    "drift",
    "contact during tare",
]
FINDING_KINDS: tuple[FindingKind, ...] = get_args(FindingKind)


@dataclass(frozen=True, slots=True)
class ForceFinding:
    """One implausible stretch of a force log.

    Attributes:
        kind: kind of the finding.
        start_s: start, s since the first row of the log.
        end_s: end, s since the first row of the log.
        axes: letters of the axes of the sensor, as in "xy".
        size_n: level of clipping, height of a spike, or step of the zero, N; NaN where none applies.
        readings: number of readings that are not used.
        detail: one sentence, or empty.
    """

    kind: FindingKind
    start_s: float
    end_s: float
    axes: str = "xyz"
    size_n: float = math.nan
    readings: int = 0
    detail: str = ""

    @classmethod
    def of_step(cls, at_s: float, step_n: FloatArray, readings: int = 0, then: str = "") -> "ForceFinding":
        """Returns a step of the zero.

        Args:
            at_s: time of the step since the log's first row, s.
            step_n: (3,) step, N.
            readings: number of readings that are not used because of it.
            then: the rest of the sentence.
        """
        axes = [axis for axis in range(3) if abs(step_n[axis]) > MIN_REPORTED_STEP_N]
        size = ", ".join(f"f{'xyz'[axis]} {step_n[axis]:+.3f}" for axis in axes)
        return cls(
            kind="step of the zero",
            start_s=at_s,
            end_s=at_s,
            axes="".join("xyz"[axis] for axis in axes),
            size_n=float(np.linalg.norm(step_n)),
            readings=readings,
            detail=f"the readings jump by {size} N and stay there{then}",
        )

    def values(self) -> dict[str, Any]:
        """Returns the finding as JSON values; an unknown size is None."""
        return {
            "kind": self.kind,
            "start_s": round(self.start_s, 6),
            "end_s": round(self.end_s, 6),
            "axes": self.axes,
            "size_n": None if math.isnan(self.size_n) else round(self.size_n, 6),
            "readings": self.readings,
            "detail": self.detail,
        }

    @classmethod
    def of(cls, values: Mapping[str, Any]) -> "ForceFinding":
        """Inverts `values`. Raises ValueError or TypeError."""
        kind: FindingKind | None = next((kind for kind in FINDING_KINDS if kind == values.get("kind")), None)
        if kind is None:
            raise ValueError(f"{values.get('kind')!r} is no kind of finding")
        size = values.get("size_n")
        return cls(
            kind=kind,
            start_s=float(values.get("start_s", math.nan)),
            end_s=float(values.get("end_s", math.nan)),
            axes=str(values.get("axes", "")),
            size_n=math.nan if size is None else float(size),
            readings=int(values.get("readings", 0)),
            detail=str(values.get("detail", "")),
        )


@dataclass(frozen=True, slots=True, eq=False)
class ForcePlausibility:
    """Findings of a force log, and its readings that may be used.

    Attributes:
        findings: the findings in the order of time.
        unusable_ns: (k, 2) first and last stamp of each run of readings that are not used.
        dead_axes: letters of axes that never measure.
        zero_steps: stamp of the first reading after a step of the zero -> the step (3,) in N, which is subtracted from
            all readings from there on.
        drift_n_per_s: drift of the zero, which is subtracted from all readings; it is 0 at ``drift_zero_ns``.
        drift_zero_ns: see ``drift_n_per_s``.
        bridged: number of gaps of at most `MAX_GAP_S`, across which labels are interpolated.
        longest_bridged_s: the longest of these gaps, s.
    """

    findings: tuple[ForceFinding, ...] = ()
    unusable_ns: IntArray = field(default_factory=lambda: np.empty((0, 2), np.int64))
    dead_axes: str = ""
    zero_steps: Mapping[int, tuple[float, float, float]] = field(default_factory=dict[int, tuple[float, float, float]])
    drift_n_per_s: tuple[float, float, float] = (0.0, 0.0, 0.0)
    drift_zero_ns: int = 0
    bridged: int = 0
    longest_bridged_s: float = 0.0

    def usable(self, stamps_ns: IntArray) -> BoolArray:
        """Returns whether each reading (n,) may be used, by the stamps (n,).

        >>> ForcePlausibility(unusable_ns=np.array([[20, 30]])).usable(np.array([10, 20, 25, 31])).tolist()
        [True, False, False, True]
        """
        if not len(self.unusable_ns):
            return np.ones(len(stamps_ns), np.bool_)
        run = np.searchsorted(self.unusable_ns[:, 0], stamps_ns, side="right") - 1
        return (run < 0) | (stamps_ns > self.unusable_ns[np.maximum(run, 0), 1])

    def without(self, stamps_ns: IntArray, rows: BoolArray) -> "ForcePlausibility":
        """Returns the same findings with more readings that are not used.

        Args:
            stamps_ns: (n,) stamps of all readings of the log.
            rows: (n,) True for each reading that is not used either.
        """
        bad = rows | ~self.usable(stamps_ns)
        edges = np.flatnonzero(np.diff(np.concatenate([[0], bad.astype(np.int8), [0]])))  # first row, end, ...
        return replace(self, unusable_ns=np.stack([stamps_ns[edges[::2]], stamps_ns[edges[1::2] - 1]], axis=1))

    def corrected(self, stamps_ns: IntArray, force_n: FloatArray) -> FloatArray:
        """Returns the readings in usable form.

        Args:
            stamps_ns: (n,) stamps on the log's clock.
            force_n: (n, 3) readings, N, in the sensor's frame.

        Returns:
            (n, 3): NaN where a reading or an axis is not used; steps and drift of the zero subtracted.
        """
        corrected_n = np.array(force_n, np.float64)
        for stamp, step in self.zero_steps.items():
            corrected_n[stamps_ns >= stamp] -= np.array(step)
        if any(self.drift_n_per_s):
            corrected_n -= np.outer((stamps_ns - self.drift_zero_ns) * 1e-9, self.drift_n_per_s)
        corrected_n[~self.usable(stamps_ns)] = math.nan
        corrected_n[:, ["xyz".index(axis) for axis in self.dead_axes]] = math.nan
        return corrected_n

    def lines(self) -> list[str]:
        """Returns one line for people for each kind of finding, with its stretches of time."""
        by_kind = {kind: [each for each in self.findings if each.kind == kind] for kind in FINDING_KINDS}
        lines = [_line(kind, findings) for kind, findings in by_kind.items() if findings]
        if self.bridged:
            lines.append(
                f"{self.bridged} gap{'s' * (self.bridged > 1)} of at most {1e3 * MAX_GAP_S:g} ms bridged by straight "
                f"lines (the longest {1e3 * self.longest_bridged_s:.3g} ms)"
            )
        return lines

    def record(self) -> dict[str, str]:
        """Returns the findings as a metadata record of a recording."""
        return {
            "findings": json.dumps([finding.values() for finding in self.findings]),
            "unusable_ns": json.dumps(self.unusable_ns.tolist()),
            "dead_axes": self.dead_axes,
            "zero_steps": json.dumps([[stamp, list(step)] for stamp, step in self.zero_steps.items()]),
            "drift_n_per_s": json.dumps(list(self.drift_n_per_s)),
            "drift_zero_ns": str(self.drift_zero_ns),
            "bridged": str(self.bridged),
            "longest_bridged_s": repr(self.longest_bridged_s),
            "meaning": "readings from the first to the last stamp of each pair in unusable_ns, and dead_axes, give no "
            "labels; subtract zero_steps from their stamp on, and drift_n_per_s times the seconds since drift_zero_ns",
        }

    @classmethod
    def of(cls, record: Mapping[str, str]) -> "ForcePlausibility":
        """Inverts `record`; no finding without a record. Raises ValueError, TypeError or FileFormatError."""
        steps = parse_json(record.get("zero_steps", "[]"), "zero_steps")
        findings = parse_json(record.get("findings", "[]"), "findings")
        x, y, z = parse_json(record.get("drift_n_per_s", "[0, 0, 0]"), "drift_n_per_s")
        axes = record.get("dead_axes", "")
        if set(axes) - set("xyz"):
            raise ValueError(f"dead_axes = {axes!r}: expected letters of x, y, z")
        return cls(
            findings=tuple(ForceFinding.of(dict(values)) for values in findings),
            unusable_ns=np.array(parse_json(record.get("unusable_ns", "[]"), "unusable_ns"), np.int64).reshape(-1, 2),
            dead_axes=axes,
            zero_steps={int(stamp): (float(fx), float(fy), float(fz)) for stamp, (fx, fy, fz) in steps},
            drift_n_per_s=(float(x), float(y), float(z)),
            drift_zero_ns=int(record.get("drift_zero_ns", "0")),
            bridged=int(record.get("bridged", "0")),
            longest_bridged_s=float(record.get("longest_bridged_s", "0.0")),
        )


def _line(kind: str, findings: list[ForceFinding]) -> str:
    """Returns one line on all findings of a kind: unused readings, the first stretches of time, distinct details."""
    readings = sum(finding.readings for finding in findings)
    where = ", ".join(_stretch(finding) for finding in findings[:MAX_SHOWN_STRETCHES])
    more = f" and {len(findings) - MAX_SHOWN_STRETCHES} more stretches" if len(findings) > MAX_SHOWN_STRETCHES else ""
    details = list(dict.fromkeys(finding.detail for finding in findings if finding.detail))
    sentences = "".join(f"; {detail}" for detail in details[:MAX_SHOWN_STRETCHES])
    unused = f": {readings} readings not used" if readings else ""
    if kind == "gap":
        unused = f": {len(findings)} of more than {1e3 * MAX_GAP_S:g} ms"
    return f"{kind}{unused} ({where}{more}){sentences}"


def _stretch(finding: ForceFinding) -> str:
    if finding.end_s - finding.start_s < 5e-3:
        return f"{finding.start_s:.3f} s"
    return f"{finding.start_s:.2f}-{finding.end_s:.2f} s"


def stretches(rows: BoolArray, seconds: FloatArray) -> list[tuple[int, int]]:
    """Returns (first, last) row of each stretch in which ``rows`` are set; stretches less than 0.1 s apart are one.

    Args:
        rows: (n,) the selected rows.
        seconds: (n,) times of the rows, s.
    """
    at = np.flatnonzero(rows)
    if not len(at):
        return []
    cuts = np.flatnonzero(np.diff(seconds[at]) > MAX_JOINED_GAP_S)
    first, last = at[np.concatenate([[0], cuts + 1])], at[np.concatenate([cuts, [len(at) - 1]])]
    return list(zip(first.tolist(), last.tolist(), strict=True))
