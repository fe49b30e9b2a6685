"""Scenes that step with the report's leapfrog, whose recursion and limit many oracles are in closed form."""

from functools import partial

from flag_env.physics import Scene
from flag_env.physics.integrators import Leapfrog

leapfrog_scene = partial(Scene, integrator=Leapfrog())
