"""Springs and dampers along families of links: what `Structural`, `Shear`, `Bending` and `CrossLayer` share.

Force on the first particle of a link, the opposite on the second (the report's, section "modelling"):

    isotropic:  F = w [k (1 - l/d) (x2 - x1) + z (v2 - v1)]
    axial:      F = w [k (1 - l/d) + z ((x2 - x1).(v2 - v1)) / d^2] (x2 - x1)

k stiffness [N/m], z viscosity [N s/m], l rest length [m], d length now [m], w the link's weight: 1, or the mean taper of its two
ends. Both keep linear momentum; the isotropic damper also brakes rigid rotation, the axial one keeps angular momentum.
Without viscosity no velocity is read. A link of no length has no direction and exerts no elastic force.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from flag_env.physics import validate
from flag_env.physics.effects.base import Effect, LinkTerm
from flag_env.physics.jit import jit, kernel
from flag_env.physics.lattice import Family, Lattice, Step

TINY = 1e-30
"""Added to d^2 [m^2]: keeps a link of no length finite, and changes no bit of any other."""


@kernel
def _elastic(x, y, z, xb, yb, zb, weight, k, kl, tiny, fx, fy, fz, n):
    for t in range(n):
        dx = xb[t] - x[t]
        dy = yb[t] - y[t]
        dz = zb[t] - z[t]
        a = weight[t] * (k - kl / np.sqrt(dx * dx + dy * dy + dz * dz + tiny))
        fx[t] = a * dx
        fy[t] = a * dy
        fz[t] = a * dz


@kernel
def _isotropic(x, y, z, u, v, w, xb, yb, zb, ub, vb, wb, weight, k, kl, c, tiny, fx, fy, fz, n):
    for t in range(n):
        dx = xb[t] - x[t]
        dy = yb[t] - y[t]
        dz = zb[t] - z[t]
        a = weight[t] * (k - kl / np.sqrt(dx * dx + dy * dy + dz * dz + tiny))
        b = weight[t] * c
        fx[t] = a * dx + b * (ub[t] - u[t])
        fy[t] = a * dy + b * (vb[t] - v[t])
        fz[t] = a * dz + b * (wb[t] - w[t])


@kernel
def _axial(x, y, z, u, v, w, xb, yb, zb, ub, vb, wb, weight, k, kl, c, tiny, fx, fy, fz, n):
    for t in range(n):
        dx = xb[t] - x[t]
        dy = yb[t] - y[t]
        dz = zb[t] - z[t]
        d2 = dx * dx + dy * dy + dz * dz + tiny
        rate = dx * (ub[t] - u[t]) + dy * (vb[t] - v[t]) + dz * (wb[t] - w[t])
        a = weight[t] * (k - kl / np.sqrt(d2) + c * rate / d2)
        fx[t] = a * dx
        fy[t] = a * dy
        fz[t] = a * dz


@kernel
def _add(f, g, n):
    for t in range(n):
        f[t] += g[t]


@kernel
def _subtract(f, g, n):
    for t in range(n):
        f[t] -= g[t]


@jit
def _apply(f, scratch, offset, n):
    """Add the links' forces to their first particles, subtract them from their second."""
    for d in range(f.shape[0]):
        _add(f[d], scratch[d], n)
        _subtract(f[d, offset:], scratch[d], n)


class ElasticLinks(NamedTuple):
    """Springs alone. `offset` (families,), `weight` (families, particles), `tension` k l (families,) [N]."""

    offset: NDArray[np.int64]
    weight: NDArray[Any]
    stiffness: Any
    tension: NDArray[Any]
    tiny: Any

    @staticmethod
    @jit
    def force(bound, copy, x, v, f, scratch, lag):
        """Forces of every family."""
        for j in range(bound.offset.shape[0]):
            o = bound.offset[j]
            n = x.shape[1] - o
            _elastic(
                x[0], x[1], x[2], x[0, o:], x[1, o:], x[2, o:],
                bound.weight[j], bound.stiffness, bound.tension[j], bound.tiny, scratch[0], scratch[1], scratch[2], n,
            )  # fmt: skip
            _apply(f, scratch, o, n)


class IsotropicLinks(NamedTuple):
    """Springs with isotropic dampers."""

    offset: NDArray[np.int64]
    weight: NDArray[Any]
    stiffness: Any
    tension: NDArray[Any]
    tiny: Any
    viscosity: Any

    @staticmethod
    @jit
    def force(bound, copy, x, v, f, scratch, lag):
        """Forces of every family."""
        for j in range(bound.offset.shape[0]):
            o = bound.offset[j]
            n = x.shape[1] - o
            _isotropic(
                x[0], x[1], x[2], v[0], v[1], v[2], x[0, o:], x[1, o:], x[2, o:], v[0, o:], v[1, o:], v[2, o:],
                bound.weight[j], bound.stiffness, bound.tension[j], bound.viscosity, bound.tiny,
                scratch[0], scratch[1], scratch[2], n,
            )  # fmt: skip
            _apply(f, scratch, o, n)


class AxialLinks(NamedTuple):
    """Springs with axial dampers."""

    offset: NDArray[np.int64]
    weight: NDArray[Any]
    stiffness: Any
    tension: NDArray[Any]
    tiny: Any
    viscosity: Any

    @staticmethod
    @jit
    def force(bound, copy, x, v, f, scratch, lag):
        """Forces of every family."""
        for j in range(bound.offset.shape[0]):
            o = bound.offset[j]
            n = x.shape[1] - o
            _axial(
                x[0], x[1], x[2], v[0], v[1], v[2], x[0, o:], x[1, o:], x[2, o:], v[0, o:], v[1, o:], v[2, o:],
                bound.weight[j], bound.stiffness, bound.tension[j], bound.viscosity, bound.tiny,
                scratch[0], scratch[1], scratch[2], n,
            )  # fmt: skip
            _apply(f, scratch, o, n)


@dataclass(frozen=True)
class LinkEffect(Effect):
    """Springs and dampers along the link directions `steps`.

    Parameters
    ----------
    stiffness
        Of every link [N/m], >= 0.
    viscosity
        Of every link [N s/m], >= 0.
    damping
        "isotropic" (the report's) or "axial".
    tapered
        Whether stiffness and viscosity follow the mass taper, as in the report's program: a link takes the mean of its ends.
    """

    steps: ClassVar[tuple[Step, ...]] = ()

    stiffness: float = 0.0
    viscosity: float = 0.0
    damping: str = "isotropic"
    tapered: bool = False

    def __post_init__(self) -> None:
        object.__setattr__(self, "stiffness", validate.number("stiffness", self.stiffness, minimum=0.0))
        object.__setattr__(self, "viscosity", validate.number("viscosity", self.viscosity, minimum=0.0))
        validate.choice("damping", self.damping, ("isotropic", "axial"))
        object.__setattr__(self, "tapered", validate.boolean("tapered", self.tapered))

    def families(self, lattice: Lattice) -> tuple[Family, ...]:
        """The link families that the effect acts along."""
        return lattice.families(*self.steps)

    def bind(self, lattice: Lattice, dtype: np.dtype[Any], copies: int) -> Any:
        """Weights and constants of every family, in the scene's dtype."""
        del copies
        families = self.families(lattice)
        weight = np.zeros((len(families), lattice.size), dtype)
        for row, family in zip(weight, families, strict=True):
            row[: len(family.present)] = family.weight(self.tapered)
        number = dtype.type
        springs = (
            np.array([family.offset for family in families], np.int64),
            weight,
            number(self.stiffness),
            np.array([self.stiffness * family.length for family in families], dtype),
            number(TINY),
        )
        if self.viscosity == 0:
            return ElasticLinks(*springs)
        kind = AxialLinks if self.damping == "axial" else IsotropicLinks
        return kind(*springs, number(self.viscosity))

    def link_terms(self, lattice: Lattice) -> tuple[LinkTerm, ...]:
        """Since 1 - l/d <= 1, no pose makes a spring stiffer than k, and an axial damper never exceeds an isotropic one."""
        return tuple(
            LinkTerm(family, self.stiffness * family.weight(self.tapered), self.viscosity * family.weight(self.tapered))
            for family in self.families(lattice)
        )

    def energy(self, lattice: Lattice, positions: NDArray[np.float64]) -> NDArray[np.float64]:
        """Sum of w k (d - l)^2 / 2 [J], shape (copies,)."""
        total = np.zeros(len(positions))
        for family in self.families(lattice):
            difference = positions[:, family.offset :] - positions[:, : positions.shape[1] - family.offset]
            stretch = np.linalg.norm(difference, axis=-1) - family.length
            total += 0.5 * self.stiffness * (family.weight(self.tapered) * stretch**2).sum(axis=-1)
        return total

    def scaled(self, stiffness: float, viscosity: float) -> LinkEffect:
        """The same links with stiffness and viscosity multiplied."""
        return replace(self, stiffness=self.stiffness * stiffness, viscosity=self.viscosity * viscosity)
