"""Sphinx extension: writes what the pages include, from the package's code and its committed results, and checks the links.

Each generator gives `file name -> Markdown`; the files go to `docs/_generated/`. A page takes one in with MyST's `include`.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from docs._generate import catalogue, environments, gallery, levels, links, studies, training

GENERATORS = (catalogue.pages, environments.pages, gallery.pages, levels.pages, studies.pages, training.pages)
FOLDER = Path(__file__).resolve().parents[1] / "_generated"


def pages() -> dict[str, str]:
    """Everything that the pages include."""
    return {name: text for generator in GENERATORS for name, text in generator().items()}


def write(_app: Any = None) -> None:
    """Write the generated files, those that differ from what is there."""
    FOLDER.mkdir(exist_ok=True)
    for name, text in pages().items():
        path = FOLDER / name
        if not path.exists() or path.read_text(encoding="utf-8") != text:
            path.write_text(text, encoding="utf-8")


def film(app: Any, failure: Exception | None) -> None:
    """Put the gallery's replays and videos beside the built pages."""
    if failure is None and app.builder.format == "html":
        gallery.write(Path(app.outdir) / "gallery")


def check(app: Any, failure: Exception | None) -> None:
    """Warn of links within the built pages that lead nowhere."""
    from sphinx.util import logging  # the generators serve without Sphinx too

    if failure is None and app.builder.format == "html":
        for problem in links.broken(Path(app.outdir)):
            logging.getLogger(__name__).warning(problem)


def tidied(_app: Any, what: str, _name: str, _object: Any, _options: Any, lines: list[str]) -> None:
    """Make a docstring reStructuredText: bars are magnitudes; Markdown headings begin what stands on a page of its own."""
    heading = next((index for index, line in enumerate(lines) if line.startswith("## ")), None)
    if heading is not None:
        del lines[heading:]
    if what == "property":
        lines[:] = [line.replace(": ", " -- ") for line in lines]  # napoleon takes what stands before a colon for a type
    lines[:] = [re.sub(r"\|(?=\w)", r"\\|", line) for line in lines]


def setup(app: Any) -> dict[str, Any]:
    """Sphinx's entry point."""
    app.setup_extension("sphinx.ext.autodoc")
    app.connect("builder-inited", write)
    app.connect("build-finished", film)
    app.connect("build-finished", check, priority=600)
    app.connect("autodoc-process-docstring", tidied, priority=100)  # before napoleon
    return {"parallel_read_safe": True, "parallel_write_safe": True}
