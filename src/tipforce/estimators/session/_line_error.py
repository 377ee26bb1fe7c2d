"""Error of a detected line: noise that is new in each frame, and errors that last for a session."""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from ...mechanics import LineNoise
from ...types import BoolArray, FloatArray
from ._lines import POINTS, StatedErrors
from ._settings import NoiseSettings

MODES = 6
"""Number of error shapes of a session that are unknowns; the rest counts as independent noise."""
LINE_PX = 240.0
"""Length of the line in px by which the noise is laid out: of the bench that it was measured on."""

XRAY_FRESH_PX = LineNoise(0.10, 20.0, 0.95, base_std_m=0.33, base_m=6.8, tip_std_m=0.2, tip_m=2.4, white_share=0.05)
XRAY_LASTING_PX = LineNoise(
    0.03, 20.0, 0.8, base_std_m=0.13, base_m=28.0, tip_std_m=0.11, tip_m=2.4, white_share=0.05
)  # fmt: skip
"""Error in px of lines found in X-ray images, as ``python -m bench.studies.line_noise`` measures it on `biplane`,
rounded; of the lasting part that study finds less (0.003 px). Quanta make most of the error: it is new in each frame,
while that in images of cameras lasts."""
_LEAST_STD_PX = 0.02
"""A smaller standard deviation that vision states is taken for this."""


@dataclass(frozen=True, eq=False)
class LineError:
    """Error of a line in px at its `POINTS` points, across it, and last along it at the tip.

    ``whiten`` makes the noise white whose covariance is ``covariance_px2``; ``modes`` (`POINTS` + 1, modes) are the
    errors that stay, each of unit variance. ``rows``: number of measurements.
    """

    covariance_px2: FloatArray
    whiten: FloatArray
    modes: FloatArray
    rows: int = POINTS + 1

    @classmethod
    def of(cls, noise: NoiseSettings, modes: int, level: float = 1.0) -> Self:
        """Makes the error of a line in the image of a camera from the settings.

        The bare numbers are correlation lengths in px and shares, measured on simulated images: see `LineNoise`.

        Args:
            noise: its settings.
            modes: number of lasting errors that are unknowns; 0: all are noise.
            level: factor on the errors across the shaft; those of the tip stay as stated.
        """
        fresh = LineNoise(
            level * noise.fresh_px,
            14.0,
            noise.fresh_along_px,
            level * noise.fresh_px,
            2.3,
            noise.fresh_tip_px,
            18.0,
            0.1,
            0.05,
        )
        lasting = LineNoise(
            level * noise.lasting_px,
            70.0,
            noise.lasting_along_px,
            level * noise.lasting_px,
            2.3,
            noise.lasting_tip_px,
            14.0,
            0.14,
        )
        return cls._made_of(fresh, lasting, noise.factor, modes)

    @classmethod
    def of_xray(cls, modes: int) -> Self:
        """Makes the error of a line in an X-ray image, as it was measured; ``modes``: see `of`."""
        return cls._made_of(XRAY_FRESH_PX, XRAY_LASTING_PX, 1.0, modes)

    @classmethod
    def _made_of(cls, fresh_px: LineNoise, lasting_px: LineNoise, factor: float, modes: int) -> Self:
        """Makes the error of noise that is new in each frame, and of errors that last.

        The strongest patterns of the lasting errors become ``modes``, unknowns of the session; the rest counts as
        noise.
        """
        arc_px = np.linspace(0.0, LINE_PX, POINTS)
        fresh, lasting = (factor**2 * each.covariance_m2(arc_px) for each in (fresh_px, lasting_px))
        variances, vectors = np.linalg.eigh(lasting)
        strongest = (vectors * np.sqrt(variances))[:, ::-1][:, :modes]  # eigh sorts upwards
        covariance = fresh + lasting - strongest @ strongest.T
        covariance = 0.5 * (covariance + covariance.T)
        root = np.linalg.cholesky(covariance)
        whiten = np.asarray(np.tril(np.linalg.inv(root)), np.float64)
        return cls(covariance, np.ascontiguousarray(whiten), np.ascontiguousarray(strongest))

    def beside(self, stated: StatedErrors | None, stated_unit_px: float) -> "LineError":
        """Returns the error of a line for which vision states the standard deviation and visibility of each point.

        Vision's variance adds to that of the settings, with the same correlation from point to point and the same
        share that stays for the session: most of the error of the locator's lines does (docs/results/session.md).
        Hidden points are left out, as if their errors were without bound.

        Args:
            stated: vision's statements; None: there are none.
            stated_unit_px: the unit of its figures, in px of this error.
        """
        if stated is None:
            return self
        return self._scaled(np.hypot(1.0, stated_unit_px * stated.std_px / self._std_px()), stated.seen)

    def as_stated(self, stated: StatedErrors | None, stated_unit_px: float) -> "LineError":
        """Returns the error of a line with the standard deviations that vision states, in place of those of this one.

        In X-ray images they are true in each session and view (docs/results/two-views.md). Correlation, share that
        lasts, and hidden points: see `beside`. A line without stated standard deviations keeps these.

        Args:
            stated: vision's statements; None: there are none.
            stated_unit_px: the unit of its figures, in px of this error.
        """
        if stated is None:
            return self
        factor = np.ones(POINTS + 1)
        if stated.std_px.any():
            factor = np.maximum(stated_unit_px * stated.std_px, _LEAST_STD_PX) / self._std_px()
        return self._scaled(factor, stated.seen)

    def at_level(self, level: float) -> "LineError":
        """Returns this error with ``level`` times the noise across the line; its lasting errors and its tip stay."""
        scale = np.append(np.full(POINTS, level), 1.0)
        covariance = scale[:, None] * self.covariance_px2 * scale
        return replace(self, covariance_px2=covariance, whiten=self.whiten / scale)

    def _std_px(self) -> FloatArray:
        """Returns (`POINTS` + 1,) the standard deviations of noise and modes together."""
        return np.asarray(np.sqrt(np.diag(self.covariance_px2) + np.sum(self.modes**2, axis=1)), np.float64)

    def _scaled(self, factor: FloatArray, seen_rows: BoolArray) -> "LineError":
        """Returns this error times ``factor`` (`POINTS` + 1,), without the rows that are not seen."""
        seen = np.ix_(seen_rows, seen_rows)
        whiten = np.zeros_like(self.whiten)  # zero rows leave the hidden points out
        whiten[seen] = np.tril(np.linalg.inv(np.linalg.cholesky(self.covariance_px2[seen])))
        covariance = factor[:, None] * self.covariance_px2 * factor
        return LineError(covariance, whiten / factor, factor[:, None] * self.modes, int(seen_rows.sum()))
