"""A flag that flies while its settings change: a run, the next one being built beside it, and the last state that was good."""

from __future__ import annotations

import math
import time
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flag_env import _validate
from flag_env.physics import Diverged, Scene
from flag_env.viewer.running import PROBATION, Good, Running, build, carry, in_shape
from flag_env.viewer.settings import Settings, stage_scene

Vector = NDArray[np.float64]

SHARE = 0.8
"""Of the time between two frames, that stepping may take; beyond it the flag flies slower than asked for."""

MAST_SPEED = 1.5
"""Largest speed at which the mast follows the hand [diagonals, or radians, a second on the screen]."""

LARGEST = 1000.0
"""Distance from the origin at which a flag counts as diverged [diagonals]."""

TILT = 0.6
"""Largest tilt of the mast [rad]."""


class Flight:
    """A stage in flight.

    Parameters
    ----------
    stage
        Name in `STAGES`.

    Attributes
    ----------
    settings
        What is asked for.
    message
        What was refused or went wrong last, for the page.
    version
        Grows when another lattice, or other links, are to be drawn.
    """

    def __init__(self, stage: str = "flag") -> None:
        self.settings = Settings.of(stage)
        self.paused, self.message, self.version, self.speed = False, "", 0, 0.0
        self.running: Running | None = None
        self.pose, self._goal = np.zeros(5), np.zeros(5)
        self._good: Good | None = None
        self._owed, self._cost = 0.0, 0.0
        self._builder = ThreadPoolExecutor(1, "builder")
        self._building: Future[Running] | None = None
        self._asked: Settings | None = None
        self._fresh = True
        self._ask()

    # -- what the page asks for -------------------------------------------------------------------------------------------------

    def set(self, values: dict[str, Any]) -> None:
        """Change settings; ValueError or TypeError if they are refused, and nothing has changed."""
        self.settings = self.settings.changed(values)
        self.message = ""
        self._take_up_wind()
        self._ask()

    def stage(self, name: str) -> None:
        """Fly another scene, as it comes."""
        self.settings = Settings.of(name)
        self.message = ""
        self._restart()

    def reset(self) -> None:
        """Start again under the same settings."""
        self.message = ""
        self._restart()

    def move_mast(self, position: Any, tilt: Any) -> None:
        """Where the mast is to go; it follows at a limited speed, as far as the scene's coordinates let it."""
        goal = np.concatenate([_validate.array("position", position, (3,)), _validate.array("tilt", tilt, (2,))])
        self._goal = np.clip(goal, -self.reach(), self.reach())

    def reach(self) -> Vector:
        """How far the mast goes either way: x, y, z [m], about x, about y [rad]; zero where the scene has no coordinate."""
        lattice = self.scene.lattice
        far = [0.6 * lattice.diagonal if axis in lattice.axes else 0.0 for axis in range(3)]
        tilts = [TILT if lattice.dimensions >= least else 0.0 for least in (3, 2)]
        return np.array(far + tilts) if lattice.fixed.any() else np.zeros(5)

    @property
    def scene(self) -> Scene:
        """The scene that flies, or, before one does, the stage's own."""
        return self.running.simulator.scene if self.running else stage_scene(self.settings.stage)

    # -- the run ----------------------------------------------------------------------------------------------------------------

    def advance(self, seconds: float) -> None:
        """Let the flag fly for `seconds` on the screen; takes up what was built meanwhile."""
        self._take_up_build()
        if self.running is None or self.paused or seconds == 0.0:
            self.speed = 0.0
            return
        simulator = self.running.simulator
        waiting = self.settings.stage != self.running.settings.stage  # for another scene: this one flies on as it does
        pace = (self.running.settings if waiting else self.settings).pace
        self._owed += pace * seconds / simulator.timestep
        steps = math.floor(self._owed)
        if self._cost > 0.0:
            steps = min(steps, max(1, int(SHARE * seconds / self._cost)))
        self._owed = min(self._owed - steps, 1.0)
        self._fly(steps, seconds)
        self.speed = steps * simulator.timestep / seconds

    def step(self) -> None:
        """One timestep."""
        self._take_up_build()
        if self.running is not None:
            self._fly(1, 0.0)

    def settle(self) -> None:
        """Wait until nothing is being built, and take it up."""
        while self._building is not None:
            self._building.exception()
            self._take_up_build()

    def close(self) -> None:
        """Stop building."""
        self._builder.shutdown(cancel_futures=True)

    @property
    def building(self) -> bool:
        """Whether another run is being built."""
        return self._building is not None

    def _fly(self, steps: int, seconds: float) -> None:
        assert self.running is not None
        running, simulator = self.running, self.running.simulator
        if steps == 0:
            return
        self._move_towards_goal(seconds)
        began = time.perf_counter()
        try:
            simulator.step(steps)
        except Diverged as error:
            self._go_back(str(error))
            return
        cost = (time.perf_counter() - began) / steps
        self._cost = cost if self._cost == 0.0 else 0.8 * self._cost + 0.2 * cost
        farthest = float(np.abs(simulator.positions).max())
        if farthest > LARGEST * simulator.scene.lattice.diagonal:
            self._go_back(f"the flag diverged: a particle is {farthest:.3g} m away at t = {simulator.time:.4g} s")
            return
        running.age += seconds
        if running.age >= running.keep_at and in_shape(simulator):
            running.keep_at = running.age + PROBATION / 2
            flying = running.settings if self.settings.needs_rebuild(running.settings) else self.settings
            self._good = Good(running, flying, simulator.get_state(), self.pose.copy())

    def _move_towards_goal(self, seconds: float) -> None:
        assert self.running is not None
        if np.array_equal(self.pose, self._goal):
            return
        most = MAST_SPEED * seconds * np.array([self.scene.lattice.diagonal] * 3 + [1.0] * 2)
        self.pose = self.pose + np.clip(self._goal - self.pose, -most, most)
        self.running.simulator.set_mast(self.pose[:3], self.pose[3:])

    def _take_up_wind(self) -> None:
        breeze = self.settings.breeze()
        running = self.running.settings if self.running else None
        same = running is not None and (running.stage, running.wind_unit) == (self.settings.stage, self.settings.wind_unit)
        if self.running is not None and breeze is not None and same:
            self.running.simulator.set_wind(breeze.amplitude, breeze.frequency, breeze.mean)

    # -- building beside the flying flag ----------------------------------------------------------------------------------------

    def _restart(self) -> None:
        self._fresh = True
        self.pose, self._goal, self._good = np.zeros(5), np.zeros(5), None
        self._ask(always=True)

    def _ask(self, always: bool = False) -> None:
        """Have the newest settings built, once the builder is free; what was asked for before and not begun is forgotten."""
        flying = self.running.settings if self.running else None
        if not always and not self._fresh and flying is not None and not self.settings.needs_rebuild(flying):
            self._asked = None
            return
        self._asked = self.settings
        if self._building is None:
            self._building = self._builder.submit(build, self._asked)
            self._asked = None

    def _take_up_build(self) -> None:
        if self._building is None or not self._building.done():
            return
        done, self._building = self._building, None
        newer, self._asked = self._asked, None
        if newer is not None:
            self._building = self._builder.submit(build, newer)
        try:
            built = done.result()
        except (ValueError, TypeError, FloatingPointError) as error:
            if newer is None:
                self._refuse(str(error))
            return
        if newer is not None and newer.stage != built.settings.stage:
            return
        self._swap(built)

    def _swap(self, new: Running) -> None:
        old = self.running
        same = old is not None and not self._fresh and old.simulator.scene.lattice.shape == new.simulator.scene.lattice.shape
        if same and old is not None and old.settings.stage == new.settings.stage:
            try:
                carry(old.simulator, new.simulator, self.pose)
            except ValueError as error:  # the new run cannot go on from there
                self._refuse(str(error))
                return
        self._fresh = False
        self.running, self._owed, self._cost = new, 0.0, 0.0
        self.version += 1
        self._take_up_wind()

    def _refuse(self, message: str) -> None:
        """Say why, and go on under the settings of the flag that flies."""
        self.message = message
        if self.running is not None:
            self.settings, self._fresh = self.running.settings, False

    def _go_back(self, message: str) -> None:
        """After a divergence: the last good state under its settings, or the stage's own start."""
        self.message = f"{message}; back to the last good state"
        self._asked = None
        good = self._good
        if good is None:
            self.settings = Settings.of(self.settings.stage)
            self._restart()
            self.running = None
            return
        self.running, self.settings = good.running, good.settings
        self.running.age, self.running.keep_at = 0.0, PROBATION
        good.running.simulator.set_state(good.state)
        self.pose = good.pose.copy()
        self._goal = self.pose.copy()
        self.version += 1
