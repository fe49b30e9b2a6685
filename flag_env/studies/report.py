"""How the studies' results are shown and written."""

from __future__ import annotations

import io
import json
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from PIL import Image

from flag_env._files import machine, replacing, write_bytes

if TYPE_CHECKING:
    from matplotlib.figure import Figure

DPI = 120
"""Resolution of figures."""


def table(rows: Sequence[dict[str, Any]]) -> str:
    """Rows as a Markdown table; numbers to three digits."""
    heads = list(rows[0])
    cells = [[_text(row[head]) for head in heads] for row in rows]
    widths = [max(len(head), *(len(line[i]) for line in cells)) for i, head in enumerate(heads)]
    lines = [heads, ["-" * width for width in widths], *cells]
    return "\n".join(
        "| " + " | ".join(cell.ljust(width) for cell, width in zip(line, widths, strict=True)) + " |" for line in lines
    )


def _text(value: Any) -> str:
    return f"{value:.3g}" if isinstance(value, float) else str(value)


def write(output: Path, name: str, rows: Sequence[dict[str, Any]], figure: Figure, **more: Any) -> None:
    """Print the table and write `name`.json and `name`.png into `output`, whole or not at all."""
    text = json.dumps({"machine": machine(), "rows": rows, **more}, indent=1)
    write_bytes(output / f"{name}.json", (text + "\n").encode())
    with replacing(output / f"{name}.png") as partial:
        _save(figure, partial)
    print(table(rows))
    print(f"written: {output / name}.json, {output / name}.png")


def _save(figure: Figure, path: Path) -> None:
    """The figure as a PNG of at most 256 colours, a third as large as one of all colours."""
    figure.savefig(whole := io.BytesIO(), dpi=DPI, format="png")
    with Image.open(whole) as picture:
        picture.convert("RGB").quantize(256, dither=Image.Dither.NONE).save(path, format="png", optimize=True)
