"""The scene of the camera, path-traced by Mitsuba 3: catheter, sheath, tissue, ground, light and clutter.

Mitsuba's world = base frame in millimetres. Moving objects are meshes whose vertices are set again for every frame.
"""

import math
import subprocess
import sys
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.ndimage import gaussian_filter

from tipforce.types import FloatArray, IntArray

from .camera import HEIGHT, WIDTH, Camera
from .engines import engine
from .materials import brushed, cloth, mottled, paper, plain, wood
from .session import Plan, Run

__all__ = ["Scene", "use_mitsuba"]

_PROBE = "import mitsuba as mi; mi.set_variant('llvm_ad_rgb'); mi.render(mi.load_dict(mi.cornell_box()), spp=1).numpy()"


def use_mitsuba(variant: str | None = None) -> Any:
    """Mitsuba in ``variant``, by default llvm_ad_rgb where an LLVM is new enough, else scalar_rgb (three times slower).

    An LLVM that is too old ends the whole process, so that it is tried in another one.
    """
    mitsuba = engine("mitsuba")
    if variant is None:
        tried = subprocess.run([sys.executable, "-c", _PROBE], capture_output=True, check=False)
        variant = "scalar_rgb" if tried.returncode else "llvm_ad_rgb"
    mitsuba.set_variant(variant)
    mitsuba.set_log_level(mitsuba.LogLevel.Error)
    return mitsuba


def _tube(line: FloatArray, along: FloatArray, radius: FloatArray, around: int) -> FloatArray:
    """(n * around, 3): rings about the points (n, 3) of a line with the directions ``along``; ``radius`` (n,)."""
    side = np.cross(np.array([0.0, 0.0, 1.0]), along)
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    other = np.cross(along, side)
    angle = np.linspace(0, 2 * np.pi, around, endpoint=False)
    rings = np.cos(angle)[None, :, None] * side[:, None] + np.sin(angle)[None, :, None] * other[:, None]
    return (line[:, None] + radius[:, None, None] * rings).reshape(-1, 3)


def _grid_faces(rows: int, columns: int, closed: bool) -> IntArray:
    """(m, 3): triangles of a grid of vertices whose columns join up if ``closed``."""
    across = columns if closed else columns - 1
    r, c = (each.ravel() for each in np.meshgrid(np.arange(rows - 1), np.arange(across), indexing="ij"))
    a, b = r * columns + c, r * columns + (c + 1) % columns
    return np.concatenate([np.column_stack([a, b, a + columns]), np.column_stack([b, b + columns, a + columns])])


GROUNDS = (cloth, paper, wood, brushed, mottled)
MORE_ON_METAL = 3
"""Ratio of the paths on brushed metal to those elsewhere: metal reflects lit objects, and few paths find them."""
SHEATH_SHARE = 0.75
AROUND, PIECE_ROWS, DOME_ROWS = 20, 90, 14
"""Vertices around a tube, along each piece of the catheter, along the dome of its tip."""


class Scene:
    """The scene of one session; `render` gives linear light for one frame."""

    def __init__(self, mitsuba: Any, plan: Plan, run: Run, camera: Camera) -> None:
        self._mi, self._plan, self._camera = mitsuba, plan, camera
        rng = np.random.default_rng((plan.seed, 5))
        self._rng = rng
        self._radius = 1e3 * plan.rod.radius_m
        self._length = 1e3 * (plan.rod.length_m + plan.rod.rigid_m)
        self._gap = float(rng.uniform(4.0, 20.0))
        self._sheath_vertices: FloatArray | None = None
        self._pieces = self._cut_catheter()
        self._tissue_shape = self._draw_tissue()
        parts: dict[str, Any] = {
            "type": "scene",
            "integrator": {"type": "path", "max_depth": 4, "rr_depth": 4, "hide_emitters": False},
            "sensor": self._sensor(),
        }
        for name, _, _, material in self._pieces:
            parts[name] = self._mesh(name, self._piece_rows(name), AROUND, True, material)
        rows, columns = self._tissue_shape["depth"].shape
        parts["tissue"] = self._mesh(
            "tissue", rows, columns, False, self._tissue_material(), self._tissue_shape["colour"]
        )
        parts["carrier"] = self._mesh("carrier", 6, 4, True, plain(rng, metal=bool(rng.integers(2))))
        parts |= self._sheath() | self._ground() | self._lights() | self._clutter(run)
        self._scene = mitsuba.load_dict(parts)
        self._parameters = mitsuba.traverse(self._scene)

    def render(
        self, line_m: FloatArray, wall_m: FloatArray, dent_m: float, seed: int, samples: int
    ) -> npt.NDArray[np.float32]:
        """(h, w, 3): linear light."""
        line = 1e3 * line_m
        for name, start, end, _ in self._pieces:
            self._move(name, self._piece(line, name, start, end))
        self._move("tissue", self._tissue_vertices(1e3 * wall_m, line[-1], 1e3 * dent_m))
        self._move("carrier", self._carrier_vertices(1e3 * wall_m))
        if self._sheath_vertices is not None:
            self._move("sheath", self._sheath_vertices + line[0] * [1.0, 0.0, 0.0])
        self._parameters.update()
        samples *= MORE_ON_METAL if GROUNDS[self._plan.seed % len(GROUNDS)] is brushed else 1
        return np.asarray(self._mi.render(self._scene, spp=samples, seed=seed))[:, :, :3].astype(np.float32)

    def _move(self, name: str, vertices: FloatArray) -> None:
        self._parameters[f"{name}.vertex_positions"] = np.ascontiguousarray(vertices, np.float32).ravel()

    def _mesh(
        self, name: str, rows: int, columns: int, closed: bool, material: Any, colour: FloatArray | None = None
    ) -> Any:
        mi = self._mi
        properties = mi.Properties()
        properties["mesh_bsdf"] = mi.load_dict(material)
        faces = _grid_faces(rows, columns, closed)
        faces = faces[:, ::-1] if name == "carrier" else faces
        mesh = mi.Mesh(name, rows * columns, len(faces), has_vertex_normals=True, props=properties)
        if colour is not None:
            mesh.add_attribute("vertex_color", 3, np.ascontiguousarray(colour, np.float32).ravel())
        parameters = mi.traverse(mesh)
        parameters["faces"] = faces.astype(np.uint32).ravel()
        parameters["vertex_positions"] = np.random.default_rng(0).uniform(size=rows * columns * 3).astype(np.float32)
        parameters.update()
        return mesh

    def _sensor(self) -> dict[str, Any]:
        camera, mi = self._camera, self._mi
        return {
            "type": "thinlens",
            "fov": math.degrees(2 * math.atan(WIDTH / 2 / camera.focal_px)),
            "fov_axis": "x",
            "aperture_radius": camera.aperture_mm,
            "focus_distance": camera.focus_mm,
            "to_world": mi.ScalarTransform4f().look_at(
                origin=camera.centre.tolist(), target=(camera.centre + camera.away).tolist(), up=(-camera.down).tolist()
            ),
            "film": {"type": "hdrfilm", "width": WIDTH, "height": HEIGHT, "rfilter": {"type": "tent"}},
            "sampler": {"type": "multijitter"},
        }

    def _cut_catheter(self) -> list[tuple[str, float, float, Any]]:
        """Name, start and end (share of the length) and material of the shaft, its rings and the tip."""
        rng = self._rng
        flexible = self._plan.rod.length_m / (self._plan.rod.length_m + self._plan.rod.rigid_m)
        shaft = plain(rng, metal=False)
        metal = plain(rng, metal=True)
        tip = metal if rng.uniform() < 0.8 else shaft
        pieces = [("shaft", 0.0, flexible, shaft), ("tip", flexible, 1.0, tip)]
        end = flexible
        for index in range(int(rng.integers(0, 4))):
            end -= rng.uniform(2.0, 3.0) / self._length
            start = end - rng.uniform(1.0, 2.0) / self._length
            pieces.append((f"ring{index}", start, end, metal))
            end = start
        return pieces

    def _piece_rows(self, name: str) -> int:
        return PIECE_ROWS + (DOME_ROWS if name == "tip" else 2)

    def _piece(self, line: FloatArray, name: str, start: float, end: float) -> FloatArray:
        """Vertices of a piece of the catheter; the tip ends in a dome, the shaft goes on into the sheath."""
        radius = self._radius * (1.02 if name.startswith("ring") else 1.0)
        reach = np.linspace(0.0, 1.0, len(line))
        dome = radius / self._length
        last = end - dome if name == "tip" else end
        at = np.linspace(start, last, PIECE_ROWS)
        radii = np.full(PIECE_ROWS, radius)
        if name == "tip":
            angle = np.linspace(0.0, np.pi / 2, DOME_ROWS + 1)[1:]
            at = np.concatenate([at, last + dome * np.sin(angle)])
            radii = np.concatenate([radii, radius * np.maximum(np.cos(angle), 1e-3)])
        else:
            at = np.concatenate([[at[0]], at, [at[-1]]])
            radii = np.concatenate([[1e-3], radii, [1e-3]])
        tangent = np.gradient(line, axis=0)
        points, along = (np.column_stack([np.interp(at, reach, xyz) for xyz in each.T]) for each in (line, tangent))
        if name == "shaft":
            points[:2] -= [[90.0, 0.0, 0.0], [90.0, 0.0, 0.0]]
        return _tube(points, along / np.linalg.norm(along, axis=1, keepdims=True), radii, AROUND)

    def _draw_tissue(self) -> dict[str, Any]:
        """A block with a rounded upper edge: (profile, along) grids of the depth and the height of each vertex."""
        rng = self._rng
        top, deep, half = rng.uniform(1.0, 3.5), rng.uniform(6.0, 16.0), rng.uniform(9.0, 18.0)
        edge = rng.uniform(0.4, 1.2)
        angle = np.linspace(0.0, np.pi / 2, 7)
        profile_deep = np.concatenate(
            [np.zeros(14), edge * (1 - np.cos(angle)), edge + (deep - edge) * np.linspace(0.02, 1, 50) ** 1.5]
        )
        profile_high = np.concatenate(
            [
                np.linspace(-self._gap + 0.2, top - edge, 14, endpoint=False),
                top - edge + edge * np.sin(angle),
                np.full(50, top),
            ]
        )
        along = np.linspace(-half, half, 150)
        bumps = gaussian_filter(rng.standard_normal((len(profile_deep), len(along))), (3, 8))
        bumps *= rng.uniform(0.02, 0.12) / bumps.std()
        depth = profile_deep[:, None] + bumps
        high = np.broadcast_to(profile_high[:, None], depth.shape).copy()
        high[20:] += bumps[20:]
        across = np.broadcast_to(along[None], depth.shape).copy()
        for column in (0, -1):  # close the ends
            depth[:, column] = np.minimum(depth[:, column], deep)
            high[:, column] = -self._gap
        base = np.array(
            [
                [0.75, 0.42, 0.38],
                [0.85, 0.72, 0.6],
                [0.45, 0.12, 0.1],
                [0.8, 0.8, 0.78],
                [0.85, 0.6, 0.55],
                [0.35, 0.3, 0.3],
            ]
        )[rng.integers(6)]
        spots = gaussian_filter(rng.standard_normal(depth.shape), (2, 4))
        colour = np.clip(base * (1 + rng.uniform(0.03, 0.12) * (spots / spots.std())[..., None]), 0.02, 0.95)
        return {
            "depth": depth,
            "high": high,
            "across": across,
            "colour": colour,
            "deep": deep,
            "half": half,
            "top": top,
        }

    def _tissue_material(self) -> dict[str, Any]:
        rng = self._rng
        return {
            "type": "principled",
            "base_color": {"type": "mesh_attribute", "name": "vertex_color"},
            "roughness": float(rng.uniform(0.25, 0.7)),
            "specular": float(rng.uniform(0.2, 0.6)),
            "flatness": float(rng.uniform(0.0, 1.0)),
            "clearcoat": float(rng.choice([0.0, rng.uniform(0.1, 0.6)])),
            "clearcoat_gloss": 0.8,
        }

    def _tissue_vertices(self, wall: FloatArray, tip: FloatArray, dent: float) -> FloatArray:
        """The face follows the tip as an elastic half-space follows a flat punch: 2/pi asin(a / r) beside it."""
        shape, tissue = self._tissue_shape, self._plan.tissue
        flat = np.array([math.cos(tissue.yaw_rad), math.sin(tissue.yaw_rad), 0.0])
        tilt = math.tan(tissue.tilt_rad)
        depth = shape["depth"] + tilt * shape["high"]
        points = wall - depth[..., None] * flat + shape["across"][..., None] * tissue.across
        points[..., 2] = shape["high"]
        centre = tip.copy()
        centre -= ((centre - wall) @ flat) * flat  # where the tip meets the undented face
        distance = np.linalg.norm(points - centre, axis=-1)
        share = 2 / np.pi * np.arcsin(np.minimum(1.0, 1.1 * self._radius / np.maximum(distance, 1e-6)))
        return (points - (dent * share)[..., None] * flat).reshape(-1, 3)

    def _carrier_vertices(self, wall: FloatArray) -> FloatArray:
        """A plate behind the tissue: a box as rings of four."""
        shape, tissue = self._tissue_shape, self._plan.tissue
        flat = np.array([math.cos(tissue.yaw_rad), math.sin(tissue.yaw_rad), 0.0])
        half, top = shape["half"] + 1.5, shape["top"] + 0.8
        corners = np.array([[-half, -self._gap + 0.3], [half, -self._gap + 0.3], [half, top], [-half, top]])
        rows = []
        for deep, size in ((0.0, 1e-3), (0.0, 1.0), (0.0, 1.0), (4.0, 1.0), (4.0, 1.0), (4.0, 1e-3)):
            start = wall - (shape["deep"] - 0.3 + deep) * flat
            rows.append(start + size * corners[:, :1] * tissue.across + size * np.array([[0, 0, 1.0]]) * corners[:, 1:])
        ring = np.array(rows)
        ring[..., 2] -= wall[2]
        return ring.reshape(-1, 3)

    def _sheath(self) -> dict[str, Any]:
        """A thick tube around the shaft up to the clamp, or a block that holds it."""
        mi, rng = self._mi, self._rng
        if rng.uniform() < SHEATH_SHARE:
            outer, inner = self._radius * rng.uniform(1.25, 2.1), 1.02 * self._radius
            x = np.concatenate([np.linspace(-100.0, 0.0, 39), [0.0, 0.0, -3.0]])
            line = np.column_stack([x, np.zeros((len(x), 2))])
            radii = np.concatenate([np.full(39, outer), [0.97 * outer, inner, inner]])  # the mouth is open
            self._sheath_vertices = _tube(line, np.tile([1.0, 0.0, 0.0], (len(x), 1)), radii, AROUND)
            return {"sheath": self._mesh("sheath", len(x), AROUND, True, plain(rng, metal=bool(rng.uniform() < 0.25)))}
        wide = rng.uniform(3.0, 9.0)
        box = mi.ScalarTransform4f().translate([-15.0, 0.0, -self._gap / 2 + 2]).scale([15.0, wide, self._gap / 2 + 2])
        return {"block": {"type": "cube", "to_world": box, "bsdf": plain(rng, metal=bool(rng.integers(2)))}}

    def _ground(self) -> dict[str, Any]:
        mi, rng = self._mi, self._rng
        material = GROUNDS[self._plan.seed % len(GROUNDS)](mi, rng)
        place = (
            mi.ScalarTransform4f()
            .translate([*self._middle(), -self._gap])
            .rotate([0, 0, 1], float(rng.uniform(0, 360)))
            .scale(150.0)
        )
        return {"ground": {"type": "rectangle", "to_world": place, "bsdf": material}}

    def _middle(self) -> list[float]:
        camera = self._camera
        reach = -camera.centre[2] / camera.away[2]
        return (camera.centre + reach * camera.away)[:2].tolist()

    def _lights(self) -> dict[str, Any]:
        """A dim room with some windows, visible in shiny objects, and a lamp beside the camera."""
        mi, rng = self._mi, self._rng
        room = np.full((64, 128, 3), 0.25, np.float32) * np.linspace(1.3, 0.4, 64, dtype=np.float32)[:, None, None]
        for _ in range(int(rng.integers(2, 6))):
            row, column = rng.integers(4, 34), rng.integers(0, 110)
            high, wide = rng.integers(4, 14), rng.integers(5, 18)
            tint = 1 + 0.15 * rng.uniform(-1, 1, 3)
            room[row : row + high, column : column + wide] = rng.uniform(1.5, 5.0) * tint
        whole = mi.ScalarTransform4f().rotate([0, 0, 1], float(rng.uniform(0, 360))).rotate([1, 0, 0], 90)
        around, aside = rng.uniform(0, 2 * math.pi), rng.uniform(120.0, 350.0)
        middle = np.array([*self._middle(), 0.0])
        beside = np.array([math.cos(around), math.sin(around), 0.0])
        origin = middle + aside * beside + rng.uniform(300.0, 500.0) * np.array([0.0, 0.0, 1.0])
        size, warm = rng.uniform(25.0, 110.0), rng.uniform(-0.12, 0.12)
        power = rng.uniform(0.8, 2.5) * (np.linalg.norm(origin) / (2 * size)) ** 2
        lamp = mi.ScalarTransform4f().look_at(origin=origin.tolist(), target=middle.tolist(), up=[0.1, 0.2, 1.0])
        return {
            "room": {"type": "envmap", "bitmap": mi.Bitmap(room), "to_world": whole},
            "lamp": {
                "type": "rectangle",
                "to_world": lamp.scale(size),
                "emitter": {
                    "type": "area",
                    "radiance": {"type": "rgb", "value": (power * np.array([1 + warm, 1.0, 1 - warm])).tolist()},
                },
            },
        }

    def _clutter(self, run: Run) -> dict[str, Any]:
        """Up to four things on the ground, clear of all that moves."""
        rng, camera = self._rng, self._camera
        tissue = self._plan.tissue
        line = 1e3 * run.line_m[::50, ::4, :2].reshape(-1, 2)
        wall = 1e3 * run.wall_m[::50, :2]
        block = [
            wall - d * tissue.normal[:2] + a * tissue.across[:2] for d in (0, 8, 16) for a in np.linspace(-18, 18, 9)
        ]
        sheath = np.column_stack([np.linspace(-100, 0, 60), np.zeros(60)])
        taken = np.vstack([line, *block, sheath])
        found: dict[str, Any] = {}
        for index in range(int(rng.integers(0, 5))):
            for _ in range(40):
                pixel = rng.uniform(0, 1, 2) * [WIDTH, HEIGHT] - [WIDTH / 2, HEIGHT / 2]
                ray = camera.away + (pixel[0] * camera.right + pixel[1] * camera.down) / camera.focal_px
                place = camera.centre - (camera.centre[2] + self._gap) / ray[2] * ray
                if np.min(np.linalg.norm(taken - place[:2], axis=1)) > 11.0:
                    found[f"thing{index}"] = self._thing(place, rng)
                    break
        return found

    def _thing(self, place: FloatArray, rng: np.random.Generator) -> dict[str, Any]:
        mi = self._mi
        size = float(rng.uniform(1.0, 4.0))
        material = plain(rng, metal=bool(rng.integers(2)))
        turn = mi.ScalarTransform4f().translate([place[0], place[1], -self._gap + size])
        turn = turn.rotate([0, 0, 1], float(rng.uniform(0, 360)))
        kind = rng.integers(3)
        if kind == 0:
            return {"type": "sphere", "to_world": turn.scale(size), "bsdf": material}
        if kind == 1:
            return {"type": "cube", "to_world": turn.scale([size * rng.uniform(1, 2), size, size]), "bsdf": material}
        turned = float(rng.uniform(0, 2 * np.pi))
        along = float(rng.uniform(6.0, 12.0)) * np.array([math.cos(turned), math.sin(turned), 0.0])
        middle = np.array([place[0], place[1], -self._gap + 0.6 * size])
        ends = {"p0": (middle - along).tolist(), "p1": (middle + along).tolist()}
        return {"type": "cylinder", **ends, "radius": 0.6 * size, "bsdf": material}
