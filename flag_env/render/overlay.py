"""Signs drawn over the scene: the wind arrow and the gauge of the distance to the target."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from flag_env.render.camera import view
from flag_env.render.layer import Layer
from flag_env.render.snapshot import Snapshot
from flag_env.render.solids import arrow

__all__ = ["Overlay"]

Array = NDArray[np.float64]
Pixels = NDArray[np.uint8]
Color = tuple[float, float, float]

INK: Color = (0.16, 0.20, 0.27)
PAPER: Color = (1.0, 1.0, 1.0)
AMBER: Color = (0.93, 0.55, 0.13)
GREEN: Color = (0.13, 0.62, 0.36)
WIND: Color = (0.26, 0.53, 0.92)

_LONGEST = 1.15  # the arrow stops growing here, in full lengths
_SMALLEST_UNIT = 0.20  # pixels of a picture / 480 that signs do not shrink below
_WORDS_FROM = 192  # pixels of the shorter side from which on words are written
_SIGN_ELEVATION = 50.0  # degrees
_FAR, _NEAR = 0.5, 0.01  # distances at the gauge's two ends, which is logarithmic


class Overlay:
    """Draws the signs of a `width` x `height` picture."""

    def __init__(self, width: int, height: int, azimuth: float) -> None:
        """Lay out the signs: sizes follow the picture's shorter side; small pictures leave out the words."""
        unit = max(min(width, height) / 480.0, _SMALLEST_UNIT)
        self._words = min(width, height) >= _WORDS_FROM
        # Seen from higher than the flag is, so that a wind towards the eye is no point.
        self._rotation = view(azimuth, _SIGN_ELEVATION)
        self._unit = unit
        self._radius = 42.0 * unit
        self._hub = np.array([self._radius + 18.0 * unit, height - self._radius - 12.0 * unit])
        self._track = (18.0 * unit, width - (82.0 if self._words else 18.0) * unit, 20.0 * unit)
        # Laying out text takes longer than drawing the flag: digits are drawn once and set side by side.
        self._glyphs = {sign: _glyph(sign, 13.0 * unit) for sign in "0123456789. %"}

    def draw_fixed(self, layer: Layer, snapshot: Snapshot) -> None:
        """Draw what is the same in every frame of an episode."""
        unit = self._unit
        if snapshot.wind is not None:
            angle = np.linspace(0.0, 2.0 * np.pi, 65)
            circle = np.stack([np.cos(angle), np.sin(angle), np.zeros_like(angle)], axis=-1)
            axes = np.array([[-1.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 1.0, 0.0]])
            plane = self._rotation[:2].T
            layer.line(self._hub + self._radius * circle @ plane, PAPER, 1.4 * unit, 0.85)
            layer.line(self._hub + self._radius * axes @ plane, PAPER, 1.0 * unit, 0.45)
            if self._words:
                layer.text(self._hub[0] - 15.0 * unit, self._hub[1] - self._radius - 14.0 * unit, "wind", INK, 12.0 * unit)
        if snapshot.distance is not None:
            left, right, y = self._track
            layer.line(np.array([[left, y], [right, y]]), PAPER, 7.0 * unit, 0.65)

    def draw_moving(self, layer: Layer, snapshot: Snapshot) -> None:
        """Draw the arrow and the gauge of this frame."""
        if snapshot.wind is not None:
            self._draw_arrow(layer, snapshot.wind / snapshot.wind_scale)
        if snapshot.distance is not None:
            self._draw_gauge(layer, snapshot.distance, snapshot.tolerance, snapshot.success)

    def _draw_arrow(self, layer: Layer, wind: Array) -> None:
        length = float(np.linalg.norm(wind))
        end = wind * (min(length, _LONGEST) / length) if length > 1e-6 else np.zeros(3)
        quads = arrow(end, self._rotation, self._hub, self._radius, 0.07, WIND)
        layer.quads(quads.corners, quads.colors)

    def _draw_gauge(self, layer: Layer, distance: float, tolerance: float | None, success: bool) -> None:
        left, right, y = self._track
        unit = self._unit
        color = GREEN if success else AMBER
        at = left + (right - left) * _closeness(distance)
        layer.line(np.array([[left, y], [at, y]]), color, 5.0 * unit)
        if tolerance is not None:
            mark = left + (right - left) * _closeness(tolerance)
            low, top, wide = (
                round(layer.height - y - 7.0 * unit),
                round(layer.height - y + 7.0 * unit),
                max(1, round(unit)),
            )
            layer.pixels[low:top, round(mark) : round(mark) + wide, :3] = [round(255 * value) for value in INK]
        if not self._words:
            return
        label = np.concatenate([self._glyphs[sign] for sign in f"{100.0 * min(distance, 9.99):.1f} %"], axis=1)
        layer.image(round(right + 11.0 * unit), round(y - 9.5 * unit), label)


def _glyph(sign: str, size: float) -> Pixels:
    """Return a character, `size` [pixel] high, as RGBA, as wide as the pen advances."""
    layer = Layer(round(2 * size) + 1, round(1.5 * size) + 1)
    layer.text(0.0, 0.4 * size, sign, INK, size)
    advance = {" ": 0.25, ".": 0.32, "%": 0.95}.get(sign, 0.636)
    return layer.pixels[:, : max(1, round(advance * size))].copy()


def _closeness(distance: float) -> float:
    """Return where a distance lies on the gauge, from 0 (far) to 1 (near)."""
    share = np.log(_FAR / max(distance, _NEAR)) / np.log(_FAR / _NEAR)
    return float(np.clip(share, 0.0, 1.0))
