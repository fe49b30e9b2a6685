"""What every integrator offers; see `flag_env.physics.compose` for the compiled half."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, ClassVar, Protocol

import numpy as np
from numpy.typing import NDArray


class Spectrum(Protocol):
    """What a method may ask of a scene: stiffness K, damping Z and mass M of its free particles, bounded over all poses."""

    @property
    def free(self) -> NDArray[np.intp]:
        """Flat numbers of the free particles."""
        ...

    @property
    def masses(self) -> NDArray[np.float64]:
        """Masses of the free particles [kg]."""
        ...

    @property
    def stiffness(self) -> Any:
        """Sparse M^-1/2 K M^-1/2 [1/s^2]; one matrix serves every coordinate."""
        ...

    @property
    def damping(self) -> Any:
        """Sparse M^-1/2 Z M^-1/2 [1/s]."""
        ...

    def sure_step(self, quadratic: float, linear: float, bound: float) -> float:
        """A step [s] that is no larger than `largest_step`, known at once; some ten per cent to a half smaller."""
        ...

    def largest_step(self, quadratic: float, linear: float, bound: float, enough: float = math.inf, least: float = 0.0) -> float:
        """Largest h [s] for which the top eigenvalue of M^-1 (quadratic h^2 K + linear h Z) does not exceed `bound`.

        With linear < 0, Z is only damping that acts along every direction in every pose; where links may break, that holds with
        any of them broken. Where it is at least `enough`, so is the answer, but no more is promised: that is quickly seen.
        Likewise where it is below `least`.
        """
        ...

    def damped_step(self, enough: float = math.inf) -> float:
        """Largest h [s] for which h K <= Z as matrices, counting only damping that acts along every direction in every pose.

        Where links may break, that holds with any of them broken. `enough` is as in `largest_step`.
        """
        ...


@dataclass(frozen=True)
class Integrator:
    """Description of a time integration method: immutable, hashable, picklable.

    Attributes
    ----------
    order
        Declared order of accuracy of positions, and of the velocities that a simulator hands out.
    """

    order: ClassVar[int]

    @property
    def evaluations(self) -> int:
        """Evaluations of the forces in a step."""
        return 1

    def limit(self, spectrum: Spectrum) -> float:
        """Largest stable timestep [s]; infinite where nothing limits it, 0 where no timestep is stable."""
        raise NotImplementedError(f"{type(self).__name__} must define limit(spectrum)")

    def useful(self, spectrum: Spectrum) -> float:
        """Largest timestep worth taking [s], of which `timestep="auto"` takes 0.9: the limit, unless accuracy ends sooner."""
        return self.limit(spectrum)

    def bind(self, dtype: np.dtype[Any], timestep: float, spectrum: Spectrum) -> Any:
        """Typed constants for the compiled step, as a NamedTuple whose type carries the kernels."""
        raise NotImplementedError(f"{type(self).__name__} must define bind(dtype, timestep, spectrum)")
