"""Finds links within built HTML pages that lead nowhere; nothing is asked of the network."""

from __future__ import annotations

from collections.abc import Iterator
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

NO_PAGES = {"genindex.html", "search.html", "py-modindex.html"}


class _Page(HTMLParser):
    """Targets that a page links to, and the anchors that it has."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.targets: set[str] = set()
        self.anchors: set[str] = set()
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Gather links and anchors."""
        for name, value in attrs:
            if name == "id" and value:
                self.anchors.add(value)
            if value and ((tag in {"a", "link"} and name == "href") or (tag in {"img", "script"} and name == "src")):
                self.targets.add(value)


def broken(folder: Path) -> Iterator[str]:
    """A sentence for each link of a page in `folder` that leads to no file or to no anchor in it."""
    pages = {path: _Page(path.read_text(encoding="utf-8")) for path in sorted(folder.rglob("*.html"))}
    for path, page in pages.items():
        for target in sorted(page.targets):
            parts = urlsplit(target)
            if parts.scheme or parts.netloc:
                continue
            aim = (path.parent / unquote(parts.path)).resolve() if parts.path else path
            where = f"{path.relative_to(folder)} links to {target}"
            if not aim.exists():
                yield f"{where}, which is not there"
            elif parts.fragment and aim in pages and aim.name not in NO_PAGES and parts.fragment not in pages[aim].anchors:
                yield f"{where}, which has no such anchor"
