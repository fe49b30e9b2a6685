"""flag_env: a mass-spring flag simulated in Numba, as Gymnasium environments.

Importing the package registers its environments; the simulator and the renderer load when they are first needed.
"""

import gymnasium

__version__ = "0.1.0"

for _id, _entry_point in {"Flag-v0": "flag_env.envs.flag:FlagEnv"}.items():
    if _id not in gymnasium.registry:
        gymnasium.register(_id, entry_point=_entry_point, max_episode_steps=75)

del _id, _entry_point
