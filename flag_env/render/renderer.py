"""The renderer: a snapshot in, an RGB picture out."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from flag_env.render.body import flag_body, mast_axis, mast_quads
from flag_env.render.camera import Camera
from flag_env.render.layer import Layer
from flag_env.render.overlay import GREEN, Overlay
from flag_env.render.scenery import Shadow, backdrop
from flag_env.render.shading import Quads
from flag_env.render.snapshot import Snapshot
from flag_env.render.solids import join
from flag_env.render.style import DEFAULT_STYLE, LARGEST_SIZE, SMALLEST_SIZE, Palette, Style

__all__ = ["Renderer"]

Array = NDArray[np.float64]
Pixels = NDArray[np.uint8]

_GHOST = Style(Palette((0.40, 0.53, 0.80), (0.47, 0.60, 0.86), (0.78, 0.86, 0.98), (0.78, 0.86, 0.98)))
_REACHED = Style(Palette((0.25, 0.66, 0.43), (0.34, 0.73, 0.50), (0.74, 0.95, 0.82), (0.74, 0.95, 0.82)))
_GHOST_EDGE = (0.20, 0.33, 0.66)
_GHOST_BEHIND = 0.03  # of the size: cloth this close to its target is not tinted in patches
_NO_LOWEST = np.uint32(0xFEFEFEFE)  # all bits but the lowest of each byte
_EDGE_WIDTH = 1.3  # pixels
_FARTHEST = 1e4  # m; positions of a diverged flag are drawn no farther out than this


class Renderer:
    """Draws snapshots off screen; no window, no pyplot.

    The first frame of a view box paints the backdrop, which later frames copy.
    """

    def __init__(self, width: int = 480, height: int = 480, style: Style = DEFAULT_STYLE) -> None:
        """Make a renderer of pictures of `width` x `height` pixels, in a style."""
        self.style = style
        for name, value in (("width", width), ("height", height)):
            if not isinstance(value, (int, np.integer)) or isinstance(value, bool) or not SMALLEST_SIZE <= value <= LARGEST_SIZE:
                raise ValueError(f"{name} is {value!r}; allowed is an int from {SMALLEST_SIZE} to {LARGEST_SIZE}")
        self.width, self.height = int(width), int(height)
        self._layer: Layer | None = Layer(self.width, self.height)
        self._scratch = Layer(self.width, self.height)
        self._shadow = Shadow(self.width, self.height)
        self._overlay = Overlay(self.width, self.height, self.style.azimuth)
        self._scene_key: object = None
        self._ghost_key: object = None
        self._ghost: Quads | None = None
        self._mast_key: object = None

    def draw(self, snapshot: Snapshot) -> Pixels:
        """Return the picture of `snapshot`, RGB, shape (height, width, 3), in memory of its own."""
        layer = self._layer
        if layer is None:
            raise ValueError("the renderer is closed; make a new one")
        self._set_scene(layer, snapshot)
        bounds, camera = snapshot.bounds, self._camera
        size = float(np.linalg.norm(bounds[1] - bounds[0])) / 3.0
        positions = np.clip(snapshot.positions, -_FARTHEST, _FARTHEST)
        self._set_ghost(snapshot, size)
        self._set_mast(snapshot, size)
        flag = flag_body(camera, positions, size, self.style, snapshot.intact)

        layer.pixels[...] = self._backdrop
        self._shadow.draw(layer, camera, float(bounds[0, 2]), np.concatenate([flag.shade, self._mast_shade]))
        scene = join([self._mast, flag.quads])
        if self._ghost is None:
            layer.quads(scene.corners, scene.colors)
        else:
            self._draw_with_ghost(layer, scene, self._ghost)
        self._overlay.draw_moving(layer, snapshot)
        frame = np.empty((self.height, self.width, 3), dtype=np.uint8)
        for channel in range(3):  # four times as fast as copying pixels[..., :3]
            frame[..., channel] = layer.pixels[..., channel]
        return frame

    def close(self) -> None:
        """Free the buffers; further calls do nothing."""
        self._layer = None
        for name in ("_scratch", "_shadow", "_backdrop"):
            self.__dict__.pop(name, None)

    def _set_scene(self, layer: Layer, snapshot: Snapshot) -> None:
        """Make camera and backdrop anew when the view box or the kind of signs changes."""
        key = (snapshot.bounds.tobytes(), snapshot.wind is None, snapshot.distance is None)
        if key == self._scene_key:
            return
        self._camera = Camera.framing(snapshot.bounds, self.width, self.height, self.style.azimuth, self.style.elevation)
        layer.pixels[...] = backdrop(self._camera, snapshot.bounds, self.width, self.height)
        self._overlay.draw_fixed(layer, snapshot)
        self._backdrop = layer.pixels.copy()
        self._scene_key, self._ghost_key, self._mast_key = key, None, None

    def _set_mast(self, snapshot: Snapshot, size: float) -> None:
        """Shape the pole anew when the mast moves."""
        key = snapshot.mast.tobytes()
        if key == self._mast_key:
            return
        ends = mast_axis(np.clip(snapshot.mast, -_FARTHEST, _FARTHEST), snapshot.bounds)
        self._mast = mast_quads(self._camera, ends, size)
        self._mast_shade = ends[0] + np.linspace(0.0, 1.0, 40)[:, None] * (ends[1] - ends[0])
        self._mast_key = key

    def _set_ghost(self, snapshot: Snapshot, size: float) -> None:
        """Shape the ghost anew when the target changes."""
        target = snapshot.target
        key = (None,) if target is None else (target.shape, target.tobytes(), snapshot.success)
        if key == self._ghost_key:
            return
        self._ghost_key, self._ghost = key, None
        if target is not None:
            style, edge = (_REACHED, GREEN) if snapshot.success else (_GHOST, _GHOST_EDGE)
            ghost = flag_body(self._camera, np.clip(target, -_FARTHEST, _FARTHEST), size, style)
            behind = ghost.quads._replace(depth=ghost.quads.depth + _GHOST_BEHIND * size)
            self._ghost = join([behind, *(_strokes(outline, edge, 0.01 * size) for outline in ghost.outlines)])

    def _draw_with_ghost(self, layer: Layer, scene: Quads, ghost: Quads) -> None:
        """Draw the scene, and mix with it a picture of the scene with the ghost in it, half and half.

        Where the ghost is hidden the two are the same, so that only what is seen of it tints the picture, once however it folds.
        """
        layer.quads(scene.corners, scene.colors)
        pixels = ghost.corners.reshape(-1, 2)
        left, bottom = np.clip(pixels.min(axis=0) - 3, 0, (self.width, self.height)).astype(int)
        right, top = np.clip(pixels.max(axis=0) + 4, 0, (self.width, self.height)).astype(int)
        box = slice(self.height - top, self.height - bottom), slice(left, right)
        self._scratch.pixels[box] = layer.pixels[box]
        # What lies behind all of the ghost is there already.
        before = scene.depth < ghost.depth.max()
        whole = join([Quads(scene.corners[before], scene.colors[before], scene.depth[before]), ghost])
        self._scratch.quads(whole.corners, whole.colors)
        under, over = (picture.pixels.view(np.uint32)[..., 0][box] for picture in (layer, self._scratch))
        under[...] = (under & over) + (((under ^ over) & _NO_LOWEST) >> 1)  # the mean of each byte


def _strokes(outline: Array, color: tuple[float, float, float], nearer: float) -> Quads:
    """A polyline (k, 3) of pixels and depths [m] as thin quads, so that it hides and is hidden; drawn `nearer` [m] than it is."""
    along = outline[1:, :2] - outline[:-1, :2]
    along /= np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-9)
    side = 0.5 * _EDGE_WIDTH * np.stack([-along[:, 1], along[:, 0]], axis=1)
    first, second = outline[:-1, :2], outline[1:, :2]
    corners = np.stack([first - side, second - side, second + side, first + side], axis=1)
    depth = 0.5 * (outline[:-1, 2] + outline[1:, 2]) - nearer
    return Quads(corners, np.tile(np.asarray(color, np.float64), (len(corners), 4, 1)), depth)
