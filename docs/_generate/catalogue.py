"""What the catalogues hold: effects, integrators, presets, commands, extras."""

from __future__ import annotations

import dataclasses
import inspect
import re
import tomllib
from pathlib import Path
from typing import Any

from docs._generate.markdown import code, first_line, module_text, parameters, table
from flag_env import cli
from flag_env.physics import effects, integrators, presets
from flag_env.physics.effects import Effect
from flag_env.physics.integrators import Integrator

ROOT = Path(__file__).resolve().parents[2]


def catalogue(module: Any, base: type) -> list[Any]:
    """Public classes of a catalogue that can be used as they are."""
    values = (getattr(module, name) for name in module.__all__)
    kinds = [value for value in values if isinstance(value, type) and issubclass(value, base)]
    return [kind for kind in kinds if not any(issubclass(other, kind) and other is not kind for other in kinds)]


def shipped_effects() -> list[type[Effect]]:
    """The effects."""
    return catalogue(effects, Effect)


def shipped_integrators() -> list[type[Integrator]]:
    """The integrators."""
    return catalogue(integrators, Integrator)


def pages() -> dict[str, str]:
    """Tables of names, and a section of reference for each effect and integrator."""
    return {
        "effects.md": _names(shipped_effects(), "effect"),
        "effects_reference.md": "\n".join(_section(kind) for kind in shipped_effects()),
        "integrators.md": table(
            ["integrator", "order", "force evaluations a step", "what it is"],
            [[_link(kind), kind.order, kind().evaluations, _summary(kind)] for kind in shipped_integrators()],
        ),
        "integrators_reference.md": "\n".join(_section(kind) for kind in shipped_integrators()),
        "presets.md": table(["preset", "what it is"], [[_call(value), first_line(value)] for value in _presets()]),
        "commands.md": table(
            ["command", "what it does"], [[code(f"flag-env {name}"), first_line(value)] for name, value in _commands().items()]
        ),
        "extras.md": table(["extra", "brings"], _extras()),
        "contributing.md": _as_page("CONTRIBUTING.md"),
        "changelog.md": _as_page("CHANGELOG.md"),
    }


def _names(kinds: list[Any], what: str) -> str:
    return table([what, "what it is"], [[_link(kind), _summary(kind)] for kind in kinds])


def _link(kind: type) -> str:
    return f"[`{kind.__name__}`](#{kind.__name__.lower()})"


def _summary(kind: type) -> str:
    """First sentence of the module, without the name that it opens with."""
    sentence = " ".join(module_text(kind).split("\n\n")[0].split())
    text = sentence.partition(": ")[2] or sentence
    return text[:1].upper() + text[1:]


def _section(kind: Any) -> str:
    """Heading, parameters with their defaults, and the module's formula and source."""
    meaning = {name: text for base in reversed(kind.__mro__) for name, text in parameters(base).items()}
    fields = [field for field in dataclasses.fields(kind) if field.init]
    fields.sort(key=lambda field: field.name == "name")  # which all effects have, comes last
    rows = [[code(field.name), code(repr(_default(field))), meaning.get(field.name, "")] for field in fields]
    listed = table(["parameter", "default", "meaning"], rows) if rows else ""
    return f"## {kind.__name__}\n\n{_fenced(module_text(kind))}\n\n{listed}"


def _fenced(text: str) -> str:
    """Indented formulas as fenced blocks, so that no highlighter reads them as code."""
    blocks = []
    for block in text.split("\n\n"):
        indented = all(line.startswith("    ") for line in block.splitlines())
        blocks.append(f"```text\n{inspect.cleandoc(block)}\n```" if indented else block)
    return "\n\n".join(blocks)


def _default(field: dataclasses.Field[Any]) -> Any:
    if field.default is not dataclasses.MISSING:
        return field.default
    return field.default_factory() if field.default_factory is not dataclasses.MISSING else ...


def _as_page(name: str) -> str:
    """A file beside the README as one of the pages: links among pages lead there, links to other files are their names."""
    text = (ROOT / name).read_text(encoding="utf-8")
    text = re.sub(r"\]\((?:docs/)?([\w/]+)\.md\)", lambda found: f"]({found[1].lower()}.md)", text)
    return re.sub(r"\[[^]]*\]\(((?!http)[^)]*(?<!\.md))\)", r"`\1`", text)


def _presets() -> list[Any]:
    """Public functions of the module that return a scene."""
    found = inspect.getmembers(presets, inspect.isfunction)
    here = [value for name, value in found if value.__module__ == presets.__name__ and not name.startswith("_")]
    return sorted(here, key=lambda value: value.__code__.co_firstlineno)


def _call(function: Any) -> str:
    """The call with the arguments that have no default of their own left out."""
    shown = [
        f"{name}={parameter.default!r}"
        for name, parameter in inspect.signature(function).parameters.items()
        if parameter.kind is parameter.POSITIONAL_OR_KEYWORD
    ]
    return code(f"{function.__name__}({', '.join(shown)})")


def _commands() -> dict[str, Any]:
    """Subcommands of `flag-env`, which are the public functions of its module."""
    found = dict(inspect.getmembers(cli, inspect.isfunction))
    return {
        name: value for name, value in found.items() if value.__module__ == cli.__name__ and name != "main" and name[0] != "_"
    }


def _extras() -> list[list[str]]:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    bare = {
        name: [re.split(r"[>=<,\s]", entry)[0] for entry in wanted] for name, wanted in project["optional-dependencies"].items()
    }
    return [[code(name), ", ".join(code(entry) for entry in entries)] for name, entries in bare.items()]
