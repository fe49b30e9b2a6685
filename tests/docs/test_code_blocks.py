"""Every code block of the README and the documentation runs: Python as it stands, shell commands as far as their options."""

import contextlib
import functools
import importlib
import re
import runpy
import shlex
import sys
import tomllib
from pathlib import Path

import pytest

from tests.conftest import ROOT

PAGES = [
    path
    for path in sorted([ROOT / "README.md", ROOT / "CONTRIBUTING.md", *(ROOT / "docs").rglob("*.md")])
    if "_generated" not in path.parts
]
BLOCK = re.compile(r"^```(\w+)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
OUTSIDE = {"ray", "pytest", "flag-env", "flag-train", "python", "pip", "git", "ruff", "mypy", ".ci/run"}
"""Programs that a shell block may call."""


def blocks(page: Path, language: str) -> list[str]:
    """Code blocks of a page in a language, each behind as many empty lines as it has above it, so that errors name its line."""
    text = page.read_text(encoding="utf-8")
    return ["\n" * text[: found.start()].count("\n") + "\n" + found[2] for found in BLOCK.finditer(text) if found[1] == language]


def commands() -> list[tuple[str, str]]:
    found = []
    for page in PAGES:
        for block in blocks(page, "bash"):
            for line in block.splitlines():
                for command in re.sub(r"\s#.*$", "", line).split("&&"):
                    if command.strip():
                        found.append((page.relative_to(ROOT).as_posix(), command.strip()))
    return found


@pytest.mark.parametrize("page", [page for page in PAGES if blocks(page, "python")], ids=lambda page: page.stem)
def test_python_runs(page, tmp_path, monkeypatch):
    """The blocks of a page follow each other, as one script."""
    script, lines = tmp_path / f"{page.stem}.py", []
    for block in blocks(page, "python"):
        lines += block.splitlines()[len(lines) :]
    script.write_text("\n".join(lines) + "\n", encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    with contextlib.redirect_stdout(sys.stderr):
        runpy.run_path(str(script))


@pytest.mark.filterwarnings("ignore:.*found in sys.modules:RuntimeWarning")  # other tests have imported the scripts
@pytest.mark.parametrize(("page", "command"), dict.fromkeys(commands()))
def test_command_exists(page, command, monkeypatch, capsys):
    """The program is there, the extra is declared, and the options are known to its help."""
    words = shlex.split(command)
    words = [word for word in words if not re.fullmatch(r"\w+=\S*", word)]
    assert words[0] in OUTSIDE, f"{page}: {command}"
    options = {word for word in words[1:] if word.startswith("--")}
    if words[0] == "pip":
        extras = re.findall(r"\[(\w+)\]", command)
        known = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["optional-dependencies"]
        assert set(extras) <= set(known)
        return
    if words[:2] == ["python", "-m"] and words[2].startswith("training."):
        arguments = [words[2], "--help"]
        main = functools.partial(runpy.run_module, words[2], run_name="__main__", alter_sys=True)
    elif words[0] in ("flag-env", "flag-train"):
        arguments = [*[word for word in words[:2] if not word.startswith("-")], "--help"]
        main = importlib.import_module("flag_env.cli" if words[0] == "flag-env" else "training.cli").main
    else:
        return
    monkeypatch.setattr(sys, "argv", arguments)
    with contextlib.suppress(SystemExit):
        main()
    told = capsys.readouterr().out
    assert "usage" in told, f"{page}: {command}"
    assert not {option for option in options if option not in told}, f"{page}: {command}"
