"""A rollout as a function that torch differentiates; needs torch, of the extra "training"."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from flag_env.physics import Rollout

if TYPE_CHECKING:
    from torch import Tensor


def simulate(
    rollout: Rollout, seconds: float, wind: Tensor | None = None, mast: Tensor | None = None,
    positions: Tensor | None = None, velocities: Tensor | None = None,
) -> tuple[Tensor, Tensor]:  # fmt: skip
    """Positions at the end of each action, (actions, copies, layers, rows, cols, 3) [m], and velocities at the very end [m/s].

    The tensors are those that `Rollout.run` takes, on the CPU, positions and velocities for each copy; gradients flow to all that
    ask for them. The rollout keeps one run at a time: go back before the next.

    Raises
    ------
    ValueError
        As from `Rollout.run`.
    RuntimeError
        On the way back, if the rollout has run again since.
    """
    result: tuple[Tensor, Tensor] = _function().apply(rollout, seconds, wind, mast, positions, velocities)
    return result


def _function() -> Any:
    """The torch function, made when it is first needed: to import torch takes seconds."""
    if not _made:
        _made.append(_make())
    return _made[0]


_made: list[Any] = []


def _make() -> Any:
    import torch

    class Simulate(torch.autograd.Function):
        @staticmethod
        def forward(
            context: Any, rollout: Rollout, seconds: float, *inputs: Tensor | None
        ) -> tuple[Tensor, Tensor]:  # fmt: skip
            names = ("wind", "mast", "positions", "velocities")
            arrays = {
                name: tensor.detach().numpy() for name, tensor in zip(names, inputs, strict=True) if tensor is not None
            }  # fmt: skip
            rollout.run(seconds=seconds, **arrays)
            context.rollout, context.number, context.inputs = rollout, rollout.runs, dict(zip(names, inputs, strict=True))
            kind = next((tensor.dtype for tensor in inputs if tensor is not None), torch.float64)
            return torch.from_numpy(rollout.path).to(kind), torch.from_numpy(rollout.velocities).to(kind)

        @staticmethod
        def backward(context: Any, by_path: Tensor, by_velocities: Tensor) -> tuple[Any, ...]:
            if context.rollout.runs != context.number:
                raise RuntimeError("rollout must not have run again before the way back: it keeps one run at a time")
            gradient = context.rollout.pull_back(by_path.numpy(), by_velocities.numpy())
            back = (
                None if tensor is None else torch.from_numpy(getattr(gradient, name)).to(tensor.dtype)
                for name, tensor in context.inputs.items()
            )  # fmt: skip
            return None, None, *back

    return Simulate
