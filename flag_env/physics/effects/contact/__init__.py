"""Contact: near pairs of particles, and cloth against the pole."""

from flag_env.physics.effects.contact.blocks import Blocks, blocks_of, codes, find_pairs_by_blocks
from flag_env.physics.effects.contact.cells import (
    copy_into,
    count_different,
    count_moved,
    find_pairs,
    sort_into_cells,
    table_size,
)
from flag_env.physics.effects.contact.mast_cells import SHALLOW, keep_cells_out
from flag_env.physics.effects.contact.mast_motion import edges_near, retrace, trace
from flag_env.physics.effects.contact.mast_particles import count_near_pole, dot, keep_particles_out, push_particles_out
from flag_env.physics.effects.contact.pairs import make_list, treat_pairs

__all__ = [
    "SHALLOW",
    "Blocks",
    "blocks_of",
    "codes",
    "copy_into",
    "count_different",
    "count_moved",
    "count_near_pole",
    "dot",
    "edges_near",
    "find_pairs",
    "find_pairs_by_blocks",
    "keep_cells_out",
    "keep_particles_out",
    "make_list",
    "push_particles_out",
    "retrace",
    "sort_into_cells",
    "table_size",
    "trace",
    "treat_pairs",
]
