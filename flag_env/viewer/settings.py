"""What the sliders say: a checked, immutable set of numbers and choices, and the scene that it makes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache
from typing import Any, NamedTuple

from flag_env import _validate
from flag_env.physics import Scene, integrators, tune
from flag_env.physics.effects import Effect, Gravity
from flag_env.physics.integrators import Integrator
from flag_env.physics.limits import AUTO, timestep_of
from flag_env.viewer.stages import STAGES, Breeze

INTEGRATORS: dict[str, type[Integrator]] = {
    name: getattr(integrators, name) for name in ("Leapfrog", "LFAB", "Strang", "RK4", "Implicit", "ExplicitEuler")
}

OWN = "own"
"""The accuracy that leaves integrator and step to their own controls; the others are recipes of `tune`."""

ACCURACIES = (OWN, "balanced", "reference")

AXES = "xyz"

FASTEST = 10.0
"""Frequency up to which a wind may swing [rad/s]."""

LARGEST_SHARE = 1.5
"""Of the step limit, that the step may be set to: above 1 to see a run diverge."""


class Slider(NamedTuple):
    """One number that may be set: its range, and whether the page spreads the range by ratios."""

    group: str
    label: str
    unit: str
    low: float
    high: float
    value: float
    log: bool = False


@cache
def stage_scene(stage: str) -> Scene:
    """The scene of a stage as it comes."""
    return STAGES[stage].make()


@cache
def offered(stage: str) -> dict[str, Effect]:
    """The effects of a stage by name, its own first."""
    own, extra = stage_scene(stage).effects, STAGES[stage].extra
    return {type(effect).__name__: effect for effect in (*own, *extra)}


@dataclass(frozen=True)
class Settings:
    """Everything that the page may change about a flying flag.

    Attributes
    ----------
    stage
        Name in `STAGES`.
    numbers
        Values of the sliders that were moved, by name.
    effects
        Names of the effects that are on.
    integrator, accuracy
        Names in `INTEGRATORS` and `ACCURACIES`.
    """

    stage: str
    numbers: tuple[tuple[str, float], ...]
    effects: frozenset[str]
    integrator: str
    accuracy: str = OWN

    @classmethod
    def of(cls, stage: str) -> Settings:
        """A stage as it comes."""
        _validate.choice("stage", stage, STAGES)
        scene = stage_scene(stage)
        names = frozenset(type(effect).__name__ for effect in scene.effects)
        return cls(stage, (), names, type(scene.integrator).__name__)

    def changed(self, values: Mapping[str, Any]) -> Settings:
        """These settings with some changed: numbers by slider name, effects by name, `integrator`, `accuracy`.

        Raises
        ------
        TypeError, ValueError
            Naming what is wrong; these settings stay as they are.
        """
        new = self
        for name, value in values.items():
            if name in offered(self.stage):
                new = new._toggled(name, _validate.boolean(name, value))
            elif name == "integrator":
                new = replace(new, integrator=_validate.choice(name, value, INTEGRATORS))
            elif name == "accuracy":
                new = replace(new, accuracy=_validate.choice(name, value, ACCURACIES))
            elif name in (sliders := new.sliders()):
                slider = sliders[name]
                checked = _validate.number(name, value, minimum=slider.low, maximum=slider.high)
                new = replace(new, numbers=tuple({**dict(new.numbers), name: checked}.items()))
            else:
                raise ValueError(f"values must name sliders, effects, 'integrator' or 'accuracy' of this scene, got {name!r}")
        return new

    def _toggled(self, name: str, on: bool) -> Settings:
        """With an effect on or off; winds of one unit take the place of those of the other."""
        effects, names, numbers = offered(self.stage), set(self.effects), self.numbers
        names = names | {name} if on else names - {name}
        unit = effects[name].wind_unit
        if on and unit:
            others = {other for other in names if effects[other].wind_unit not in (None, unit)}
            if others:
                numbers = tuple((key, value) for key, value in numbers if key[:-2] not in ("mean", "amplitude"))
            names -= others
        return replace(self, effects=frozenset(names), numbers=numbers)

    @property
    def wind_unit(self) -> str | None:
        """Newton or metres a second, as "N" or "m/s"; None without a wind."""
        effects = offered(self.stage)
        return next((unit for name in self.effects if (unit := effects[name].wind_unit)), None)

    @property
    def wind_reach(self) -> float:
        """The largest wind that a slider asks for, in its unit: what an arrow of full length stands for."""
        if self.wind_unit == "N":
            return 2.0 * _gravity(self.stage) * stage_scene(self.stage).lattice.mass
        return 15.0

    def sliders(self) -> dict[str, Slider]:
        """The sliders by name, at their values."""
        stage, scene, given = STAGES[self.stage], stage_scene(self.stage), dict(self.numbers)
        share = min(AUTO * timestep_of(scene) / timestep_of(scene.replace(timestep="auto")), 1.0)
        sliders = {
            "stiffness": Slider("Cloth", "stiffness", "x", 0.01, 5.0, 1.0, True),
            "viscosity": Slider("Cloth", "viscosity", "x", 0.01, 5.0, 1.0, True),
            "taper": Slider("Cloth", "free-edge mass", "x", 0.02, 1.0, scene.lattice.taper, True),
        }
        if "Gravity" in self.effects:
            own = _gravity(self.stage)
            sliders["gravity"] = Slider("Cloth", "gravity", "m/s²", 0.0, 2.0 * own, own)
        if self.wind_unit is not None:
            sliders |= self._wind_sliders(self.wind_unit, scene)
        sliders["step"] = Slider("Time", "step / limit", "", 0.05, LARGEST_SHARE, share)
        sliders["pace"] = Slider("Time", "pace / real time", "x", 0.01, 2.0, stage.pace, True)
        return {name: slider._replace(value=given.get(name, slider.value)) for name, slider in sliders.items()}

    def _wind_sliders(self, unit: str, scene: Scene) -> dict[str, Slider]:
        force = unit == "N"
        breeze, mass = STAGES[self.stage].breeze, scene.lattice.mass
        if unit not in {effect.wind_unit for effect in scene.effects}:  # a wind that is not the scene's own
            breeze = Breeze() if force else Breeze(mean=(6.0, 0.0, 0.0))
        reach, factor = self.wind_reach, mass if force else 1.0
        result = {}
        for name, label in (("mean", "mean"), ("amplitude", "amplitude"), ("frequency", "frequency")):
            for axis in scene.lattice.axes:
                value = getattr(breeze, name)[axis]
                if name == "frequency":
                    slider = Slider("Wind", f"{label} {AXES[axis]}", "rad/s", 0.0, FASTEST, value)
                else:
                    slider = Slider("Wind", f"{label} {AXES[axis]}", unit, -reach, reach, factor * value)
                result[f"{name}_{AXES[axis]}"] = slider
        return result

    def breeze(self) -> Breeze | None:
        """The wind in the scene's unit; None without one."""
        if self.wind_unit is None:
            return None
        sliders = self.sliders()

        def vector(name: str) -> tuple[float, float, float]:
            x, y, z = (slider.value if (slider := sliders.get(f"{name}_{axis}")) else 0.0 for axis in AXES)
            return x, y, z

        return Breeze(vector("mean"), vector("amplitude"), vector("frequency"))

    @property
    def pace(self) -> float:
        """Simulated seconds that a second on the screen shows."""
        return self.sliders()["pace"].value

    def needs_rebuild(self, other: Settings) -> bool:
        """Whether the other settings make another scene but for wind and pace, which a running flag takes up at once."""
        return self._built() != other._built()

    def _built(self) -> tuple[object, ...]:
        kept = {name: value for name, value in self.numbers if name != "pace" and name[:-2] not in _LIVE}
        return self.stage, kept, self.effects, self.integrator, self.accuracy

    def scene(self) -> Scene:
        """The scene that is asked for; finding its step limit takes a moment.

        Raises
        ------
        ValueError
            If there is no such scene, or its integrator is stable at no timestep.
        """
        own, known = stage_scene(self.stage), offered(self.stage)
        value = {name: slider.value for name, slider in self.sliders().items()}
        effects = [effect for name, effect in known.items() if name in self.effects]
        if (breeze := self.breeze()) is not None:
            effects = [_in_wind(effect, breeze) for effect in effects]
        if "gravity" in value:
            effects = [replace(e, acceleration=value["gravity"]) if isinstance(e, Gravity) else e for e in effects]
        lattice = replace(own.lattice, taper=value["taper"])
        if lattice.taper != own.lattice.taper:  # the cloth as a whole weighs what it did
            lattice = replace(lattice, mass=own.lattice.mass * (1.0 + own.lattice.taper) / (1.0 + lattice.taper))
        scene = own.replace(
            lattice=lattice, effects=tuple(effects), integrator=INTEGRATORS[self.integrator](), timestep="auto"
        ).scaled(value["stiffness"], value["viscosity"])
        if self.accuracy != OWN:
            return tune(scene, self.accuracy)
        share = value["step"]
        return scene.replace(timestep=share / AUTO * timestep_of(scene), allow_unstable=share > 1.0)


_LIVE = ("mean", "amplitude", "frequency")


def _gravity(stage: str) -> float:
    """The stage's own gravity [m/s^2]; the earth's where it has none."""
    return next((effect.acceleration for effect in stage_scene(stage).effects if isinstance(effect, Gravity)), 9.81)


def _in_wind(effect: Effect, breeze: Breeze) -> Effect:
    if effect.wind_unit is None:
        return effect
    wind: Any = effect
    return replace(wind, mean=breeze.mean, amplitude=breeze.amplitude, frequency=breeze.frequency)  # type: ignore[no-any-return]
