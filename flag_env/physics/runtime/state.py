"""A run's state, to the bit, and how a run fails."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from itertools import zip_longest
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flag_env.physics.scene import Scene


class Diverged(FloatingPointError):  # noqa: N818  (a public name)
    """A simulation has reached numbers that are not finite.

    Attributes
    ----------
    time
        Simulated time after the step that brought the first such number [s].
    copy
        The copy it happened to.
    particle
        (layer, row, col) of the particle that had it; the lowest, where one step has brought several.
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
    """Everything a continuation depends on, to the bit. Arrays lead with the copies.

    Attributes
    ----------
    scene
        The scene that was simulated, as given.
    timestep
        Duration of a step [s].
    time
        Simulated time [s].
    remainder
        What `Simulator.advance` was asked for beyond that time, at most half a step either way [s].
    """

    scene: Scene
    timestep: float
    time: float
    remainder: float
    positions: NDArray[Any]
    velocities: NDArray[Any]
    history: NDArray[Any]
    mast_targets: NDArray[np.float64]
    stepped: NDArray[np.bool_]
    failed_at: NDArray[np.int64]
    failed_particle: NDArray[np.int64]
    scales: tuple[float, float]
    effects: tuple[tuple[NDArray[Any], ...], ...]

    def arrays(self) -> list[NDArray[Any]]:
        """All arrays, in the order of the fields."""
        own = [getattr(self, field.name) for field in fields(self)]
        return [array for array in own if isinstance(array, np.ndarray)] + [array for group in self.effects for array in group]

    def copied(self) -> State:
        """The same state in arrays of its own."""
        own = {field.name: getattr(self, field.name) for field in fields(self)}
        arrays: dict[str, Any] = {name: value.copy() for name, value in own.items() if isinstance(value, np.ndarray)}
        return replace(self, **arrays, effects=tuple(tuple(array.copy() for array in group) for group in self.effects))

    def only(self, copy: int) -> State:
        """The state of one copy, in arrays of its own."""
        own = {field.name: getattr(self, field.name) for field in fields(self)}
        one = slice(copy, copy + 1)
        arrays: dict[str, Any] = {name: value[one].copy() for name, value in own.items() if isinstance(value, np.ndarray)}
        return replace(self, **arrays, effects=tuple(tuple(array[one].copy() for array in group) for group in self.effects))

    def finite(self) -> NDArray[np.bool_]:
        """Whether all numbers of a copy are finite, shape (copies,)."""
        copies = len(self.positions)
        rows = [np.isfinite(array).reshape(copies, -1) for array in self.arrays() if array.dtype.kind == "f"]
        return np.asarray(np.all([row.all(axis=1) for row in rows], axis=0))

    def overwrite(self, to: list[int], other: State) -> None:
        """Write copies of `other`, those of the same number or its only one, over the copies `to` of this state.

        Raises
        ------
        ValueError
            If `other` belongs to another scene, timestep or number of copies, or is not finite; nothing has changed then.
        """
        self._refuse_another_scene(other)
        count, copies = len(other.positions), len(self.positions)
        if other.positions.shape[1:] != self.positions.shape[1:] or count not in (1, copies):
            raise ValueError(f"state must have positions of shape {self.positions.shape}, got {other.positions.shape}")
        mine, theirs = self.arrays(), other.arrays()
        if [len(group) for group in self.effects] != [len(group) for group in other.effects] or any(
            a.shape[1:] != b.shape[1:] or a.dtype != b.dtype for a, b in zip(mine, theirs, strict=True)
        ):
            raise ValueError("state must hold arrays of the shapes and dtypes that get_state() of the same scene returns")
        source = to if count == copies else [0]
        running = other.failed_at[source] < 0  # those that have stopped hold what they stopped at
        if not other.finite()[source][running].all():
            raise ValueError("state must be finite in all copies that have not diverged")
        for a, b in zip(mine, theirs, strict=True):
            a[to] = b[source]

    def _refuse_another_scene(self, other: State) -> None:
        """Raise ValueError, naming what differs, unless `other` was taken from the same scene at the same timestep."""
        if other.scene is self.scene and other.timestep == self.timestep:
            return
        mine, theirs = self.scene, other.scene
        for name, own, given in [
            *((name.name, getattr(mine.lattice, name.name), getattr(theirs.lattice, name.name)) for name in fields(mine.lattice)),
            *(
                (f"effects ({type(own or given).__name__})", own, given)
                for own, given in zip_longest(mine.effects, theirs.effects)
            ),
            ("integrator", mine.integrator, theirs.integrator),
            ("dtype", mine.dtype, theirs.dtype),
            ("timestep", self.timestep, other.timestep),
        ]:
            if own != given:
                raise ValueError(f"state must come from a simulator of the same {name}, {own!r}, got one of {given!r}")
