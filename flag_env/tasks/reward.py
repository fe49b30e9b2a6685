"""Rewards of a step: named terms that sum to the reward.

`d` is the distance to the target (RMS over the particles / flag diagonal), `tolerance` the distance that counts as reached.

"shaped":  in_tolerance = 0.1 [d < tolerance];  approach = 3 (d_before - 0.98 d)
"dense":   distance = -d
"sparse":  miss = -[d >= tolerance]

The approach term is the difference of a potential -3 d, discounted by 0.98 (Ng, Harada, Russell 1999). Summed with the weights
0.98^t over an episode of n steps it telescopes, whatever the actions: 3 d_0 - 3 * 0.98^n d_n. For an agent that discounts by 0.98
the shaped return is thus that of the bonuses alone, plus what the start decides, less 3 * 0.98^n d_n: 0.66 d_75 at the usual end.
That last part is a second aim, not nothing: episodes end by time, where the potential has not vanished, so that of two policies
with nearly the same bonuses the one that ends nearer is preferred. With another discount the sum does not telescope, and rewards
at other times than the last count too; undiscounted it is 3 d_0 - 3 d_n + 0.06 (d_1 + ... + d_n).
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
