"""The preset scenes in motion: a replay and a GIF of each, and a picture of all."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray
from PIL import Image
from tqdm import tqdm

from flag_env import viewer
from flag_env._files import replacing
from flag_env.physics import Scene, Simulator, presets
from flag_env.render import Renderer, Snapshot, write_video

FPS = 25
SECONDS = 4.0
SIZE = 240
"""Width and height of a scene in the picture [pixels]."""


@dataclass(frozen=True)
class Shot:
    """A scene, the wind in it, and how many simulated seconds a second of the film shows."""

    scene: Scene
    told: str
    """What it shows, in a few words."""

    wind: tuple[float, float, float] = (0.0, 0.0, 0.0)
    pace: float = 1.0
    still: float = 2.0
    """Time of the gallery's picture [s of film]."""

    reach: float = 1.05
    """How far along the picture goes, in lengths of the flag at rest."""


def shots() -> dict[str, Shot]:
    """Every scene by its name; winds as `Simulator.set_wind` takes them."""
    flag = presets.flag()
    mean_mass = float(flag.lattice.masses.mean())
    breeze = (8 * mean_mass, -4 * mean_mass, 0.0)
    plane = (9 * mean_mass, 0.0, 0.0)
    half = (8 * mean_mass, -2 * mean_mass, 0.0)
    gale = (4800.0, 1150.0, 5700.0)
    return {
        "rope()": Shot(presets.rope(24), "one coordinate, plucked", pace=0.05, still=0.6),
        'rope(pinned="edge")': Shot(presets.rope(24, pinned="edge"), "its far end free", pace=0.05, still=1.4),
        "sheet()": Shot(presets.sheet(), "two coordinates, in its plane", plane, still=1.0),
        "flag()": Shot(flag, "a breeze across it", breeze, still=1.6),
        "two_layer_flag()": Shot(presets.two_layer_flag(), "struts and cube diagonals", half, still=0.9),
        "storm_flag()": Shot(presets.storm_flag(dtype="float32"), "turbulent air, cloth against cloth", still=3.0),
        "report_flag(layers=1)": Shot(presets.report_flag(), "the report's units and wind", gale, pace=0.1, still=2.0, reach=1.4),
        "report_flag(layers=2)": Shot(presets.report_flag(2), "no shear links, two layers", gale, pace=0.1, still=2.0, reach=1.4),
    }


def start(shot: Shot) -> Simulator:
    """The scene at rest in its wind; a rope drawn aside."""
    simulator = viewer.start(shot.scene)
    if any(shot.wind):
        simulator.set_wind(amplitude=shot.wind)
    return simulator


def draw(simulator: Simulator, renderer: Renderer, reach: float) -> NDArray[np.uint8]:
    """The scene's first copy now, (height, width, 3)."""
    positions = simulator.positions[0]
    length, height = simulator.scene.lattice.extent
    side, top = (0.3 * length, (reach - 0.95) * height) if height > 0 else (0.02 * length, 0.42 * length)
    low = -0.55 * height if height > 0 else -0.42 * length
    bounds = np.array([[-0.1 * length, -side, low], [reach * length, side, height + top]])
    intact = simulator.intact_cells()[0]
    return renderer.draw(Snapshot(positions, mast=positions[0, [0, -1], 0], bounds=bounds, intact=intact))


def film(shot: Shot, renderer: Renderer, seconds: float) -> Iterator[NDArray[np.uint8]]:
    """Frames of a scene in motion."""
    simulator = start(shot)
    for _ in range(round(seconds * FPS)):
        yield draw(simulator, renderer, shot.reach)
        simulator.advance(shot.pace / FPS)


def still(shot: Shot, renderer: Renderer) -> NDArray[np.uint8]:
    """The scene at the time of the gallery's picture."""
    simulator = start(shot)
    simulator.advance(shot.pace * shot.still)
    return draw(simulator, renderer, shot.reach)


def motion(name: str, shot: Shot) -> viewer.Motion:
    """A scene in motion, for a replay."""
    reach = 1.25 * float(np.linalg.norm(shot.wind)) or None
    return viewer.of_simulator(start(shot), SECONDS, FPS, title=name, told=shot.told, pace=shot.pace, wind_reach=reach)


def run(output: Path, quick: bool) -> None:
    """Write gallery.png and, unless `quick`, a replay and a GIF of each scene."""
    output.mkdir(parents=True, exist_ok=True)
    stills = {}
    for name, shot in tqdm(shots().items(), desc="scenes"):
        renderer = Renderer(2 * SIZE, 2 * SIZE)
        stills[name] = still(shot, renderer)
        renderer.close()
        if not quick:
            renderer = Renderer(360, 360)
            write_video(list(film(shot, renderer, SECONDS)), output / f"{_file(name)}.gif", FPS)
            renderer.close()
            viewer.save(motion(name, shot), output / f"{_file(name)}.html")
    with replacing(output / "gallery.png") as partial:
        _picture(stills).save(partial, optimize=True)
    print(f"written: {output / 'gallery.png'}")


def _file(name: str) -> str:
    return name.replace("()", "").replace('"', "")


def _picture(stills: dict[str, NDArray[np.uint8]]) -> Image.Image:
    """All scenes in two rows, their names and what they show below them; 255 colours, for a small file."""
    gap, caption, told = 8, 44, {name: shot.told for name, shot in shots().items()}
    cols, rows = -(-len(stills) // 2), 2
    width, height = cols * (SIZE + gap) + gap, rows * (SIZE + caption) + gap
    figure = Figure(figsize=(width / 100, height / 100), dpi=100, facecolor="white")
    for place, (name, picture) in enumerate(stills.items()):
        left = gap + place % cols * (SIZE + gap)
        top = gap + place // cols * (SIZE + caption)
        small = Image.fromarray(picture).resize((SIZE, SIZE), Image.Resampling.LANCZOS)
        axes = figure.add_axes((left / width, 1 - (top + SIZE) / height, SIZE / width, SIZE / height))
        axes.imshow(np.asarray(small), interpolation="nearest")
        axes.set_axis_off()
        middle = (left + SIZE / 2) / width
        figure.text(middle, 1 - (top + SIZE + 13) / height, name, ha="center", va="center", fontsize=10, family="monospace")
        figure.text(
            middle, 1 - (top + SIZE + 29) / height, told[name], ha="center", va="center", fontsize=8.5, color="#5a646e"
        )  # fmt: skip
    file = BytesIO()
    figure.savefig(file, format="png")
    return Image.open(file).convert("RGB").quantize(255, dither=Image.Dither.NONE)
