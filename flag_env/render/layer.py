"""A pixel buffer drawn by matplotlib's Agg renderer; the only file that touches matplotlib."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["Layer"]

Array = NDArray[np.float64]
Pixels = NDArray[np.uint8]

_HALVES = np.array([[0, 1, 2], [0, 2, 3]])  # corners of a quad's two triangles


class Layer:
    """An RGBA image that quads, lines and text are drawn into.

    Pixel coordinates of quads and lines: x to the right, y up from the lower left corner.

    Attributes
    ----------
        pixels: the live buffer, shape (height, width, 4), top row first; writing to it draws.
    """

    def __init__(self, width: int, height: int) -> None:
        """Make a transparent layer of `width` x `height` pixels."""
        # Imported here so that importing the package does not import matplotlib.
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure
        from matplotlib.font_manager import FontProperties
        from matplotlib.path import Path
        from matplotlib.transforms import IdentityTransform

        dpi = 100.0
        canvas = FigureCanvasAgg(Figure(figsize=((width + 0.01) / dpi, (height + 0.01) / dpi), dpi=dpi))
        self._renderer: Any = canvas.get_renderer()  # type: ignore[no-untyped-call]
        self._identity: Any = IdentityTransform()
        self._path: Any = Path
        self._font: Any = FontProperties
        self.pixels: Pixels = np.asarray(self._renderer.buffer_rgba())
        self.height = height

    def clear(self) -> None:
        """Make every pixel transparent."""
        self.pixels[...] = 0

    def quads(self, corners: Array, colors: Array) -> None:
        """Fill quads in the order given, so the last covers the others; colours blend between corners.

        Two Gouraud triangles a quad. Measured for quads of 6 x 6 pixels: 3.2 us each, against 2.6 us in one colour by a
        QuadMesh, of which many more are needed to look as smooth. Agg lets triangles grow by half a pixel, so that no hairline
        stays between neighbours.

        Args:
            corners: vertices [pixel], shape (n, 4, 2).
            colors: of the corners, RGB from 0 to 1, shape (n, 4, 3).
        """
        if len(corners) == 0:
            return
        colors = np.concatenate([colors, np.ones((len(colors), 4, 1))], axis=2)
        triangles, shades = (np.ascontiguousarray(part[:, _HALVES]) for part in (corners, colors))
        self._renderer.draw_gouraud_triangles(
            self._renderer.new_gc(), triangles.reshape(-1, 3, 2), shades.reshape(-1, 3, 4), self._identity
        )

    def line(self, points: Array, color: tuple[float, float, float], width: float, alpha: float = 1.0) -> None:
        """Stroke a polyline with round joins.

        Args:
            points: vertices [pixel], shape (n, 2).
            color: RGB from 0 to 1.
            width: width of the stroke [pixel].
            alpha: opacity from 0 to 1.
        """
        context = self._renderer.new_gc()
        context.set_foreground((*color, alpha), isRGBA=True)
        context.set_linewidth(width)
        context.set_capstyle("round")
        context.set_joinstyle("round")
        context.set_snap(False)
        self._renderer.draw_path(context, self._path(points), self._identity)

    def image(self, x: int, y: int, rgba: Pixels) -> None:
        """Blend an RGBA image, shape (rows, columns, 4), with its lower left pixel at (x, y)."""
        # Agg takes the lowest row first.
        self._renderer.draw_image(self._renderer.new_gc(), x, y, np.ascontiguousarray(rgba[::-1]))

    def text(self, x: float, y: float, text: str, color: tuple[float, float, float], size: float) -> None:
        """Write `text` with its baseline starting at (x, y) [pixel], `size` [pixel] high."""
        context = self._renderer.new_gc()
        context.set_foreground(color)
        font = self._font(family="DejaVu Sans", size=size * 0.72)  # points at 100 dpi
        self._renderer.draw_text(context, x, self.height - y, text, font, 0.0)
