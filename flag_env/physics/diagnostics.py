"""Measurements on scenes in motion: energies, momentum, strain. Positions and velocities as `Simulator` hands them out."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from flag_env.physics.effects import Effect, Structural
from flag_env.physics.lattice import Lattice

Array = NDArray[np.float64]


def energy(
    lattice: Lattice, effects: tuple[Effect, ...], bindings: tuple[Any, ...], positions: Array, velocities: Array
) -> dict[str, Array]:
    """Energies of the free particles [J], each of shape (copies,): "kinetic" and one entry per conservative effect.

    Parameters
    ----------
    lattice, effects
        The scene's.
    bindings
        The effects' data in a run, where links may have broken.
    positions, velocities : (copies, layers, rows, cols, 3)
        [m], [m/s].
    """
    flat = positions.reshape(len(positions), -1, 3)
    result = {"kinetic": 0.5 * (velocities.reshape(flat.shape) ** 2).sum(axis=-1) @ _free_masses(lattice)}
    for effect, data in zip(effects, bindings, strict=True):
        potential = effect.energy(lattice, flat, data)
        if potential is not None:
            result[_snake(type(effect).__name__) + (f"_{effect.name}" if effect.name else "")] = potential
    return result


def momentum(lattice: Lattice, velocities: Array) -> Array:
    """Momentum of the free particles [kg m/s], shape (copies, 3), for velocities (copies, layers, rows, cols, 3) [m/s]."""
    return np.asarray(np.einsum("cpi,p->ci", velocities.reshape(len(velocities), -1, 3), _free_masses(lattice)))


def strain(lattice: Lattice, positions: Array) -> Array:
    """Strain d/l - 1 of every structural link, shape (copies, links), for positions (copies, layers, rows, cols, 3) [m]."""
    flat = positions.reshape(len(positions), -1, 3)
    parts = []
    for family in lattice.families(*Structural.directions):
        first = np.flatnonzero(family.present)
        length = np.linalg.norm(flat[:, first + family.offset] - flat[:, first], axis=-1)
        parts.append(length / family.length - 1.0)
    return np.concatenate([np.zeros((len(flat), 0)), *parts], axis=1)


def _free_masses(lattice: Lattice) -> Array:
    return np.where(lattice.fixed, 0.0, lattice.masses)


def _snake(name: str) -> str:
    return "".join(f"_{c.lower()}" if c.isupper() and i else c.lower() for i, c in enumerate(name))
