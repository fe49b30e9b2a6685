"""Which effects and integrators have a way back, and which of their parameters derivatives are known for."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from flag_env.physics.effects import Effect
from flag_env.physics.scene import Scene

MASS = "Lattice.mass"


class Parameter(NamedTuple):
    """A parameter of a scene.

    Attributes
    ----------
    name
        Kind of the effect, its name where it has one, and the parameter: "Structural.stiffness", "Attachment.halyard.viscosity".
    effect
        The effect's place in the scene.
    first, last
        Columns of the effect's slopes.
    """

    name: str
    effect: int
    first: int
    last: int


def refuse_without_way_back(scene: Scene, method: Any, bindings: Iterable[Any]) -> None:
    """Raise ValueError, naming them, unless the integrator and all effects can carry derivatives back."""
    if not hasattr(method, "step_back") or getattr(method, "iterations", 1) > 1:
        raise ValueError(
            f"scene must have an integrator with a way back for gradients, such as integrators.LFAB(), got {scene.integrator!r}"
        )
    missing = [effect.label for effect, data in zip(scene.effects, bindings, strict=True) if not _carries_back(data)]
    if missing:
        raise ValueError(
            f"scene must hold effects with a derivative for gradients; {', '.join(missing)} have none, since they are not smooth "
            "or offer no pull_back; take them out with scene.without(...)"
        )


def _carries_back(data: Any) -> bool:
    return hasattr(data, "pull_back") and not hasattr(data, "project")


def parameters_of(scene: Scene, bindings: Iterable[Any]) -> list[Parameter]:
    """All parameters that derivatives are known for, besides the mass."""
    found = []
    for place, (effect, data) in enumerate(zip(scene.effects, bindings, strict=True)):
        column = 0
        label = type(effect).__name__ + (f".{effect.name}" if effect.name else "")
        for name in names_of(data):
            width = int(np.size(getattr(effect, name)))
            if not (name == "viscosity" and scene.integrator.solves_damping and not _isotropic(scene, effect)):
                found.append(Parameter(f"{label}.{name}", place, column, column + width))
            column += width
    return found


def names_of(data: Any) -> tuple[str, ...]:
    """Names of the parameters of an effect that its data tells."""
    return tuple(data.parameters()) if hasattr(data, "parameters") else ()


def _isotropic(scene: Scene, effect: Effect) -> bool:
    """Whether the effect's damping is a constant matrix, which a method may solve with."""
    bound = effect.linear_bound(scene.lattice)
    return (bound.drag is None or bound.isotropic) and all(term.isotropic for term in bound.links)


def mass_parameters(scene: Scene, known: list[Parameter]) -> list[Parameter] | None:
    """Parameters that make up all forces that do not follow the mass, None if some are not known.

    Motion depends on forces over masses alone. So the derivative with respect to the mass, times the mass, is minus the sum of
    p dL/dp over parameters p that these forces are proportional to, all together.
    """
    needed: list[Parameter] = []
    for place, effect in enumerate(scene.effects):
        if effect.scales_with is None:
            return None
        for name in effect.scales_with:
            value: NDArray[np.float64] = np.asarray(getattr(effect, name))
            here = [one for one in known if one.effect == place and one.name.endswith("." + name)]
            if here:
                needed += here
            elif value.any():
                return None
    return needed
