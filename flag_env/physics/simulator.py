"""Advances one copy of a scene, or many in parallel."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from copy import deepcopy
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flag_env.physics import diagnostics, validate
from flag_env.physics.bound import state_of, winds
from flag_env.physics.mast import mast_points, mast_poses
from flag_env.physics.reading import Reading
from flag_env.physics.run import Run
from flag_env.physics.scene import Scene
from flag_env.physics.stability import scaled, timestep_of
from flag_env.physics.state import State
from flag_env.physics.threads import processors


class Simulator:
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

    def __init__(self, scene: Scene, copies: int = 1, seed: int = 0, threads: int | None = None) -> None:
        if not isinstance(scene, Scene):
            raise TypeError(f"scene must be a Scene, got {scene!r}")
        self._scene = scene
        self._copies = validate.count("copies", copies)
        seed = validate.count("seed", seed, minimum=0)
        threads = validate.count("threads", processors() if threads is None else threads)
        self._timestep = timestep_of(scene)
        self._run = Run(scene, self._timestep, self._copies, seed, threads)
        self._shape = (self._copies, *scene.lattice.shape, 3)
        self._steps_taken = 0
        self._scales = (1.0, 1.0)
        self._present_winds: list[Any] | None = None
        self._amplitudes: list[NDArray[np.float64]] | None = None

    # -- what it is -------------------------------------------------------------------------------------------------------------

    @property
    def scene(self) -> Scene:
        """The scene as given."""
        return self._scene

    @property
    def copies(self) -> int:
        """Number of copies."""
        return self._copies

    @property
    def timestep(self) -> float:
        """Duration of one physics step [s]."""
        return self._timestep

    @property
    def time(self) -> float:
        """Simulated time since construction, or since the state that was set [s]."""
        return self._steps_taken * self._timestep

    @property
    def diverged(self) -> NDArray[np.bool_]:
        """Which copies have stopped at non-finite numbers, shape (copies,)."""
        return self._run.failed_at >= 0

    # -- state ------------------------------------------------------------------------------------------------------------------

    @property
    def positions(self) -> NDArray[np.float64]:
        """Positions [m], a fresh array of shape (copies, layers, rows, cols, 3)."""
        return self._run.coordinates.public(self._run.x, self._scene.lattice.rest_positions)

    @property
    def velocities(self) -> NDArray[np.float64]:
        """Velocities at the instant of the positions [m/s], a fresh array of shape (copies, layers, rows, cols, 3)."""
        if not self._run.stepped.any():
            return self._run.coordinates.public(self._run.v)
        reading = self.reading()
        self._run.step(0, reading)
        return reading.velocities

    def set_positions(self, positions: ArrayLike) -> None:
        """Place every particle [m], (layers, rows, cols, 3) for all copies or with a leading copies axis.

        Pinned particles stay where they are placed until the next `set_mast`.
        """
        self._run.place(self._run.coordinates.flat("positions", positions, self._scene.lattice.rest_positions))
        self._run.failed_at[:] = -1

    def set_velocities(self, velocities: ArrayLike) -> None:
        """Set every velocity [m/s], shaped as for `set_positions`; those of pinned particles follow from the mast's motion."""
        self._run.v[:] = self._run.coordinates.flat("velocities", velocities)
        self._run.moving = True
        self._run.stepped[:] = False
        self._run.failed_at[:] = -1

    def get_state(self) -> State:
        """Copy of everything a continuation depends on."""
        return deepcopy(self._live_state())

    def set_state(self, state: State, copies: Sequence[int] | None = None) -> None:
        """Continue from `state`, bit for bit.

        Parameters
        ----------
        state
            What `get_state` of a simulator of the same scene returned.
        copies
            Which copies to set, from those of the same number in `state`, or all from its only one; None: all, and the clock.
        """
        if not isinstance(state, State):
            raise TypeError(f"state must come from get_state(), got {state!r}")
        to = list(range(self._copies)) if copies is None else [validate.count("copies", copy, minimum=0) for copy in copies]
        if any(copy >= self._copies for copy in to):
            raise ValueError(f"copies must be numbers from 0 to {self._copies - 1}, got {to}")
        if copies is None:
            validate.number("state.time", state.time, minimum=0.0)
            scaled(self._scene, self._timestep, *state.scales)
        self._live_state().overwrite(to, state)
        self._run.moving = True
        if copies is None:
            if state.scales != self._scales:
                self.set_parameters(*state.scales)
            self._steps_taken = round(state.time / self._timestep)

    # -- controls ---------------------------------------------------------------------------------------------------------------

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
        self._run.mast[:] = points.transpose(0, 2, 1)[:, self._run.coordinates.axes]
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
            If the scene has no wind or winds in different units, or a value is not finite or of the wrong shape.
        """
        present = self._winds()
        if not present:
            raise ValueError("scene must hold a wind for set_wind, such as effects.CosineWind(); it has none")
        given = {"amplitude": amplitude, "frequency": frequency, "mean": mean}
        shapes = ((3,), (self._copies, 3))
        checked = {name: validate.array(name, value, *shapes) for name, value in given.items() if value is not None}
        for wind in present:
            for name, value in checked.items():
                getattr(wind, name)[:] = value

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

    def set_parameters(self, stiffness_scale: float = 1.0, viscosity_scale: float = 1.0) -> None:
        """Multiply the scene's own stiffness and viscosity of all links by these factors from now on.

        Raises
        ------
        ValueError
            If the timestep would exceed the changed scene's limit.
        """
        scene = scaled(self._scene, self._timestep, stiffness_scale, viscosity_scale)
        self._run.change(scene)
        self._scales = (float(stiffness_scale), float(viscosity_scale))
        self._present_winds = self._amplitudes = None

    # -- running ----------------------------------------------------------------------------------------------------------------

    def step(self, n: int = 1) -> None:
        """Take `n` physics steps.

        Raises
        ------
        Diverged
            If a copy reaches non-finite numbers. It stops, until its state is set anew; the others have taken all steps.
        """
        n = validate.count("n", n, minimum=0)
        if n == 0:
            return
        self._steps_taken += n
        if self._run.step(n, None) < self._copies and (failure := self._run.failure(n, self._steps_taken)):
            raise failure

    def reading(self) -> Reading:
        """Memory for `step_into`, which holds the positions at rest and no velocities."""
        return Reading(self._scene.lattice, self._copies)

    def step_into(self, n: int, reading: Reading, then: Callable[[int, int], Any] | None = None) -> int:
        """Take `n` >= 1 physics steps, then write positions and velocities into a reading.

        The same as `step` and a look at both properties, in one call of the machine code and without fresh memory.

        Parameters
        ----------
        n
            Number of steps.
        reading
            Memory from `reading()`.
        then
            Called as `then(first, last)` for each block of copies that is done, in the thread that has moved it.

        Returns
        -------
        int
            How many copies run on; `diverged` tells which do not. Nothing is raised for them.
        """
        if type(n) is not int or n < 1:  # what a control step asks for needs no closer look
            n = validate.count("n", n)
        if reading.shape != self._shape:
            raise ValueError(f"reading must be of shape {self._shape}, got {reading.shape}")
        self._steps_taken += n
        return self._run.step(n, reading, then)

    def advance(self, seconds: float) -> None:
        """Advance by `seconds`, rounded to whole steps."""
        self.step(round(validate.number("seconds", seconds, minimum=0.0) / self._timestep))

    # -- measurements -----------------------------------------------------------------------------------------------------------

    def energy(self) -> dict[str, NDArray[np.float64]]:
        """Energies of the free particles [J], each of shape (copies,): "kinetic" and one entry per conservative effect."""
        run = self._run
        return diagnostics.energy(self._scene.lattice, run.scene.effects, run.effects, self.positions, self.velocities)

    # -- inner ------------------------------------------------------------------------------------------------------------------

    def _live_state(self) -> State:
        """The state in the arrays that the run works on."""
        run = self._run
        return State(
            self.time, run.x, run.v, run.memory, run.mast, run.stepped, run.failed_at, run.failed_particle, self._scales,
            state_of(run.effects),
        )  # fmt: skip

    def _winds(self) -> list[Any]:
        if self._present_winds is None:
            self._present_winds = winds(self._scene.effects, self._run.effects)
        return self._present_winds

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_present_winds": None, "_amplitudes": None}
