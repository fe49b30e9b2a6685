"""Lines of links whose lengths are corrected together."""

from flag_env.physics.effects.strain.lines import holds, shorten

__all__ = ["holds", "shorten"]
