"""How far a path is from the scene's exact one, at every instant of the first second.

The exact path stands for itself by RK4 in float64, its timestep halved and halved again. Each halving tells two things: how far
it moved the path, and how far a twin gets away whose start differs by no more than rounding: the noise, below which nothing in
this arithmetic tells two paths apart. A path is known to the larger of both. Halving ends where it no longer helps, at round-off
or, in a scene that is past its horizon within the second, at the size that round-off has grown to; where that is does not depend
on what is asked for, so that who is refused an accuracy is refused all finer ones too, and only those.

A path is compared at its own steps, since between them there is none: with an RK4 path that takes a whole number of steps to each
of them, not with an interpolated one. Two thousand instants, evenly spread, stand for all where there are more.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flag_env.physics.integrators import RK4
from flag_env.physics.limits import AUTO, max_timestep, timestep_of
from flag_env.physics.scene import Scene
from flag_env.physics.simulator import Simulator

SECOND = 1.0
"""Time over which paths are compared [s]."""

LONGEST = 0.04
"""Longest timestep of a path [s]: motion is seen 25 times a second at least."""

INSTANTS = 2000
"""Instants at which paths with more steps than that are compared."""

DISPLACED = 3
"""Displaced starts, where such are asked for."""

HALVINGS = 12
"""Most halvings of the exact path's timestep; each leaves a sixteenth of the error, and round-off ends them before."""

RESOLVED = 0.1
"""Share of an error that may be the exact path's own."""

_ROUNDING = 2.0**-52
"""By which two starts that are the same differ, relatively."""

_NOISE = 4.0
"""Multiple of the noise at which a difference is noise."""

Array = NDArray[np.float64]


class Level(NamedTuple):
    """An exact path's timestep [s], and the error to which the path is known with it [m]."""

    timestep: float
    known: float


class Exact:
    """A scene's exact path, followed as finely as is asked for.

    Parameters
    ----------
    scene
        Its integrator, dtype and timestep play no part.
    displaced
        RMS displacement of the particles in starts besides the scene's own that are followed too [m]; 0: its own alone.

    Attributes
    ----------
    starts : (starts, layers, rows, cols, 3)
        Positions to start from [m]; the first is that of a `Simulator` of seed 0.
    """

    def __init__(self, scene: Scene, displaced: float) -> None:
        self._scene = scene.replace(integrator=RK4(), dtype="float64", timestep="auto", allow_unstable=False)
        self.starts = _starts(self._scene, displaced)
        self._size = float(np.abs(self.starts).max(initial=0.0))
        self._levels: list[Level] = []
        self._moved = math.inf
        self._steps = math.ceil(SECOND / longest_step(self._scene) - 1e-9)
        self._ended = False

    def within(self, error: float) -> Level | None:
        """The coarsest level at which the path is known to this error [m]; None where there is none."""
        number = 0
        while number < len(self._levels) or not self._ended:
            if number == len(self._levels):
                self._halve()
            if self._levels[number].known <= error:
                return self._levels[number]
            number += 1
        return None

    def coarsest(self) -> Level:
        """The first level."""
        if not self._levels:
            self._halve()
        return self._levels[0]

    def best(self) -> Level:
        """The level at which the path is known best; all have been tried."""
        self.within(-1.0)
        return min(self._levels, key=lambda level: level.known)

    def distance(self, scene: Scene, timestep: float, level: Level) -> float:
        """Worst RMS distance of the scene's path from the exact one, over its steps and the starts [m].

        Parameters
        ----------
        scene
            The scene with the integrator and dtype to judge.
        timestep
            Its timestep [s].
        level
            How fine the exact path is to be at least.

        Returns
        -------
        float
            Infinite if a path diverges.
        """
        finer = max(2, math.ceil(timestep / level.timestep - 1e-9))
        steps = math.ceil(SECOND / timestep - 1e-9)
        stride = math.ceil(steps / INSTANTS)
        path = _Path(scene.replace(timestep=timestep), self.starts)
        exact = _Path(self._scene.replace(timestep=timestep / finer), self.starts)
        worst = 0.0
        for _ in range(math.ceil(steps / stride)):
            if not (path.take(stride) and exact.take(finer * stride)):
                return math.inf
            worst = max(worst, _apart(path.x, exact.x))
        return worst

    def _halve(self) -> None:
        """Add a level: half the timestep of the last."""
        coarse_step, copies = SECOND / self._steps, len(self.starts)
        coarse = _Path(self._scene.replace(timestep=coarse_step), self.starts)
        fine = _Path(self._scene.replace(timestep=coarse_step / 2), np.concatenate([self.starts, self._twins()]))
        stride = math.ceil(self._steps / INSTANTS)
        moved, noise = 0.0, _ROUNDING * self._size
        for _ in range(math.ceil(self._steps / stride)):
            if not (coarse.take(stride) and fine.take(2 * stride)):
                moved = math.inf
                break
            moved = max(moved, _apart(fine.x[:copies], coarse.x))
            noise = max(noise, _apart(fine.x[:copies], fine.x[copies:]))
        stuck = moved > self._moved / 2 and moved <= math.sqrt(self._steps) * noise  # at what the steps' rounding adds up to
        self._levels.append(Level(coarse_step / 2, max(moved, noise)))
        self._ended = moved <= _NOISE * noise or stuck or len(self._levels) > HALVINGS
        self._steps, self._moved = 2 * self._steps, moved

    def _twins(self) -> Array:
        """Starts that differ from `starts` by rounding; a coordinate in which nothing extends keeps its zeros."""
        drawn = np.random.default_rng(1).choice([-1.0, 1.0], self.starts.shape) * np.isin(range(3), self._scene.lattice.axes)
        drawn[:, self._scene.lattice.fixed.reshape(self._scene.lattice.shape)] = 0.0
        twins: Array = self.starts + _ROUNDING * np.abs(self.starts).max(axis=(0, 1, 2, 3)) * drawn
        return twins


@lru_cache(maxsize=16)
def exact_path(scene: Scene, displaced: float) -> Exact:
    """The `Exact` of a scene; the last few are kept, and what they have found with them."""
    return Exact(scene, displaced)


def longest_step(scene: Scene) -> float:
    """Longest timestep that a path may take [s]: the scene's automatic one, or 0.9 of a limit that lies far beyond it."""
    automatic, limit = timestep_of(scene.replace(timestep="auto", allow_unstable=False)), max_timestep(scene)
    beyond = math.isinf(limit) or limit > 2.0 * automatic / AUTO  # an automatic step of half the limit is what keeps energy
    return min(LONGEST, AUTO * limit if beyond else automatic)


class _Path:
    """A scene in motion from given starts."""

    def __init__(self, scene: Scene, starts: Array) -> None:
        self._simulator = Simulator(scene, copies=len(starts))
        self._simulator.set_positions(starts)
        self._frame = self._simulator.frame()
        self.x = self._frame.x

    def take(self, steps: int) -> bool:
        """Take steps and read the positions `x`, (starts, 3 particles) [m]; whether they are finite."""
        return self._simulator.step_into(steps, self._frame) == len(self.x)


def _apart(first: Array, second: Array) -> float:
    """Worst RMS distance over the starts [m]; x (starts, 3 particles)."""
    difference = first - second
    return math.sqrt(3.0 * float(np.einsum("ij,ij->i", difference, difference).max()) / difference.shape[1])


def _starts(scene: Scene, displaced: float) -> Array:
    """The scene's own start and, if any are asked for, `DISPLACED` in which free particles move by normal random numbers."""
    lattice = scene.lattice
    count = 1 + DISPLACED * (displaced > 0.0)
    drawn = np.zeros((count, lattice.size, 3))
    axes = list(lattice.axes)
    drawn[1:, :, axes] = np.random.default_rng(0).standard_normal((count - 1, lattice.size, len(axes)))
    drawn[:, lattice.fixed] = 0.0
    return Simulator(scene).positions + displaced / math.sqrt(len(axes)) * drawn.reshape(count, *lattice.shape, 3)
