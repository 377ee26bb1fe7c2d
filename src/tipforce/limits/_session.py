"""The bound of a session, frame by frame: of each frame on its own, and of all frames until then."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal, Self

import numpy as np
from scipy.linalg import block_diag, solve_triangular

from ..mechanics import posterior_covariance, posterior_covariance_along
from ..simulation._bench import SimulatedBench
from ..simulation._sidecar import Truth
from ..types import BoolArray, FloatArray, IntArray, frozen
from ._facts import facts_of
from ._noise import MEASURED, SeenNoise, measured_on
from ._rows import seen_rows
from ._unknowns import LASTING, Unknown, unknowns_of

__all__ = ["ForceBound", "SessionBound"]

_PLAY = "place in the backlash"


@dataclass(frozen=True, slots=True, eq=False)
class ForceBound:
    """The smallest covariance of the force, frame by frame; base frame, newtons; NaN where no shape was found.

    ``stamp_ns`` (m,); ``force_n`` (m, 3): the true force; ``covariance_n2`` (m, 3, 3).
    """

    session: str
    stamp_ns: IntArray
    force_n: FloatArray
    covariance_n2: FloatArray

    @property
    def std_n(self) -> FloatArray:
        """(m, 3): of fx, fy and fz."""
        return np.sqrt(np.diagonal(self.covariance_n2, axis1=1, axis2=2))

    @property
    def magnitude_std_n(self) -> FloatArray:
        """(m,): of the force's magnitude, to first order; NaN where there is no force."""
        size = np.linalg.norm(self.force_n, axis=1, keepdims=True)
        way = np.divide(self.force_n, size, out=np.full_like(self.force_n, np.nan), where=size > 0)
        return np.sqrt(np.einsum("mi,mij,mj->m", way, self.covariance_n2, way))

    @property
    def fx_fy_magnitude_n(self) -> FloatArray:
        """(m, 3): standard deviations of fx, fy and of the magnitude."""
        return np.column_stack([self.std_n[:, :2], self.magnitude_std_n])


@dataclass(frozen=True, slots=True, eq=False)
class SessionBound:
    """All that the bound of a session is made of.

    ``slopes`` (m, rows, unknowns): of the seen line with each of ``unknowns``, see `seen_rows`; ``arc_m`` (points,):
    where along the seen line. ``touching``, ``stable`` (m,); ``contact_angle_deg`` (m,): between tip and wall's normal.
    ``play_open`` (m,): until when the knob has not yet surely crossed its backlash. ``tare_s``: until when the sheet
    says that nothing touches.
    """

    session: str
    stamp_ns: IntArray
    force_n: FloatArray
    touching: BoolArray
    stable: BoolArray
    contact_angle_deg: FloatArray
    play_open: BoolArray
    tare_s: float
    unknowns: tuple[Unknown, ...]
    slopes: FloatArray
    arc_m: FloatArray
    noise: SeenNoise

    @classmethod
    def of(cls, source: Truth | SimulatedBench, noise: SeenNoise | None = None) -> Self:
        """Of a session of the twin. ``noise``: of the seen line; None: what was measured on its preset.

        Raises ValueError where nothing was measured on pictures of its preset and no ``noise`` is given, where they are
        X-ray pictures, and where the tissue touches the shaft's side too.
        """
        preset = measured_on(source.settings)
        if noise is None:
            if preset is None:
                name = source.settings.preset if isinstance(source, SimulatedBench) else source.settings.get("preset")
                raise ValueError(
                    f"the error of seen centrelines was measured on pictures of {' and '.join(MEASURED)} only, "
                    f"not of preset {str(name)!r}"
                )
            noise = MEASURED[preset]
        facts = facts_of(source)
        settings = facts.settings
        if settings.world.wall.side_stiffness_n_per_m2 > 0:
            raise ValueError("the bound is of a force on the electrode's dome; here the shaft's side is touched too")
        unknowns = unknowns_of(settings, facts.rig.draw)
        rows, arc, stable = seen_rows(facts)
        slopes = np.stack([rows[unknown.name] for unknown in unknowns], axis=2)
        slopes[~stable] = 0.0
        knob = facts.knob_deg
        travelled = np.maximum.accumulate(knob) - np.minimum.accumulate(knob)
        return cls(
            session=facts.session,
            stamp_ns=facts.stamp_ns,
            force_n=facts.force_n,
            touching=facts.touching,
            stable=stable,
            contact_angle_deg=facts.contact_angle_deg,
            play_open=travelled < settings.world.actuation.play_deg,
            tare_s=settings.world.tare_s,
            unknowns=unknowns,
            slopes=slopes,
            arc_m=arc,
            noise=noise,
        )

    def each(self, known: Iterable[str] = (), force_n2: FloatArray | None = None) -> ForceBound:
        """Of every frame on its own. ``known``: groups of unknowns that are taken as known.

        ``force_n2`` (3, 3): covariance of the force beforehand, base frame; None: broad, see `unknowns_of`. Raises
        ValueError for a group that there is not, and for that of the force.
        """
        free, lasting = self._free(known)
        covariance = self.noise.fresh.covariance_m2(self.arc_m)
        if lasting:
            covariance = covariance + self.noise.lasting.covariance_m2(self.arc_m)
        white = _whitened(self.slopes[:, :, free], covariance)
        return self._bound(posterior_covariance(white, self._prior(free, force_n2), sum(k < 3 for k in free)))

    def along(
        self,
        known: Iterable[str] = (),
        force_n2: FloatArray | None = None,
        free_known: Literal["all", "tare", "none"] = "all",
    ) -> ForceBound:
        """Of every frame with all frames before it, from the session's first on; ``known``, ``force_n2``: as in `each`.

        ``free_known``: which frames without contact the estimator may be sure of: all of them, which makes the bound
        hold for those that can tell contact too; the tare only, which the sheet states; none.
        """
        free, lasting = self._free(known)
        slopes = self.slopes[:, :, free].copy()
        chosen = [self.unknowns[k] for k in free]
        time_s = (self.stamp_ns - self.stamp_ns[0]) * 1e-9
        still = self.stamp_ns * 1e-9 < self.tare_s
        nothing = {"all": ~self.touching, "tare": still & ~self.touching, "none": np.zeros_like(still)}[free_known]
        for k, unknown in enumerate(chosen):
            if unknown.memory_s == 0:  # the force's components
                slopes[nothing, :, k] = 0.0
            if unknown.name == _PLAY:
                slopes[~self.play_open, :, k] = 0.0
        fresh = self.noise.fresh.covariance_m2(self.arc_m)
        prior, memory = self._prior(free, force_n2), [unknown.memory_s for unknown in chosen]
        if lasting:
            # What stays wrong for a session is an unknown like others: one for each row.
            rows = self.noise.lasting.covariance_m2(self.arc_m)
            prior, memory = np.asarray(block_diag(prior, rows), np.float64), memory + [np.inf] * len(rows)
            shown = np.broadcast_to(np.eye(len(rows)) * self.stable[:, None, None], (len(slopes), *rows.shape))
            slopes = np.concatenate([slopes, shown], axis=2)
        wanted = sum(k < 3 for k in free)
        found = posterior_covariance_along(_whitened(slopes, fresh), prior, wanted, time_s, np.array(memory))
        found[nothing] = 0.0
        return self._bound(found)

    def _free(self, known: Iterable[str]) -> tuple[list[int], bool]:
        """Places of the unknowns that are left, and whether the lasting errors of seeing are."""
        groups, known = {unknown.group for unknown in self.unknowns} | {LASTING}, set(known)
        if known - groups or "force" in known:
            allowed = ", ".join(sorted(groups - {"force"}))
            raise ValueError(f"known: expected some of {allowed}, got {', '.join(sorted(known))}")
        return [k for k, unknown in enumerate(self.unknowns) if unknown.group not in known], LASTING not in known

    def _prior(self, free: list[int], force_n2: FloatArray | None) -> FloatArray:
        """Covariance of the unknowns at ``free``."""
        prior = np.diag([unknown.std**2 for unknown in self.unknowns])
        if force_n2 is not None:
            prior[:3, :3] = frozen("force_n2", force_n2, (3, 3))
        return prior[np.ix_(np.array(free), np.array(free))]

    def _bound(self, found: FloatArray) -> ForceBound:
        """``found`` (m, 2, 2) where the depth is known, else (m, 3, 3)."""
        covariance = np.zeros((len(found), 3, 3))
        covariance[:, : found.shape[1], : found.shape[1]] = found
        covariance[~self.stable] = np.nan
        return ForceBound(self.session, self.stamp_ns, self.force_n, covariance)


def _whitened(slopes: FloatArray, covariance: FloatArray) -> FloatArray:
    root = np.linalg.cholesky(covariance)
    m, rows, columns = slopes.shape
    flat = np.moveaxis(slopes, 1, 0).reshape(rows, -1)
    return np.moveaxis(solve_triangular(root, flat, lower=True).reshape(rows, m, columns), 0, 1)
