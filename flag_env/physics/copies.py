"""Copies of a scene: what they are, and the state that is read and set."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flag_env import _validate
from flag_env.physics.limits import scaled, timestep_of
from flag_env.physics.runtime import Frame, Run, State, processors, state_of, winds
from flag_env.physics.scene import Scene


class Copies:
    """One or many copies of a scene that nothing moves yet; `Simulator` says what the arguments are."""

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

    # -- what they are -----------------------------------------------------------------------------------------------------------

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

    # -- state -------------------------------------------------------------------------------------------------------------------

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

    def frame(self) -> Frame:
        """Memory for `Simulator.step_into`, which holds the positions at rest and no velocities."""
        return Frame(self._scene.lattice, self._copies)

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
            if state.scales != self._scales:  # its own are known to be stable
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

    # -- inner -------------------------------------------------------------------------------------------------------------------

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

    def _winds(self) -> list[Any]:
        if self._present_winds is None:
            self._present_winds = winds(self._scene.effects, self._run.effects)
        return self._present_winds

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_present_winds": None, "_amplitudes": None}
