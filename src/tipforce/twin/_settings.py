"""All settings of a simulated bench, and the presets that the yardstick is made of."""

from pydantic import Field

from ._ranges import Settings
from .camera import GENERALISE, SceneRanges
from .world.settings import ActuationSettings, ShaftSettings, WallSettings, WorldSettings

__all__ = ["PRESETS", "TwinSettings"]


class TwinSettings(Settings):
    """A bench: the world that is pressed on and measured, and the camera that looks at it."""

    preset: str = "bench-2021"
    """Where the settings come from; those that were changed carry another name."""
    world: WorldSettings = WorldSettings()
    scene: SceneRanges = SceneRanges()
    scale_error: float = Field(default=0.01, ge=0, lt=1)
    """The picture's scale is measured with a uniform error within +- this share."""
    width: int = Field(default=640, ge=160, le=4096, multiple_of=2)
    height: int = Field(default=480, ge=120, le=4096, multiple_of=2)


_FRENCH_M = 1e-3 / 3
"""1 F of diameter."""

PRESETS: dict[str, TwinSettings] = {
    "bench-2021": TwinSettings(),
    "generalise": TwinSettings(
        preset="generalise",
        world=WorldSettings(
            shaft=ShaftSettings(
                name="ablation catheter with 8 mm tip",
                diameter_m=(5 * _FRENCH_M, 8 * _FRENCH_M),
                flexible_length_m=(35e-3, 65e-3),
                stiffness_nm2=(3.1e-4, 9.2e-4),
                nominal_flexible_length_m=None,
                nominal_stiffness_nm2=None,
                known_to=0.05,
                sessions_per_catheter=5,
            ),
            actuation=ActuationSettings(knob_deg=(0.0, 30.0), knob_deg_per_s=10.0),
            wall=WallSettings(contact_angle_deg=(0.0, 80.0), either_side=True),
        ),
        scene=GENERALISE,
    ),
}
"""By name; ``bench-2021`` and ``generalise`` are frozen: a change makes a new name."""
