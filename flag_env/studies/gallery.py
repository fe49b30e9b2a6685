"""The preset scenes in motion: a GIF of each, and a picture of all."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray
from tqdm import tqdm

from flag_env.physics import Scene, Simulator, presets
from flag_env.render import Renderer, Snapshot, write_video

FPS = 25
SECONDS = 4.0


@dataclass(frozen=True)
class Shot:
    """A scene, the wind in it, and how many simulated seconds a second of the film shows."""

    scene: Scene
    wind: tuple[float, float, float] = (0.0, 0.0, 0.0)
    pace: float = 1.0
    still: float = 2.0
    """Time of the gallery's picture [s of film]."""


def shots() -> dict[str, Shot]:
    """Every scene by its name; winds as `Simulator.set_wind` takes them."""
    flag = presets.flag()
    mean_mass = float(flag.lattice.masses.mean())
    breeze = (5 * mean_mass, 6 * mean_mass, 0.0)
    plane = (9 * mean_mass, 0.0, 0.0)
    half = (2 * mean_mass, 4 * mean_mass, 0.0)
    return {
        "rope": Shot(presets.rope(24), pace=0.05, still=0.6),
        "sheet": Shot(presets.sheet(), plane),
        "flag": Shot(flag, breeze),
        "storm_flag": Shot(presets.storm_flag(dtype="float32"), still=3.0),
        "two_layer_flag": Shot(presets.two_layer_flag(), half),
        "report_flag(layers=1)": Shot(presets.report_flag(), (4800.0, 1150.0, 5700.0), pace=0.1),
        "report_flag(layers=2)": Shot(presets.report_flag(2), (4800.0, 1150.0, 5700.0), pace=0.1),
    }


def film(shot: Shot, renderer: Renderer, seconds: float) -> Iterator[NDArray[np.uint8]]:
    """Frames of a scene in motion."""
    simulator = Simulator(shot.scene)
    lattice = shot.scene.lattice
    if lattice.dimensions == 1:
        simulator.set_positions(_plucked(shot.scene))
    if any(shot.wind):
        simulator.set_wind(amplitude=shot.wind)
    length, height = lattice.extent
    reach = 0.55 * max(length, height)
    bounds = np.array([[-0.15 * length, -reach, -0.5 * reach - 0.4 * length], [1.1 * length, reach, height + 0.5 * reach]])
    for _ in range(round(seconds * FPS)):
        positions = simulator.positions[0]
        yield renderer.draw(Snapshot(positions, mast=positions[0, [0, -1], 0], bounds=bounds))
        simulator.advance(shot.pace / FPS)


def _plucked(scene: Scene) -> NDArray[np.float64]:
    """The rope drawn aside at a third of its length."""
    positions = scene.lattice.rest_positions.copy()
    x = positions[..., 0] / positions[..., 0].max()
    positions[..., 2] = 6.0 * np.minimum(x / 0.3, (1.0 - x) / 0.7)
    return positions


def run(output: Path, quick: bool) -> None:
    """Write a GIF of each scene and gallery.png."""
    output.mkdir(parents=True, exist_ok=True)
    stills = {}
    for name, shot in tqdm(shots().items(), desc="scenes"):
        renderer = Renderer(360, 360)
        frames = list(film(shot, renderer, shot.still if quick else SECONDS))
        renderer.close()
        stills[name] = frames[min(round(shot.still * FPS), len(frames) - 1)]
        if not quick:
            write_video(frames, output / f"{name}.gif", FPS)
    figure = Figure(figsize=(12, 6.3), layout="constrained")
    for axes, (name, still) in zip(figure.subplots(2, 4).ravel(), stills.items(), strict=False):
        axes.imshow(still)
        axes.set_title(name, fontsize=11, family="monospace")
    for axes in figure.axes:
        axes.set_axis_off()
    figure.savefig(output / "gallery.png", dpi=100)
    print(f"written: {output / 'gallery.png'}")
