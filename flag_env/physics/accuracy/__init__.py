"""Accuracy as a dial: the cheapest way to integrate a scene within an error, and what a scene costs."""

from flag_env.physics.accuracy.calibration import price_of
from flag_env.physics.accuracy.tuning import ACCURACIES, Description, describe, divided, tune

__all__ = ["ACCURACIES", "Description", "describe", "divided", "price_of", "tune"]
