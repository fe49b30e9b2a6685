"""The effects of a scene bound to a run: their arrays, in the scene's order."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from numpy.typing import NDArray

from flag_env.physics.effects import BindContext, Effect
from flag_env.physics.effects.wind import Oscillation


def bind(effects: tuple[Effect, ...], context: BindContext) -> tuple[Any, ...]:
    """Data of all effects, in their order."""
    return tuple(effect.bind(context) for effect in effects)


def rebind(old: tuple[Effect, ...], new: tuple[Effect, ...], bindings: tuple[Any, ...], context: BindContext) -> tuple[Any, ...]:
    """Bind anew the effects of a scene that have changed; the others go on as they are."""
    return tuple(data if before == after else after.bind(context) for before, after, data in zip(old, new, bindings, strict=True))


def winds(effects: tuple[Effect, ...], bindings: tuple[Any, ...]) -> list[Oscillation]:
    """The winds as they are now.

    Raises
    ------
    ValueError
        If they do not share a unit.
    """
    units = sorted({effect.wind_unit for effect in effects if effect.wind_unit})
    if len(units) > 1:
        raise ValueError(
            f"scene must hold winds in one unit for set_wind, got winds in {' and '.join(units)}; take one out, as in "
            "scene.without(effects.CosineWind)"
        )
    return [data.wind for effect, data in zip(effects, bindings, strict=True) if effect.wind_unit]


def state_of(bindings: tuple[Any, ...]) -> tuple[tuple[NDArray[Any], ...], ...]:
    """Arrays of each effect that a run changes, with a leading copies axis."""
    return tuple(tuple(_changing(data)) for data in bindings)


def _changing(part: Any) -> Iterator[NDArray[Any]]:
    for name in part.state() if hasattr(part, "state") else ():
        field = getattr(part, name)
        if hasattr(field, "state"):
            yield from _changing(field)
        elif isinstance(field, tuple):
            yield from field
        else:
            yield field
