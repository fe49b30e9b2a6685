"""Rewards of a step: named terms that sum to the reward.

`d` is the distance to the target (RMS over the particles / flag diagonal), `tolerance` the distance that counts as reached.

"shaped":  in_tolerance = 0.1 [d < tolerance];  approach = 3 (d_before - 0.98 d)
"dense":   distance = -d
"sparse":  miss = -[d >= tolerance]
"track":   in_tolerance = 0.1 [d < tolerance];  closeness = 0.1 exp(-(d / 2 tolerance)^2);  distance = -0.3 d
"snap":    approach as above, and at the last step  reached = [d < tolerance];  closeness = 2 exp(-d / tolerance)

The approach term is the difference of a potential -3 d, discounted by 0.98 (Ng, Harada, Russell 1999). Summed with the weights
0.98^t over an episode of n steps it telescopes, whatever the actions: 3 d_0 - 3 * 0.98^n d_n. For an agent that discounts by 0.98
the shaped return is thus that of the bonuses alone, plus what the start decides, less 3 * 0.98^n d_n: 0.66 d_75 at the usual end.
That last part is a second aim, not nothing: episodes end by time, where the potential has not vanished, so that of two policies
with nearly the same bonuses the one that ends nearer is preferred. With another discount the sum does not telescope, and rewards
at other times than the last count too; undiscounted it is 3 d_0 - 3 d_n + 0.06 (d_1 + ... + d_n).
"""

from __future__ import annotations

from typing import Any

import numpy as np

Numbers = Any  # float, or NDArray[np.float64]
Flags = Any  # bool, or NDArray[np.bool_]

BONUS = 0.1
SLOPE = 3.0
DISCOUNT = 0.98


def shaped(before: Numbers, distance: Numbers, tolerance: float, last: Flags = False) -> dict[str, Numbers]:
    """A bonus within tolerance, and for the way made towards the target."""
    del last
    return {"in_tolerance": BONUS * (distance < tolerance), "approach": SLOPE * (before - DISCOUNT * distance)}


def dense(before: Numbers, distance: Numbers, tolerance: float, last: Flags = False) -> dict[str, Numbers]:
    """Minus the distance."""
    del before, tolerance, last
    return {"distance": -distance}


def sparse(before: Numbers, distance: Numbers, tolerance: float, last: Flags = False) -> dict[str, Numbers]:
    """Minus one outside tolerance."""
    del before, last
    return {"miss": (distance < tolerance) - 1.0}


def track(before: Numbers, distance: Numbers, tolerance: float, last: Flags = False) -> dict[str, Numbers]:
    """A bonus within tolerance and near it, less the distance."""
    del before, last
    near = np.exp(-((distance / (2.0 * tolerance)) ** 2))
    return {"in_tolerance": BONUS * (distance < tolerance), "closeness": BONUS * near, "distance": -0.3 * distance}


def snap(before: Numbers, distance: Numbers, tolerance: float, last: Flags = False) -> dict[str, Numbers]:
    """For the way made towards the target, and at the end for being there."""
    return {
        "approach": SLOPE * (before - DISCOUNT * distance),
        "reached": 1.0 * (last & (distance < tolerance)),
        "closeness": last * (2.0 * np.exp(-distance / tolerance)),
    }


REWARDS = {"shaped": shaped, "dense": dense, "sparse": sparse, "track": track, "snap": snap}
"""Terms of each reward, of the shape of `distance`; `before` is the distance one step earlier, `last` whether it is the 75th."""

REWARD_SLOPES = {"shaped": (SLOPE, -SLOPE * DISCOUNT), "dense": (0.0, -1.0)}
"""Derivatives of rewards with respect to the distances before and after, where they have one: a bonus has none at its edge."""
