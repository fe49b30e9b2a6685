"""Advances one copy of a scene, or many in parallel.

State is kept flat, one contiguous row per coordinate: `x, v` (copies, 3, particles) in the scene's dtype. Copies are independent:
each is stepped by itself, so its bits do not depend on how many there are nor on the number of threads.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flag_env.physics import validate
from flag_env.physics.compose import compiled_run
from flag_env.physics.effects.base import Effect, Setting, Wind
from flag_env.physics.effects.cosine_wind import BoundCosineWind
from flag_env.physics.effects.springs import LinkEffect
from flag_env.physics.mast import mast_points
from flag_env.physics.scene import Scene
from flag_env.physics.stability import SceneSpectrum, max_timestep, timestep_of

_SERIAL = 20_000
"""Particle-steps below which waking threads costs more than it gains."""


class Diverged(FloatingPointError):  # noqa: N818  (a public name)
    """A simulation has reached numbers that are not finite.

    Attributes
    ----------
    time
        Simulated time at which it was seen [s], at most 50 steps after the first such number.
    copy
        The copy it happened to.
    particle
        (layer, row, col) of the first particle concerned.
    """

    def __init__(self, time: float, copy: int, particle: tuple[int, int, int]) -> None:
        super().__init__(time, copy, particle)
        self.time, self.copy, self.particle = time, copy, particle

    def __str__(self) -> str:
        return (
            f"copy {self.copy} diverged: particle (layer, row, col) = {self.particle} is not finite at t = {self.time:.6g} s; "
            "a smaller timestep or softer links may help"
        )


@dataclass(frozen=True)
class State:
    """Everything a continuation depends on, to the bit. Arrays lead with the copies."""

    time: float
    positions: NDArray[Any]
    velocities: NDArray[Any]
    memory: NDArray[Any]
    mast: NDArray[np.float64]
    stepped: NDArray[np.bool_]
    failed_at: NDArray[np.int64]
    failed_particle: NDArray[np.int64]
    scales: tuple[float, float]
    effects: tuple[tuple[NDArray[Any], ...], ...]


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
        available = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
        self._threads = min(validate.count("threads", available if threads is None else threads), self._copies)
        self._timestep = timestep_of(scene)
        self._dtype = np.dtype(scene.dtype)
        lattice = scene.lattice
        self._pinned = np.flatnonzero(lattice.fixed)
        self._inverse_mass = np.where(lattice.fixed, 0.0, 1.0 / lattice.masses).astype(self._dtype)
        self._method = scene.integrator.bind(self._dtype, self._timestep, SceneSpectrum(lattice, scene.effects))
        self._axes = list(lattice.axes)
        self._seed = seed
        self._effects = self._bind(scene.effects, {})
        self._steps_taken = 0
        start = np.tile(lattice.rest_positions.reshape(-1, 3).T, (self._copies, 1, 1))
        if scene.perturbation > 0 and lattice.dimensions == 3:
            for copy in range(self._copies):
                noise = np.random.default_rng((seed, copy)).standard_normal(lattice.size)
                start[copy, 1] += scene.perturbation * np.where(lattice.fixed, 0.0, noise)
        start = start[:, self._axes]
        self._x = np.ascontiguousarray(start, self._dtype)
        self._v = np.zeros_like(self._x)
        self._mast = start[:, :, self._pinned]
        memory_rows, work_rows = self._method.rows()
        self._memory = np.zeros((self._copies, memory_rows, *self._x.shape[1:]), self._dtype)
        self._work = np.zeros((self._threads, 2 + work_rows, 3, lattice.size), self._dtype)
        self._stepped = np.zeros(self._copies, bool)
        self._failed_at = np.full(self._copies, -1, np.int64)
        self._failed_particle = np.zeros(self._copies, np.int64)
        self._scaled, self._scales = scene, (1.0, 1.0)
        self._pool: tuple[int, ThreadPoolExecutor] | None = None

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
        return self._failed_at >= 0

    # -- state ------------------------------------------------------------------------------------------------------------------

    @property
    def positions(self) -> NDArray[np.float64]:
        """Positions [m], a fresh array of shape (copies, layers, rows, cols, 3)."""
        return self._public(self._x, self._scene.lattice.rest_positions)

    @property
    def velocities(self) -> NDArray[np.float64]:
        """Velocities at the instant of the positions [m/s], a fresh array of shape (copies, layers, rows, cols, 3)."""
        if not self._stepped.any():
            return self._public(self._v)
        synchronous = np.empty_like(self._v)
        self._run(0, synchronous)
        synchronous[~self._stepped] = self._v[~self._stepped]
        synchronous[:, :, self._pinned] = self._v[:, :, self._pinned]
        return self._public(synchronous)

    def set_positions(self, positions: ArrayLike) -> None:
        """Place every particle [m], (layers, rows, cols, 3) for all copies or with a leading copies axis.

        Pinned particles stay where they are placed until the next `set_mast`.
        """
        value = self._flat("positions", positions, self._scene.lattice.rest_positions)
        self._x[:] = value
        self._mast[:] = value[:, :, self._pinned]
        self._failed_at[:] = -1

    def set_velocities(self, velocities: ArrayLike) -> None:
        """Set every velocity [m/s], shaped as for `set_positions`; those of pinned particles follow from the mast's motion."""
        self._v[:] = self._flat("velocities", velocities)
        self._stepped[:] = False
        self._failed_at[:] = -1

    def get_state(self) -> State:
        """Copy of everything a continuation depends on."""
        return State(
            self.time,
            self._x.copy(),
            self._v.copy(),
            self._memory.copy(),
            self._mast.copy(),
            self._stepped.copy(),
            self._failed_at.copy(),
            self._failed_particle.copy(),
            self._scales,
            tuple(tuple(array.copy() for array in arrays) for arrays in self._effect_state()),
        )

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
        count = len(state.positions)
        if state.positions.shape[1:] != self._x.shape[1:] or count not in (1, self._copies):
            raise ValueError(f"state must have positions of shape {self._x.shape}, got {state.positions.shape}")
        if state.positions.dtype != self._dtype or len(state.effects) != len(self._effects):
            raise ValueError("state must come from a simulator of the same scene (effects and dtype)")
        to = list(range(self._copies)) if copies is None else [validate.count("copies", copy, minimum=0) for copy in copies]
        if any(copy >= self._copies for copy in to):
            raise ValueError(f"copies must be numbers from 0 to {self._copies - 1}, got {to}")
        source = to if count == self._copies else [0] * len(to)
        pairs = [
            (self._x, state.positions),
            (self._v, state.velocities),
            (self._memory, state.memory),
            (self._mast, state.mast),
            (self._stepped, state.stepped),
        ]
        pairs += [(self._failed_at, state.failed_at), (self._failed_particle, state.failed_particle)]
        mine_too = [array for arrays in self._effect_state() for array in arrays]
        theirs_too = [array for arrays in state.effects for array in arrays]
        pairs += zip(mine_too, theirs_too, strict=False)
        if len(mine_too) != len(theirs_too) or any(mine.shape[1:] != theirs.shape[1:] for mine, theirs in pairs):
            raise ValueError("state must come from a simulator of the same scene (pinned particles and effects)")
        for mine, theirs in pairs:
            mine[to] = theirs[source]
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
        """
        n = self._copies
        position = np.broadcast_to(validate.array("position", position, (3,), (n, 3)), (n, 3))
        tilt = np.broadcast_to(validate.array("tilt", tilt, (2,), (n, 2)), (n, 2))
        yaw = np.broadcast_to(validate.array("yaw", yaw, (), (n,)), (n,))
        rest = self._scene.lattice.rest_positions.reshape(-1, 3)[self._pinned]
        self._mast[:] = mast_points(rest, position, tilt, yaw).transpose(0, 2, 1)[:, self._axes]

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
        winds = [bound for effect, bound in zip(self._scene.effects, self._effects, strict=True) if isinstance(effect, Wind)]
        if not winds:
            raise ValueError("scene must hold a wind for set_wind, such as effects.CosineWind(); it has none")
        units = sorted({effect.unit for effect in self._scene.effects if isinstance(effect, Wind)})
        if len(units) > 1:
            raise ValueError(
                f"scene must hold winds in one unit for set_wind, got winds in {' and '.join(units)}; take one out, as in "
                "scene.without(effects.CosineWind)"
            )
        given = {"amplitude": amplitude, "frequency": frequency, "mean": mean}
        shapes = ((3,), (self._copies, 3))
        checked = {name: validate.array(name, value, *shapes) for name, value in given.items() if value is not None}
        for wind in winds:
            for name, value in checked.items():
                getattr(wind, name)[:] = value

    def wind_force(self) -> NDArray[np.float64] | None:
        """Wind force on every free particle now [N], shape (copies, 3); None in a scene without wind."""
        winds = [bound for bound in self._effects if isinstance(bound, BoundCosineWind)]
        if not winds:
            return None
        return sum(wind.mean + wind.amplitude * np.cos(wind.phase) for wind in winds)  # type: ignore[return-value]

    def set_parameters(self, stiffness_scale: float = 1.0, viscosity_scale: float = 1.0) -> None:
        """Multiply the scene's own stiffness and viscosity of all links by these factors from now on.

        Raises
        ------
        ValueError
            If the timestep would exceed the changed scene's limit.
        """
        scene = self._scene.scaled(stiffness_scale, viscosity_scale)
        limit = max_timestep(scene)
        if self._timestep > limit and not scene.allow_unstable:
            raise ValueError(
                f"stiffness_scale = {stiffness_scale:g} and viscosity_scale = {viscosity_scale:g} must keep the step limit above "
                f"the timestep of {self._timestep:.6g} s; they lower it to {limit:.6g} s"
            )
        kept = dict(zip((type(effect) for effect in self._scene.effects), self._effects, strict=True))
        changed = {type(old) for effect, old in zip(scene.effects, self._current_effects, strict=True) if effect != old}
        rebound = self._bind(scene.effects, {kind: bound for kind, bound in kept.items() if kind not in changed})
        self._effects = tuple(
            bound._replace(weight=kept[type(effect)].weight) if isinstance(effect, LinkEffect) else bound  # broken links stay so
            for effect, bound in zip(scene.effects, rebound, strict=True)
        )
        self._method = scene.integrator.bind(self._dtype, self._timestep, SceneSpectrum(scene.lattice, scene.effects))
        self._scaled, self._scales = scene, (float(stiffness_scale), float(viscosity_scale))

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
        before = self._failed_at >= 0
        self._v[:, :, self._pinned] = (self._mast.astype(self._dtype) - self._x[:, :, self._pinned]) / (n * self._timestep)
        self._run(n, None)
        moved = self._failed_at < 0
        self._x[np.ix_(moved, np.arange(len(self._axes)), self._pinned)] = self._mast[moved]
        self._stepped[:] = True
        self._steps_taken += n
        new = np.flatnonzero((self._failed_at >= 0) & ~before)
        if len(new) or before.all():
            copy = int(new[0]) if len(new) else 0
            late = n - int(self._failed_at[copy]) if len(new) else 0
            particle = np.unravel_index(self._failed_particle[copy], self._scene.lattice.shape)
            raise Diverged(self.time - late * self._timestep, copy, tuple(int(i) for i in particle))  # type: ignore[arg-type]

    def advance(self, seconds: float) -> None:
        """Advance by `seconds`, rounded to whole steps."""
        self.step(round(validate.number("seconds", seconds, minimum=0.0) / self._timestep))

    # -- measurements -----------------------------------------------------------------------------------------------------------

    def energy(self) -> dict[str, NDArray[np.float64]]:
        """Energies of the free particles [J], each of shape (copies,): "kinetic" and one entry per conservative effect."""
        lattice = self._scene.lattice
        positions = self.positions.reshape(self._copies, -1, 3)
        velocities = self.velocities.reshape(self._copies, -1, 3)
        masses = np.where(lattice.fixed, 0.0, lattice.masses)
        result = {"kinetic": 0.5 * (velocities**2).sum(axis=-1) @ masses}
        for effect, bound in zip(self._current_effects, self._effects, strict=True):
            if isinstance(effect, LinkEffect):
                energy = effect.energy(lattice, positions, bound.weight != 0)  # links may have broken
            else:
                energy = effect.energy(lattice, positions)
            if energy is not None:
                result[_snake(type(effect).__name__)] = energy
        return result

    # -- inner ------------------------------------------------------------------------------------------------------------------

    @property
    def _current_effects(self) -> tuple[Any, ...]:
        return self._scaled.effects

    def _bind(self, effects: tuple[Effect, ...], kept: dict[type[Effect], Any]) -> tuple[Any, ...]:
        """Bound effects in the scene's order, those of `kept` as they are."""
        bound = dict(kept)
        for effect in sorted(effects, key=lambda effect: effect.binds_last):
            if type(effect) not in bound:
                setting = Setting(self._scene.lattice, self._dtype, self._copies, self._timestep, self._seed, bound)
                bound[type(effect)] = effect.bind(setting)
        return tuple(bound[type(effect)] for effect in effects)

    def _effect_state(self) -> list[tuple[NDArray[Any], ...]]:
        return [
            tuple(getattr(bound, name) for name in (bound.state() if hasattr(bound, "state") else ())) for bound in self._effects
        ]

    def _run(self, steps: int, velocities: NDArray[Any] | None) -> None:
        """Step all copies, or, with an array to write to, only read the velocities at the instant of the positions."""
        run = compiled_run(self._method, self._effects)
        read = velocities is not None
        out = self._v if velocities is None else velocities
        work = self._copies * self._scene.lattice.size * (steps or 1)
        threads = 1 if work < _SERIAL else self._threads
        bounds = np.linspace(0, self._copies, threads + 1).astype(int)

        def share(thread: int) -> None:
            f, scratch, work_arrays = self._work[thread, 0, : len(self._axes)], self._work[thread, 1], self._work[thread, 2:]
            first, last = int(bounds[thread]), int(bounds[thread + 1])
            run(
                self._method, self._effects, self._x, self._v, self._memory, f, scratch, work_arrays, self._inverse_mass,
                steps, first, last, self._stepped, self._failed_at, self._failed_particle, read, out,
            )  # fmt: skip

        if threads == 1:
            share(0)
        else:
            list(self._executor().map(share, range(threads)))

    def _executor(self) -> ThreadPoolExecutor:
        """Threads of this process: a pool that was made before a fork does not exist in the child."""
        if self._pool is None or self._pool[0] != os.getpid():
            self._pool = os.getpid(), ThreadPoolExecutor(self._threads, thread_name_prefix="flag_env")
        return self._pool[1]

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_pool": None}

    def _public(self, flat: NDArray[Any], rest: NDArray[np.float64] | None = None) -> NDArray[np.float64]:
        """Three coordinates of every particle; those that the scene does not hold are zero, or the `rest` positions'."""
        shape = (self._copies, *self._scene.lattice.shape, 3)
        if len(self._axes) == 3:
            return np.array(flat.transpose(0, 2, 1), dtype=np.float64, order="C").reshape(shape)
        ordered = np.zeros(shape) if rest is None else np.tile(rest, (self._copies, 1, 1, 1, 1))
        ordered.reshape(self._copies, -1, 3)[:, :, self._axes] = flat.transpose(0, 2, 1)
        return ordered

    def _flat(self, name: str, value: ArrayLike, rest: NDArray[np.float64] | float = 0.0) -> NDArray[np.float64]:
        shape = (*self._scene.lattice.shape, 3)
        checked = validate.array(name, value, shape, (self._copies, *shape))
        if (largest := np.abs(checked).max()) > np.finfo(self._dtype).max:
            raise ValueError(f"{name} must fit the scene's {self._dtype}, got a magnitude of {largest:g}")
        absent = [axis for axis in range(3) if axis not in self._axes]
        if absent and (checked - rest)[..., absent].any():
            names = " and ".join("xyz"[axis] for axis in absent)
            raise ValueError(f"{name} must keep {names} as at rest: the scene has dimensions={len(self._axes)}")
        flat = checked.reshape(-1, self._scene.lattice.size, 3).transpose(0, 2, 1)[:, self._axes]
        return np.broadcast_to(flat, self._x.shape)


def _snake(name: str) -> str:
    return "".join(f"_{c.lower()}" if c.isupper() and i else c.lower() for i, c in enumerate(name))
