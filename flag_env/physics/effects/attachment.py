"""Attachment: a spring and a damper from a particle to a point in space, such as a halyard or a second corner.

    F = k (p - x) - z v

k stiffness [N/m], z viscosity [N s/m], p the point [m], x and v the particle's position [m] and velocity [m/s]. The spring has no
rest length. Parameters: particle (layer, row, col), point p, stiffness k, viscosity z. Source: Hooke's law.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from flag_env import _validate
from flag_env.physics.compiling import jit
from flag_env.physics.effects.base import BindContext, Effect, LinearBound
from flag_env.physics.lattice import Lattice


class AttachmentData(NamedTuple):
    """What holds the particle.

    Attributes
    ----------
    particle
        Its flat number.
    axes : (coordinates,)
        Axes of the scene's coordinates.
    point : (copies, 3)
        Where it is held [m]; may be moved while a simulation runs.
    stiffness, viscosity
        [N/m], [N s/m].
    """

    particle: int
    axes: NDArray[np.int64]
    point: NDArray[np.float64]
    stiffness: Any
    viscosity: Any

    @staticmethod
    def state() -> tuple[str, ...]:
        """Fields that a run changes."""
        return ("point",)

    @staticmethod
    def inputs() -> tuple[str, ...]:
        """Fields that `Simulator.set_input` may set."""
        return ("point",)

    @staticmethod
    @jit
    def force(data, copy, x, v, f, effect_work, lag):
        """Pull the particle to its point and brake it."""
        t = data.particle
        for d in range(f.shape[0]):
            point = f.dtype.type(data.point[copy, data.axes[d]])
            f[d, t] += data.stiffness * (point - x[d, t]) - data.viscosity * v[d, t]

    @staticmethod
    def parameters() -> tuple[str, ...]:
        """What `slopes` are with respect to."""
        return "stiffness", "viscosity"

    @staticmethod
    @jit
    def pull_back(data, copy, x, v, g, dx, dv, effect_work, lag):
        """Spring and damper are linear."""
        t = data.particle
        for d in range(g.shape[0]):
            dx[d, t] -= data.stiffness * g[d, t]
            dv[d, t] -= data.viscosity * g[d, t]

    @staticmethod
    @jit
    def slopes(data, copy, x, v, g, out, effect_work, lag):
        """By the stiffness: p - x; by the viscosity: -v."""
        t = data.particle
        for d in range(g.shape[0]):
            out[0] += g[d, t] * (data.point[copy, data.axes[d]] - x[d, t])
            out[1] -= g[d, t] * v[d, t]


@dataclass(frozen=True)
class Attachment(Effect):
    """A spring and a damper from a particle to a point.

    Parameters
    ----------
    particle
        (layer, row, col) of the particle.
    point
        (x, y, z) of the point [m]; `Simulator.set_input(effects.Attachment, "point", ...)` moves it.
    stiffness
        Of the spring [N/m], >= 0.
    viscosity
        Of the damper [N s/m], >= 0.
    """

    scales_with: ClassVar[tuple[str, ...] | None] = ("stiffness", "viscosity")

    particle: tuple[int, ...] = (0, 0, 0)
    point: tuple[float, ...] = (0.0, 0.0, 0.0)
    stiffness: float = 100.0
    viscosity: float = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        if not isinstance(self.particle, (tuple, list)) or len(self.particle) != 3:
            raise ValueError(f"particle must be (layer, row, col), got {self.particle!r}")
        object.__setattr__(self, "particle", tuple(_validate.count("particle", entry, minimum=0) for entry in self.particle))
        object.__setattr__(self, "point", _validate.vector("point", self.point))
        for name in ("stiffness", "viscosity"):
            object.__setattr__(self, name, _validate.number(name, getattr(self, name), minimum=0.0))

    def check(self, lattice: Lattice) -> None:
        """The lattice must have the particle."""
        if any(index >= size for index, size in zip(self.particle, lattice.shape, strict=True)):
            raise ValueError(f"particle must be (layer, row, col) below {lattice.shape}, got {self.particle}")

    def bind(self, context: BindContext) -> AttachmentData:
        """The particle's number, a point for each copy, and constants in the scene's dtype."""
        number = context.dtype.type
        particle = int(np.ravel_multi_index(self.particle, context.lattice.shape))
        point = np.tile(np.array(self.point), (context.copies, 1))
        return AttachmentData(particle, np.array(context.lattice.axes), point, number(self.stiffness), number(self.viscosity))

    def linear_bound(self, lattice: Lattice) -> LinearBound:
        """Stiffness and damping of the one particle, along every direction."""
        held = np.zeros(lattice.size)
        held[np.ravel_multi_index(self.particle, lattice.shape)] = 1.0
        return LinearBound(stiffness=self.stiffness * held, drag=self.viscosity * held, isotropic=True)

    def energy(self, lattice: Lattice, positions: NDArray[np.float64], data: Any = None) -> NDArray[np.float64]:
        """K |p - x|^2 / 2, along the scene's coordinates [J], shape (copies,)."""
        point = np.array(self.point) if data is None else data.point
        away = (point - positions[:, np.ravel_multi_index(self.particle, lattice.shape)])[:, list(lattice.axes)]
        return np.asarray(0.5 * self.stiffness * (away**2).sum(axis=-1))

    def scaled(self, stiffness: float, viscosity: float) -> Attachment:
        """Unchanged: it is no link of the cloth."""
        del stiffness, viscosity
        return self
