"""What a benchmark makes of a training's learning curve, and the threads that a training takes."""

import torch

from training.benchmark import seconds_to
from training.train import run


def test_time_to_a_success_is_the_share_of_the_steps_at_the_first_point_that_has_it():
    curve = [{"timesteps": steps, "success_5": success} for steps, success in ((0, 0.0), (500, 0.96), (800, 0.9), (1000, 1.0))]
    assert seconds_to(0.95, curve, 1000, 60.0) == 30.0
    assert seconds_to(0.97, curve, 1000, 60.0) == 60.0
    assert seconds_to(0.95, curve[:1], 1000, 60.0) is None


def test_a_training_leaves_torch_one_thread(tiny):
    """The simulator's threads have the other cores."""
    torch.set_num_threads(2)
    run(tiny(total_timesteps=128))
    assert torch.get_num_threads() == 1
