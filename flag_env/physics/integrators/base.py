"""What every integrator offers; see `flag_env.physics.compose` for the compiled half."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, Protocol

import numpy as np


class Spectrum(Protocol):
    """What a step limit may ask of a scene: its stiffness K, damping Z and mass M, bounded over all poses."""

    def largest_step(self, quadratic: float, linear: float, bound: float) -> float:
        """Largest h [s] for which the top eigenvalue of M^-1 (quadratic h^2 K + linear h Z) does not exceed `bound`."""
        ...


@dataclass(frozen=True)
class Integrator:
    """Description of a time integration method: immutable, hashable, picklable.

    Attributes
    ----------
    order
        Declared order of accuracy of positions.
    """

    order: ClassVar[int]

    def limit(self, spectrum: Spectrum) -> float:
        """Largest stable timestep [s]; infinite where nothing limits it."""
        raise NotImplementedError(f"{type(self).__name__} must define limit(spectrum)")

    def bind(self, dtype: np.dtype[Any], timestep: float) -> Any:
        """Typed constants for the compiled step, as a NamedTuple whose type carries the kernels."""
        raise NotImplementedError(f"{type(self).__name__} must define bind(dtype, timestep)")
