"""What a recorded motion tells of cloth and wind: factors on stiffness and viscosity, and the mean wind, with intervals.

Least squares on the positions by exact gradients. At the minimum the Hessian H of the sum S of squared differences, by central
differences of the gradient, and the noise's variance s^2 = S / (numbers - unknowns) give the unknowns' covariance 2 s^2 H^-1
(Nocedal, Wright, Numerical Optimization, 10.1; independent noise, and a motion that is linear in the unknowns over the
interval).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import scipy.linalg
import scipy.optimize
import scipy.stats
from numpy.typing import ArrayLike, NDArray

from flag_env import _validate
from flag_env.physics import Rollout, Scene, Simulator

Array = NDArray[np.float64]

NAMES = ("stiffness", "viscosity", "wind x", "wind y", "wind z")
"""The unknowns: factors on those of all links of the scene, and the mean of its wind, in the wind's unit."""

_STEP = 1e-3
"""Step of the differences of the gradient, in the unknowns' own units."""


class Fit(NamedTuple):
    """What was found, in the order of `NAMES`.

    Attributes
    ----------
    values
        Best values.
    low, high
        Ends of the intervals of confidence.
    covariance : (5, 5)
        Of the logarithms of the factors, and of the wind in its unit.
    noise
        Standard deviation of a recorded coordinate about the fitted motion [m].
    """

    values: Array
    low: Array
    high: Array
    covariance: Array
    noise: float


class Identification:
    """Fits a scene to the recorded motion of one flag that starts as the scene does.

    Parameters
    ----------
    scene
        What the flag is thought to be; it must hold a wind, and be smooth as for `Rollout`.
    recorded : (frames, layers, rows, cols, 3)
        Positions at even times [m], the first at `interval`.
    interval
        Time between two frames [s].
    wind : (frames, 3)
        Known amplitudes of the wind, each held for an interval; None: those of the scene.
    largest
        Largest factor on stiffness or viscosity that is tried; the scene's timestep must be stable at both.
    """

    def __init__(
        self, scene: Scene, recorded: ArrayLike, interval: float, wind: ArrayLike | None = None, largest: float = 2.5
    ) -> None:
        shape = (len(np.asarray(recorded)), *scene.lattice.shape, 3)
        self._recorded = _validate.array("recorded", recorded, shape)[:, None]
        self._interval = _validate.number("interval", interval, above=0.0)
        frames = shape[0]
        self._simulator = Simulator(scene)
        self._largest = _validate.number("largest", largest, minimum=1.0)
        self._simulator.set_parameters(largest, largest)  # told now, if the timestep is too long
        present = self._simulator.wind_amplitudes
        if not present:
            raise ValueError("scene must hold a wind to be identified, such as effects.CosineWind(); it has none")
        given = np.tile(present[0], (frames, 1)) if wind is None else _validate.array("wind", wind, (frames, 3))
        self._amplitudes = given[:, None]
        self._links = [e for e in scene.effects if e.link_weights(scene.lattice) is not None]
        winds = [e for e in scene.effects if e.wind_unit]
        self._mean_names = [f"{type(effect).__name__}.mean" for effect in winds]
        self._start_mean = np.array(winds[0].mean)  # type: ignore[attr-defined]
        known = Rollout(scene).parameters
        names = [f"{type(e).__name__}.{field}" for e in self._links for field in ("stiffness", "viscosity")]
        self._names = [name for name in names if name in known]
        self._rollout = Rollout(scene, parameters=(*self._names, *self._mean_names))
        self._unit = float(scene.lattice.masses.mean()) if winds[0].wind_unit == "N" else 1.0

    def fit(self, confidence: float = 0.95) -> Fit:
        """Best values, from the scene's own on, and the intervals that hold each with this probability."""
        share = _validate.number("confidence", confidence, above=0.0, maximum=1.0)
        start = np.concatenate([np.zeros(2), self._start_mean / self._unit])
        top = float(np.log(self._largest))
        bounds = [(-4.0, top), (-4.0, top), *[(None, None)] * 3]
        unit = max(self._loss(start)[0], 1e-12)
        best = scipy.optimize.minimize(  # type: ignore[call-overload]
            lambda p: tuple(part / unit for part in self._loss(p)), start, jac=True, method="L-BFGS-B", bounds=bounds,
            options={"maxiter": 100, "ftol": 1e-7},
        ).x  # fmt: skip
        best[:2] = np.minimum(best[:2], top - _STEP)
        steps = _STEP * np.eye(len(best))
        hessian = np.array([(self._loss(best + step)[1] - self._loss(best - step)[1]) / (2 * _STEP) for step in steps])
        hessian = 0.5 * (hessian + hessian.T)
        for _ in range(4):  # Newton: L-BFGS crawls along the valley that scales so different make
            change = scipy.linalg.solve(hessian, self._loss(best)[1], assume_a="sym")
            if max(best[:2] - change[:2]) > top or self._loss(best - change)[0] >= self._loss(best)[0]:
                break
            best = best - change
        left = self._loss(best)[0]
        variance = left / (self._recorded.size - len(best))
        covariance = 2.0 * variance * scipy.linalg.pinvh(hessian)
        reach = scipy.stats.norm.ppf(0.5 + 0.5 * share) * np.sqrt(np.diag(covariance))
        to = self._values
        scale = np.array([1.0, 1.0, *[self._unit] * 3])
        return Fit(to(best), to(best - reach), to(best + reach), covariance * np.outer(scale, scale), float(np.sqrt(variance)))

    def _values(self, p: Array) -> Array:
        return np.concatenate([np.exp(p[:2]), p[2:] * self._unit])

    def _loss(self, p: Array) -> tuple[float, Array]:
        """Sum of squared differences of the positions [m^2], and its derivatives."""
        stiffness, viscosity, *mean = self._values(p)
        simulator, rollout = self._simulator, self._rollout
        simulator.set_parameters(stiffness, viscosity)
        simulator.set_wind(mean=mean)
        rollout.start = simulator.get_state()
        rollout.run(wind=self._amplitudes, seconds=len(self._recorded) * self._interval)
        apart = rollout.path - self._recorded
        found = rollout.pull_back(2.0 * apart).parameters
        by = np.zeros(len(NAMES))
        factors = {"stiffness": stiffness, "viscosity": viscosity}
        for effect in self._links:
            for k, (field, factor) in enumerate(factors.items()):
                name = f"{type(effect).__name__}.{field}"
                if name in found:
                    by[k] += found[name][0] * getattr(effect, field) * factor
        by[2:] = self._unit * np.sum([found[name][0] for name in self._mean_names], axis=0)
        return float(np.square(apart).sum()), by
