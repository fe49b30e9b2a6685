"""Rewards of a step: named terms that sum to the reward.

`d` is the distance to the target (RMS over the particles / flag diagonal), `tolerance` the distance that counts as reached.

"shaped":  in_tolerance = 0.1 [d < tolerance];  approach = 3 (d_before - 0.98 d)
"dense":   distance = -d
"sparse":  miss = -[d >= tolerance]

The approach term is potential-based, with potential -3 d and discount 0.98, so that it leaves the best policies as they are
(Ng, Harada, Russell 1999).
"""

from __future__ import annotations

from typing import Any

Numbers = Any  # float, or NDArray[np.float64]

BONUS = 0.1
SLOPE = 3.0
DISCOUNT = 0.98


def shaped(before: Numbers, distance: Numbers, tolerance: float) -> dict[str, Numbers]:
    """A bonus within tolerance, and for the way made towards the target."""
    return {"in_tolerance": BONUS * (distance < tolerance), "approach": SLOPE * (before - DISCOUNT * distance)}


def dense(before: Numbers, distance: Numbers, tolerance: float) -> dict[str, Numbers]:
    """Minus the distance."""
    del before, tolerance
    return {"distance": -distance}


def sparse(before: Numbers, distance: Numbers, tolerance: float) -> dict[str, Numbers]:
    """Minus one outside tolerance."""
    del before
    return {"miss": (distance < tolerance) - 1.0}


REWARDS = {"shaped": shaped, "dense": dense, "sparse": sparse}
"""Terms of each reward, of the shape of `distance`; `before` is the distance one step earlier."""
