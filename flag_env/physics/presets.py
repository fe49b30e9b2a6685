"""Ready-made scenes: functions that return a `Scene`."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from flag_env import _validate
from flag_env.physics.effects import (
    AirDrag,
    AirPressure,
    Bending,
    CosineWind,
    CrossLayer,
    Gravity,
    Gusts,
    MastCollision,
    SelfCollision,
    Shear,
    Structural,
)
from flag_env.physics.integrators import Leapfrog
from flag_env.physics.lattice import Lattice
from flag_env.physics.scene import Scene

_THIN = 0.9
"""Largest radius of a pole, in distances of the columns: free particles must stand outside it at rest."""

REPORT_RATE = 1000.0
"""The report's sampling frequency Fe [Hz]."""


def _cloth(rows: int, cols: int, length: float, height: float, density: float, taper: float, pinned: Any) -> Lattice:
    """A lattice of the given size [m] and areal density [kg/m^2], however fine."""
    rows, cols = _validate.count("rows", rows), _validate.count("cols", cols)
    length = _validate.number("length", length, above=0.0)
    height = _validate.number("height", height, above=0.0)
    density = _validate.number("density", density, above=0.0)
    taper = _validate.number("taper", taper, above=0.0)
    mean_mass = density * length * height / (rows * cols)
    mean_taper = 0.5 * (1.0 + taper) if cols > 1 else 1.0
    along, up = length / max(cols - 1, 1), height / max(rows - 1, 1)
    return Lattice(1, rows, cols, (along, up, min(along, up)), mean_mass / mean_taper, taper, pinned)


def flag(
    rows: int = 20,
    cols: int = 32,
    *,
    length: float = 1.5,
    height: float = 1.0,
    density: float = 0.15,
    taper: float = 0.1,
    pinned: str = "edge",
    stiffness: float = 300.0,
    viscosity: float = 0.02,
    drag: float = 1.5,
    **scene: Any,
) -> Scene:
    """A one-layer flag in air: gravity, structural, shear and bending links, linear drag, and a wind that is calm until told.

    Parameters
    ----------
    rows, cols
        Particles up and along; size, areal density and stiffness per width stay the same.
    length, height
        Size along x and z [m].
    density
        Areal density, the mean over the tapered cloth [kg/m^2].
    taper
        Mass at the free edge / mass at the mast; stiffness and viscosity follow it, so that it costs no timestep.
    pinned
        See `Lattice`.
    stiffness
        Of the structural links [N/m]; shear links have 1/4, bending links 1/50 of it.
    viscosity
        Of every link [N s/m].
    drag
        Rate of the linear air drag [1/s].
    **scene
        Further fields of `Scene`: integrator, timestep, dtype, allow_unstable, perturbation.
    """
    lattice = _cloth(rows, cols, length, height, density, taper, pinned)
    stiffness = _validate.number("stiffness", stiffness, minimum=0.0)
    return Scene(
        lattice=lattice,
        effects=(
            Gravity(),
            Structural(stiffness, viscosity, tapered=True),
            Shear(stiffness / 4, viscosity, tapered=True),
            Bending(stiffness / 50, viscosity, tapered=True),
            AirDrag(drag),
            CosineWind(),
        ),
        **{"perturbation": 1e-3 * min(lattice.spacings), **scene},
    )


def rope(cols: int = 32, *, pinned: str = "ends", **scene: Any) -> Scene:
    """The report's rope: masses on springs in a row, each displaced along z only; linear, in the report's units.

    Mass 1, spacing 1, k = 0.1 m Fe^2, z = 0.01 m Fe, Fe = 1000 Hz, timestep 1/Fe. Displacements X obey exactly
    X_{n+1} = (2 I - Z - K) X_n + (Z - I) X_{n-1}, K = h^2 M^-1 K_m, Z = h M^-1 Z_m. At rest until it is displaced.

    Parameters
    ----------
    cols
        Number of masses, the fixed ones included.
    pinned
        "ends": fixed at both ends; "edge": the far end hangs free.
    **scene
        Further fields of `Scene`.
    """
    lattice = Lattice(1, 1, cols, spacing=1.0, mass=1.0, pinned=pinned, dimensions=1)
    links = Structural(0.1 * REPORT_RATE**2, 0.01 * REPORT_RATE)
    return Scene(**{"lattice": lattice, "effects": (links,), "integrator": Leapfrog(), "timestep": 1.0 / REPORT_RATE, **scene})


def sheet(rows: int = 20, cols: int = 32, **flag_options: Any) -> Scene:
    """The report's 2-D flag: `flag` in its plane, with the coordinates x and z only; takes what `flag` takes."""
    scene = flag(rows, cols, **flag_options)
    return scene.replace(lattice=replace(scene.lattice, dimensions=2))


def two_layer_flag(rows: int = 20, cols: int = 32, *, cross: float | None = None, **flag_options: Any) -> Scene:
    """A flag of two layers held apart by struts and cube diagonals, which resist skewing in place of the shear links.

    Parameters
    ----------
    rows, cols
        Particles up and along.
    cross
        Stiffness of the cross-layer links [N/m]; None: that of the shear links they replace.
    **flag_options
        Everything that `flag` takes.
    """
    single = flag(rows, cols, **flag_options)
    shear = next(effect for effect in single.effects if isinstance(effect, Shear))
    lattice = replace(single.lattice, layers=2, mass=single.lattice.mass / 2)
    links = CrossLayer(shear.stiffness if cross is None else cross, shear.viscosity, tapered=True)
    effects = tuple(links if isinstance(effect, Shear) else effect for effect in single.effects)
    return single.replace(lattice=lattice, effects=effects)


def storm_flag(rows: int = 20, cols: int = 32, *, wind: float = 8.0, intensity: float = 2.0, **flag_options: Any) -> Scene:
    """`flag` in turbulent air that presses on the moving cloth, which runs neither into itself nor into the mast.

    The pole's radius is 2 cm, or where columns stand closer 0.9 of their distance: the cloth must stand outside at rest.

    Parameters
    ----------
    rows, cols
        Particles up and along.
    wind
        Mean velocity of the air along x [m/s]; `Simulator.set_wind` changes it, in m/s.
    intensity
        Standard deviation of the turbulence [m/s].
    **flag_options
        Everything that `flag` takes.
    """
    wind = _validate.number("wind", wind, minimum=0.0)
    intensity = _validate.number("intensity", intensity, minimum=0.0)
    scene = flag(rows, cols, **flag_options)
    pole = MastCollision(radius=min(MastCollision.radius, _THIN * scene.lattice.spacings[0]))
    air = AirPressure(mean=(wind, 0.0, 0.0), max_speed=max(20.0, 1.5 * wind), gusts=Gusts(intensity, speed=max(wind, 1.0)))
    return scene.without(CosineWind).adding(air, SelfCollision(), pole)


def report_flag(layers: int = 1, rows: int = 10, cols: int = 15, **scene: Any) -> Scene:
    """The student report's flag in the report's own units (unit spacing and mass), its vertical turned to z.

    k = 0.1 m Fe^2, z = 0.01 m Fe, Fe = 1000 Hz, timestep 1/Fe; mass, k and z taper to 10 %. Gravity (5 Fe) and the cosine wind
    pull every free particle with the same force. One layer has structural, shear and bending links; with two, struts and cube
    diagonals take the place of the shear links.

    Parameters
    ----------
    layers
        1 or 2.
    rows, cols
        Particles up and along.
    **scene
        Further fields of `Scene`.
    """
    if layers not in (1, 2):
        raise ValueError(f"layers must be 1 or 2, got {layers!r}")
    stiffness, viscosity = 0.1 * REPORT_RATE**2, 0.01 * REPORT_RATE
    cross = (Shear if layers == 1 else CrossLayer)(stiffness, viscosity, tapered=True)
    return Scene(
        lattice=Lattice(layers, rows, cols, spacing=1.0, mass=1.0, taper=0.1),
        effects=(
            Gravity(5.0 * REPORT_RATE, tapered=False),
            Structural(stiffness, viscosity, tapered=True),
            cross,
            Bending(stiffness, viscosity, tapered=True),
            # the report's axes are (along, vertical, normal)
            CosineWind(amplitude=(4800.0, 1150.0, 5700.0), frequency=(0.04, 0.05, 0.35)),
        ),
        **{"integrator": Leapfrog(), "timestep": 1.0 / REPORT_RATE, **scene},
    )
