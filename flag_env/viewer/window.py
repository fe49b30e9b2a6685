"""The live page of an environment that runs elsewhere: what `render_mode="human"` opens."""

from __future__ import annotations

import sys
import threading
import time
from typing import Any

import numpy as np

from flag_env.physics import Scene
from flag_env.render import Snapshot
from flag_env.viewer.body import body
from flag_env.viewer.host import Background, open_browser
from flag_env.viewer.wire import pack


class Window:
    """Shows snapshots of one flag, as they come, in a browser; an environment calls `show` once a step.

    Parameters
    ----------
    scene
        What is simulated.
    fps
        Snapshots a second: `show` waits until the next is due.
    title
        Of the page.
    length
        Steps of an episode.

    Raises
    ------
    ImportError
        If the extra "play" is not installed.
    """

    def __init__(self, scene: Scene, fps: float, title: str, length: int) -> None:
        self._body, self._fps, self._length = body(scene), fps, length
        self._lock = threading.Lock()
        self._shot: Snapshot | None = None
        self._distance: list[float] = []
        self._terms: dict[str, list[float]] = {}
        self._number, self._target, self._version, self._due, self._title = 0, b"", 0, 0.0, title
        self._server = Background(self)
        self.address = self._server.address
        if not open_browser(self.address):
            port = self.address.rstrip("/").rpartition(":")[2]
            sys.stderr.write(
                f"flag_env: no browser could be opened here; open {self.address} in one, from another machine through "
                f"ssh -L {port}:127.0.0.1:{port} THIS_MACHINE\n"
            )

    # -- the environment's side -------------------------------------------------------------------------------------------------

    def show(self, snapshot: Snapshot, terms: dict[str, float] | None) -> None:
        """The next picture, with the rewards of its step; None begins an episode. Waits until it is due."""
        with self._lock:
            self._shot = snapshot
            if terms is None:
                self._distance, self._terms = [], {}
            if snapshot.distance is not None:
                self._distance.append(round(snapshot.distance, 5))
            for name, value in (terms or {}).items():
                self._terms.setdefault(name, []).append(round(float(value), 5))
            target = b"" if snapshot.target is None else snapshot.target.tobytes()
            if target != self._target:
                self._target, self._version = target, self._version + 1
        now = time.perf_counter()
        time.sleep(max(0.0, min(self._due - now, 1.0 / self._fps)))
        self._due = max(now, self._due) + 1.0 / self._fps

    def close(self) -> None:
        """Close the page's connection."""
        self._server.close()

    # -- the server's side ------------------------------------------------------------------------------------------------------

    @property
    def version(self) -> int:
        """Grows with every target."""
        return self._version

    def handle(self, text: str | bytes) -> str:
        """A page only looks."""
        del text
        return "this page shows an environment that runs elsewhere; it takes no orders"

    def advance(self, seconds: float) -> bytes:
        """The newest picture."""
        del seconds
        with self._lock:
            shot, version = self._shot, self._version
        self._number += 1
        if shot is None:
            return pack(version, self._number, 0.0, np.zeros((*self._body["shape"], 3)))
        wind = None if shot.wind is None else shot.wind / shot.wind_scale
        return pack(version, self._number, 0.0, shot.positions, wind, -1.0 if shot.distance is None else shot.distance)

    def describe(self) -> dict[str, Any]:
        """The scene and the target of now."""
        with self._lock:
            shot, version = self._shot, self._version
        target = None if shot is None or shot.target is None else np.round(shot.target, 4).ravel().tolist()
        watch = {"control": "", "level": "", "driver": self._title, "size": 0}
        fixed = {"mode": "watch", "only": "watch", "fixed": True, "watch": watch, "drivers": [], "controls": [], "levels": []}
        wind = shot is not None and shot.wind is not None
        return {"type": "scene", "version": version, **self._body, **fixed, "stages": {}, "target": target, "wind": wind}

    def status(self) -> dict[str, Any]:
        """Distance and rewards of the episode so far."""
        with self._lock:
            distance, terms, shot = list(self._distance), {name: list(values) for name, values in self._terms.items()}, self._shot
        total = sum(sum(values) for values in terms.values())
        episode = {
            "driver": self._title, "target": "", "targets": 0, "steps": max(0, len(distance) - 1), "length": self._length,
            "tolerance": (shot and shot.tolerance) or 0.05, "action": [], "distance": distance, "terms": terms,
            "total": round(total, 3), "success": bool(shot and shot.success), "reference": None,
        }  # fmt: skip
        return {"type": "status", "paused": False, "message": "", "mode": "watch", "episode": episode}
