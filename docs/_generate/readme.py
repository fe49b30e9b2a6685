"""Brings the README's numbers and tables up to date: `python -m docs._generate.readme`.

What stands between `<!-- name -->` and `<!-- end -->` is generated: a number of `quoted`, or a generated file `name.md`.
"""

from __future__ import annotations

import re
from pathlib import Path

from docs._generate import pages
from docs._generate.quoted import quoted

README = Path(__file__).resolve().parents[2] / "README.md"
MARKED = re.compile(r"<!-- (\w+) -->.*?<!-- end -->", re.DOTALL)


def updated(text: str) -> str:
    """The README with everything that is marked generated anew."""
    values = quoted() | {name.removesuffix(".md"): f"\n\n{page}\n" for name, page in pages().items()}
    return MARKED.sub(lambda found: f"<!-- {found[1]} -->{values[found[1]]}<!-- end -->", text)


if __name__ == "__main__":
    README.write_text(updated(README.read_text(encoding="utf-8")), encoding="utf-8")
