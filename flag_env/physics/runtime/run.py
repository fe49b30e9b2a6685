"""The arrays of a run, and the compiled step on them.

State is kept flat, one contiguous row per coordinate: `x, v` (copies, 3, particles) in the scene's dtype. Copies are independent:
each is stepped by itself, so its bits do not depend on how many there are nor on the number of threads.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flag_env.physics.compiling import compiled_run, entry_point
from flag_env.physics.effects import BindContext
from flag_env.physics.effects.links import link_groups
from flag_env.physics.limits import SceneSpectrum
from flag_env.physics.runtime import aligned
from flag_env.physics.runtime.binding import bind, rebind, state_of
from flag_env.physics.runtime.coordinates import Coordinates
from flag_env.physics.runtime.frame import Frame
from flag_env.physics.runtime.mast import pull
from flag_env.physics.runtime.replay import Past
from flag_env.physics.runtime.state import Diverged
from flag_env.physics.runtime.threads import Threads
from flag_env.physics.scene import Scene

_SERIAL_BELOW = 20_000
"""Particle-steps below which waking threads costs more than it gains."""

_BLOCKS_PER_THREAD = 4
"""Blocks of copies for each thread: who is done takes over some of the others', so that none waits long for one held up."""


class Run:
    """All copies of a scene in motion. Arguments are checked by the `Simulator`.

    Attributes
    ----------
    scene
        The scene, its links scaled as they are now.
    timestep
        Duration of a step [s].
    x, v : (copies, coordinates, particles)
        Positions [m] and velocities [m/s] as the method keeps them.
    history : (copies, rows, coordinates, particles)
        What else the method remembers from step to step.
    mast_targets : (copies, coordinates, pinned particles)
        Where the pinned particles are to be [m].
    stepped, failed_at, failed_particle : (copies,)
        Whether a step has been taken; the step of the last call at which a copy stopped at bad numbers, 0 if that was in a call
        before, or -1; its particle.
    moving
        Whether the pinned particles move, or may: to be set by whoever writes to `x`, `v` or `mast_targets`.
    effects
        The effects' data, in the scene's order.
    links
        The links of all effects, with their weights now.
    past
        What `failure` goes back to: to be told to forget by whoever changes an effect's state.
    entry
        The machine code; None until it is first needed.
    """

    def __init__(self, scene: Scene, timestep: float, copies: int, seed: int, threads: int) -> None:
        lattice = scene.lattice
        self.scene, self.timestep, self._seed = scene, timestep, seed
        self._dtype = np.dtype(scene.dtype)
        self._threads = Threads(min(threads, copies))
        self.coordinates = Coordinates(lattice, copies, self._dtype)
        self.method = scene.integrator.bind(self._dtype, timestep, SceneSpectrum(lattice, scene.effects))
        self._breaks = any(effect.breaks for effect in scene.effects)
        self.links = link_groups(lattice, scene.effects, copies, self._dtype)
        self.effects = bind(scene.effects, self._context(copies))
        self._pinned = np.flatnonzero(lattice.fixed)
        self._inverse_mass = np.where(lattice.fixed, 0.0, 1.0 / lattice.masses).astype(self._dtype)
        start = _start(scene, copies, seed)[:, self.coordinates.axes]
        self.x = aligned.zeros(0, start.shape, self._dtype)
        self.x[:] = start
        self.v = aligned.zeros(1, start.shape, self._dtype)
        self.mast_targets = np.ascontiguousarray(start[:, :, self._pinned])
        history_rows, work_rows = self.method.rows()
        self.history = aligned.zeros(2, (copies, history_rows, *start.shape[1:]), self._dtype)
        effect_work = (6, aligned.padded_row(2 * lattice.size, self._dtype))
        shapes = (start.shape[1:], effect_work, (work_rows, 3, lattice.size))
        self._work = [
            tuple(aligned.zeros(place, shape, self._dtype) for place, shape in enumerate(shapes, start=3))
            for _ in range(self._threads.count)
        ]
        self._axes = np.array(lattice.axes)
        self._unread = np.zeros((0, 0))
        self.stepped = np.zeros(copies, bool)
        self.failed_at = np.full(copies, -1, np.int64)
        self.failed_particle = np.zeros(copies, np.int64)
        self._few_steps = math.inf if self._threads.count == 1 else _SERIAL_BELOW / (copies * lattice.size)
        self._arguments: list[tuple[Any, ...]] = []
        self._pull: Callable[..., bool] | None = None
        self.moving = True
        self.past = Past(self._changing())
        self.entry: Callable[..., int] | None = None

    def change(self, scene: Scene) -> None:
        """Go on with the links of `scene`, which differs in their stiffness and viscosity only."""
        self.effects = rebind(self.scene.effects, scene.effects, self.effects, self._context(len(self.x)))
        self.method = scene.integrator.bind(self._dtype, self.timestep, SceneSpectrum(scene.lattice, scene.effects))
        self.scene, self.entry = scene, None
        self.past = Past(self._changing())

    def place(self, rows: NDArray[np.float64]) -> None:
        """Put all particles at `rows` (copies, coordinates, particles); pinned ones are to stay there."""
        self.x[:] = rows
        self.mast_targets[:] = rows[:, :, self._pinned]
        self.moving = True

    def step(self, steps: int, into: Frame | None, then: Callable[[int, int], Any] | None = None) -> int:
        """Take `steps` steps, if any, moving the mast to where it is to be, then write `into` a frame, if any.

        `then(first, last)` is called for each block of copies that is done, in the thread that has moved it. Returns how many
        copies have not stopped.
        """
        if self.entry is None:
            self._compile()
        if steps > 0 and self.moving:
            self.moving = self._pull(self.x, self.v, self._pinned, self.mast_targets, steps * self.timestep)  # type: ignore[misc]
            self.past.forget()
        if steps > 1 and into is None:
            self.past.before(steps)
        elif steps > 0:  # a single step is looked at anyhow, and who reads is told of no particle
            self.past.forget()
        if steps >= self._few_steps:
            return self._parallel(steps, into, then)
        return self._serial(steps, into, then, 0, len(self.x))

    def _parallel(self, steps: int, into: Frame | None, then: Callable[[int, int], Any] | None) -> int:
        """All copies of `step`, in all threads."""
        copies, threads = len(self.x), self._threads.count
        blocks = min(copies, _BLOCKS_PER_THREAD * threads)
        ends = [block * copies // blocks for block in range(blocks + 1)]
        queues = [deque(range(i * blocks // threads, (i + 1) * blocks // threads)) for i in range(threads)]

        def work(thread: int) -> int:
            return sum(self._serial(steps, into, then, ends[i], ends[i + 1], thread) for i in _block_order(queues, thread))

        return sum(self._threads.run(work))

    def failure(self, steps: int, taken: int) -> Diverged | None:
        """What went wrong first in the last `steps` steps of all `taken`, if anything has, or that nothing runs on."""
        new = np.flatnonzero(self.failed_at > 0)
        if not len(new):
            if (self.failed_at < 0).any():
                return None
            copy, late = 0, 0
        else:
            seen = int(self.failed_at[new].min())
            ago = {int(copy): self._first_failure(int(copy), steps - seen) for copy in new[self.failed_at[new] == seen]}
            copy = max(ago, key=ago.__getitem__)
            late = ago[copy]
        particle = np.unravel_index(self.failed_particle[copy], self.scene.lattice.shape)
        return Diverged((taken - late) * self.timestep, copy, tuple(int(i) for i in particle))  # type: ignore[arg-type]

    def _first_failure(self, copy: int, late: int) -> int:
        """How many steps ago a copy went bad, if that is known, else how many ago that was seen."""
        first = self.past.first(copy, late, partial(self._again, copy))
        if first is not None:
            late, self.failed_particle[copy] = first
        return late

    def _changing(self) -> list[NDArray[Any]]:
        """Arrays that a step changes, with a leading copies axis."""
        return [
            self.x,
            self.v,
            self.history,
            self.stepped,
            self.failed_at,
            *(a for group in state_of(self.effects) for a in group),
        ]

    def _again(self, copy: int, steps: int) -> int:
        """Take steps of one copy, its mast moving on as it does; return the particle with a bad number, or -1."""
        mast_targets = self.mast_targets[copy]
        there = mast_targets.copy()
        mast_targets[:] = self.x[copy][:, self._pinned] + steps * self.timestep * self.v[copy][:, self._pinned].astype(np.float64)
        self._serial(steps, None, None, copy, copy + 1)
        mast_targets[:] = there
        return int(self.failed_particle[copy]) if self.failed_at[copy] >= 0 else -1

    def _serial(
        self, steps: int, into: Frame | None, then: Callable[[int, int], Any] | None, first: int, last: int, thread: int = 0
    ) -> int:
        """The copies `first <= copy < last` of `step`, in memory of a thread's own."""
        if into is None:
            return self.entry(*self._arguments[thread], first, last, steps, False, self._unread, self._unread)  # type: ignore[misc]
        healthy = self.entry(*self._arguments[thread], first, last, steps, True, into.x, into.v)  # type: ignore[misc]
        if then is not None:
            then(first, last)
        return healthy

    def _compile(self) -> None:
        self._arguments = [
            (
                self.method, self.effects, self.x, self.v, self.history, *work, self._inverse_mass, self._pinned,
                self.mast_targets, self._axes, self.stepped, self.failed_at, self.failed_particle,
            )
            for work in self._work
        ]  # fmt: skip
        last = (0, 1, 1, True, self._unread, self._unread)
        self._pull = pull(self._dtype)
        self.entry = entry_point(compiled_run(self.method, self.effects), (*self._arguments[0], *last))

    def _context(self, copies: int) -> BindContext:
        return BindContext(self.scene.lattice, self._dtype, copies, self.timestep, self._seed, self.links, self._breaks)

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "entry": None, "_arguments": [], "_pull": None, "past": None}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self.past = Past(self._changing())


def _block_order(queues: list[deque[int]], thread: int) -> Iterator[int]:
    """Blocks for a thread: first its own, the same each time and so still in its core's cache; then the last of the others."""
    own = queues[thread]
    for own_blocks in (own, *(other for other in queues if other is not own)):
        while own_blocks:
            try:
                yield own_blocks.popleft() if own_blocks is own else own_blocks.pop()
            except IndexError:  # another thread was quicker
                break


def _start(scene: Scene, copies: int, seed: int) -> NDArray[np.float64]:
    """Positions at rest, perturbed across the cloth as the scene says, shape (copies, 3, particles) [m]."""
    lattice = scene.lattice
    start = np.tile(lattice.rest_positions.reshape(-1, 3).T, (copies, 1, 1))
    if scene.perturbation > 0 and lattice.dimensions == 3:
        for copy in range(copies):
            noise = np.random.default_rng((seed, copy)).standard_normal(lattice.size)
            start[copy, 1] += scene.perturbation * np.where(lattice.fixed, 0.0, noise)
    return start
