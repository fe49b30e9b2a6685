"""The energy budget of a run: what a method adds or loses that no effect accounts for.

    R(t) = E(t) - E(0) - integral of P from 0 to t,    P = sum over free particles of wind . v - c m v^2 - power of the dampers

E is kinetic energy and the potential of gravity and springs, from positions and synchronised velocities at every step; the
integral is Simpson's rule over pairs of steps, of order 4, so that it hides no method's order. The exact motion has R = 0. The
residual is the largest |R| over the energy that the wind moves, the integral of |wind . v|.

The mast stands still. Power of an isotropic damper: z |v2 - v1|^2; of an axial one: z ((x2 - x1).(v2 - v1))^2 / d^2.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from flag_env.physics import Scene, Simulator
from flag_env.physics.effects import AirDrag, CosineWind
from flag_env.studies import reference

Array = NDArray[np.float64]

_BLOCK = 1000
"""Steps looked at together."""


def residual(scene: Scene, seconds: float) -> float:
    """Largest unaccounted energy within `seconds`, as a share of what the wind moves; for scenes of at least 3 particles."""
    simulator = Simulator(scene)
    pairs = max(round(seconds / simulator.timestep) // 2, 1)
    energies, winds, losses = [], [], []
    for start in range(0, 2 * pairs + 1, _BLOCK):
        frames = []
        for step in range(start, min(start + _BLOCK, 2 * pairs + 1)):
            if step:
                simulator.step()
            frames.append((simulator.positions[0], simulator.velocities[0]))
        x, v = (np.array(part).reshape(len(frames), -1, 3) for part in zip(*frames, strict=True))
        times = np.float64(simulator.timestep) * np.arange(start, start + len(frames))
        energies.append(_energy(scene, x, v))
        winds.append(_wind_power(scene, times, v))
        losses.append(_loss(scene, x, v))
    energy, wind, loss = (np.concatenate(part) for part in (energies, winds, losses))
    turned = _simpson(np.abs(wind), simulator.timestep)[-1]
    unaccounted = energy[::2] - energy[0] - np.concatenate([[0.0], _simpson(wind - loss, simulator.timestep)])
    return float(np.abs(unaccounted).max() / turned)


def _simpson(power: Array, timestep: float) -> Array:
    """Integral up to every second step."""
    return np.asarray(np.cumsum(timestep / 3 * (power[:-2:2] + 4 * power[1:-1:2] + power[2::2])))


def _energy(scene: Scene, x: Array, v: Array) -> Array:
    mass = np.where(scene.lattice.fixed, 0.0, scene.lattice.masses)
    total = 0.5 * (v**2).sum(axis=-1) @ mass
    for effect in scene.effects:
        potential = effect.energy(scene.lattice, x)
        if potential is not None:
            total = total + potential
    return np.asarray(total)


def _wind_power(scene: Scene, times: Array, v: Array) -> Array:
    power = np.zeros(len(times))
    free = ~scene.lattice.fixed
    for wind in scene.effects:
        if isinstance(wind, CosineWind):
            angle = np.array(wind.phase) + np.array(wind.frequency) * times[:, None]
            force = np.array(wind.mean) + np.array(wind.amplitude) * np.cos(angle)
            power += (force * v[:, free].sum(axis=1)).sum(axis=1)
    return power


def _loss(scene: Scene, x: Array, v: Array) -> Array:
    links = reference.links(scene)
    rate = v[:, links.second] - v[:, links.first]
    loss = (rate**2).sum(axis=-1) @ links.isotropic
    if links.axial.any():
        apart = x[:, links.second] - x[:, links.first]
        loss = loss + ((apart * rate).sum(axis=-1) ** 2 / (apart**2).sum(axis=-1)) @ links.axial
    for effect in scene.effects:
        if isinstance(effect, AirDrag):
            loss = loss + (v**2).sum(axis=-1) @ np.where(scene.lattice.fixed, 0.0, effect.rate * scene.lattice.masses)
    return np.asarray(loss)
