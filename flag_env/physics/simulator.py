"""Advances one copy of a scene, or many in parallel."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flag_env import _validate
from flag_env.physics import diagnostics
from flag_env.physics.copies import Copies
from flag_env.physics.effects import Effect
from flag_env.physics.effects.links import intact_cells
from flag_env.physics.runtime import Frame, mast_points, mast_poses


class Simulator(Copies):
    """One or many copies of a scene in motion.

    Parameters
    ----------
    scene
        What to simulate.
    copies
        Number of independent flags, stepped in parallel.
    seed
        Seed of the start perturbation and of random effects; copy i draws from the stream (seed, i).
    threads
        Threads to use; None: as many as there are processors, at most one per copy. Results do not depend on it.

    Raises
    ------
    ValueError
        If the scene's timestep is above its limit (named) and the scene does not allow that, or an argument is out of range.
    """

    # -- controls ----------------------------------------------------------------------------------------------------------------

    def reseed(self, copies: Sequence[int], seeds: Sequence[int]) -> None:
        """Let the turbulence of these copies start anew, each from its seed, as if it had blown for ever.

        A copy then has the turbulence of copy 0 of a fresh simulator with that seed, wherever it stands among others.

        Parameters
        ----------
        copies
            Numbers of copies.
        seeds
            One seed >= 0 for each of them.

        Raises
        ------
        TypeError, ValueError
            If the scene has no turbulence, or `copies` or `seeds` are not as told. Nothing has changed then.
        """
        turbulent = self._turbulent()
        if not turbulent:
            raise ValueError("scene must hold turbulence for reseed, such as effects.Gusts(); it has none")
        numbers, given = self._numbers(copies), _validate.counts("seeds", seeds, minimum=0, maximum=math.inf)
        if len(given) != len(numbers):
            raise ValueError(f"seeds must be one for each of {len(numbers)} copies, got {len(given)}")
        self._run.past.forget()
        for copy, seed in zip(numbers, given, strict=True):
            for run in turbulent:
                run.reseed(copy, seed)

    def set_mast(self, position: ArrayLike = (0.0, 0.0, 0.0), tilt: ArrayLike = (0.0, 0.0), yaw: ArrayLike = 0.0) -> None:
        """Say where the pinned particles are to be at the end of the next step or advance call; they move there evenly.

        Parameters
        ----------
        position : (3,) or (copies, 3)
            Displacement of the mast's foot, which stands at the origin at rest [m].
        tilt : (2,) or (copies, 2)
            Angles about the world's x and then y axis through the foot [rad].
        yaw : scalar or (copies,)
            Angle about the mast's own axis, applied first [rad].

        Raises
        ------
        ValueError
            If a value is not finite or of the wrong shape, or takes the mast out of the coordinates that the scene has.
        """
        lattice = self._scene.lattice
        rest = lattice.rest_positions.reshape(-1, 3)[lattice.fixed]
        points = mast_points(rest, *mast_poses(self._copies, position, tilt, yaw))
        self._run.coordinates.check("position, tilt and yaw", points, rest)
        self._run.mast_targets[:] = points.transpose(0, 2, 1)[:, self._run.coordinates.axes]
        self._run.moving = True

    def set_wind(
        self, amplitude: ArrayLike | None = None, frequency: ArrayLike | None = None, mean: ArrayLike | None = None
    ) -> None:
        """Change the wind from now on; what is None stays as it is, and the phase goes on without a jump.

        Parameters
        ----------
        amplitude, mean : (3,) or (copies, 3)
            Force on every free particle [N], or velocity of the air [m/s], as the scene's wind has it.
        frequency : (3,) or (copies, 3)
            [rad/s].

        Raises
        ------
        ValueError
            If the scene has no wind or winds in different units, or a value is not finite, of the wrong shape, or above the
            `max_speed` of an `AirPressure`; nothing has changed then.
        """
        present = self._winds()
        if not present:
            raise ValueError("scene must hold a wind for set_wind, such as effects.CosineWind(); it has none")
        given = {"amplitude": amplitude, "frequency": frequency, "mean": mean}
        shapes = ((3,), (self._copies, 3))
        checked = {name: _validate.array(name, value, *shapes) for name, value in given.items() if value is not None}
        for effect, wind in zip((effect for effect in self._scene.effects if effect.wind_unit), present, strict=True):
            effect.check_wind(checked.get("mean", wind.mean), checked.get("amplitude", wind.amplitude))
        self._run.past.forget()
        for wind in present:
            for name, value in checked.items():
                getattr(wind, name)[:] = value

    def set_input(self, kind: type[Effect], field: str, value: ArrayLike, name: str | None = None) -> None:
        """Change what an effect acts by from now on, such as the point of an `Attachment`.

        Parameters
        ----------
        kind
            The effect's class.
        field
            One of the inputs that its data names.
        value : as the field for each copy, or without the copies axis for all
        name
            The effect's name, where it has one.

        Raises
        ------
        ValueError
            If the scene has no such effect, the effect no such input, or the value is not finite or of the wrong shape.
        """
        found = [data for effect, data in zip(self._scene.effects, self._run.effects, strict=True) if effect.key == (kind, name)]
        if not found:
            present = ", ".join(effect.label for effect in self._scene.effects) or "none"
            raise ValueError(
                f"kind and name must be those of an effect of the scene, got {kind!r} and {name!r}; it has {present}"
            )
        (data,) = found
        inputs = data.inputs() if hasattr(data, "inputs") else ()
        if field not in inputs:
            raise ValueError(f"field must be one of the inputs of {kind.__name__}, {inputs}, got {field!r}")
        array = getattr(data, field)
        self._run.past.forget()
        array[:] = _validate.array(field, value, array.shape[1:], array.shape)

    @property
    def wind_amplitudes(self) -> list[NDArray[np.float64]]:
        """Amplitudes of each wind of the scene, (copies, 3): to write into is to `set_wind`, without a look at the numbers."""
        if self._amplitudes is None:
            self._amplitudes = [wind.amplitude for wind in self._winds()]
        return self._amplitudes

    def wind(self) -> NDArray[np.float64] | None:
        """Mean and swinging part of the wind now, shape (copies, 3), in its unit as for `set_wind`; None in a scene without."""
        present = self._winds()
        return sum(wind.mean + wind.amplitude * np.cos(wind.phase) for wind in present) if present else None

    # -- running -----------------------------------------------------------------------------------------------------------------

    def step(self, n: int = 1) -> None:
        """Take `n` physics steps.

        Raises
        ------
        Diverged
            If a copy reaches non-finite numbers. It stops, until its state is set anew; the others have taken all steps.
        """
        n = _validate.count("n", n, minimum=0)
        if n == 0:
            return
        self._steps_taken += n
        running = self._run.step(n, None)
        self._warn_of_misses()
        if running < self._copies and (failure := self._run.failure(n, self._steps_taken)):
            raise failure

    def step_into(self, n: int, frame: Frame, then: Callable[[int, int], Any] | None = None) -> int:
        """Take `n` >= 1 physics steps, then write positions and velocities into a frame.

        The same as `step` and a look at both properties, in one call of the machine code and without fresh memory.

        Parameters
        ----------
        n
            Number of steps.
        frame
            Memory from `frame()`.
        then
            Called as `then(first, last)` for each block of copies that is done, in the thread that has moved it.

        Returns
        -------
        int
            How many copies run on; `diverged` tells which do not. Nothing is raised for them.
        """
        if type(n) is not int or n < 1:  # what a control step asks for needs no closer look
            n = _validate.count("n", n)
        if frame.shape != self._shape:
            raise ValueError(f"frame must be of shape {self._shape}, got {frame.shape}")
        self._steps_taken += n
        running = self._run.step(n, frame, then)
        self._warn_of_misses()
        return running

    def advance(self, seconds: float) -> None:
        """Advance by `seconds` in whole steps: what is left over, at most half a step either way, counts in the next call.

        However many calls: `time` is within half a step of the sum of what was asked for, plus the steps of `step`.

        Raises
        ------
        Diverged
            See `step`.
        """
        due = self._remainder + _validate.number("seconds", seconds, minimum=0.0)
        steps = max(round(due / self._timestep), 0)  # a remainder of minus half a step may round to one step less than none
        self._remainder = due - steps * self._timestep
        self.step(steps)

    # -- measurements ------------------------------------------------------------------------------------------------------------

    def energy(self) -> dict[str, NDArray[np.float64]]:
        """Energies of the free particles [J], each of shape (copies,): "kinetic" and one entry per conservative effect."""
        run = self._run
        return diagnostics.energy(self._scene.lattice, run.scene.effects, run.effects, self.positions, self.velocities)

    def intact_cells(self) -> NDArray[np.bool_]:
        """Which cells of the cloth have no torn side, shape (copies, layers, rows - 1, cols - 1); all, where nothing tears."""
        return intact_cells(self._scene.lattice, self._run.links, self._copies)

    def _warn_of_misses(self) -> None:
        """Warn, once, of a strain limit that does not hold."""
        if self._may_miss and (misses := self.strain_limit_misses).any():
            self._may_miss = False
            copy = int(np.argmax(misses))
            warnings.warn(
                f"StrainLimit does not hold: {misses[copy]} steps have left links of copy {copy} longer. More iterations may "
                "help, if the mast lets it hold at all; Simulator.strain_limit_misses goes on counting",
                RuntimeWarning,
                stacklevel=3,
            )
