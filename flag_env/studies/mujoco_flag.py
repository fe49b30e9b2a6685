"""The flag of the speed study as MuJoCo's flex cloth; a baseline, left out where `mujoco` is not installed.

Its membrane is as stiff as the springs: Young's modulus times thickness is the structural links' stiffness, so that both stretch
alike under their weight; mass, size, pins and lattice are the same. It has no taper, no bending and no contacts, which spares
MuJoCo work. Of a list of timesteps, the one with most simulated seconds per second counts among those that keep the cloth finite
and within the stretch that half the smallest of them gives, by a tenth.
"""

from __future__ import annotations

import importlib.util
import time
from typing import Any, NamedTuple

import numpy as np

from flag_env.physics import Scene, effects

TIMESTEPS = (0.02, 0.01, 0.005, 0.002)
"""Tried for the cloth [s]."""

_THICKNESS = 1e-3

_MODEL = """<mujoco>
  <option timestep="{timestep}" integrator="discrete" solver="CG" tolerance="1e-6"/>
  <size memory="200M"/>
  <worldbody>
    <flexcomp name="flag" type="grid" dim="2" dof="full" count="{cols} {rows} 1" spacing="{along} {up} 1" mass="{mass}"
              radius="0.001">
      <elasticity young="{young}" poisson="0" thickness="{thickness}" damping="0.0005" elastic2d="stretch"/>
      <contact selfcollide="none" contype="0" conaffinity="0"/>
      <pin gridrange="0 0 0 {last}"/>
    </flexcomp>
  </worldbody>
</mujoco>"""


class Cloth(NamedTuple):
    """Simulated seconds per second, at which timestep [s], and the largest stretch of a link along the rows."""

    speed: float
    timestep: float
    stretch: float


def seconds_per_second(scene: Scene, seconds: float) -> Cloth | None:
    """The cloth's best speed over `seconds` of falling from the flat pose, the quickest of three runs; None without MuJoCo."""
    if importlib.util.find_spec("mujoco") is None:
        return None
    runs = [max(_run(scene, timestep, seconds) for _ in range(3)) for timestep in (0.5 * TIMESTEPS[-1], *TIMESTEPS)]
    most = 1.1 * runs[0].stretch
    return max((run for run in runs[1:] if run.stretch <= most), default=runs[0])


def _run(scene: Scene, timestep: float, seconds: float) -> Cloth:
    import mujoco

    lattice = scene.lattice
    along, up = lattice.spacings[:2]
    (stiffness,) = (effect.stiffness for effect in scene.effects if isinstance(effect, effects.Structural))
    text = _MODEL.format(
        timestep=timestep, cols=lattice.cols, rows=lattice.rows, along=along, up=up, mass=lattice.masses.sum(),
        young=stiffness / _THICKNESS, thickness=_THICKNESS, last=lattice.rows - 1,
    )  # fmt: skip
    model: Any = mujoco.MjModel.from_xml_string(text)
    data: Any = mujoco.MjData(model)
    steps = max(1, round(seconds / timestep))
    start = time.perf_counter()
    for _ in range(steps):
        mujoco.mj_step(model, data)
    spent = time.perf_counter() - start
    places = np.array(data.flexvert_xpos).reshape(lattice.cols, lattice.rows, 3)
    stretch = float(np.abs(np.linalg.norm(np.diff(places, axis=0), axis=2) / along - 1.0).max())
    return Cloth(steps * timestep / spent, timestep, stretch if np.isfinite(stretch) else np.inf)
