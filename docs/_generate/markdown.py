"""Small pieces of Markdown, and what docstrings hold."""

from __future__ import annotations

import inspect
import re
import sys
from collections.abc import Iterable, Sequence
from typing import Any


def table(heads: Sequence[str], rows: Iterable[Sequence[Any]], *, right: bool = False) -> str:
    """A Markdown table; with `right` all columns but the first are aligned to the right."""
    rules = ["---"] + ["---:" if right else "---"] * (len(heads) - 1)
    lines = [heads, rules, *rows]
    return "\n".join("| " + " | ".join(_cell(cell) for cell in line) + " |" for line in lines) + "\n"


def _cell(value: Any) -> str:
    text = f"{value:.3g}" if isinstance(value, float) else str(value)
    return " ".join(text.split()).replace("|", "\\|")


def code(text: Any) -> str:
    """In code font."""
    return f"`{text}`"


def percent(share: float, digits: int = 1) -> str:
    """A share as a percentage, "100 %" without digits."""
    return "100 %" if share == 1.0 else f"{100 * share:.{digits}f} %"


def module_text(value: Any) -> str:
    """Docstring of the module that a class or function is defined in."""
    return inspect.cleandoc(sys.modules[value.__module__].__doc__ or "")


def first_line(value: Any) -> str:
    """First sentence of a docstring, which may take two lines."""
    paragraph = inspect.getdoc(value).split("\n\n")[0]  # type: ignore[union-attr]  (every public name has one)
    return " ".join(paragraph.split())


def parameters(value: Any) -> dict[str, str]:
    """Names and meanings in the numpydoc section "Parameters" of a docstring; several names of one entry are taken apart."""
    found = re.search(r"^Parameters\n-+\n(.*?)(?=^\w[^\n]*\n-{3,}$|\Z)", inspect.getdoc(value) or "", re.MULTILINE | re.DOTALL)
    result: dict[str, str] = {}
    for entry in re.split(r"^(?=\S)", found[1] if found else "", flags=re.MULTILINE):
        head, _, text = entry.partition("\n")
        for name in re.sub(r"\s:\s.*", "", head).split(", "):
            if name.strip():
                result[name.strip()] = " ".join(text.split())
    return result
