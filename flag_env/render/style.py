"""How a picture looks: colours, pattern, and where it is seen from."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = ["CLOTH", "DEFAULT_STYLE", "LARGEST_SIZE", "SMALLEST_SIZE", "Palette", "Style"]

Color = tuple[float, float, float]

SMALLEST_SIZE, LARGEST_SIZE = 64, 8192
"""Least and largest width and height of a picture [pixel]: flag, pole, wind and gauge are told apart from 64 on."""


class Palette(NamedTuple):
    """Colours of one flag, RGB from 0 to 1: two fields, the cross between them, the heading at the mast."""

    first: Color
    second: Color
    cross: Color
    heading: Color


CLOTH = Palette((0.890, 0.270, 0.235), (0.965, 0.640, 0.200), (0.985, 0.950, 0.885), (0.930, 0.905, 0.850))


@dataclass(frozen=True, eq=False)
class Style:
    """Colours, pattern and point of view.

    Attributes
    ----------
        palette: colours of the flag.
        texture: picture on the cloth in place of the pattern, RGB from 0 to 1 or uint8, shape (height, width, 3), its left
            edge at the mast, its first row on top; None: the pattern.
        azimuth: where the eye stands, degrees about z: 0 looks along -x, -90 along +y.
        elevation: of the eye above the horizon, degrees, from 0 to 80.
    """

    palette: Palette = CLOTH
    texture: ArrayLike | None = None
    azimuth: float = -62.0
    elevation: float = 15.0

    def __post_init__(self) -> None:
        """Check and freeze every field; raise ValueError with its name, value and what is allowed."""
        colors = np.asarray(self.palette, np.float64)
        if colors.shape != (4, 3) or not ((colors >= 0.0) & (colors <= 1.0)).all():
            raise ValueError(f"palette is {self.palette!r}; allowed are four colours, RGB from 0 to 1")
        object.__setattr__(self, "palette", Palette(*(tuple(color) for color in colors.tolist())))
        if self.texture is not None:
            object.__setattr__(self, "texture", _texture(self.texture))
        for name, low, high in (("azimuth", -360.0, 360.0), ("elevation", 0.0, 80.0)):
            angle = getattr(self, name)
            if isinstance(angle, bool) or not isinstance(angle, (int, float, np.number)) or not low <= angle <= high:
                raise ValueError(f"{name} is {angle!r}; allowed is a number of degrees from {low:g} to {high:g}")


def _texture(given: ArrayLike) -> NDArray[np.float64]:
    """A read-only copy, RGB from 0 to 1."""
    array = np.array(given)
    if array.ndim != 3 or array.shape[2] != 3 or array.size == 0 or array.dtype.kind not in "uif":
        raise ValueError(f"texture is of shape {array.shape} and dtype {array.dtype}; allowed is (height, width, 3) of numbers")
    colors = array / 255.0 if array.dtype == np.uint8 else array.astype(np.float64)
    if not ((colors >= 0.0) & (colors <= 1.0)).all():
        raise ValueError(f"texture runs from {colors.min():g} to {colors.max():g}; allowed is 0 to 1, or uint8")
    colors.setflags(write=False)
    return colors


DEFAULT_STYLE = Style()
