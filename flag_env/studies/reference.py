"""Reference solutions: what a scene does when the error of integration is gone.

SciPy's DOP853 (Runge-Kutta of order 8, step chosen by its error estimate) at rtol 1e-11 on a right-hand side written here a
second time, in plain NumPy from the effects' formulas, with lists of links and a sparse incidence matrix. It shares no code with
the compiled kernels, so that an error in one of them cannot hide.

    M x'' = sum over links of +-w [k (1 - l/d) (x2 - x1) + z (v2 - v1)] - m g e_z - c m v + mean + a cos(p + f t)

with w, k, l, d, z as in `LinkEffect` (axial dampers: z (x2 - x1).(v2 - v1) / d^2 (x2 - x1)), g of `Gravity`, c of `AirDrag`, the
wind of `CosineWind`. Pinned particles move evenly. About 0.1 ms an evaluation for a flag of 16 x 10 particles.

Source: Hairer, Norsett, Wanner, Solving Ordinary Differential Equations I, II.10 (DOP853).
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import product
from typing import NamedTuple

import numpy as np
import scipy.integrate
import scipy.sparse
from numpy.typing import ArrayLike, NDArray

from flag_env import _validate
from flag_env.physics import Scene, Simulator
from flag_env.physics.effects import AirDrag, Bending, CosineWind, CrossLayer, Gravity, LinkEffect, Shear, Structural

Array = NDArray[np.float64]

DIRECTIONS = {
    Structural: ((0, 0, 1), (0, 1, 0)),
    Shear: ((0, 1, 1), (0, 1, -1)),
    Bending: ((0, 0, 2), (0, 2, 0)),
    CrossLayer: ((1, 0, 0), *((1, a, b) for a, b in product((-1, 1), repeat=2))),
}
"""(layers, rows, columns) from one end of a link to the other; not read from the effects themselves."""


class Links(NamedTuple):
    """All links of a scene, one entry each: ends (flat numbers), rest length [m], k [N/m], isotropic and axial z [N s/m]."""

    first: NDArray[np.intp]
    second: NDArray[np.intp]
    length: Array
    stiffness: Array
    isotropic: Array
    axial: Array


class Solution(NamedTuple):
    """`times` (n,) [s]; `positions` [m] and `velocities` [m/s], each (n, layers, rows, cols, 3)."""

    times: Array
    positions: Array
    velocities: Array


def links(scene: Scene) -> Links:
    """The links of a scene, found one by one."""
    lattice = scene.lattice
    rest, share = lattice.rest_positions, _share(scene)
    number = np.arange(lattice.size).reshape(lattice.shape)
    found = []
    for effect in (effect for effect in scene.effects if isinstance(effect, LinkEffect)):
        for start, step in product(np.ndindex(lattice.shape), DIRECTIONS[type(effect)]):
            end = tuple(a + b for a, b in zip(start, step, strict=True))
            if not all(0 <= place < count for place, count in zip(end, lattice.shape, strict=True)):
                continue
            weight = (share[start[2]] + share[end[2]]) / 2 if effect.tapered else 1.0
            z, axial = weight * effect.viscosity, effect.damping == "axial"
            length = np.sqrt(((rest[end] - rest[start]) ** 2).sum())
            found.append((number[start], number[end], length, weight * effect.stiffness, z * (not axial), z * axial))
    columns = np.array(found, float).reshape(-1, 6).T
    return Links(columns[0].astype(np.intp), columns[1].astype(np.intp), *columns[2:])


def _share(scene: Scene) -> Array:
    """Share of the mast-side mass in each column."""
    lattice = scene.lattice
    return 1.0 - (1.0 - lattice.taper) * np.arange(lattice.cols) / max(lattice.cols - 1, 1)


def right_hand_side(scene: Scene) -> Callable[[float, Array], Array]:
    """The slope y' at (t, y) of y = (x, v), both (particles, 3), raveled.

    Raises
    ------
    ValueError
        If the scene holds an effect whose formula is not written here.
    """
    known = (Gravity, AirDrag, CosineWind, *DIRECTIONS)
    for effect in scene.effects:
        if type(effect) not in known:
            raise ValueError(f"effects must be among {', '.join(kind.__name__ for kind in known)}, got {effect!r}")
    lattice, chain = scene.lattice, links(scene)
    moving = [axis in lattice.axes for axis in range(3)]
    mass = np.broadcast_to(lattice.mass * _share(scene), lattice.shape).reshape(-1, 1)
    inverse_mass = np.where(lattice.fixed[:, None], 0.0, moving / mass)
    count = len(chain.first)
    entries = np.repeat([-1.0, 1.0], count), (np.tile(np.arange(count), 2), np.concatenate([chain.first, chain.second]))
    difference = scipy.sparse.csr_array(entries, shape=(count, lattice.size))
    gather = scipy.sparse.csr_array(-difference.T)
    constant, drag, wind = np.zeros((lattice.size, 3)), 0.0, CosineWind()
    for effect in scene.effects:
        if isinstance(effect, Gravity):
            constant[:, 2] -= effect.acceleration * (mass[:, 0] if effect.tapered else lattice.mass)
        elif isinstance(effect, AirDrag):
            drag = effect.rate
        elif isinstance(effect, CosineWind):
            wind = effect
    constant += np.array(wind.mean)
    amplitude, frequency, phase = np.array(wind.amplitude), np.array(wind.frequency), np.array(wind.phase)
    rope, axial = lattice.dimensions == 1, bool(chain.axial.any())
    damper = (chain.isotropic + chain.axial if rope else chain.isotropic)[:, None]  # along one axis they are the same

    def slope(t: float, y: Array) -> Array:
        x, v = y.reshape(2, lattice.size, 3)
        apart, rate = difference @ x, difference @ v
        if rope:
            pull = chain.stiffness[:, None] * apart + damper * rate
        else:
            squared = np.einsum("ij,ij->i", apart, apart)
            factor = chain.stiffness * (1.0 - chain.length / np.sqrt(squared))
            if axial:
                factor = factor + chain.axial * np.einsum("ij,ij->i", apart, rate) / squared
            pull = factor[:, None] * apart + damper * rate
        force = gather @ pull + constant + amplitude * np.cos(phase + frequency * t) - drag * mass * v
        return np.concatenate([v.ravel(), (inverse_mass * force).ravel()])

    return slope


def path(scene: Scene, times: ArrayLike, positions: ArrayLike | None = None, rtol: float = 1e-11, atol: float = 1e-13) -> Array:
    """Positions at many instants, (times, layers, rows, cols, 3) [m], from rest.

    In one go, with DOP853's interpolation inside its steps; `solve`, which stops at each instant, differs by 1e-13 m. Arguments
    and errors as for `solve`, but the instants may begin with 0.
    """
    instants = _validate.array("times", times, (np.size(times),))
    if not (np.diff(instants) > 0).all() or instants[0] < 0:
        raise ValueError(f"times must rise from 0 or later, got {times!r}")
    state = _state(scene, positions, None)
    span = (0.0, instants[-1])
    result = scipy.integrate.solve_ivp(right_hand_side(scene), span, state, "DOP853", t_eval=instants, rtol=rtol, atol=atol)
    if not result.success:
        raise RuntimeError(f"DOP853 gave up at {result.t[-1] if len(result.t) else 0.0:.6g} s: {result.message}")
    found: Array = result.y.T.reshape(len(instants), 2, *scene.lattice.shape, 3)[:, 0]
    return found


def _state(scene: Scene, positions: ArrayLike | None, velocities: ArrayLike | None) -> Array:
    """Positions and velocities at the start, raveled."""
    shape = (*scene.lattice.shape, 3)
    if positions is None:
        positions = Simulator(scene.replace(dtype="float64", timestep="auto", allow_unstable=False)).positions[0]
    x = _validate.array("positions", positions, shape)
    v = _validate.array("velocities", np.zeros(shape) if velocities is None else velocities, shape)
    state: Array = np.stack([x, v]).ravel()
    return state


def solve(
    scene: Scene,
    times: ArrayLike,
    positions: ArrayLike | None = None,
    velocities: ArrayLike | None = None,
    rtol: float = 1e-11,
    atol: float = 1e-13,
) -> Solution:
    """The scene's motion from time 0 on, at the given times.

    Parameters
    ----------
    scene
        Its integrator, timestep and dtype play no part.
    times : (n,)
        Rising, > 0 [s].
    positions : (layers, rows, cols, 3)
        At time 0 [m]; None: as a `Simulator` of the scene with seed 0 starts.
    velocities : (layers, rows, cols, 3)
        At time 0 [m/s], None: at rest. Pinned particles keep theirs for ever.
    rtol, atol
        Relative and absolute error that DOP853 allows a step.

    Raises
    ------
    ValueError
        If an effect is not known here, the times do not rise, or an array has the wrong shape.
    RuntimeError
        If DOP853 gives up.
    """
    instants = _validate.array("times", times, (np.size(times),))
    if not (np.diff(instants, prepend=0.0) > 0).all():
        raise ValueError(f"times must rise from above 0, got {times!r}")
    slope, state = right_hand_side(scene), _state(scene, positions, velocities)
    start, found = 0.0, []
    for end in instants:  # each span by itself: the interpolation inside a step is of lower order
        result = scipy.integrate.solve_ivp(slope, (start, end), state, "DOP853", t_eval=(end,), rtol=rtol, atol=atol)
        if not result.success:
            raise RuntimeError(f"DOP853 gave up at {result.t[-1] if len(result.t) else start:.6g} s: {result.message}")
        state, start = result.y[:, -1], end
        found.append(state.reshape(2, *scene.lattice.shape, 3))
    both = np.array(found)
    return Solution(instants, both[:, 0], both[:, 1])
