"""The arrays of a run, and the compiled step on them.

State is kept flat, one contiguous row per coordinate: `x, v` (copies, 3, particles) in the scene's dtype. Copies are independent:
each is stepped by itself, so its bits do not depend on how many there are nor on the number of threads.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flag_env.physics import placed
from flag_env.physics.bound import bind, rebind
from flag_env.physics.compose import compiled_run
from flag_env.physics.coordinates import Coordinates
from flag_env.physics.effects.base import Setting
from flag_env.physics.jit import entry_point
from flag_env.physics.mast import pull
from flag_env.physics.reading import Reading
from flag_env.physics.scene import Scene
from flag_env.physics.spectrum import SceneSpectrum
from flag_env.physics.state import Diverged
from flag_env.physics.threads import Threads

_SERIAL = 20_000
"""Particle-steps below which waking threads costs more than it gains."""

_BLOCKS = 4
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
    memory : (copies, rows, coordinates, particles)
        What else the method remembers from step to step.
    mast : (copies, coordinates, pinned particles)
        Where the pinned particles are to be [m].
    stepped, failed_at, failed_particle : (copies,)
        Whether a step has been taken; the step of the last call at which a copy stopped at bad numbers, 0 if that was in a call
        before, or -1; its particle.
    moving
        Whether the pinned particles move, or may: to be set by whoever writes to `x`, `v` or `mast`.
    effects
        The bound effects, in the scene's order.
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
        self.effects = bind(scene.effects, self._setting(copies))
        self._pinned = np.flatnonzero(lattice.fixed)
        self._inverse_mass = np.where(lattice.fixed, 0.0, 1.0 / lattice.masses).astype(self._dtype)
        start = _start(scene, copies, seed)[:, self.coordinates.axes]
        self.x = placed.zeros(0, start.shape, self._dtype)
        self.x[:] = start
        self.v = placed.zeros(1, start.shape, self._dtype)
        self.mast = np.ascontiguousarray(start[:, :, self._pinned])
        memory_rows, work_rows = self.method.rows()
        self.memory = placed.zeros(2, (copies, memory_rows, *start.shape[1:]), self._dtype)
        scratch = (6, placed.pitch(2 * lattice.size, self._dtype))
        shapes = (start.shape[1:], scratch, (work_rows, 3, lattice.size))
        self._work = [
            tuple(placed.zeros(place, shape, self._dtype) for place, shape in enumerate(shapes, start=3))
            for _ in range(self._threads.count)
        ]
        self._axes = np.array(lattice.axes)
        self._unread = np.zeros((0, 0))
        self.stepped = np.zeros(copies, bool)
        self.failed_at = np.full(copies, -1, np.int64)
        self.failed_particle = np.zeros(copies, np.int64)
        self._few_steps = math.inf if self._threads.count == 1 else _SERIAL / (copies * lattice.size)
        self._arguments: list[tuple[Any, ...]] = []
        self._pull: Callable[..., bool] | None = None
        self.moving = True
        self.entry: Callable[..., int] | None = None

    def change(self, scene: Scene) -> None:
        """Go on with the links of `scene`, which differs in their stiffness and viscosity only."""
        self.effects = rebind(self.scene.effects, scene.effects, self.effects, self._setting(len(self.x)))
        self.method = scene.integrator.bind(self._dtype, self.timestep, SceneSpectrum(scene.lattice, scene.effects))
        self.scene, self.entry = scene, None

    def place(self, rows: NDArray[np.float64]) -> None:
        """Put all particles at `rows` (copies, coordinates, particles); pinned ones are to stay there."""
        self.x[:] = rows
        self.mast[:] = rows[:, :, self._pinned]
        self.moving = True

    def step(self, steps: int, into: Reading | None, then: Callable[[int, int], Any] | None = None) -> int:
        """Take `steps` steps, if any, moving the mast to where it is to be, then write `into` a reading, if any.

        `then(first, last)` is called for each block of copies that is done, in the thread that has moved it. Returns how many
        copies have not stopped.
        """
        if self.entry is None:
            self._compile()
        if steps > 0 and self.moving:
            self.moving = self._pull(self.x, self.v, self._pinned, self.mast, steps * self.timestep)  # type: ignore[misc]
        if steps >= self._few_steps:
            return self._shares(steps, into, then)
        return self._share(steps, into, then, 0, len(self.x))

    def _shares(self, steps: int, into: Reading | None, then: Callable[[int, int], Any] | None) -> int:
        """All copies of `step`, in all threads."""
        copies, threads = len(self.x), self._threads.count
        blocks = min(copies, _BLOCKS * threads)
        ends = [block * copies // blocks for block in range(blocks + 1)]
        shares = [deque(range(i * blocks // threads, (i + 1) * blocks // threads)) for i in range(threads)]

        def work(thread: int) -> int:
            return sum(self._share(steps, into, then, ends[i], ends[i + 1], thread) for i in _turns(shares, thread))

        return sum(self._threads.run(work))

    def failure(self, steps: int, taken: int) -> Diverged | None:
        """What has gone wrong in the last `steps` steps of all `taken`, if anything has, or if nothing runs on."""
        new = np.flatnonzero(self.failed_at > 0)
        if not len(new) and (self.failed_at < 0).any():
            return None
        copy = int(new[0]) if len(new) else 0
        late = steps - int(self.failed_at[copy]) if len(new) else 0
        particle = np.unravel_index(self.failed_particle[copy], self.scene.lattice.shape)
        return Diverged((taken - late) * self.timestep, copy, tuple(int(i) for i in particle))  # type: ignore[arg-type]

    def _share(
        self, steps: int, into: Reading | None, then: Callable[[int, int], Any] | None, first: int, last: int, thread: int = 0
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
                self.method, self.effects, self.x, self.v, self.memory, *work, self._inverse_mass, self._pinned, self.mast,
                self._axes, self.stepped, self.failed_at, self.failed_particle,
            )
            for work in self._work
        ]  # fmt: skip
        last = (0, 1, 1, True, self._unread, self._unread)
        self._pull = pull(self._dtype)
        self.entry = entry_point(compiled_run(self.method, self.effects), (*self._arguments[0], *last))

    def _setting(self, copies: int) -> Setting:
        return Setting(self.scene.lattice, self._dtype, copies, self.timestep, self._seed, {})

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "entry": None, "_arguments": [], "_pull": None}


def _turns(shares: list[deque[int]], thread: int) -> Iterator[int]:
    """Blocks for a thread: first its own, the same each time and so still in its core's cache; then the last of the others."""
    own = shares[thread]
    for share in (own, *(other for other in shares if other is not own)):
        while share:
            try:
                yield share.popleft() if share is own else share.pop()
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
