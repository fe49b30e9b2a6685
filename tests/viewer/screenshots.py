"""Pictures of the live page, of a replay, and of both in narrow windows: `python -m tests.viewer.screenshots build/screens`."""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path
from typing import Any

from PIL import Image
from tqdm import tqdm

from flag_env.viewer import STAGES, Session, Task, of_episode, save
from flag_env.viewer.host import Background
from tests.viewer.chromium import Tab, browser

WIDE, SMALL, NARROW = (1280, 800), (800, 500), (420, 760)


@contextmanager
def opened(started: Any, size: tuple[int, int], **session: Any) -> Iterator[Tab]:
    """A page of a session of its own."""
    shown = Session(**session)
    shown.settle()
    server = Background(shown, 0)
    page = Tab(started, server.address, size, device_scale_factor=2)
    try:
        page.wait("window.live && live.drawn > 2 && live.status")
        yield page
        assert page.errors == [], page.errors
    finally:
        page.context.close()
        server.close()
        shown.close()


def keep(page: Tab, path: Path) -> None:
    """A picture of the page, drawn twice as large and made smaller: software WebGL smooths no edges."""
    image = Image.open(BytesIO(page.page.screenshot()))
    image.convert("RGB").resize((image.width // 2, image.height // 2), Image.Resampling.LANCZOS).save(path, quality=90)


def fly(page: Tab, seconds: float) -> None:
    """Let time pass in the scene, however slowly the pictures come."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        page.page.wait_for_timeout(100)


def modes(page: Tab, folder: Path, name: str) -> None:
    """The flag as it stands, in every way that it can be drawn."""
    page.page.click("#pause")
    page.wait("live.status.paused")
    for mode in ("cloth", "balls", "strain"):
        if page.value(f'Boolean(document.getElementById("mode-{mode}")) && !document.getElementById("mode-{mode}").hidden'):
            page.page.click(f"#mode-{mode}")
            page.page.wait_for_timeout(400)
            keep(page, folder / f"{name}-{mode}.jpg")


def run(folder: Path, only: str) -> None:
    """Write every picture whose name begins with `only`."""
    folder.mkdir(parents=True, exist_ok=True)
    with browser() as started:
        for name in tqdm([name for name in STAGES if name.startswith(only)], desc="scenes"):
            with opened(started, WIDE, stage=name) as page:
                fly(page, 3.0)
                modes(page, folder, name)
        for name, size in (("small", SMALL), ("narrow", NARROW)):
            if name.startswith(only):
                with opened(started, size) as page:
                    fly(page, 2.0)
                    keep(page, folder / f"{name}.jpg")
        for name, watch, size in (
            ("watch-witness", ("witness", 5), WIDE), ("watch-hand", ("hand", 5), WIDE), ("watch-narrow", ("witness", 5), NARROW),
        ):  # fmt: skip
            if name.startswith(only):
                with opened(started, size, watch=watch, task=Task()) as page:
                    page.wait("live.status.episode.steps > 40")
                    keep(page, folder / f"{name}.jpg")
        for name, size in (("replay", SMALL), ("replay-narrow", NARROW)):
            if name.startswith(only):
                path = save(of_episode(Task(), "witness", 5), folder / "replay.html")
                page = Tab(started, path.resolve().as_uri(), size, device_scale_factor=2)
                page.wait("window.player && player.time > 1.5")
                keep(page, folder / f"{name}.jpg")
                page.context.close()


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path, help="where the pictures go")
    parser.add_argument("--only", default="", help="pictures whose names begin so")
    arguments = parser.parse_args()
    run(arguments.folder, arguments.only)
