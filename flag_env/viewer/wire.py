"""What goes over the wire: messages from a page, checked, and frames to it.

A message is a JSON object with a key "do" and the fields of that verb, no others. A frame is, little-endian:

| bytes | what |
|---|---|
| 0-3, 4-7 | uint32: version of the scene it belongs to, number of the frame |
| 8-39 | 8 float32: time [s], wind (x, y, z) as a share of a full-length arrow, distance to the target or -1, 3 spare |
| 40- | float32 (x, y, z) of every particle [m] |
| then | in scenes that tear: uint16 a particle, bit j set while its link of family j holds; uint8 a cell, 1 while it is whole |
"""

from __future__ import annotations

import json
import math
import struct
from collections.abc import Mapping
from typing import Any, NamedTuple, NoReturn

import numpy as np
from numpy.typing import NDArray

from flag_env import _validate

LARGEST_MESSAGE = 4096
"""Bytes of the longest message that is read."""

VERBS: dict[str, tuple[str, ...]] = {
    "set": ("values",),
    "stage": ("name",),
    "mast": ("position", "tilt"),
    "pause": ("on",),
    "step": (),
    "reset": (),
    "watch": ("control", "level", "driver", "target"),
    "action": ("values",),
}
"""Fields of each verb."""

ACK = '{"do":"ack"}'
"""What a page says, in these very characters, when it has taken in a frame."""

_HEADER = struct.Struct("<2I8f")


class Torn(NamedTuple):
    """What of a cloth still holds: bits of each particle's links, (particles,) uint16; cells (layers, rows - 1, cols - 1)."""

    links: NDArray[np.uint16]
    cells: NDArray[np.bool_]


def parse(text: str | bytes) -> dict[str, Any]:
    """The message in `text`.

    Raises
    ------
    ValueError
        Unless it is an object with a known verb and exactly that verb's fields, all numbers finite.
    """
    if not isinstance(text, str):
        raise ValueError("message must be text, got bytes")
    if len(text) > LARGEST_MESSAGE:
        raise ValueError(f"message must have at most {LARGEST_MESSAGE} characters, got {len(text)}")
    try:
        message = json.loads(text, parse_constant=_refuse, parse_float=_finite, parse_int=_whole)
    except (json.JSONDecodeError, RecursionError) as error:
        raise ValueError(f"message must be JSON: {error}") from None
    if not isinstance(message, dict):
        raise ValueError(f"message must be a JSON object, got {message!r}")
    verb = _validate.choice("do", message.get("do"), VERBS)
    if set(message) - {"do"} != set(VERBS[verb]):
        raise ValueError(f"{verb!r} must come with the fields {list(VERBS[verb])}, got {sorted(set(message) - {'do'})}")
    if verb == "set" and not isinstance(message["values"], Mapping):
        raise ValueError(f"values must be an object, got {message['values']!r}")
    return message


def _refuse(constant: str) -> NoReturn:
    raise ValueError(f"message must hold finite numbers, got {constant}")


def _finite(text: str) -> float:
    number = float(text)
    return number if math.isfinite(number) else _refuse(text)


def _whole(text: str) -> int:
    return int(text) if len(text) < 16 else _refuse(text)


def pack(
    version: int,
    number: int,
    time: float,
    positions: NDArray[np.float64],
    wind: NDArray[np.float64] | None = None,
    distance: float = -1.0,
    torn: Torn | None = None,
) -> bytes:
    """A frame.

    Raises
    ------
    ValueError
        If a position is not finite.
    """
    if not np.isfinite(positions).all():
        raise ValueError("positions must be finite")
    x, y, z = (0.0, 0.0, 0.0) if wind is None else wind.tolist()
    header = _HEADER.pack(version, number, time, x, y, z, distance, 0.0, 0.0, 0.0)
    body = positions.astype("<f4").tobytes()
    tail = b"" if torn is None else torn.links.astype("<u2").tobytes() + torn.cells.astype(np.uint8).tobytes()
    return header + body + tail
