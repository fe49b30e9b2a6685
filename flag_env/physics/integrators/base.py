"""What every integrator offers; see `flag_env.physics.compiling.step` for the compiled half."""

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

    def guaranteed_step(self, quadratic: float, linear: float, bound: float) -> float:
        """A step [s] that is no larger than `largest_step`, known at once; some ten per cent to a half smaller."""
        ...

    def largest_step(
        self, quadratic: float, linear: float, bound: float, stop_above: float = math.inf, least: float = 0.0
    ) -> float:
        """Largest h [s] for which the top eigenvalue of M^-1 (quadratic h^2 K + linear h Z) does not exceed `bound`.

        Never above it, and at most some 0.2 % below. With linear < 0, Z is only damping that acts along every direction in every
        pose; where links may break, that holds with any of them broken. Where it is at least `stop_above`, so is the answer, but
        no more is promised: that is quickly seen. Likewise where it is below `least`.
        """
        ...

    def damped_step(self, stop_above: float = math.inf) -> float:
        """Largest h [s] for which h K <= Z as matrices, counting only damping that acts along every direction in every pose.

        Where links may break, that holds with any of them broken. `stop_above` is as in `largest_step`.
        """
        ...


DAMPED = 1e-3
"""Stiffness counts as damped at a timestep h where Z >= DAMPED h K as matrices: measured, violent motion then loses energy."""


@dataclass(frozen=True)
class Integrator:
    """Description of a time integration method: immutable, hashable, picklable.

    Attributes
    ----------
    order
        Declared order of accuracy of positions, and of the velocities that a simulator hands out.
    undamped_share
        Share of the limit up to which the energy of undamped cloth in violent motion stays; `timestep="auto"` takes no more where
        some stiffness is undamped.
    solves_damping
        Whether a step solves with the scene's damping, as bounded, so that a viscosity is felt there too.
    """

    order: ClassVar[int]
    undamped_share: ClassVar[float] = 0.9
    solves_damping: ClassVar[bool] = False

    @property
    def evaluations(self) -> int:
        """Evaluations of the forces in a step."""
        return 1

    @property
    def solutions(self) -> int:
        """Solutions with a constant banded factor in a step."""
        return 0

    def limit(self, spectrum: Spectrum) -> float:
        """Largest stable timestep [s]; infinite where nothing limits it, 0 where no timestep is stable."""
        raise NotImplementedError(f"{type(self).__name__} must define limit(spectrum)")

    def useful(self, spectrum: Spectrum) -> float:
        """Largest timestep worth taking [s], of which `timestep="auto"` takes 0.9: the limit, unless accuracy ends sooner."""
        return self.limit(spectrum)

    def bind(self, dtype: np.dtype[Any], timestep: float, spectrum: Spectrum) -> Any:
        """Typed constants for the compiled step, as a NamedTuple whose type carries the kernels."""
        raise NotImplementedError(f"{type(self).__name__} must define bind(dtype, timestep, spectrum)")


def positive_root(a: float, b: float, bound: float) -> float:
    """Positive h with a h^2 + b h = bound, for a >= 0 and bound >= 0; infinite where there is none."""
    a = max(a, 0.0)  # but for round-off
    spread = math.sqrt(b * b + 4.0 * a * bound)
    if b < 0.0:
        return 0.5 * (spread - b) / a if a > 0.0 else math.inf
    return 2.0 * bound / (b + spread) if b + spread > 0.0 else math.inf
