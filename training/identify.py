"""Hidden scenes found from their motion: `flag-train identify` hides stiffness, viscosity and wind, and fits them by gradients.

Each scene is the environments' flag with a stiffness and a viscosity of half to twice its own, in a wind of its own. Its motion
under known gusts is recorded with noise, as a camera would; from the record alone the fit finds all five with intervals.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import tyro
from tqdm import tqdm

from flag_env import _validate
from flag_env._files import check_file, machine, write_json
from flag_env.control import WindControl, wind_of
from flag_env.physics import Scene, Simulator, presets
from flag_env.physics.effects import CosineWind
from flag_env.physics.integrators import LFAB
from training.command import refusals
from training.identification import NAMES, Fit, Identification

INTERVAL = 0.04
"""Time between two recorded frames [s]."""


def known_scene(rows: int, cols: int) -> Scene:
    """What is known of every hidden scene; its step holds for stiffer and more viscous ones too."""
    flag = presets.flag(rows, cols, integrator=LFAB())
    mean = wind_of(flag, np.array([6.0, 0.0, 0.0]))
    flag = flag.adding(CosineWind(mean=tuple(mean.tolist()), frequency=tuple(WindControl.frequency.tolist())))
    return flag.replace(timestep=Simulator(flag.scaled(2.5, 2.5)).timestep)


def hide(scene: Scene, frames: int, noise: float, seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """True values in the order of `NAMES`, known gusts (frames, 3) and the noisy record of a hidden scene's motion."""
    rng = np.random.default_rng(seed)
    factors = 2.0 ** rng.uniform(-1, 1, 2)
    mean = wind_of(scene, np.array([6.0, 0.0, 0.0]) + rng.uniform(-2, 2, 3))
    gusts = np.repeat(0.3 * wind_of(scene, WindControl.gain) * rng.uniform(-1, 1, (-(-frames // 5), 3)), 5, axis=0)[:frames]
    simulator = Simulator(scene)
    simulator.set_parameters(*factors)
    simulator.set_wind(mean=mean)
    record = np.empty((frames, *scene.lattice.shape, 3))
    for frame, gust in enumerate(gusts):
        simulator.set_wind(amplitude=gust)
        simulator.advance(INTERVAL)
        record[frame] = simulator.positions[0]
    record[:, ~scene.lattice.fixed.reshape(scene.lattice.shape)] += noise * rng.standard_normal(
        (frames, int((~scene.lattice.fixed).sum()), 3)
    )
    return np.concatenate([factors, mean]), gusts, record


def identify(scenes: int, frames: int, noise: float, rows: int = 10, cols: int = 16) -> list[dict[str, Any]]:
    """A row for each hidden scene: truth, best value and 95 % interval of each unknown."""
    scene = known_scene(rows, cols)
    found = []
    for seed in tqdm(range(scenes), desc="hidden scenes"):
        truth, gusts, record = hide(scene, frames, noise, seed)
        fit: Fit = Identification(scene, record, INTERVAL, gusts).fit()
        found.append(
            {
                "noise (m)": fit.noise,
                **{
                    name: {"true": truth[k], "fitted": fit.values[k], "low": fit.low[k], "high": fit.high[k]}
                    for k, name in enumerate(NAMES)
                },
            }
        )
    return found


def within(rows: list[dict[str, Any]]) -> dict[str, float]:
    """Share of the scenes whose true value lies in its interval, for each unknown."""
    return {name: float(np.mean([row[name]["low"] <= row[name]["true"] <= row[name]["high"] for row in rows])) for name in NAMES}


def main(scenes: int = 20, frames: int = 40, noise: float = 1e-3, output: Path | None = None) -> None:
    """Fit hidden scenes and count how often the intervals hold the truth.

    Args:
        scenes: how many hidden scenes.
        frames: recorded frames, 0.04 s apart.
        noise: standard deviation of each recorded coordinate [m].
        output: JSON file to write as well.
    """
    with refusals():
        if output is not None:
            check_file("output", output, (".json",))
        _validate.count("scenes", scenes)
        _validate.count("frames", frames, 2)
        _validate.number("noise", noise, minimum=0.0)
    rows = identify(scenes, frames, noise)
    if output is not None:
        write_json(output, {"machine": machine(), "frames": frames, "noise": noise, "rows": rows})
    for name, share in within(rows).items():
        spread = np.median([(row[name]["high"] - row[name]["low"]) / 2 / abs(row[name]["true"]) for row in rows])
        print(f"{name:10} {share:6.0%} of the true values in their 95 % intervals; half an interval is {spread:.2%} of the value")


if __name__ == "__main__":
    tyro.cli(main)
