"""What the studies share: where they ran, and how their results are written."""

from __future__ import annotations

import datetime
import io
import json
import os
import platform
from collections.abc import Sequence
from importlib import metadata
from pathlib import Path
from typing import TYPE_CHECKING, Any

from PIL import Image

if TYPE_CHECKING:
    from matplotlib.figure import Figure

DPI = 120
"""Resolution of figures."""

PACKAGES = ("flag_env", "numpy", "numba", "scipy", "gymnasium", "matplotlib", "stable_baselines3", "torch")


def machine() -> dict[str, Any]:
    """Processor, number of usable cores, system, versions and date."""
    versions = {"python": platform.python_version()}
    for package in PACKAGES:
        try:
            versions[package] = metadata.version(package)
        except metadata.PackageNotFoundError:
            continue
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    return {
        "processor": _processor(),
        "cores": cores,
        "system": f"{platform.system()} {platform.machine()}",
        "versions": versions,
        "date": datetime.datetime.now(datetime.UTC).date().isoformat(),
    }


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
        return next(line.partition(":")[2].strip() for line in lines if line.startswith("model name"))
    except (OSError, StopIteration):
        return platform.processor() or "unknown"


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
    output.mkdir(parents=True, exist_ok=True)
    text = json.dumps({"machine": machine(), "rows": rows, **more}, indent=1)
    replace_file(output / f"{name}.json", lambda path: path.write_text(text + "\n"))
    replace_file(output / f"{name}.png", lambda path: _save(figure, path))
    print(table(rows))
    print(f"written: {output / name}.json, {output / name}.png")


def _save(figure: Figure, path: Path) -> None:
    """The figure as a PNG of at most 256 colours, a third as large as one of all colours."""
    figure.savefig(whole := io.BytesIO(), dpi=DPI, format="png")
    with Image.open(whole) as picture:
        picture.convert("RGB").quantize(256, dither=Image.Dither.NONE).save(path, format="png", optimize=True)


def replace_file(path: Path, writer: Any) -> None:
    """Let `writer(path)` write a file that takes the place of the old one only once it is whole."""
    partial = path.with_name(path.name + ".partial")
    writer(partial)
    partial.replace(path)
