"""The effects of a scene as bound to a run: their arrays, in the scene's order."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from numpy.typing import NDArray

from flag_env.physics.effects.base import Effect, Setting
from flag_env.physics.effects.springs import LinkEffect
from flag_env.physics.effects.wind import Swing, Wind


def bind(effects: tuple[Effect, ...], setting: Setting) -> tuple[Any, ...]:
    """Bind the effects that `setting.bound` does not hold yet, and return all in the order of `effects`."""
    for effect in sorted(effects, key=lambda effect: effect.binds_last):
        if type(effect) not in setting.bound:
            setting.bound[type(effect)] = effect.bind(setting)
    return tuple(setting.bound[type(effect)] for effect in effects)


def rebind(old: tuple[Effect, ...], new: tuple[Effect, ...], bound: tuple[Any, ...], setting: Setting) -> tuple[Any, ...]:
    """Bind anew the effects of a scene that have changed; the others go on as they are, and broken links stay broken."""
    for before, after, run in zip(old, new, bound, strict=True):
        if before == after:
            setting.bound[type(after)] = run
    return tuple(
        after._replace(weight=before.weight) if isinstance(effect, LinkEffect) else after
        for effect, before, after in zip(new, bound, bind(new, setting), strict=True)
    )


def winds(effects: tuple[Effect, ...], bound: tuple[Any, ...]) -> list[Swing]:
    """The winds as they are now.

    Raises
    ------
    ValueError
        If they do not share a unit.
    """
    units = sorted({effect.unit for effect in effects if isinstance(effect, Wind)})
    if len(units) > 1:
        raise ValueError(
            f"scene must hold winds in one unit for set_wind, got winds in {' and '.join(units)}; take one out, as in "
            "scene.without(effects.CosineWind)"
        )
    return [run.wind for effect, run in zip(effects, bound, strict=True) if isinstance(effect, Wind)]


def state_of(bound: tuple[Any, ...]) -> tuple[tuple[NDArray[Any], ...], ...]:
    """Arrays of each effect that a run changes, with a leading copies axis."""
    return tuple(tuple(_changing(run)) for run in bound)


def _changing(part: Any) -> Iterator[NDArray[Any]]:
    for name in part.state() if hasattr(part, "state") else ():
        field = getattr(part, name)
        if isinstance(field, tuple):
            yield from _changing(field)
        else:
            yield field
