"""Near pairs of particles, found by cells of space and by blocks of the lattice."""

from flag_env.physics.effects.contact.blocks import Blocks, blocks_of, codes, find_pairs_by_blocks
from flag_env.physics.effects.contact.cells import (
    copy_into,
    count_different,
    count_moved,
    find_pairs,
    sort_into_cells,
    table_size,
)
from flag_env.physics.effects.contact.mast_cells import SHALLOW, edges_near, keep_cells_out, retrace, trace
from flag_env.physics.effects.contact.pairs import make_list, treat_pairs

__all__ = [
    "SHALLOW",
    "Blocks",
    "blocks_of",
    "codes",
    "copy_into",
    "count_different",
    "count_moved",
    "edges_near",
    "find_pairs",
    "find_pairs_by_blocks",
    "keep_cells_out",
    "make_list",
    "retrace",
    "sort_into_cells",
    "table_size",
    "trace",
    "treat_pairs",
]
