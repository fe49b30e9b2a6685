"""What all pages of one server share: messages in, frames and descriptions out. Knows nothing of sockets."""

from __future__ import annotations

import math
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace
from typing import Any

import numpy as np

from flag_env import _validate
from flag_env.physics.diagnostics import strain
from flag_env.tasks import LEVELS, rungs
from flag_env.viewer.body import body, torn
from flag_env.viewer.episode import DRIVERS, Act, Episode, Task
from flag_env.viewer.flight import Flight
from flag_env.viewer.settings import ACCURACIES, INTEGRATORS, offered
from flag_env.viewer.stages import STAGES
from flag_env.viewer.wire import pack, parse


class Session:
    """A flag in flight or an episode, as the messages say.

    Parameters
    ----------
    stage
        Name in `STAGES` of the scene that flies first.
    task, agent
        The environment that is watched, and a policy for it.
    watch
        (driver, target) of an episode to begin with; None: fly.

    Attributes
    ----------
    number
        Of the last frame.
    """

    def __init__(
        self, stage: str = "flag", task: Task | None = None, agent: Act | None = None, watch: tuple[str, int] | None = None
    ) -> None:
        self._task, self._agent = task or Task(), agent
        self.flight = Flight(stage)
        self.episode: Episode | None = None if watch is None else self._episode(self._task, *watch)
        self._maker = ThreadPoolExecutor(1, "episode")
        self._coming: Future[Episode] | None = None
        self._message = ""
        self.number, self._version, self._seen = 0, 0, (-1, -1, False)

    # -- messages ---------------------------------------------------------------------------------------------------------------

    def handle(self, text: str | bytes) -> str:
        """Do what a message asks for; return why it is refused, in which case nothing has changed, or ""."""
        try:
            message = parse(text)
            self._verbs[message.pop("do")](self, **message)
        except (ValueError, TypeError) as error:
            return str(error)
        return ""

    def _set(self, values: dict[str, Any]) -> None:
        self.flight.set(values)

    def _stage(self, name: Any) -> None:
        self.flight.stage(name)
        self._fly()

    def _mast(self, position: Any, tilt: Any) -> None:
        self.flight.move_mast(position, tilt)

    def _pause(self, on: Any) -> None:
        self._show.paused = _validate.boolean("on", on)

    def _step(self) -> None:
        self._show.paused = True
        self._show.step()

    def _reset(self) -> None:
        if self.episode is None:
            self.flight.reset()
        else:
            self.episode.begin(self.episode.target)

    def _watch(self, control: Any, level: Any, driver: Any, target: Any) -> None:
        """Begin an episode; the agent acts in the task that it was trained for."""
        task = self._task if driver == "agent" else replace(self._task, control=control, level=level)
        if self.episode is not None and self.episode.task == task:
            self.episode.drive(driver, target)
        elif self._coming is not None:
            raise ValueError("watch must wait until the environment that was asked for is made")
        else:
            self._coming = self._maker.submit(self._episode, task, driver, target)

    def _action(self, values: Any) -> None:
        if self.episode is None:
            raise ValueError("action needs an episode; 'watch' begins one")
        self.episode.act(values)

    _verbs: dict[str, Callable[..., None]] = {  # noqa: RUF012
        "set": _set, "stage": _stage, "mast": _mast, "pause": _pause, "step": _step, "reset": _reset, "watch": _watch,
        "action": _action,
    }  # fmt: skip

    def _episode(self, task: Task, driver: str, target: int) -> Episode:
        return Episode(task, driver, target, self._agent if task == self._task else None)

    def _take_up_episode(self, made: Future[Episode]) -> None:
        """Watch an environment that was made beside the flying flag."""
        self._coming, self._message = None, ""
        try:
            episode = made.result()
        except (ValueError, TypeError, FloatingPointError) as error:
            self._message = str(error)
            return
        self._fly()
        self.episode = episode

    def _fly(self) -> None:
        if self.episode is not None:
            self.episode.close()
            self.episode = None

    def settle(self) -> None:
        """Wait until nothing is being built, and take it up."""
        self.flight.settle()
        if self._coming is not None:
            self._coming.exception()
            self._take_up_episode(self._coming)

    # -- what is seen -----------------------------------------------------------------------------------------------------------

    @property
    def _show(self) -> Flight | Episode:
        return self.flight if self.episode is None else self.episode

    @property
    def version(self) -> int:
        """Changes whenever `describe` does."""
        seen = (self.flight.version, self.episode.version if self.episode else -1, self.flight.running is None)
        if seen != self._seen:
            self._seen = seen
            self._version += 1
        return self._version

    def advance(self, seconds: float) -> bytes:
        """Let time pass, and return the frame that is then to be seen."""
        if self._coming is not None and self._coming.done():
            self._take_up_episode(self._coming)
        self._show.advance(seconds)
        self.number += 1
        if self.episode is not None:
            shot = self.episode.snapshot()
            wind = None if shot.wind is None else shot.wind / shot.wind_scale
            time = self.episode.env.simulator.time
            return pack(self.version, self.number, time, shot.positions, wind, self.episode.distance)
        running = self.flight.running
        if running is None:
            return pack(self.version, self.number, 0.0, self.flight.scene.lattice.rest_positions)
        simulator = running.simulator
        unit, reach = self.flight.settings.wind_unit, self.flight.settings.wind_reach
        wind = simulator.wind()[0] / reach if unit is not None and unit == running.settings.wind_unit else None  # type: ignore[index]
        return pack(self.version, self.number, simulator.time, simulator.positions[0], wind, torn=torn(simulator))

    def describe(self) -> dict[str, Any]:
        """What a page must know to draw the frames of this version, and the controls that it offers."""
        common = {
            "type": "scene",
            "version": self.version,
            "agent": self._agent is not None,
            "drivers": [driver for driver in DRIVERS if driver != "agent" or self._agent is not None],
            "controls": list(dict.fromkeys(control for control, _ in rungs())),
            "levels": list(LEVELS),
            "stages": {name: [stage.title, stage.told] for name, stage in STAGES.items()},
        }
        if self.episode is not None:
            episode, task = self.episode, self.episode.task
            target = np.round(episode.snapshot().target, 4).ravel().tolist()  # type: ignore[arg-type]
            size = len(episode.hand)
            watch = {"control": task.control, "level": task.level, "driver": episode.driver, "size": size}
            return {
                **common,
                **body(episode.env.simulator.scene),
                "mode": "watch",
                "target": target,
                "watch": watch,
                "wind": True,
            }
        flight = self.flight
        wind = flight.settings.wind_unit is not None
        return {**common, **body(flight.scene), "mode": "fly", "target": None, "wind": wind, "reach": flight.reach().tolist()}

    def status(self) -> dict[str, Any]:
        """What changes now and then: readouts, the sliders and their values, scores."""
        status: dict[str, Any] = {"type": "status", "paused": self._show.paused, "message": self._message or self._show.message}
        if self.episode is not None:
            return status | {"mode": "watch", "episode": self.episode.status()}
        flight = self.flight
        settings = flight.settings
        status |= {
            "mode": "fly",
            "building": flight.building or self._coming is not None,
            "stage": settings.stage,
            "sliders": {name: list(slider) for name, slider in settings.sliders().items()},
            "effects": {name: name in settings.effects for name in offered(settings.stage)},
            "integrator": settings.integrator,
            "accuracy": settings.accuracy,
            "integrators": list(INTEGRATORS),
            "accuracies": list(ACCURACIES),
        }
        if (running := flight.running) is not None:
            simulator = running.simulator
            positions = simulator.positions
            energy = {name: _finite(value[0]) for name, value in simulator.energy().items()}
            largest = float(strain(simulator.scene.lattice, positions).max(initial=0.0))
            status |= {
                "pose": flight.pose.tolist(),
                "readouts": {
                    "energy": energy,
                    "strain": _finite(largest),
                    "timestep": simulator.timestep,
                    "limit": _finite(running.limit),
                    "limited_by": running.limited_by,
                    "integrator": type(simulator.scene.integrator).__name__,
                    "dtype": simulator.scene.dtype,
                    "particles": simulator.scene.lattice.size,
                    "real_time": flight.speed,
                },
            }
        return status

    def close(self) -> None:
        """Stop what runs beside."""
        self.flight.close()
        self._maker.shutdown(cancel_futures=True)
        self._fly()


def _finite(value: float) -> float | None:
    """JSON has no infinity."""
    return float(value) if math.isfinite(value) else None
