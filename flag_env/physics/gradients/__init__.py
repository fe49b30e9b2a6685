"""Derivatives of where a scene's motion ends, with respect to what moved it and what it is made of."""

from flag_env.physics.gradients.parameters import refuse_without_way_back
from flag_env.physics.gradients.rollout import Gradient, Rollout

__all__ = ["Gradient", "Rollout", "refuse_without_way_back"]
