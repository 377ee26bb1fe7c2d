"""The catheter and the tissue in MuJoCo: a cable clamped at its base, a rigid tip, a wall on a spring that presses it.

World = base frame (metres): origin at the clamp when the advance is zero, x along the base tangent, z to the camera.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from tipforce.types import FloatArray

from .engines import engine

__all__ = ["LAWS", "CableWorld", "Rod", "Tissue"]

STEP_S = 2e-4
ELEMENTS = 16
PLUGIN = "mujoco.elasticity.cable"
ARMATURE_PER_STEP2 = 6.0
"""Inertia added to a joint, over its stiffness and the square of the step: MuJoCo's cable is integrated explicitly and
needs 4 at least. It slows the rod down to some 30 Hz, its statics stay."""
REST_TIME_S = 4e-3
"""Damping of the joints over their stiffness: the rod rests some hundredths of a second after a change."""
WALL_MASS_KG = 1e-3
WALL_HALF_SIZE_M = (0.004, 0.06, 0.06)
LOSS_TIME_S = 0.02
"""Viscosity of the tissue over its stiffness: a loss factor near 0.15 at the heart's rate."""
HERTZ_DEPTH_M, STIFFENING_DEPTH_M = 4e-3, 3e-3
LAWS: dict[str, Callable[[float], float]] = {
    "linear": lambda depth: depth,
    "hertz": lambda depth: depth**1.5 / math.sqrt(HERTZ_DEPTH_M),
    "exponential": lambda depth: STIFFENING_DEPTH_M * math.expm1(min(depth / STIFFENING_DEPTH_M, 6.0)),
}
"""Name -> force over stiffness (m) at a depth (m) >= 0."""


@dataclass(frozen=True, slots=True)
class Rod:
    """A shaft of one bending stiffness and a rigid tip of the same radius that ends in a half-sphere."""

    length_m: float = 0.045
    rigid_m: float = 0.008
    radius_m: float = 1.165e-3
    stiffness_nm2: float = 4.3e-4


@dataclass(frozen=True, slots=True)
class Tissue:
    """A wall that gives way along its normal. ``yaw_rad``, ``tilt_rad``: its normal's direction, in plane and out."""

    stiffness_n_per_m: float
    law: str
    friction: float
    yaw_rad: float
    tilt_rad: float

    @property
    def normal(self) -> FloatArray:
        """(3,): from the tissue towards the catheter."""
        flat = math.cos(self.tilt_rad)
        return np.array([flat * math.cos(self.yaw_rad), flat * math.sin(self.yaw_rad), math.sin(self.tilt_rad)])

    @property
    def across(self) -> FloatArray:
        """(3,): along the wall, in the base frame's plane."""
        return np.array([-math.sin(self.yaw_rad), math.cos(self.yaw_rad), 0.0])

    @property
    def rotation(self) -> FloatArray:
        """(3, 3): columns are normal, across, and the direction perpendicular to both."""
        return np.column_stack([self.normal, self.across, np.cross(self.normal, self.across)])


class CableWorld:
    """One catheter and, if given, one wall; `advance` steps time and the properties return the results of MuJoCo."""

    def __init__(self, rod: Rod, tissue: Tissue | None = None) -> None:
        self._mujoco = mujoco = _mujoco_with_cable()
        self.rod, self.tissue = rod, tissue
        self.model = mujoco.MjModel.from_xml_string(_mjcf(rod, tissue))
        self.data = mujoco.MjData(self.model)
        self._tip = self.model.body("tip").id
        self._base_mocap = int(self.model.body("base").mocapid[0])
        if tissue is not None:
            self._wall = self.model.geom("wall").id
            self._carrier = int(self.model.body("carrier").mocapid[0])
            self._slide = int(self.model.joint("give").dofadr[0])
            mujoco.mju_mat2Quat(self.data.mocap_quat[self._carrier], tissue.rotation.flatten())
        mujoco.mj_forward(self.model, self.data)

    def advance(
        self,
        duration_s: float,
        *,
        curvature_per_m: float = 0.0,
        dead_load_n: FloatArray | None = None,
        wall_m: FloatArray | None = None,
        base_x_m: float = 0.0,
    ) -> None:
        """Steps the time on. ``wall_m`` (3,): position of the middle of the undeformed face.

        A steerable catheter is bent by a moment that its pull wire exerts at the tip, against its base.
        """
        data, mujoco = self.data, self._mujoco
        moment = np.array([0.0, 0.0, self.rod.stiffness_nm2 * curvature_per_m])
        data.mocap_pos[self._base_mocap, 0] = base_x_m
        if wall_m is not None:
            data.mocap_pos[self._carrier] = wall_m
        for _ in range(max(1, round(duration_s / STEP_S))):
            data.xfrc_applied[self._tip, 3:] = moment
            if dead_load_n is not None:
                data.xfrc_applied[self._tip, :3] = dead_load_n
                arm = self.end_m - data.xipos[self._tip]
                data.xfrc_applied[self._tip, 3:] = moment + np.cross(arm, dead_load_n)
            if self.tissue is not None:
                data.qfrc_applied[self._slide] = self._tissue_force()
            mujoco.mj_step(self.model, data)
        if data.warning[mujoco.mjtWarning.mjWARN_BADQACC].number:
            raise ArithmeticError(f"MuJoCo diverged with {self.rod} and {self.tissue}; it needs a smaller step")

    def _tissue_force(self) -> float:
        tissue = self.tissue
        assert tissue is not None
        depth, speed = -float(self.data.qpos[-1]), -float(self.data.qvel[self._slide])
        if depth <= 0.0:
            return -tissue.stiffness_n_per_m * (depth + LOSS_TIME_S * speed)
        return tissue.stiffness_n_per_m * (LAWS[tissue.law](depth) + LOSS_TIME_S * speed)

    @property
    def indentation_m(self) -> float:
        """Depth of the indentation of the tissue."""
        return max(0.0, -float(self.data.qpos[-1]))

    @property
    def wall_m(self) -> FloatArray:
        """(3,): middle of the undeformed face."""
        return self.data.mocap_pos[self._carrier].copy()

    @property
    def tip_force_n(self) -> FloatArray:
        """(3,): of the tissue on the tip, base frame: the sum of MuJoCo's contact forces."""
        total, six = np.zeros(3), np.zeros(6)
        for index, contact in enumerate(self.data.contact):
            self._mujoco.mj_contactForce(self.model, self.data, index, six)
            sign = 1.0 if contact.geom[0] == self._wall else -1.0
            total += sign * contact.frame.reshape(3, 3).T @ six[:3]
        return total

    @property
    def base_reaction_n(self) -> FloatArray:
        """(3,): of the shaft on its clamp, base frame: the reading of a second sensor there."""
        self._mujoco.mj_rnePostConstraint(self.model, self.data)
        return -self.data.sensor("clamp").data.copy()

    @property
    def end_m(self) -> FloatArray:
        """(3,): the foremost point of the tip."""
        return self.data.site("end").xpos.copy()

    @property
    def joints_m(self) -> FloatArray:
        """(n, 3): clamp, joints, start of the rigid tip's axis and its end: the centreline as MuJoCo has it."""
        names = ["base", *(f"s{i}" for i in range(1, ELEMENTS)), "tip"]
        return np.vstack([*(self.data.body(name).xpos for name in names), self.data.site("shoulder").xpos, self.end_m])


def _mujoco_with_cable() -> Any:
    """MuJoCo with its plugin of cables; to load this twice is an error of MuJoCo's."""
    mujoco = engine("mujoco")
    try:
        mujoco.MjModel.from_xml_string(f"<mujoco><extension><plugin plugin='{PLUGIN}'/></extension></mujoco>")
    except ValueError:
        for path in (Path(mujoco.__file__).parent / "plugin").glob("*elasticity*"):
            mujoco.mj_loadPluginLibrary(str(path))
    return mujoco


def _mjcf(rod: Rod, tissue: Tissue | None) -> str:
    """Joints are at h/2, 3h/2, ... from the clamp, each in the middle of the length h that the plugin counts for it."""
    h, r = rod.length_m / ELEMENTS, rod.radius_m
    modulus = 4.0 * rod.stiffness_nm2 / (math.pi * r**4)
    spring = rod.stiffness_nm2 / h
    joint = (
        f'<joint type="ball" damping="{REST_TIME_S * spring}" armature="{ARMATURE_PER_STEP2 * spring * STEP_S**2}"/>'
    )
    plugin = '<plugin instance="cable"/>'
    capsule = f'<geom type="capsule" size="{r}" fromto="{{}} 0 0 {{}} 0 0" contype="0" conaffinity="0" density="1500"/>'
    inner = f"""<body name="tip" pos="{h} 0 0">{joint}{capsule.format(0, h)}
      <geom name="dome" type="sphere" size="{r}" pos="{h / 2 + rod.rigid_m - r} 0 0" density="1500"/>
      <site name="shoulder" pos="{h / 2} 0 0"/><site name="end" pos="{h / 2 + rod.rigid_m} 0 0"/>{plugin}</body>"""
    for i in reversed(range(1, ELEMENTS)):
        inner = f'<body name="s{i}" pos="{h} 0 0">{joint}{capsule.format(0, h)}{plugin}{inner}</body>'
    wall = ""
    if tissue is not None:
        a, b, c = WALL_HALF_SIZE_M
        wall = f"""<body name="carrier" mocap="true" pos="1 0 0">
          <body name="plate"><joint name="give" type="slide" axis="1 0 0"/>
          <geom name="wall" type="box" size="{a} {b} {c}" pos="{-a} 0 0" mass="{WALL_MASS_KG}"
            friction="{tissue.friction} 0 0" priority="1"/></body></body>"""  # else the dome's friction of 1 counts
    return f"""<mujoco>
      <extension><plugin plugin="{PLUGIN}"><instance name="cable">
        <config key="twist" value="{modulus / 2.6}"/><config key="bend" value="{modulus}"/>
        <config key="vmax" value="0"/></instance></plugin></extension>
      <option timestep="{STEP_S}" gravity="0 0 0" integrator="implicitfast" cone="elliptic" impratio="10"/>
      <default><geom solref="0.002 1" solimp="0.95 0.99 0.0002"/></default>
      <worldbody>
        <body name="base" mocap="true"><body name="s0" pos="{-h / 2} 0 0">
          <site name="clamp" pos="{h / 2} 0 0"/>{capsule.format(0, h)}{plugin}{inner}</body>
        </body>{wall}
      </worldbody>
      <sensor><force name="clamp" site="clamp"/></sensor>
    </mujoco>"""
