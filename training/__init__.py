"""Trains, evaluates and records agents on flag_env: `python -m training.train`."""
