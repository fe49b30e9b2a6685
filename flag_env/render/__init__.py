"""Pictures of a flag: a snapshot, the renderer that draws it, and the writer of videos.

Knows nothing of the simulator; matplotlib is imported when the first renderer is made.
"""

from flag_env.render.recording import write_video
from flag_env.render.renderer import Renderer
from flag_env.render.snapshot import Snapshot
from flag_env.render.style import LARGEST_SIZE, SMALLEST_SIZE, Palette, Style

__all__ = ["LARGEST_SIZE", "SMALLEST_SIZE", "Palette", "Renderer", "Snapshot", "Style", "write_video"]
