"""How long a pose can be foretold, and what still means something after that.

Growth: two copies start 1e-9 m apart; the slope of the logarithm of their RMS distance is the rate at which an error grows. An
error of integration is worth comparing path by path up to the horizon, t = ln(1 mm / 1e-9 m) / rate.

Past it a flag is compared by what it does on average: 32 copies, each of its own start, are watched for some seconds from the
horizon on (a quick run does not wait for it), and each gives its time-mean pose, the variance of its tip's height, the centroid
of the spectrum of its tip's motion across the wind, and quantiles of its strain. Means over the copies come with 95 % intervals
of the bootstrap over copies (`scipy.stats.bootstrap`, percentile method), which need not assume that the frames of one copy are
independent.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import scipy.signal
import scipy.stats
from numpy.typing import NDArray

from flag_env.physics import Scene, Simulator
from flag_env.physics.diagnostics import strain
from flag_env.physics.integrators import LFAB
from flag_env.studies.accuracy_scenes import stepped

SEEDS = 32
"""Copies that statistics are taken over."""

FRAME = 0.02
"""Seconds between two looks at a flag."""

KEPT = 5
"""Looks at two copies from one that is kept to the next."""

QUANTILES = (0.5, 0.95, 0.99)
"""Of the strain of structural links."""

_SMALL, _LARGE = 1e-9, 1e-3
_ROUND_OFF = 1e-14
"""Distance below which rounding keeps copies apart [m]."""

Array = NDArray[np.float64]


def growth(scene: Scene, seconds: float) -> dict[str, Any]:
    """Distance of two copies over time [m], the rate of growth [1/s] and the horizon [s], None if nothing grows."""
    simulator = Simulator(stepped(scene.replace(integrator=LFAB()), 0.5, FRAME), copies=2)
    start = simulator.positions
    noise = np.random.default_rng(0).standard_normal(start.shape[1:])
    noise[:, :, 0] = 0.0
    start[1] = start[0] + _SMALL * noise / np.sqrt((noise**2).sum(axis=-1).mean())
    simulator.set_positions(start)
    times, apart = [0.0], [_SMALL]
    for _ in range(round(seconds / FRAME)):
        simulator.advance(FRAME)
        x = simulator.positions
        times.append(simulator.time)
        apart.append(float(np.sqrt(((x[1] - x[0]) ** 2).sum(axis=-1).mean())))
    t, d = np.array(times), np.array(apart)
    first = min(len(t) // 10, round(1.0 / FRAME))
    ends = np.flatnonzero((d[first:] > _LARGE) | (d[first:] < _ROUND_OFF))
    usable = slice(first, first + ends[0] if len(ends) else None)
    rate = float(np.polyfit(t[usable], np.log(d[usable]), 1)[0])
    kept = slice(None, None, KEPT)
    until = math.log(_LARGE / _SMALL) / rate if rate > 0 else None
    return {"times": times[kept], "distances": apart[kept], "rate": rate, "horizon": until}


def watch(scene: Scene, settle: float, seconds: float) -> dict[str, Any]:
    """What each copy does on average: see the module; lists with one entry a copy."""
    simulator = Simulator(scene.replace(perturbation=0.1 * scene.lattice.spacings[0]), copies=SEEDS)
    simulator.advance(settle)
    lattice = scene.lattice
    tips, pose, strains = [], np.zeros((SEEDS, *lattice.shape, 3)), []
    frames = round(seconds / FRAME)
    for _ in range(frames):
        simulator.advance(FRAME)
        x = simulator.positions
        tips.append(x[:, 0, -1, -1])
        pose += x / frames
        strains.append(strain(lattice, x))
    tip = np.array(tips)
    frequency, power = scipy.signal.welch(tip[..., 1], 1 / FRAME, nperseg=min(frames, 128), axis=0)
    spectrum = np.quantile(np.concatenate(strains, axis=1), QUANTILES, axis=1)
    return {
        "pose": pose.tolist(),
        "tip height variance": tip[..., 2].var(axis=0).tolist(),
        "tip frequency": ((frequency[:, None] * power).sum(axis=0) / power.sum(axis=0)).tolist(),
        **{f"strain {100 * q:g} %": values.tolist() for q, values in zip(QUANTILES, spectrum, strict=True)},
    }


def compare(found: dict[str, dict[str, Any]], standard: str) -> list[dict[str, Any]]:
    """One row for each run and quantity: mean over copies, its 95 % interval, and whether that meets the standard's.

    The time-mean pose is compared by its RMS distance to the mean pose of all the standard's copies [m].
    """
    centre = np.array(found[standard]["pose"]).mean(axis=0)
    rows, intervals = [], {}
    for name in sorted(found, key=lambda name: name != standard):
        values = {key: np.array(value) for key, value in found[name].items()}
        pose = values.pop("pose")
        values = {"pose from the standard's mean [m]": np.sqrt(((pose - centre) ** 2).sum(axis=-1).mean(axis=(1, 2, 3)))} | values
        for quantity, sample in values.items():
            low, high = _interval(sample)
            if name == standard:
                intervals[quantity] = low, high
            theirs = intervals[quantity]
            agrees = low <= theirs[1] and theirs[0] <= high
            rows.append(
                {"run": name, "quantity": quantity, "mean": float(sample.mean()), "low": low, "high": high, "agrees": agrees}
            )
    return rows


def _interval(sample: Array) -> tuple[float, float]:
    result = scipy.stats.bootstrap((sample,), np.mean, n_resamples=2000, method="percentile", rng=np.random.default_rng(0))
    return float(result.confidence_interval.low), float(result.confidence_interval.high)
