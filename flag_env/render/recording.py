"""Videos from frames, written whole or not at all."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator
from importlib import import_module
from itertools import chain, islice
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from flag_env._files import replacing

if TYPE_CHECKING:
    from PIL import Image

__all__ = ["write_video"]

Pixels = NDArray[np.uint8]

_SUFFIXES = (".gif", ".mp4")
_COLORS = 224  # of 256: the encoder needs a free one that stands for "as in the frame before"
_AHEAD, _EVERY = 32, 6  # the palette is that of every sixth of the first frames
_STEP = 4.0  # between two colours of a smooth area, about [of 255]


def write_video(frames: Iterable[Pixels], path: str | os.PathLike[str], fps: float) -> Path:
    """Write frames as a GIF or MP4, after the suffix of `path`, and return the path.

    The file appears only when it is whole: if `frames` or the encoder raises, what stood at `path` stays.

    Args:
        frames: at least one RGB picture, uint8, shape (height, width, 3), all of one size; read one by one.
        path: where to write; ends in .gif or .mp4; its directory is made if it is not there.
        fps: frames per second, > 0. GIF rounds the time between frames to 10 ms, and to no less than 20 ms.
    """
    path = Path(path)
    suffix = path.suffix.lower()
    if suffix not in _SUFFIXES:
        raise ValueError(f"path is {str(path)!r}; allowed is a name that ends in {' or '.join(_SUFFIXES)}")
    if not (np.isfinite(fps) and fps > 0):
        raise ValueError(f"fps is {fps!r}; allowed is a finite number > 0")
    write = _write_gif if suffix == ".gif" else _write_mp4
    with replacing(path) as partial:
        write(_checked(frames), partial, float(fps))
    return path


def _checked(frames: Iterable[Pixels]) -> Iterator[Pixels]:
    """Yield the frames; raise ValueError at a wrong one, or if there is none."""
    shape: tuple[int, ...] | None = None
    for number, frame in enumerate(frames):
        if not isinstance(frame, np.ndarray) or frame.dtype != np.uint8 or frame.ndim != 3 or frame.shape[2] != 3:
            kind = f"{frame.dtype} of shape {frame.shape}" if isinstance(frame, np.ndarray) else type(frame).__name__
            raise ValueError(f"frames[{number}] is {kind}; allowed is uint8 of shape (height, width, 3)")
        if shape is not None and frame.shape != shape:
            raise ValueError(f"frames[{number}] has shape {frame.shape}; allowed is that of frames[0], {shape}")
        shape = frame.shape
        yield frame
    if shape is None:
        raise ValueError("frames is empty; allowed is at least one frame")


def _write_gif(frames: Iterator[Pixels], path: Path, fps: float) -> None:
    from PIL import Image

    first = list(islice(frames, _AHEAD))
    palette = _palette(np.concatenate(first[::_EVERY]))
    grain = _grain(*first[0].shape[:2])

    def indexed(frame: Pixels) -> Image.Image:
        # One palette for as long as it fits, and the same grain in every frame: still pixels keep their number, so
        # that the encoder stores only what moves.
        nonlocal palette
        image = Image.fromarray(np.clip(np.rint(frame + grain), 0, 255).astype(np.uint8))
        result = image.quantize(palette=palette, dither=Image.Dither.NONE)
        if not _fits(np.asarray(result.convert("RGB")), frame):
            palette = _palette(frame)
            result = image.quantize(palette=palette, dither=Image.Dither.NONE)
        return result

    every = (indexed(frame) for frame in chain(first, frames))
    next(every).save(
        path,
        format="GIF",
        save_all=True,
        append_images=every,
        duration=max(20, 10 * round(100.0 / fps)),
        loop=0,
        optimize=True,  # pixels that stay become transparent, which compresses well
    )


def _palette(frame: Pixels) -> Image.Image:
    """Return an image that carries the palette for `frame`."""
    from PIL import Image

    # Half the colours go to wide areas, where a gradient would show steps, half to all hues that there are.
    image, half = Image.fromarray(frame), _COLORS // 2
    methods = (Image.Quantize.MEDIANCUT, Image.Quantize.FASTOCTREE)
    halves = [image.quantize(half, method=method).getpalette() or [] for method in methods]
    carrier = Image.new("P", (1, 1))
    carrier.putpalette(halves[0][: 3 * half] + halves[1][: 3 * half])
    return carrier


def _grain(height: int, width: int) -> NDArray[np.float64]:
    """Return what is added to a frame so that gradients show no steps, shape (height, width, 1): Bayer's ordered dither."""
    bayer = np.zeros((1, 1))
    for _ in range(3):
        bayer = np.block([[4 * bayer, 4 * bayer + 2], [4 * bayer + 3, 4 * bayer + 1]])
    tile = _STEP * ((bayer + 0.5) / bayer.size - 0.5)
    return np.tile(tile, (height // 8 + 1, width // 8 + 1))[:height, :width, None]


def _fits(shown: Pixels, wanted: Pixels) -> bool:
    """Return whether all but a few pixels, looked at sparsely, have about the wanted colour."""
    error = np.abs(shown[::3, ::3].astype(np.int16) - wanted[::3, ::3]).max(axis=-1)
    return bool(np.mean(error > 24) < 0.01)


def _write_mp4(frames: Iterator[Pixels], path: Path, fps: float) -> None:
    try:
        imageio = import_module("imageio.v2")
        import_module("imageio_ffmpeg")  # imageio falls back to other, lesser writers without it
    except ImportError as error:
        raise ImportError("MP4 needs imageio and imageio-ffmpeg; install them: pip install -e '.[training]'") from error
    writer = imageio.get_writer(path, format="FFMPEG", fps=fps, codec="libx264", quality=8, macro_block_size=2)
    try:
        for frame in frames:
            writer.append_data(frame)
    finally:
        writer.close()  # as a context manager it would leave ffmpeg running after an error
