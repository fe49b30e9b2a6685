"""flag_env: a mass-spring flag simulated in Numba, as Gymnasium environments.

Importing the package registers its environments; the simulator and the renderer load when they are first needed.
"""

import gymnasium

__version__ = "0.1.0"


def _register() -> None:
    single, many = "flag_env.envs.flag:FlagEnv", "flag_env.envs.vector:FlagVectorEnv"
    goal, goals = "flag_env.envs.goal:FlagGoalEnv", "flag_env.envs.vector:FlagGoalVectorEnv"
    for name, one, vector, kwargs in (
        ("Flag-v0", single, many, {}),
        ("FlagGoal-v0", goal, goals, {"reward": "sparse"}),
        ("FlagGoalDense-v0", goal, goals, {"reward": "dense"}),
    ):
        if name not in gymnasium.registry:  # a second import must not warn
            gymnasium.register(name, entry_point=one, vector_entry_point=vector, max_episode_steps=75, kwargs=kwargs)


_register()
