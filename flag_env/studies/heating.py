"""Whether undamped cloth heats: energy of flags that are thrown and left alone, over the share of the step limit, and its price.

Every particle of an 8 x 12 flag without gravity, wind and drag gets a random velocity; four copies fly for many steps. Energy has
no source, so E/E0 above 1 is the method's own doing. The automatic step takes a smaller share of the limit where that happens.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from flag_env.physics import Diverged, Scene, Simulator, max_timestep, presets
from flag_env.physics.effects import CosineWind, Gravity
from flag_env.physics.integrators import LFAB, RK4, Leapfrog, Strang

SHARES = (0.9, 0.7, 0.5)
VISCOSITIES = (0.0, 3e-4, 0.02)
SPEED = 5.0
"""Standard deviation of a component of the velocities [m/s]."""

COPIES, LOOKS = 4, 20


def worst_energy(scene: Scene, steps: int) -> float:
    """Largest E/E0 of thrown copies; infinite where one diverges."""
    simulator = Simulator(scene, COPIES)
    simulator.set_velocities(SPEED * np.random.default_rng(0).standard_normal(simulator.positions.shape))
    start, worst = _energy(simulator), 0.0
    for _ in range(LOOKS):
        try:
            simulator.step(steps // LOOKS)
        except Diverged:
            return float("inf")
        worst = max(worst, float((_energy(simulator) / start).max()))
    return worst


def _energy(simulator: Simulator) -> NDArray[np.float64]:
    return np.sum(list(simulator.energy().values()), axis=0)  # type: ignore[no-any-return]


def heating(steps: int) -> list[dict[str, Any]]:
    """A row for each method and viscosity: E/E0 at every share, the automatic step's share, and its cost beside 0.9."""
    rows = []
    for method in tqdm((Leapfrog(), LFAB(), Strang(), RK4()), desc="undamped cloth"):
        for viscosity in VISCOSITIES:
            scene = presets.flag(8, 12, viscosity=viscosity, drag=0.0, integrator=method).without(Gravity, CosineWind)
            limit = max_timestep(scene)
            energies = {f"E/E0 at {share}": worst_energy(scene.replace(timestep=share * limit), steps) for share in SHARES}
            auto = Simulator(scene).timestep / limit
            row = {"integrator": type(method).__name__, "viscosity [N s/m]": viscosity, "steps": steps}
            rows.append(row | energies | {"automatic share": round(auto, 3), "price": round(0.9 / auto, 2)})
    return rows
