"""Timing in pyrender, a scene-graph renderer, which draws polygons as roofs of a city.

pyrender (0.1.45, unmaintained) is an example of common renderers: perspective, depth test,
multisampling, and a frame that is read back. Nothing can be counted. Views of a model are drawn in
their own projection, one frame per view, without roofs.
"""

import importlib.util
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from harness.errors import NoRasteriserError, UsageError
from harness.frame import Frame
from harness.grid import SUBPIXEL
from harness.rasterisers import devices, opengl
from harness.rasterisers.base import (
    Counters,
    Device,
    Drawing,
    Options,
    Rasteriser,
    Sample,
    Stopwatch,
    Triangles,
)
from harness.rasterisers.reference import choose_polygon_colours
from harness.rasterisers.spans import DEEPEST
from triangulators.gpu import is_software, selects_renderer

FIELD_OF_VIEW = np.radians(40.0)
ELEVATION = np.radians(50.0)
AZIMUTH = np.radians(-115.0)
DISTANCE = 1.5  # distance of the camera from the city's centre, in viewport widths
OLD_INFINITY = "infty"  # name of infinity in numpy 1, which pyrender still uses
LOWEST, TALLEST = 0.005, 0.035  # heights of roofs, as shares of the viewport's width
GOLDEN = 0.6180339887498949  # step of successive roofs' heights, modulo 1: spreads them evenly
WALL_SHADE = 0.55  # brightness relative to the roof

SKY = (0.93, 0.95, 0.98, 1.0)


class Pyrender(Rasteriser):
    """Rasteriser that draws extruded roofs in perspective with pyrender's off-screen renderer."""

    name = "pyrender"
    limitation = "fixed samples and shaders"
    supports_depth = True
    device_names: ClassVar[tuple[str, ...]] = ("gpu0", "llvmpipe", "osmesa")
    module: ClassVar[str] = "pyrender"
    remedies: ClassVar[Mapping[str, str]] = {
        "osmesa": f"run: {opengl.INSTALL_OSMESA}",
        "": f"run: {devices.INSTALL}",
    }

    @classmethod
    def devices(cls) -> list[Device]:
        """List GPUs and llvmpipe through EGL, then OSMesa; [] if pyrender is not installed."""
        if importlib.util.find_spec("pyrender") is None:
            return []
        usable = []
        for device in devices.list_egl_devices()[0]:
            if device.name == "llvmpipe" or not device.software:
                number = str(device.details["egl_index"])
                platform = {"PYOPENGL_PLATFORM": "egl", "EGL_DEVICE_ID": number}
                environment = {**device.environment, **platform}
                usable.append(replace(device, environment=environment))
        for device in opengl.OSMesa.devices():
            environment = {**device.environment, "PYOPENGL_PLATFORM": "osmesa"}
            usable.append(replace(device, environment=environment))
        return usable

    def __init__(self, device: Device) -> None:
        device.require_environment()
        if not hasattr(np, OLD_INFINITY):
            setattr(np, OLD_INFINITY, np.inf)
        try:
            import pyrender
        except ImportError as error:
            raise NoRasteriserError(
                f"pyrender: import failed ({error}); {self.remedy()}"
            ) from error
        self.pyrender: Any = pyrender
        try:
            self.renderer: Any = pyrender.OffscreenRenderer(8, 8)
        except Exception as error:  # PyOpenGL may raise any exception
            raise NoRasteriserError(
                f"pyrender on {device.name}: {error}; {self.remedy(device.name)}"
            ) from error
        from OpenGL import GL

        renderer = GL.glGetString(GL.GL_RENDERER).decode()
        if not selects_renderer("llvmpipe" if device.software else device.name, renderer):
            self.close()
            raise NoRasteriserError(
                f"{device.name}: pyrender opened '{renderer}' instead; choose another device"
            )
        details = {**device.details, "renderer": renderer}
        self.device = replace(device, software=is_software(renderer), details=details)

    def close(self) -> None:
        """Free the renderer and its context."""
        self.renderer.delete()

    def _draw_and_count(self, frame: Frame, triangles: Triangles, options: Options) -> Counters:
        return {}

    def _prepare(self, frame: Frame, triangles: Triangles, options: Options) -> Drawing:
        return _SceneDrawing(self, frame, triangles)

    def _check_and_order(self, frame: Frame, triangles: Triangles, options: Options) -> Triangles:
        if frame.viewing is not None and frame.depths is None:
            raise UsageError("pyrender always tests depth; add depth=file or depth=front")
        return super()._check_and_order(frame, triangles, options)


class _SceneDrawing(Drawing):
    """Scenes of pyrender: one city, or the views of a model."""

    def __init__(self, owner: Pyrender, frame: Frame, triangles: Triangles) -> None:
        self.owner = owner
        self.size = (frame.width, frame.height)
        module = owner.pyrender
        self.flags = (
            module.RenderFlags.FLAT | module.RenderFlags.SKIP_CULL_FACES | module.RenderFlags.RGBA
        )
        if frame.viewing is None:
            camera = module.PerspectiveCamera(
                yfov=FIELD_OF_VIEW, znear=0.05 * frame.width, zfar=4.0 * frame.width
            )
            pose = compute_camera_pose(frame.width, frame.height)
            solids = [extrude_polygons(frame, triangles)]
        else:
            camera = module.OrthographicCamera(
                xmag=frame.width / 2, ymag=frame.height / 2, znear=0.5, zfar=2.5
            )
            pose = np.eye(4)
            pose[:3, 3] = frame.width / 2, frame.height / 2, 1.0
            draws = [triangles[rows] for rows in frame.split_by_draw(triangles)]
            solids = [project_triangles(frame, rows) for rows in draws]
        self.scenes = [self._make_scene(solid, camera, pose) for solid in solids]

    def _make_scene(self, solid: "Solid", camera: Any, pose: np.ndarray) -> Any:
        module = self.owner.pyrender
        scene = module.Scene(bg_color=np.array(SKY), ambient_light=np.ones(3))
        primitive = module.Primitive(
            positions=solid.positions,
            normals=np.tile(np.array([0, 0, 1], np.float32), (len(solid.positions), 1)),
            color_0=solid.colours,
            indices=solid.faces,
            mode=4,
            material=module.MetallicRoughnessMaterial(doubleSided=True),
        )
        scene.add(module.Mesh([primitive]))
        scene.add(camera, pose=pose)
        return scene

    def sample(self, repeats: int) -> Sample:
        """Draw all scenes `repeats` times; reading each frame back waits for the device."""
        renderer = self.owner.renderer
        renderer.viewport_width, renderer.viewport_height = self.size
        watch = Stopwatch()
        for _ in range(repeats):
            for scene in self.scenes:
                renderer.render(scene, flags=self.flags)
        return watch.stop()


def compute_camera_pose(width: float, height: float) -> np.ndarray:
    """Return the (4, 4) camera-to-world matrix of a view of the city's centre from the south."""
    plan = np.cos(ELEVATION) * np.array([np.cos(AZIMUTH), np.sin(AZIMUTH)])
    backward = np.array([*plan, np.sin(ELEVATION)])
    right = np.cross([0.0, 0.0, 1.0], backward)
    right /= np.linalg.norm(right)
    pose = np.eye(4)
    pose[:3, 0], pose[:3, 1], pose[:3, 2] = right, np.cross(backward, right), backward
    pose[:3, 3] = np.array([width / 2, height / 2, 0.0]) + DISTANCE * max(width, height) * backward
    return pose


@dataclass(frozen=True)
class Solid:
    """Roofs and walls in pixels, z up: positions (v, 3), colours (v, 4) in 0..1, faces (f, 3)."""

    positions: NDArray[np.float32]
    colours: NDArray[np.float32]
    faces: NDArray[np.uint32]


def extrude_polygons(frame: Frame, triangles: Triangles) -> Solid:
    """Extrude each polygon to a different height; the roof's triangles keep their order."""
    owner = np.repeat(np.arange(len(frame.grid)), frame.grid.vertex_counts).astype(np.int32)
    heights = (LOWEST + (TALLEST - LOWEST) * ((owner * GOLDEN) % 1.0)) * frame.width
    plan = frame.points / SUBPIXEL
    roof = np.column_stack([plan, heights])
    ground = np.column_stack([plan, np.zeros(len(plan))])
    paint = choose_polygon_colours(owner).view(np.uint8).reshape(-1, 4) / 255
    dark = paint * [WALL_SHADE, WALL_SHADE, WALL_SHADE, 1.0]

    # Walls have separate vertices, which have the wall's colour instead of the roof's.
    following = np.arange(1, len(plan) + 1)
    following[frame.grid.ring_offsets[1:] - 1] = frame.grid.ring_offsets[:-1]
    top = len(plan) + np.arange(len(plan))
    bottom = len(plan) + top
    walls = np.concatenate(
        [
            np.column_stack([bottom, bottom[following], top[following]]),
            np.column_stack([bottom, top[following], top]),
        ]
    )
    return Solid(
        positions=np.concatenate([roof, roof, ground]).astype(np.float32),
        colours=np.concatenate([paint, dark, dark]).astype(np.float32),
        faces=np.concatenate([triangles, walls]).astype(np.uint32),
    )


def project_triangles(frame: Frame, triangles: Triangles) -> Solid:
    """Return triangles (m, 3) of a model's view, projected; z is from 0, near, to -1, far."""
    assert frame.depths is not None
    used, faces = np.unique(triangles, return_inverse=True)
    if not len(used):
        used, faces = np.zeros(1, np.int64), np.zeros(3, np.int64)  # pyrender rejects empty meshes
    points = np.column_stack([frame.points[used] / SUBPIXEL, frame.depths[used] / -DEEPEST])
    owner = np.searchsorted(frame.grid.vertex_offsets, used, side="right").astype(np.int32) - 1
    paint = choose_polygon_colours(owner.astype(np.int32)).view(np.uint8).reshape(-1, 4) / 255
    return Solid(
        points.astype(np.float32), paint.astype(np.float32), faces.reshape(-1, 3).astype(np.uint32)
    )
