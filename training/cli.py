"""The `flag-train` command: every script of this package under one name; `flag-train train` is `python -m training.train`."""

from __future__ import annotations

import ast
import runpy
import sys
from importlib.resources import files

SCRIPTS = {
    "train": "train",
    "evaluate": "evaluate",
    "record": "record",
    "benchmark": "benchmark",
    "accuracy-cost": "accuracy_cost",
    "vector-speed": "vector_speed",
    "rllib": "rllib_train",
    "plan": "plan",
    "identify": "identify",
}
"""Subcommand -> module, which takes its own arguments."""


def usage() -> str:
    """The subcommands, each with the first sentence of its module."""
    lines = ["usage: flag-train COMMAND [--help] [OPTIONS]", ""]
    for name, module in SCRIPTS.items():
        source = files("training").joinpath(f"{module}.py").read_text(encoding="utf-8")
        lines.append(f"  {name:14} {(ast.get_docstring(ast.parse(source)) or '').partition(': `')[0].splitlines()[0]}")
    return "\n".join(lines)


def main() -> None:
    """Run a subcommand."""
    name, *rest = sys.argv[1:] or ["--help"]
    if name in ("-h", "--help"):
        print(usage())
        return
    if name not in SCRIPTS:
        sys.exit(f"COMMAND must be one of {', '.join(SCRIPTS)}, got {name!r}")
    sys.argv = [f"flag-train {name}", *rest]
    try:
        runpy.run_module(f"training.{SCRIPTS[name]}", run_name="__main__", alter_sys=True)
    except ModuleNotFoundError as missing:
        if (missing.name or "").partition(".")[0] in ("flag_env", "training"):
            raise
        sys.exit(f'flag-train needs the extra "training", which brings {missing.name}: pip install "flag_env[training]"')
