"""A pixel buffer drawn by matplotlib's Agg renderer; the only file that touches matplotlib."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["Layer"]

Array = NDArray[np.float64]
Pixels = NDArray[np.uint8]

# Pixels by which quads grow, so that antialiased neighbours leave no hairline between them.
_OVERLAP = 0.3

_NOTHING_2 = np.zeros((0, 2))
_NOTHING_4 = np.zeros((0, 4))


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
        """Fill quads in the order given, so the last covers the others.

        Of Agg's primitives, one QuadMesh call is the quickest way to fill quads in any order. Measured for
        quads of 4 x 4 pixels: 1.4 us each, against 4.5 us for a pair of Gouraud triangles, and 2.5 us or more
        for a PolyCollection or for a path collection with an affine map per quad. A mesh wants neighbouring
        cells, so the quads lie in a row with a column of NaN vertices between each two, which Agg drops.

        Args:
            corners: vertices [pixel], shape (n, 4, 2).
            colors: RGB from 0 to 1, shape (n, 3).
        """
        count = len(corners)
        if count == 0:
            return
        across = corners[:, 1] - corners[:, 0] + corners[:, 2] - corners[:, 3]
        up = corners[:, 3] - corners[:, 0] + corners[:, 2] - corners[:, 1]
        across *= (_OVERLAP / (np.sqrt(across[:, 0] ** 2 + across[:, 1] ** 2) + 1e-9))[:, None]
        up *= (_OVERLAP / (np.sqrt(up[:, 0] ** 2 + up[:, 1] ** 2) + 1e-9))[:, None]
        rising, falling = across + up, across - up
        # Agg's time goes by the rows of pixels an edge crosses. The edges beside the NaN are walked once
        # more, so these are the lower and upper ones, which are level as a rule.
        vertices = np.full((2, count, 3, 2), np.nan)
        vertices[0, :, 0], vertices[0, :, 1] = corners[:, 0] - rising, corners[:, 3] - falling
        vertices[1, :, 0], vertices[1, :, 1] = corners[:, 1] + falling, corners[:, 2] + rising
        faces = np.ones((count, 3, 4))
        faces[..., :3] = colors[:, None]
        context = self._renderer.new_gc()
        self._renderer.draw_quad_mesh(
            context,
            self._identity,
            3 * count - 1,
            1,
            vertices.reshape(2, 3 * count, 2),
            _NOTHING_2,
            self._identity,
            faces.reshape(-1, 4)[:-1],
            True,
            _NOTHING_4,
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
