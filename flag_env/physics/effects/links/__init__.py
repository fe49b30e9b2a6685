"""Springs and dampers along families of links, and their kernels in one, two and three dimensions."""

from flag_env.physics.effects.links.groups import intact_cells, link_groups, sides_of
from flag_env.physics.effects.links.link_effect import LinkEffect

__all__ = ["LinkEffect", "intact_cells", "link_groups", "sides_of"]
