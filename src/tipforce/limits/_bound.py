"""The posterior Cramer-Rao bound of a session, for each frame alone and for each with all frames before it."""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Literal, Self

import numpy as np
from scipy.linalg import block_diag, solve_triangular

from ..mechanics import posterior_covariance, posterior_covariance_along
from ..mechanics.spatial import SpatialWall
from ..simulation import SimulatedBench, Truth
from ..types import BoolArray, FloatArray, IntArray, frozen
from ._jacobian import bound_inputs, centreline_jacobian
from ._priors import (
    CENTRELINE_NOISE,
    SESSION_NOISE,
    CentrelineNoise,
    IndentationReading,
    Parameter,
    noise_preset,
    unknown_parameters,
)

_PLAY = "place in the backlash"


@dataclass(frozen=True, slots=True, eq=False)
class ForceCovarianceBound:
    """The smallest covariance of the force in each frame, base frame; NaN where no stable shape was found.

    Attributes:
        session: name of the session.
        stamp_ns: (m,) stamps.
        force_n: (m, 3) true force.
        covariance_n2: (m, 3, 3) covariance of its error.
    """

    session: str
    stamp_ns: IntArray
    force_n: FloatArray
    covariance_n2: FloatArray

    @property
    def std_n(self) -> FloatArray:
        """(m, 3) standard deviations of fx, fy and fz."""
        return np.sqrt(np.diagonal(self.covariance_n2, axis1=1, axis2=2))

    @property
    def magnitude_std_n(self) -> FloatArray:
        """(m,) standard deviation of the force's magnitude, to first order; NaN without a force."""
        size = np.linalg.norm(self.force_n, axis=1, keepdims=True)
        direction = np.divide(self.force_n, size, out=np.full_like(self.force_n, np.nan), where=size > 0)
        return np.sqrt(np.einsum("mi,mij,mj->m", direction, self.covariance_n2, direction))

    @property
    def fx_fy_magnitude_n(self) -> FloatArray:
        """(m, 3) standard deviations of fx, fy and of the magnitude."""
        return np.column_stack([self.std_n[:, :2], self.magnitude_std_n])


@dataclass(frozen=True, slots=True, eq=False)
class CramerRaoBound:
    """The measurement model of a session, from which its bounds are computed.

    Attributes:
        session: name of the session.
        stamp_ns: (m,) stamps.
        force_n: (m, 3) true force.
        touching: (m,) whether the tip is in contact.
        stable: (m,) whether a stable shape was found.
        contact_angle_deg: (m,) angle between the tip and the wall's normal.
        play_open: (m,) whether the knob may not have crossed its backlash yet.
        tare_s: end of the time without contact that the session metadata state.
        parameters: unknown parameters.
        jacobian: (m, rows, parameters) derivatives of the detected centreline, see `centreline_jacobian`.
        arc_m: (points,) positions along the centreline.
        noise: noise of the detected centreline.
        wall: the tissue.
        indentation_rows: (m, parameters) derivatives of the indentation, in standard deviations of its reading; None:
            it is not read, and the bound is that of the shape.
    """

    session: str
    stamp_ns: IntArray
    force_n: FloatArray
    touching: BoolArray
    stable: BoolArray
    contact_angle_deg: FloatArray
    play_open: BoolArray
    tare_s: float
    parameters: tuple[Parameter, ...]
    jacobian: FloatArray
    arc_m: FloatArray
    noise: CentrelineNoise
    wall: SpatialWall
    indentation_rows: FloatArray | None = None

    @classmethod
    def of(cls, source: Truth | SimulatedBench, noise: CentrelineNoise | None = None) -> Self:
        """Sets up the model of a simulated session.

        Args:
            source: the session's ground truth, or its bench.
            noise: noise of the detected centreline; None: as measured on the session's preset.

        Returns:
            The model, from which bounds are computed.

        Raises:
            ValueError: ``noise`` is None and was not measured for the preset, the session has X-ray images, or the
                tissue also touches the shaft's side.
        """
        preset = noise_preset(source.settings)
        if noise is None:
            if preset is None:
                name = source.settings.preset if isinstance(source, SimulatedBench) else source.settings.get("preset")
                raise ValueError(
                    "the error of detected centrelines was measured on images of "
                    f"{' and '.join(CENTRELINE_NOISE)} only, not of preset {str(name)!r}"
                )
            noise = CENTRELINE_NOISE[preset]
        inputs = bound_inputs(source)
        settings = inputs.settings
        if settings.world.wall.side_stiffness_n_per_m2 > 0:
            raise ValueError(
                "the bound is for a force on the electrode's dome; here the tissue also touches the shaft's side"
            )
        parameters = unknown_parameters(settings, inputs.bench_model.parameters)
        rows, arc, stable = centreline_jacobian(inputs)
        jacobian = np.stack([rows[parameter.name] for parameter in parameters], axis=2)
        jacobian[~stable] = 0.0
        # The knob has crossed its backlash when the range of its angles until now exceeds the backlash.
        knob_deg = inputs.knob_deg
        travelled_deg = np.maximum.accumulate(knob_deg) - np.minimum.accumulate(knob_deg)
        return cls(
            session=inputs.session,
            stamp_ns=inputs.stamp_ns,
            force_n=inputs.force_n,
            touching=inputs.touching,
            stable=stable,
            contact_angle_deg=inputs.contact_angle_deg,
            play_open=travelled_deg < settings.world.actuation.play_deg,
            tare_s=settings.world.tare_s,
            parameters=parameters,
            jacobian=jacobian,
            arc_m=arc,
            noise=noise,
            wall=inputs.bench_model.wall,
        )

    def with_indentation(self, reading: IndentationReading) -> Self:
        """Returns the model of an estimator that also reads the indentation of the tissue.

        The force along the normal is stiffness x indentation; the rate of the indentation is assumed to be known. The
        tissue's stiffness and the position of its face are unknown, with priors from ``reading``.

        Args:
            reading: accuracy of the reading, and the priors.

        Raises:
            ValueError: the tissue is not linear, or not flat.
        """
        wall = self.wall
        if not (wall.hertz_depth_m is wall.exponential_depth_m is wall.face_radius_m is None):
            raise ValueError("the bound with the indentation is for a flat face of linear tissue")
        slope_m_per_n = -wall.normal / wall.stiffness_n_per_m  # by the tissue's force on the tip
        depth_m = self.force_n @ slope_m_per_n
        rows = np.zeros((len(self.force_n), len(self.parameters) + 2))
        rows[:, :3], rows[:, -2], rows[:, -1] = slope_m_per_n, -depth_m, 1.0
        rows[~(self.touching & self.stable)] = 0.0
        return replace(
            self,
            parameters=(*self.parameters, *reading.parameters()),
            jacobian=np.pad(self.jacobian, ((0, 0), (0, 0), (0, 2))),
            indentation_rows=rows / reading.std_m,
        )

    def single_frame(self, known: Iterable[str] = (), force_n2: FloatArray | None = None) -> ForceCovarianceBound:
        """Returns the bound of every frame alone.

        Args:
            known: groups of parameters that are assumed to be known.
            force_n2: (3, 3) prior covariance of the force, base frame; None: broad, see `unknown_parameters`.

        Raises:
            ValueError: a group does not exist, or is that of the force.
        """
        free, lasting = self._free(known)
        covariance = self.noise.fresh.covariance_m2(self.arc_m)
        if lasting:
            covariance = covariance + self.noise.lasting.covariance_m2(self.arc_m)
        white = self._with_indentation_row(_whitened(self.jacobian[:, :, free], covariance), free)
        return self._bound(posterior_covariance(white, self._prior(free, force_n2), sum(k < 3 for k in free)))

    def sequential(
        self,
        known: Iterable[str] = (),
        force_n2: FloatArray | None = None,
        free_known: Literal["all", "tare", "none"] = "all",
    ) -> ForceCovarianceBound:
        """Returns the bound of every frame together with all frames before it (the filtering bound).

        Args:
            known: as in `single_frame`.
            force_n2: as in `single_frame`.
            free_known: frames without contact in which the estimator is sure that there is none: "all" (the bound then
                also holds for estimators that detect contact), "tare" (only those that the metadata state), or "none".

        Raises:
            ValueError: as in `single_frame`.
        """
        free, lasting = self._free(known)
        jacobian = self.jacobian[:, :, free].copy()
        free_parameters = [self.parameters[k] for k in free]
        time_s = (self.stamp_ns - self.stamp_ns[0]) * 1e-9
        in_tare = self.stamp_ns * 1e-9 < self.tare_s
        no_contact = ~self.touching
        no_contact = {"all": no_contact, "tare": in_tare & no_contact, "none": np.zeros_like(in_tare)}[free_known]
        for k, parameter in enumerate(free_parameters):
            if parameter.memory_s == 0:  # the force's components
                jacobian[no_contact, :, k] = 0.0
            if parameter.name == _PLAY:
                jacobian[~self.play_open, :, k] = 0.0
        fresh = self.noise.fresh.covariance_m2(self.arc_m)
        prior, memory = self._prior(free, force_n2), [parameter.memory_s for parameter in free_parameters]
        if lasting:
            # A constant error of a session is treated as parameters: one for each row.
            rows = self.noise.lasting.covariance_m2(self.arc_m)
            prior, memory = np.asarray(block_diag(prior, rows), np.float64), memory + [np.inf] * len(rows)
            errors = np.eye(len(rows)) * self.stable[:, None, None]
            jacobian = np.concatenate([jacobian, errors], axis=2)
        force_count = sum(k < 3 for k in free)
        white = self._with_indentation_row(_whitened(jacobian, fresh), free)
        covariance_n2 = posterior_covariance_along(white, prior, force_count, time_s, np.array(memory))
        covariance_n2[no_contact] = 0.0
        return self._bound(covariance_n2)

    def _with_indentation_row(self, white: FloatArray, free: list[int]) -> FloatArray:
        """Adds a row for the indentation, if it is read, to ``white`` (m, rows, columns); first columns: ``free``."""
        if self.indentation_rows is None:
            return white
        row = np.zeros((len(white), 1, white.shape[2]))
        row[:, 0, : len(free)] = self.indentation_rows[:, free]
        return np.concatenate([white, row], axis=1)

    def _free(self, known: Iterable[str]) -> tuple[list[int], bool]:
        """Returns the indices of the parameters whose group is not ``known``; whether the constant noise is free."""
        groups, known = {parameter.group for parameter in self.parameters} | {SESSION_NOISE}, set(known)
        if known - groups or "force" in known:
            allowed = ", ".join(sorted(groups - {"force"}))
            raise ValueError(f"known: expected some of {allowed}, got {', '.join(sorted(known))}")
        free = [k for k, parameter in enumerate(self.parameters) if parameter.group not in known]
        return free, SESSION_NOISE not in known

    def _prior(self, free: list[int], force_n2: FloatArray | None) -> FloatArray:
        """Returns the prior covariance of the parameters at ``free``."""
        prior = np.diag([parameter.std**2 for parameter in self.parameters])
        if force_n2 is not None:
            prior[:3, :3] = frozen("force_n2", force_n2, (3, 3))
        return prior[np.ix_(np.array(free), np.array(free))]

    def _bound(self, found: FloatArray) -> ForceCovarianceBound:
        """Returns the bound for ``found``: (m, 2, 2) if the depth is known, otherwise (m, 3, 3)."""
        covariance = np.zeros((len(found), 3, 3))
        covariance[:, : found.shape[1], : found.shape[1]] = found
        covariance[~self.stable] = np.nan
        return ForceCovarianceBound(self.session, self.stamp_ns, self.force_n, covariance)


def _whitened(jacobian: FloatArray, covariance: FloatArray) -> FloatArray:
    """Returns ``jacobian`` (m, rows, columns) with rows of independent errors of standard deviation 1."""
    root = np.linalg.cholesky(covariance)
    m, rows, columns = jacobian.shape
    flat = np.moveaxis(jacobian, 1, 0).reshape(rows, -1)
    return np.moveaxis(solve_triangular(root, flat, lower=True).reshape(rows, m, columns), 0, 1)
