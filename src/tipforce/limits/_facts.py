"""What the bound needs to know of a session, from its truth or from the bench that makes it."""

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from pydantic import ValidationError

from ..simulation._bench import SimulatedBench
from ..simulation._imaging import CameraImaging
from ..simulation._settings import SimulationSettings
from ..simulation._sidecar import Truth
from ..simulation.rendering.camera import Lens
from ..simulation.world import Device, Draw, Rig, build_rig
from ..types import BoolArray, FloatArray, IntArray

__all__ = ["Facts", "facts_of"]


@dataclass(frozen=True, slots=True, eq=False)
class Facts:
    """A session at its m frames; see `Truth` for the arrays. ``force_n``, ``touch_m`` (m, 3), ``lines_m`` (m, p, 3)."""

    session: str
    settings: SimulationSettings
    rig: Rig
    lens: Lens
    stamp_ns: IntArray
    force_n: FloatArray
    touch_m: FloatArray
    touching: BoolArray
    lines_m: FloatArray
    curvature_per_m: FloatArray
    knob_deg: FloatArray

    @property
    def time_s(self) -> FloatArray:
        """(m,) since the first frame."""
        return (self.stamp_ns - self.stamp_ns[0]) * 1e-9

    @property
    def contact_angle_deg(self) -> FloatArray:
        """(m,): between the tip's axis and the direction into the wall."""
        axis = self.lines_m[:, -1] - self.lines_m[:, -2]
        cosine = axis @ self.rig.wall.normal / np.linalg.norm(axis, axis=1)
        return np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0)))


def facts_of(source: Truth | SimulatedBench) -> Facts:
    """Of a session's truth, or of the bench itself, which need not draw a single picture for it.

    Raises ValueError for X-ray sessions, and for a truth of settings that are not those of this version.
    """
    if isinstance(source, Truth):
        stated = {name: value for name, value in source.settings.items() if name not in ("seed", "number")}
        try:
            settings = SimulationSettings.model_validate(stated)
        except ValidationError as error:
            key = ".".join(str(part) for part in error.errors()[0]["loc"])
            raise ValueError(
                f"its truth was made with settings that one camera's bench does not have ({key})"
            ) from None
        values: Mapping[str, Any] = source.values
        draw = Draw(device=Device(**_part(Device, values)), **_part(Draw, values))
        return Facts(
            session=source.session,
            settings=settings,
            rig=build_rig(settings.world, draw),
            lens=Lens(**_part(Lens, values["lens"])),
            stamp_ns=source.stamp_ns,
            force_n=source.force_n,
            touch_m=source.touch_m,
            touching=source.touching,
            lines_m=source.centreline_m,
            curvature_per_m=source.curvature_per_m,
            knob_deg=source.knob_deg,
        )
    if not isinstance(source.settings, SimulationSettings) or not isinstance(source.imaging, CameraImaging):
        raise ValueError(f"the bound is of what one camera sees; {source.settings.preset} is seen by X-ray")
    times, course, when = source.frame_s, source.session.course, source.instants
    return Facts(
        session=source.name,
        settings=source.settings,
        rig=source.session.rig,
        lens=source.imaging.scene.lens,
        stamp_ns=source.stamp_ns,
        force_n=when.at(course.contact.force_n, times),
        touch_m=when.at(course.contact.touch_m, times),
        touching=course.contact.touching[when.nearest(times)],
        lines_m=when.lines_m(times),
        curvature_per_m=when.at(course.curvature_per_m, times),
        knob_deg=when.at(course.knob_deg, times),
    )


def _part(kind: type[Any], values: Mapping[str, Any]) -> dict[str, Any]:
    """Of ``values``, the fields of the dataclass ``kind``; a file has made lists of its tuples."""
    found = {field.name: values[field.name] for field in fields(kind) if field.name in values}
    return {name: tuple(value) if isinstance(value, list) else value for name, value in found.items()}
