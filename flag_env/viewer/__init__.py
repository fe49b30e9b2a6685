"""A snapshot made live: a page in the browser with a flag in flight, and replays that open anywhere.

The live page needs the extra "play"; replays need nothing besides the package.
"""

from flag_env.viewer.episode import Act, Task
from flag_env.viewer.film import of_episode, of_scene, of_simulator, of_stage, pictures, save
from flag_env.viewer.host import play
from flag_env.viewer.replay import Motion, Replay
from flag_env.viewer.session import Session
from flag_env.viewer.stages import STAGES, Breeze, Stage, start
from flag_env.viewer.window import Window

__all__ = [
    "STAGES",
    "Act",
    "Breeze",
    "Motion",
    "Replay",
    "Session",
    "Stage",
    "Task",
    "Window",
    "of_episode",
    "of_scene",
    "of_simulator",
    "of_stage",
    "pictures",
    "play",
    "save",
    "start",
]
