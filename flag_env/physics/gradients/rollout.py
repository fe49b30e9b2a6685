"""A run of a scene as a differentiable function of what moves it, of its start and of what it is made of."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flag_env import _validate
from flag_env.physics.compiling import compiled_back, compiled_record, entry_point
from flag_env.physics.gradients.legs import Plan, plan, steps_of
from flag_env.physics.gradients.masts import points_of, poses_back
from flag_env.physics.gradients.parameters import MASS, mass_parameters, parameters_of, refuse_without_way_back
from flag_env.physics.runtime import Diverged, State, Threads, padded_row, processors, state_of, zeros
from flag_env.physics.scene import Scene
from flag_env.physics.simulator import Simulator

Array = NDArray[np.float64]

_SERIAL_BELOW = 20_000
"""Particle-steps below which waking threads costs more than it gains."""


@dataclass(frozen=True)
class Gradient:
    """Derivatives of a loss L, float64.

    Attributes
    ----------
    wind : (actions, copies, 3) or None
        With respect to the wind's amplitudes as given [1/N]; None where none were given.
    mast : (actions, copies, 5 or 6) or None
        With respect to the mast's poses as given [1/m, 1/rad].
    positions, velocities : (copies, layers, rows, cols, 3)
        With respect to those of the start [1/m, s/m]. Of pinned particles: a mast that is given no poses stands where its
        particles are placed; their velocities follow from its motion, and count for nothing. Where the start is in mid-motion
        the method's own velocities count, those it remembers changing with them.
    parameters
        With respect to those asked for: "Structural.stiffness" of every link, "Gravity.acceleration", "AirDrag.rate" and so on,
        (copies,) each, "CosineWind.mean" (copies, 3), and "Lattice.mass", that of a particle at the mast, the others following.
        "CosineWind.amplitude" where no amplitudes were given.
    """

    wind: Array | None
    mast: Array | None
    positions: Array
    velocities: Array
    parameters: dict[str, Array]


class Rollout:
    """Runs copies of a scene, each time from the same start, and carries derivatives back through the run.

    The steps are those of `Simulator`, to the bit. Positions and velocities of all of them are kept: 24 bytes a particle and step
    in float32, 48 in float64; where that exceeds `memory`, states from time to time, from which the way back takes the steps once
    more.

    Parameters
    ----------
    scene
        What to simulate. Its integrator must be `LFAB`, `Leapfrog`, `Strang` or `RK4`, and its effects smooth.
    copies
        Number of independent flags.
    seed, threads
        As for `Simulator`.
    parameters
        Names of the parameters to derive by; None: all that there are. The others cost nothing.
    memory
        Bytes for the steps that are kept; at least the root of their number are.

    Raises
    ------
    TypeError, ValueError
        As from `Simulator`; if the scene has an effect or an integrator without a way back, which is named; if a parameter is
        none of the scene's.
    """

    def __init__(
        self, scene: Scene, copies: int = 1, seed: int = 0, threads: int | None = None,
        parameters: Sequence[str] | None = None, memory: float = 1e9,
    ) -> None:  # fmt: skip
        self._simulator = Simulator(scene, copies, seed, threads)
        run = self._simulator.run
        refuse_without_way_back(scene, run.method, run.effects)
        self._memory = _validate.number("memory", memory, above=0.0)
        lattice = scene.lattice
        self._known = parameters_of(scene, run.effects)
        self._mass = mass_parameters(scene, self._known)
        self._asked = self._checked(parameters)
        self._threads = Threads(min(processors() if threads is None else threads, copies))
        self._pinned = np.flatnonzero(lattice.fixed)
        self._inverse_mass = np.where(lattice.fixed, 0.0, 1.0 / lattice.masses).astype(scene.dtype)
        self._rest = lattice.rest_positions.reshape(-1, 3)[self._pinned]
        self._windy = any(effect.wind_unit for effect in scene.effects)
        dtype, size = np.dtype(scene.dtype), lattice.size
        rows = run.x.shape[1], size
        shapes = (rows, (6, padded_row(2 * size, dtype)), (max(run.method.rows()[1], run.method.back_rows()), 3, size))
        self._work = [
            [zeros(place, shape, dtype) for place, shape in enumerate(shapes, start=3)] for _ in range(self._threads.count)
        ]
        self._kept: tuple[NDArray[Any], NDArray[Any]] = (np.empty(0), np.empty(0))
        self._machine: dict[tuple[Any, ...], Callable[..., None]] = {}
        self._velocities: Array | None = None
        self._runs = 0
        self.start = self._simulator.get_state()

    # -- what it is -------------------------------------------------------------------------------------------------------------

    @property
    def scene(self) -> Scene:
        """The scene as given."""
        return self._simulator.scene

    @property
    def copies(self) -> int:
        """Number of copies."""
        return self._simulator.copies

    @property
    def timestep(self) -> float:
        """Duration of one physics step [s]."""
        return self._simulator.timestep

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of the parameters that derivatives are taken by."""
        return self._asked

    @property
    def start(self) -> State:
        """Where each run starts: the state of a `Simulator` of the same scene and number of copies, with its winds and mast."""
        return self._start

    @start.setter
    def start(self, state: State) -> None:
        self._simulator.set_state(state)
        if (self._simulator.run.failed_at >= 0).any():
            raise ValueError("start must be a state in which no copy has diverged")
        self._start = self._simulator.get_state()
        self._velocities = None

    @property
    def runs(self) -> int:
        """How many runs there have been."""
        return self._runs

    # -- there ------------------------------------------------------------------------------------------------------------------

    def run(
        self, wind: ArrayLike | None = None, mast: ArrayLike | None = None, seconds: float = 1.0,
        positions: ArrayLike | None = None, velocities: ArrayLike | None = None,
    ) -> Array:  # fmt: skip
        """Run from the start; return the positions at the end [m], (copies, layers, rows, cols, 3).

        Parameters
        ----------
        wind : (actions, copies, 3)
            Amplitudes of the scene's winds, as for `Simulator.set_wind`, each held for an equal share of the time. None: as they
            are at the start.
        mast : (actions, copies, 5 or 6)
            Where the mast is to be at the end of each share: x, y, z [m], tilt about x and about y, and yaw [rad], as for
            `Simulator.set_mast`. None: it stays.
        seconds
            Duration, in whole steps: each share as `Simulator.advance` takes it.
        positions, velocities
            Of the start, as for the setters of `Simulator`; None: those of `start`.

        Raises
        ------
        ValueError
            If an argument is not as told, or a share is shorter than a step.
        Diverged
            If a copy reaches numbers that are not finite.
        """
        seconds = _validate.number("seconds", seconds, above=0.0)
        amplitudes, poses, actions = self._inputs(wind, mast)
        counts = steps_of(actions, seconds, self.timestep, self._start.remainder)
        simulator, run = self._simulator, self._simulator.run
        self._velocities = None
        self._runs += 1
        simulator.set_state(self._start)
        if positions is not None:
            simulator.set_positions(positions)
        if velocities is not None:
            simulator.set_velocities(velocities)
        self._amplitudes, self._poses = amplitudes, poses
        self._targets = self._mast_targets(actions)
        self._fresh = ~run.stepped
        self._standing = poses is None and np.array_equal(run.mast_targets.astype(run.x.dtype), run.x[:, :, self._pinned])
        self._start_v = run.v.copy()
        gap = self._targets[0].astype(run.x.dtype) - run.x[:, :, self._pinned]
        self._start_v[:, :, self._pinned] = gap / run.x.dtype.type(counts[0] * self.timestep)
        self._plan = self._planned(counts)
        self._path = np.zeros((actions, *run.x.shape), run.x.dtype)
        self._at_start = [array.copy() for group in state_of(run.effects) for array in group]
        self._last_v = np.zeros_like(run.x)
        self._states: list[list[NDArray[Any]]] = []
        for number in range(len(self._plan.segments)):
            self._states.append([array.copy() for array in self._changing()] if len(self._plan.segments) > 1 else [])
            self._record(number, keep=number + 1 == len(self._plan.segments))
        self._raise_unless_finite()
        self._velocities = run.coordinates.public(self._last_v)
        return run.coordinates.public(self._path[-1], self.scene.lattice.rest_positions)

    @property
    def velocities(self) -> Array:
        """Velocities at the end of the last run [m/s], shaped as the positions."""
        return self._done().copy()

    @property
    def path(self) -> Array:
        """Positions at the end of each action of the last run [m], (actions, copies, layers, rows, cols, 3)."""
        self._done()
        coordinates, rest = self._simulator.run.coordinates, self.scene.lattice.rest_positions
        return np.stack([coordinates.public(rows, rest) for rows in self._path])

    # -- and back ---------------------------------------------------------------------------------------------------------------

    def pull_back(self, dL_dx: ArrayLike, dL_dv: ArrayLike | None = None) -> Gradient:
        """Derivatives of a loss with respect to what the last run was made from.

        Parameters
        ----------
        dL_dx : (copies, layers, rows, cols, 3) or (actions, copies, layers, rows, cols, 3)
            Derivatives of the loss with respect to the positions at the end, or to those of `path` [1/m].
        dL_dv : (copies, layers, rows, cols, 3)
            With respect to `velocities` [s/m]; None: zero.

        Raises
        ------
        RuntimeError
            If there is no run.
        ValueError
            If an argument is of another shape, or not finite.
        """
        shape = self._done().shape
        run, actions = self._simulator.run, len(self._plan.counts)
        given = _validate.array("dL_dx", dL_dx, shape, (actions, *shape))
        dpath = np.zeros(self._path.shape, run.x.dtype)
        dpath[-1 if given.ndim == len(shape) else slice(None)] = self._rows(given)
        dvelocities = np.zeros_like(run.x)
        if dL_dv is not None:
            dvelocities[:] = self._rows(_validate.array("dL_dv", dL_dv, shape))
        dx, dv, dhistory = np.zeros_like(run.x), np.zeros_like(run.v), np.zeros_like(run.history)
        dtargets, damplitudes = np.zeros_like(self._targets), np.zeros((actions, self.copies, 3))
        slopes = self._slopes()
        last = len(self._plan.segments) - 1
        for number in range(last, -1, -1):
            if self._held != number:
                for array, state in zip(self._changing(), self._states[number], strict=True):
                    array[...] = state
                self._record(number, keep=True)
            self._restore_effects()
            self._back(
                number, slopes, self._start_v, self._fresh, dpath, dvelocities, dx, dv, dhistory, dtargets, damplitudes,
                dL_dv is not None and number == last, number == 0,
            )  # fmt: skip
        self._restore_effects()
        if self._standing:
            dx[:, :, self._pinned] += dtargets.sum(axis=0)
        dv += dhistory.sum(axis=1)
        coordinates = run.coordinates
        return Gradient(
            damplitudes if self._amplitudes is not None else None,
            self._poses_back(dtargets),
            coordinates.public(dx),
            coordinates.public(dv),
            self._by_parameters(slopes, damplitudes),
        )

    # -- inner ------------------------------------------------------------------------------------------------------------------

    def _checked(self, names: Sequence[str] | None) -> tuple[str, ...]:
        known = [parameter.name for parameter in self._known] + ([MASS] if self._mass is not None else [])
        if names is None:
            return tuple(known)
        if isinstance(names, str) or not all(name in known for name in names):
            raise ValueError(f"parameters must be some of {', '.join(known) or 'none'}, got {names!r}")
        return tuple(names)

    def _inputs(self, wind: ArrayLike | None, mast: ArrayLike | None) -> tuple[Array | None, Array | None, int]:
        """Amplitudes and poses, checked, and the number of actions."""
        lengths = {name: len(np.asarray(value)) for name, value in (("wind", wind), ("mast", mast)) if value is not None}
        if any(length < 1 for length in lengths.values()) or len(set(lengths.values())) > 1:
            raise ValueError(f"wind and mast must hold the same number of actions, at least one, got {lengths}")
        actions = next(iter(lengths.values()), 1)
        amplitudes = poses = None
        if wind is not None:
            if not self._windy:
                raise ValueError("scene must hold a wind for wind=, such as effects.CosineWind(); it has none")
            amplitudes = np.array(_validate.array("wind", wind, (actions, self.copies, 3)), order="C")
        if mast is not None:
            poses = np.array(_validate.array("mast", mast, (actions, self.copies, 5), (actions, self.copies, 6)), order="C")
        return amplitudes, poses, actions

    def _mast_targets(self, actions: int) -> Array:
        """Where the pinned particles are at the end of each action, (actions, copies, coordinates, pinned)."""
        run = self._simulator.run
        if self._poses is None:
            return np.ascontiguousarray(np.broadcast_to(run.mast_targets, (actions, *run.mast_targets.shape)))
        points = points_of(self._rest, self._poses.reshape(-1, self._poses.shape[-1]))
        run.coordinates.check("mast", points, self._rest)
        rows = points.transpose(0, 2, 1)[:, run.coordinates.axes]
        return np.ascontiguousarray(rows.reshape(actions, self.copies, *rows.shape[1:]))

    def _planned(self, counts: list[int]) -> Plan:
        """The run's steps in segments, and memory for one of them."""
        x = self._simulator.run.x
        capacity = int(self._memory / (2 * x.nbytes))
        made = plan(counts, capacity)
        positions, velocities = made.rows
        if self._kept[0].ndim < 2 or self._kept[0].shape[1] < positions or self._kept[1].shape[1] < velocities:
            self._kept = tuple(np.empty((len(x), rows, *x.shape[1:]), x.dtype) for rows in (positions, velocities))  # type: ignore[assignment]
        return made

    def _changing(self) -> list[NDArray[Any]]:
        run = self._simulator.run
        return [run.x, run.v, run.history, run.stepped, *(array for group in state_of(run.effects) for array in group)]

    def _restore_effects(self) -> None:
        """Bring the effects' own state back to the start, from which the way back counts its time."""
        run = self._simulator.run
        for array, start in zip((array for group in state_of(run.effects) for array in group), self._at_start, strict=True):
            array[...] = start

    def _record(self, number: int, keep: bool) -> None:
        """Take the steps of a segment."""
        run = self._simulator.run
        after = (
            self._pinned, run.stepped, self._plan.segments[number], self._blown(), self._amplitudes is not None, self._targets,
            self._path, self._last_v, *self._kept, keep,
        )  # fmt: skip
        self._parallel(
            ("record",), compiled_record, number,
            lambda work: (run.method, run.effects, run.x, run.v, run.history, *work, self._inverse_mass, *after),
        )  # fmt: skip
        self._held = number if keep else -1

    def _back(self, number: int, slopes: tuple[Any, ...], *arrays: Any) -> None:
        """Undo the steps of a segment."""
        run = self._simulator.run
        *before, at_end, at_start = arrays
        after = (
            self._inverse_mass, self._pinned, self._plan.segments[number], self._blown(), self._amplitudes is not None, at_end,
            at_start,
        )  # fmt: skip
        self._parallel(
            ("back", *(out is None for out in slopes)), compiled_back, number,
            lambda work: (run.method, run.effects, slopes, *self._kept, *before, work[2], work[1], *after),
        )  # fmt: skip

    def _blown(self) -> Array:
        return np.zeros((0, 0, 3)) if self._amplitudes is None else self._amplitudes

    def _parallel(
        self, key: tuple[Any, ...], compiled: Callable[..., Any], number: int, arguments: Callable[[list[NDArray[Any]]], Any]
    ) -> None:
        """Call machine code for all copies, in all threads where that pays."""
        run, copies = self._simulator.run, self.copies
        whole = [arguments(work) for work in self._work]
        key = (*key, *map(type, run.effects))  # links without viscosity are of another type
        if key not in self._machine:
            self._machine[key] = entry_point(compiled(run.method, run.effects), (*whole[0], 0, 1))
        entry = self._machine[key]
        steps = int(self._plan.segments[number][:, 0].sum())
        threads = self._threads.count
        if threads == 1 or steps * copies * self.scene.lattice.size < _SERIAL_BELOW:
            entry(*whole[0], 0, copies)
            return
        blocks = min(copies, 4 * threads)
        queue = deque((block * copies // blocks, (block + 1) * copies // blocks) for block in range(blocks))

        def work(thread: int) -> None:
            while True:
                try:
                    first, last = queue.popleft()
                except IndexError:
                    return
                entry(*whole[thread], first, last)

        self._threads.run(work)

    def _slopes(self) -> tuple[Any, ...]:
        """For each effect None, or memory for the derivatives with respect to its parameters."""
        wanted = {parameter.effect for parameter in self._known if parameter.name in self._asked}
        if MASS in self._asked:
            wanted |= {parameter.effect for parameter in self._mass or ()}
        if self._amplitudes is not None:
            wanted |= {place for place, effect in enumerate(self.scene.effects) if effect.wind_unit}
        widths = {parameter.effect: parameter.last for parameter in self._known}
        return tuple(
            np.zeros((self.copies, widths[place])) if place in wanted else None for place in range(len(self.scene.effects))
        )

    def _by_parameters(self, slopes: tuple[Any, ...], damplitudes: Array) -> dict[str, Array]:
        result, blown = {}, self._amplitudes is not None
        for parameter in self._known:
            if parameter.name in self._asked and not (blown and parameter.name.endswith(".amplitude")):
                columns = slopes[parameter.effect][:, parameter.first : parameter.last]
                result[parameter.name] = columns[:, 0].copy() if columns.shape[1] == 1 else columns.copy()
        if MASS in self._asked:
            total = np.zeros(self.copies) if self._amplitudes is None else (self._amplitudes * damplitudes).sum(axis=(0, 2))
            run = self._simulator.run
            for parameter in self._mass or ():
                name = parameter.name.rpartition(".")[2]
                data = run.effects[parameter.effect]
                value = getattr(data.wind, name) if hasattr(data, "wind") else getattr(run.scene.effects[parameter.effect], name)
                total += (value * slopes[parameter.effect][:, parameter.first : parameter.last]).sum(axis=1)
            result[MASS] = -total / self.scene.lattice.mass
        return result

    def _poses_back(self, dtargets: Array) -> Array | None:
        if self._poses is None:
            return None
        dpoints = np.zeros((dtargets.shape[0] * self.copies, len(self._pinned), 3))
        rows = dtargets.reshape(-1, *dtargets.shape[2:]).transpose(0, 2, 1)
        dpoints[:, :, self._simulator.run.coordinates.axes] = rows
        return poses_back(self._rest, self._poses.reshape(-1, self._poses.shape[-1]), dpoints).reshape(self._poses.shape)

    def _rows(self, public: Array) -> Array:
        """Rows (..., coordinates, particles) of a public array."""
        flat = public.reshape(*public.shape[:-4], self.scene.lattice.size, 3)
        return np.swapaxes(flat, -1, -2)[..., self._simulator.run.coordinates.axes, :]

    def _done(self) -> Array:
        if self._velocities is None:
            raise RuntimeError("run must have been called, and start not set since")
        return self._velocities

    def _raise_unless_finite(self) -> None:
        bad = ~np.isfinite(self._path[-1]).all(axis=1)
        if bad.any():
            copy, particle = (int(index) for index in np.argwhere(bad)[0])
            time = self._start.time + sum(self._plan.counts) * self.timestep
            where = np.unravel_index(particle, self.scene.lattice.shape)
            raise Diverged(time, copy, tuple(int(index) for index in where))  # type: ignore[arg-type]
