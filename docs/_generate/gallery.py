"""The gallery: every scene of the live page and two witnesses, each a replay and a GIF, by the command that a reader types."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import flag_env
from flag_env.viewer import STAGES, Motion, Task, of_episode, of_stage, save

SECONDS, SIZE = 3.0, 320


@dataclass(frozen=True)
class Item:
    """What is shown, by which command, and how it is made."""

    name: str
    title: str
    told: str
    options: str
    make: Callable[[], Motion]

    def markdown(self) -> str:
        """Its place in the page: the replay, the GIF beside it, and the command."""
        here = f"gallery/{self.name}"
        return (
            f"## {self.title}\n\n{self.told[0].upper()}{self.told[1:]}.\n\n"
            ':::{raw} html\n<div class="shown">\n'
            f'<iframe src="{here}.html" loading="lazy" title="{self.title}: replay"></iframe>\n'
            f'<img src="{here}.gif" loading="lazy" alt="{self.title}">\n</div>\n:::\n\n'
            f"```bash\nflag-env record {self.options} --output {self.name}.html\n```\n"
        )


def items() -> list[Item]:
    """Everything in the gallery, in order."""
    scenes = [
        Item(name, stage.title, stage.told, f"--scene {name}", partial(of_stage, name, SECONDS)) for name, stage in STAGES.items()
    ]
    told = "actions that are known to reach the target, under {} control"
    episodes = [
        Item(
            f"witness-{name}",
            f"A witness, {name} control",
            told.format(name),
            f"--witness 5 --control {name}",
            partial(_witness, name),
        )
        for name in ("wind", "mast")
    ]
    return episodes + scenes


def _witness(control: str) -> Motion:
    return of_episode(Task(control), "witness", 5)


def pages() -> dict[str, str]:
    """What the gallery's page includes."""
    return {"gallery.md": "\n".join(item.markdown() for item in items())}


def write(folder: Path) -> None:
    """Make the replays and GIFs that are missing there, or older than the code that makes them."""
    package = Path(flag_env.__file__).parent
    newest = max(
        path.stat().st_mtime for room in ("viewer", "render", "physics") for path in (package / room).rglob("*.[pj][ys]")
    )
    folder.mkdir(parents=True, exist_ok=True)
    for item in items():
        paths = [folder / f"{item.name}.{suffix}" for suffix in ("html", "gif")]
        if all(path.exists() and path.stat().st_mtime > newest for path in paths):
            continue
        motion = item.make()
        for path in paths:
            save(motion, path, SIZE)
