"""What a scene's effects add to its stiffness and damping at most, in any pose, as plain arrays."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from flag_env.physics.effects import Effect, Key
from flag_env.physics.lattice import Lattice

Array = NDArray[np.float64]
Scales = Mapping[Key, tuple[float, float]]
"""Factors on stiffness and damping of effects, by their keys; 1 where there is none."""


class Terms(NamedTuple):
    """Bounds of every link and of every particle by itself.

    Attributes
    ----------
    first, second : (links,)
        Flat numbers of a link's ends.
    stiffness, viscosity, lasting : (links,)
        [N/m]; [N s/m]; the viscosity that acts along every direction in every pose.
    anchor : (particles,)
        Stiffness towards a point that does not move with the cloth [N/m].
    drag, lasting_drag : (particles,)
        Damping against what does not move with the cloth [N s/m]; that which acts along every direction at every velocity.
    """

    first: NDArray[np.intp]
    second: NDArray[np.intp]
    stiffness: Array
    viscosity: Array
    lasting: Array
    anchor: Array
    drag: Array
    lasting_drag: Array


def terms_of(lattice: Lattice, effects: tuple[Effect, ...], scales: Scales) -> Terms:
    """The bounds of some effects on a lattice."""
    ends: list[Any] = [np.zeros((2, 0), np.intp)]
    values: list[Array] = [np.zeros((3, 0))]
    anchor, drag, lasting_drag = np.zeros((3, lattice.size))
    for effect in effects:
        stiff, damped = scales.get(effect.key, (1.0, 1.0))
        bound = effect.linear_bound(lattice)
        for family, stiffness, viscosity, isotropic in bound.links:
            start = np.flatnonzero((stiffness != 0.0) | (viscosity != 0.0))
            ends.append(np.stack([start, start + family.offset]))
            k, z = stiff * stiffness[start], damped * viscosity[start]
            values.append(np.stack([k, z, z * isotropic]))
        if bound.stiffness is not None:
            anchor += stiff * bound.stiffness
        if bound.drag is not None:
            drag += damped * bound.drag
            lasting_drag += damped * bound.drag * bound.isotropic
    first, second = np.concatenate(ends, axis=1)
    stiffness, viscosity, lasting = np.concatenate(values, axis=1)
    return Terms(first, second, stiffness, viscosity, lasting, anchor, drag, lasting_drag)
