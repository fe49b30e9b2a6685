"""The links of a run: one group for each effect that has links, which effects that break or limit links are handed too."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from flag_env.physics.effects.base import Effect, LinkGroup
from flag_env.physics.lattice import SIDES, Lattice


def link_groups(lattice: Lattice, effects: tuple[Effect, ...], copies: int, dtype: np.dtype[Any]) -> tuple[LinkGroup, ...]:
    """The links of all effects that have any, for each copy on its own where an effect may break them."""
    rows = copies if any(effect.breaks for effect in effects) else 1
    groups = []
    for effect in effects:
        links = effect.link_weights(lattice)
        if links is not None:
            weight = np.zeros((rows, len(links), lattice.size), dtype)
            for j, (family, factors) in enumerate(links.values()):
                weight[:, j, : len(family.present)] = factors
            families = tuple(family for family, _ in links.values())
            groups.append(LinkGroup(effect.key, tuple(links), families, weight))
    return tuple(groups)


def sides_of(groups: tuple[LinkGroup, ...]) -> NDArray[Any] | None:
    """Weights of the links along rows and up columns, (1 or copies, 2, particles); None where no effect has both."""
    found = [group.weight for group in groups if group.directions[: len(SIDES)] == SIDES]
    return found[0] if found else None


def intact_cells(lattice: Lattice, groups: tuple[LinkGroup, ...], copies: int) -> NDArray[np.bool_]:
    """Which cells of the cloth have four unbroken sides, shape (copies, layers, rows - 1, cols - 1)."""
    sides = sides_of(groups)
    if sides is None:
        return np.ones((copies, lattice.layers, lattice.rows - 1, lattice.cols - 1), bool)
    along, up = (sides[:, axis].reshape(-1, *lattice.shape) != 0 for axis in range(2))
    whole = along[:, :, :-1, :-1] & along[:, :, 1:, :-1] & up[:, :, :-1, :-1] & up[:, :, :-1, 1:]
    return np.broadcast_to(whole, (copies, *whole.shape[1:])).copy()
