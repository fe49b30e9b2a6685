"""Draws witnesses of a level and keeps those that make a fair target.

Kept is a witness whose target is

- well-posed: from a start in which every free particle is moved by 1 mm, the same actions stay within half the tolerance of it;
- not reached by doing nothing;
- at least two tolerances away from the flag at rest, and as far from every target of the splits before as the level asks for.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flag_env.envs.batch import replay
from flag_env.envs.config import EPISODE_STEPS, FlagConfig
from flag_env.envs.observation import observed_nodes
from flag_env.tasks import Targets

PERTURBATION = 1e-3
"""RMS displacement of a free particle at the start [m]."""

_CHUNK = 64


@dataclass
class Library:
    """Frames of the targets found so far, (targets, steps x 3 particles) float32 each."""

    frames: list[NDArray[np.float32]]

    def nearest(self, frames: NDArray[np.float32]) -> NDArray[np.float64]:
        """Least RMS distance of each of these frames to those here [m]."""
        particles = frames.shape[1] / 3
        least = np.full(len(frames), np.inf)
        for others in self.frames:
            square = (frames**2).sum(axis=1)[:, None] + (others**2).sum(axis=1) - 2.0 * frames @ others.T
            least = np.minimum(least, np.sqrt(np.maximum(square.min(axis=1), 0.0) / particles))
        return least


NONE = Targets(
    np.zeros((0, 1, 0), np.float32), np.array([EPISODE_STEPS]), np.zeros((0, 3), np.float32), np.zeros(0), own_turbulence=True
)
"""Stands for targets that are still to be drawn."""


def proven(
    config: FlagConfig,
    count: int,
    rng: np.random.Generator,
    others: Library,
    shifted: bool = False,
    progress: Callable[[int], Any] = lambda found: None,
) -> Targets:
    """So many targets of a level.

    Parameters
    ----------
    config
        The task.
    count
        How many targets.
    rng
        Draws witnesses, hidden winds and perturbations.
    others
        Those of other splits, to which the new ones are added.
    shifted
        Whether hidden winds are beyond the level's range, up to `Level.shifted_wind`.
    progress
        Called with the number of targets that each batch of candidates has brought.
    """
    scene, goal = config.resolved_scene(), config.task.goal
    diagonal, rest = scene.lattice.diagonal, scene.lattice.rest_positions
    still = np.tile(rest.astype(np.float32).reshape(1, -1), (1, goal.steps))
    kept: list[tuple[NDArray[Any], NDArray[Any], NDArray[Any]]] = []
    while len(kept) < count:
        drawn = _draw(config, rng, shifted)
        start = rest + np.where(scene.lattice.fixed.reshape(rest.shape[:-1])[..., None], 0.0, _noise(rng, rest.shape))
        poses = replay(config, drawn, range(_CHUNK), goal.steps)

        def away(actions: Targets, start: NDArray[np.float64] | None, poses: NDArray[np.float64] = poses) -> NDArray[np.float64]:
            """Largest distance to the candidates' targets on the steps that count, in flag diagonals."""
            other = replay(config, actions, range(_CHUNK), goal.steps, start)
            square = ((other - poses) ** 2).sum(axis=-1).mean(axis=(2, 3, 4)).max(axis=0)
            return np.sqrt(square) / diagonal  # type: ignore[no-any-return]

        fair = away(drawn, start) < 0.5 * config.tolerance
        fair &= away(replace(drawn, witnesses=np.zeros_like(drawn.witnesses)), None) > config.tolerance
        frames = poses.swapaxes(0, 1).reshape(_CHUNK, -1).astype(np.float32)
        for known, apart in ((Library([still]), 2.0), (others, config.task.apart)):
            fair &= known.nearest(frames) > apart * config.tolerance * diagonal
        found = np.flatnonzero(fair)[: count - len(kept)]
        kept += [(drawn.witnesses[i], drawn.wind[i], frames[i]) for i in found]
        progress(len(found))
    witnesses, wind, frames = (np.stack(column) for column in zip(*kept, strict=True))
    others.frames.append(frames)
    ends = frames.reshape(count, goal.steps, -1, 3)[:, -1, observed_nodes(scene)].astype(np.float64)
    return Targets(witnesses, drawn.spans, wind, np.zeros(0), ends, config.task.turbulent)


def _draw(config: FlagConfig, rng: np.random.Generator, shifted: bool) -> Targets:
    """Candidates: witnesses with their hidden winds."""
    level, size = config.task, config.control_type.size
    assert level.witness is not None
    drawn = [level.witness(rng, size) for _ in range(_CHUNK)]
    witnesses = np.stack([knots for knots, _ in drawn]).astype(np.float32)
    hidden, range_ = np.array(level.hidden_wind), np.array(level.shifted_wind if shifted else level.hidden_wind)
    wind = range_ * rng.uniform(-1, 1, (_CHUNK, 3))
    while shifted and (inside := (np.abs(wind) <= hidden).all(axis=1) & hidden.any()).any():
        wind[inside] = range_ * rng.uniform(-1, 1, (int(inside.sum()), 3))
    return Targets(witnesses, np.array(drawn[0][1]), wind.astype(np.float32), np.zeros(0), own_turbulence=level.turbulent)


def _noise(rng: np.random.Generator, shape: tuple[int, ...]) -> NDArray[np.float64]:
    """Displacements of 1 mm in random directions."""
    given = rng.standard_normal((_CHUNK, *shape))
    return np.asarray(PERTURBATION * given / np.linalg.norm(given, axis=-1, keepdims=True))
