"""A flag's motion as one HTML file: no network, opened from disk or in a notebook.

Positions are rounded to a grid of 0.1 mm (coarser on scenes larger than 2 m), and their differences taken, twice in time and once
along rows and columns each, which leaves small numbers; these go zigzag (0, -1, 1, -2 ... as 0, 1, 2, 3 ...) into planes of equal
bytes, are deflated and written in base64. What reads them is `static/replay.js`.

Needs WebGL 2 and DecompressionStream: Chrome and Edge 80, Safari 16.4, Firefox 113, or newer.
"""

from __future__ import annotations

import base64
import hashlib
import html
import json
import os
import tempfile
import zlib
from dataclasses import dataclass, field
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

GRID = 1e-4
"""Rounding of positions on a scene of up to 2 m [m]."""

LARGEST = 2**26
"""Steps of the grid that a position may be away from the origin: differences of differences then fit into 32 bits."""

SCRIPTS = ("view", "shaders", "surface", "graphics", "draw", "plot", "replay")


@dataclass(frozen=True)
class Motion:
    """What a replay shows.

    Attributes
    ----------
    body
        The scene, as `flag_env.viewer.body.body` describes it.
    frames : (frames, layers, rows, cols, 3)
        Positions [m].
    fps
        Frames a second on the screen.
    title, told
        Its heading, and a line below.
    pace
        Simulated seconds that a second on the screen shows.
    wind : (frames, 3)
        Shares of a full-length arrow; None: no wind is shown.
    target : (layers, rows, cols, 3)
        Drawn as a ghost [m]; None: none.
    distance
        To the target, in flag diagonals, a number a frame; empty: none is shown.
    tolerance
        Distance that counts as reached.
    """

    body: dict[str, Any]
    frames: NDArray[np.float64]
    fps: float
    title: str
    told: str = ""
    pace: float = 1.0
    wind: NDArray[np.float64] | None = None
    target: NDArray[np.float64] | None = None
    distance: list[float] = field(default_factory=list)
    tolerance: float = 0.05


class Replay:
    """The HTML of a motion.

    Parameters
    ----------
    motion
        What is shown.

    Raises
    ------
    ValueError
        If there is no frame, or one is not finite.
    """

    def __init__(self, motion: Motion) -> None:
        frames = np.asarray(motion.frames, np.float64)
        if frames.ndim != 5 or not frames.size:
            raise ValueError(f"frames must have the shape (frames, layers, rows, cols, 3), none of them 0, got {frames.shape}")
        grid = GRID * max(1.0, float(np.hypot(*motion.body["extent"])) / 2.0)
        data, planes = encode(frames, grid)
        about = {
            **motion.body,
            "frames": len(frames), "fps": motion.fps, "pace": motion.pace, "grid": grid, "planes": planes, "title": motion.title,
            "told": motion.told,
            "mode": "replay", "target": _rounded("target", motion.target, 4), "wind": motion.wind is not None,
            "winds": _rounded("wind", motion.wind, 3), "distance": _rounded("distance", motion.distance, 4) or [],
            "tolerance": motion.tolerance,
        }  # fmt: skip
        self.html = _page(about, data)

    def save(self, path: str | os.PathLike[str]) -> Path:
        """Write the file, whole or not at all, and return its path; it must end in .html."""
        path = Path(path)
        if path.suffix.lower() != ".html":
            raise ValueError(f"path must end in .html, got {str(path)!r}")
        with tempfile.TemporaryDirectory(prefix=f".{path.stem}-", dir=path.parent) as folder:  # a rename within one file system
            partial = Path(folder) / "replay.html"
            partial.write_text(self.html, encoding="utf-8")
            partial.replace(path)
        return path

    def _repr_html_(self) -> str:
        """In a notebook: a frame of its own, so that neither disturbs the other."""
        style = "width: 100%; max-width: 900px; height: 520px; border: 0; border-radius: 10px"
        return f'<iframe style="{style}" sandbox="allow-scripts" srcdoc="{html.escape(self.html)}"></iframe>'


def encode(frames: NDArray[np.float64], grid: float) -> tuple[str, int]:
    """The frames in base64, and how many planes of bytes they take.

    Raises
    ------
    ValueError
        If a position is not finite, or too far out for the grid.
    """
    if not np.isfinite(frames).all():
        where = tuple(int(index) for index in np.argwhere(~np.isfinite(frames))[0])
        raise ValueError(f"frames must be finite, got {frames[where]} at index {where}")
    farthest = float(np.abs(frames).max())
    if farthest > LARGEST * grid:
        raise ValueError(f"frames must stay within {LARGEST * grid:g} m, got {farthest:g} m")
    small = np.rint(frames / grid).astype(np.int64)
    for axis in (0, 0, 2, 3):
        small = np.diff(small, axis=axis, prepend=0)
    unsigned = np.moveaxis((small << 1) ^ (small >> 63), -1, 0).astype(np.uint64)
    planes = max(1, (int(unsigned.max()).bit_length() + 7) // 8)
    split = np.stack([(unsigned >> (8 * plane)) & 0xFF for plane in range(planes)]).astype(np.uint8)
    return base64.b64encode(zlib.compress(split.tobytes(), 9)).decode(), planes


def _rounded(name: str, values: ArrayLike | None, digits: int) -> list[float] | None:
    if values is None:
        return None
    array = np.asarray(values, np.float64)
    if not np.isfinite(array).all():
        raise ValueError(f"{name} must be finite")
    result: list[float] = np.round(array, digits).ravel().tolist()
    return result


def _page(about: dict[str, Any], data: str) -> str:
    static = files("flag_env.viewer") / "static"
    script = "\n".join((static / f"{name}.js").read_text(encoding="utf-8").replace('"use strict";\n', "") for name in SCRIPTS)
    script = f'"use strict";\n{script}'
    if "</" in script or "<!--" in script:
        raise AssertionError("a script must not hold what ends it in HTML")
    style = (static / "style.css").read_text(encoding="utf-8")
    known = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    policy = f"default-src 'none'; script-src 'sha256-{known}'; style-src 'unsafe-inline'; img-src data:"
    described = json.dumps(about, separators=(",", ":"), allow_nan=False).replace("<", "\\u003c")
    return (
        '<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        f'<meta http-equiv="Content-Security-Policy" content="{policy}">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f'<title>{html.escape(about["title"])}</title>\n<link rel="icon" href="data:,">\n<style>\n{style}</style>\n</head>\n'
        '<body class="replay">\n<canvas id="picture" tabindex="0" aria-label="the flag"></canvas>\n'
        '<div id="modes" class="glass bar"></div><div id="told"></div><div id="message" role="status"></div>\n'
        '<div id="sign" class="glass"><canvas id="compass"></canvas><span>wind</span></div>\n'
        '<div id="legend" class="glass"></div>\n'
        '<div id="curve" class="glass" hidden><canvas id="distance" class="plot"></canvas></div>\n'
        '<div id="player" class="glass"></div>\n'
        f'<script type="application/json" id="about">{described}</script>\n'
        f'<script type="text/plain" id="data">{data}</script>\n<script>{script}</script>\n</body>\n</html>\n'
    )
