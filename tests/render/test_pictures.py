"""Pictures against reviewed ones. `python tests/render/test_pictures.py` draws them anew, to be reviewed before they are kept."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from matplotlib.image import imread, imsave
from render_flags import BOUNDS, MAST, lattice

from flag_env.render import Renderer, Snapshot, Style

REFERENCE = Path(__file__).parent / "reference"
SIGNS = {"wind": [3.0, -4.0, 1.0], "wind_scale": 8.0, "distance": 0.08, "tolerance": 0.05}
TORN = np.ones((1, 9, 15), bool)
TORN[0, 4, 5:] = TORN[0, :3, 9] = False
CHESS = np.kron(np.indices((4, 6)).sum(axis=0) % 2, np.ones((5, 5)))[..., None] * [0.2, 0.5, 0.9]
SCENES = {
    "target": (Style(), {"target": lattice(wave=-0.2), **SIGNS}),
    "reached": (Style(), {"target": lattice(wave=0.17), **SIGNS, "success": True}),
    "torn": (Style(), {"intact": TORN}),
    "two_layers": (Style(azimuth=-100.0, elevation=30.0), {"positions": lattice(layers=2)}),
    "rope": (Style(), {"positions": lattice(rows=1, cols=12)}),
    "texture": (Style(texture=CHESS), SIGNS),
}


def picture(name: str) -> np.ndarray:
    style, changes = SCENES[name]
    return Renderer(160, 160, style).draw(Snapshot(**{"positions": lattice(), "mast": MAST, "bounds": BOUNDS} | changes))


@pytest.mark.parametrize("name", SCENES)
def test_it_looks_as_when_it_was_reviewed(name):
    reviewed = np.rint(255 * imread(REFERENCE / f"{name}.png")[..., :3])
    off = np.abs(picture(name).astype(float) - reviewed)
    assert off.mean() < 0.1  # of 255: another build of a library may round a pixel otherwise
    assert (off.max(axis=-1) > 30).mean() < 1e-3


if __name__ == "__main__":
    for name in SCENES:
        imsave(REFERENCE / f"{name}.png", picture(name))
