"""The gallery: every scene, by commands that exist; what is up to date is not made again."""

import inspect
import shlex

from docs._generate import gallery
from flag_env import cli
from flag_env.viewer import STAGES, of_stage


def test_every_scene_is_shown_by_a_command_that_exists():
    shown = {item.name: shlex.split(item.options) for item in gallery.items()}
    assert set(STAGES) < set(shown)
    for name, options in shown.items():
        assert {option.removeprefix("--") for option in options if option.startswith("--")} < set(
            inspect.signature(cli.record).parameters
        )
        assert name not in STAGES or options == ["--scene", name]
    page = gallery.pages()["gallery.md"]
    assert all(f'src="gallery/{name}.html"' in page and f'src="gallery/{name}.gif"' in page for name in shown)


def test_files_are_made_once(tmp_path, monkeypatch):
    made = []

    def short():
        made.append(1)
        return of_stage("rope", 0.1)

    monkeypatch.setattr(gallery, "items", lambda: [gallery.Item("rope", "Rope", "plucked", "--scene rope", short)])
    for _ in range(2):
        gallery.write(tmp_path / "gallery")
    assert sorted(path.name for path in (tmp_path / "gallery").iterdir()) == ["rope.gif", "rope.html"]
    assert len(made) == 1
