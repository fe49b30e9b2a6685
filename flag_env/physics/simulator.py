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
from flag_env.physics.effects import Effect
from flag_env.physics.effects.links import intact_cells
from flag_env.physics.limits import scaled, timestep_of
from flag_env.physics.runtime import Frame, Run, State, mast_points, mast_poses, processors, state_of, winds
from flag_env.physics.scene import Scene


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
        self._copies = _validate.count("copies", copies)
        seed = _validate.count("seed", seed, minimum=0, maximum=math.inf)
        threads = _validate.count("threads", processors() if threads is None else threads)
        self._timestep = timestep_of(scene)
        self._run = Run(scene, self._timestep, self._copies, seed, threads)
        self._shape = (self._copies, *scene.lattice.shape, 3)
        self._steps_taken = 0
        self._remainder = 0.0
        self._scales = (1.0, 1.0)
        self._present_winds: list[Any] | None = None
        self._amplitudes: list[NDArray[np.float64]] | None = None
        self._may_miss = any(hasattr(data, "missed") for data in self._run.effects)

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
        """Simulated time since construction, or since the state that was set [s]; whole steps."""
        return self._steps_taken * self._timestep

    @property
    def scales(self) -> tuple[float, float]:
        """Factors on stiffness and viscosity of all links now; see `set_parameters`."""
        return self._scales

    @property
    def turbulent(self) -> bool:
        """Whether the scene holds turbulence, which `reseed` starts anew."""
        return bool(self._turbulent())

    @property
    def diverged(self) -> NDArray[np.bool_]:
        """Which copies have stopped at non-finite numbers, shape (copies,)."""
        return self._run.failed_at >= 0

    @property
    def run(self) -> Run:
        """The arrays that the compiled step works on: for studies and tests; what they hold may change with any version."""
        return self._run

    @property
    def strain_limit_misses(self) -> NDArray[np.int64]:
        """Number of steps, since construction, after which links were longer than `StrainLimit` allows, shape (copies,)."""
        counts = [data.missed for data in self._run.effects if hasattr(data, "missed")]
        return counts[0].copy() if counts else np.zeros(self._copies, np.int64)

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
        frame = self.frame()
        self._run.step(0, frame)
        return frame.velocities

    def set_positions(self, positions: ArrayLike) -> None:
        """Place every particle [m], (layers, rows, cols, 3) for all copies or with a leading copies axis.

        Pinned particles stay where they are placed until the next `set_mast`. A copy that has diverged runs on once all its
        numbers are finite: its velocities, too, must be set where they are not.
        """
        self._run.place(self._run.coordinates.flat("positions", positions, self._scene.lattice.rest_positions))
        self._revive()

    def set_velocities(self, velocities: ArrayLike) -> None:
        """Set every velocity [m/s], shaped as for `set_positions`; those of pinned particles follow from the mast's motion.

        A copy that has diverged runs on once all its numbers are finite: its positions, too, must be set where they are not.
        """
        self._run.v[:] = self._run.coordinates.flat("velocities", velocities)
        self._run.history[:] = 0  # as in a fresh run: the first step makes it anew
        self._run.moving = True
        self._run.stepped[:] = False
        self._revive()

    def get_state(self) -> State:
        """Copy of everything a continuation depends on."""
        return self._live_state().copied()

    def set_state(self, state: State, copies: Sequence[int] | None = None) -> None:
        """Continue from `state`, bit for bit.

        Parameters
        ----------
        state
            What `get_state` of a simulator of the same scene and timestep returned.
        copies
            Which copies to set, from those of the same number in `state`, or all from its only one; None: all, with the clock
            and the factors of `set_parameters`.

        Raises
        ------
        TypeError, ValueError
            If the state belongs to another lattice, effect, integrator, dtype or timestep, or to other factors where only some
            copies are set, or is not finite; if `copies` are not numbers of copies. Nothing has changed then.
        """
        if not isinstance(state, State):
            raise TypeError(f"state must come from get_state(), got {state!r}")
        to = list(range(self._copies)) if copies is None else self._numbers(copies)
        if copies is None:
            _validate.number("state.time", state.time, minimum=0.0)
            _validate.number("state.remainder", state.remainder, minimum=-self._timestep, maximum=self._timestep)
            scaled(self._scene, self._timestep, *state.scales)
        elif state.scales != self._scales:
            raise ValueError(
                "state must come from a simulator of the same stiffness_scale and viscosity_scale, "
                f"{self._scales}, to set some copies, got {state.scales}"
            )
        self._live_state().overwrite(to, state)
        self._run.moving = True
        if copies is None:
            if state.scales != self._scales:
                self.set_parameters(*state.scales)
            self._steps_taken, self._remainder = round(state.time / self._timestep), float(state.remainder)

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

    def set_parameters(self, stiffness_scale: float = 1.0, viscosity_scale: float = 1.0) -> None:
        """Multiply the scene's own stiffness and viscosity of all links by these factors from now on.

        Raises
        ------
        ValueError
            If the timestep would exceed the changed scene's limit.
        """
        stiffness_scale = _validate.number("stiffness_scale", stiffness_scale, minimum=0.0)
        viscosity_scale = _validate.number("viscosity_scale", viscosity_scale, minimum=0.0)
        scene = scaled(self._scene, self._timestep, stiffness_scale, viscosity_scale)
        self._run.change(scene)
        self._scales = (stiffness_scale, viscosity_scale)
        self._present_winds = self._amplitudes = None

    # -- running ----------------------------------------------------------------------------------------------------------------

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

    def frame(self) -> Frame:
        """Memory for `step_into`, which holds the positions at rest and no velocities."""
        return Frame(self._scene.lattice, self._copies)

    def step_into(self, n: int, frame: Frame, then: Callable[[int, int], Any] | None = None) -> int:
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

    # -- measurements -----------------------------------------------------------------------------------------------------------

    def energy(self) -> dict[str, NDArray[np.float64]]:
        """Energies of the free particles [J], each of shape (copies,): "kinetic" and one entry per conservative effect."""
        run = self._run
        return diagnostics.energy(self._scene.lattice, run.scene.effects, run.effects, self.positions, self.velocities)

    def intact_cells(self) -> NDArray[np.bool_]:
        """Which cells of the cloth have no torn side, shape (copies, layers, rows - 1, cols - 1); all, where nothing tears."""
        return intact_cells(self._scene.lattice, self._run.links, self._copies)

    # -- inner ------------------------------------------------------------------------------------------------------------------

    def _live_state(self) -> State:
        """The state in the arrays that the run works on."""
        run = self._run
        return State(
            self._scene, self._timestep, self.time, self._remainder, run.x, run.v, run.history, run.mast_targets,
            run.stepped, run.failed_at, run.failed_particle, self._scales, state_of(run.effects),
        )  # fmt: skip

    def _revive(self) -> None:
        """Let copies that have stopped run on if all their numbers are finite."""
        if (self._run.failed_at >= 0).any():
            self._run.failed_at[self._live_state().finite()] = -1

    def _numbers(self, copies: Sequence[int]) -> list[int]:
        """The numbers of copies as a list; raise unless they are."""
        numbers = _validate.counts("copies", copies, minimum=0)
        if any(copy >= self._copies for copy in numbers):
            raise ValueError(f"copies must be numbers from 0 to {self._copies - 1}, got {numbers}")
        return numbers

    def _turbulent(self) -> list[Any]:
        """The effects with random numbers."""
        return [run for run in self._run.effects if hasattr(run, "reseed")]

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

    def _winds(self) -> list[Any]:
        if self._present_winds is None:
            self._present_winds = winds(self._scene.effects, self._run.effects)
        return self._present_winds

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_present_winds": None, "_amplitudes": None}
