"""The package's import rules: one direction, and a physics that stands alone."""

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1] / "flag_env"

RUNNING = tuple(f"flag_env.physics.{name}" for name in ("scene", "simulator", "run", "spectrum", "stability"))
FORBIDDEN = {
    "physics": ("gymnasium", "matplotlib", "torch", "stable_baselines3", "flag_env.control", "flag_env.tasks", "flag_env.envs",
                "flag_env.render", "flag_env.studies", "flag_env.cli"),
    "render": ("gymnasium", "torch", "stable_baselines3", "numba", "flag_env.physics", "flag_env.control", "flag_env.tasks",
               "flag_env.envs", "flag_env.studies", "flag_env.cli"),
    "control": ("gymnasium", "matplotlib", "torch", "stable_baselines3", "flag_env.tasks", "flag_env.envs", "flag_env.render",
                "flag_env.studies", "flag_env.cli"),
    "tasks": ("gymnasium", "matplotlib", "torch", "stable_baselines3", "flag_env.control", "flag_env.envs", "flag_env.render",
              "flag_env.studies", "flag_env.cli"),
    "envs": ("matplotlib", "torch", "flag_env.studies", "flag_env.cli", "training"),
    "studies": ("flag_env.cli", "training"),
    "physics/effects": (*RUNNING, "flag_env.physics.compose", "flag_env.physics.integrators"),
    "physics/integrators": (*RUNNING, "flag_env.physics.lattice", "flag_env.physics.effects"),
    "physics/compose.py": (*RUNNING, "flag_env.physics.effects", "flag_env.physics.integrators", "flag_env.physics.lattice"),
    "physics/compiler.py": ("flag_env",),
    "physics/jit.py": ("flag_env.physics.effects", "flag_env.physics.integrators", "flag_env.physics.lattice",
                       "flag_env.physics.scene", "flag_env.physics.compose"),
    "physics/lattice.py": ("flag_env.physics.effects", "flag_env.physics.scene", "flag_env.physics.compose"),
}  # fmt: skip
"""What a part of the package must not import, at any depth."""


def imported(path: Path) -> set[str]:
    names: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            assert node.level == 0, f"{path}: relative import"
            names |= {node.module, *(f"{node.module}.{alias.name}" for alias in node.names)}
    return names


@pytest.mark.parametrize("part", FORBIDDEN)
def test_imports_run_one_way(part):
    place = ROOT / part
    files = [place] if place.is_file() else sorted(place.rglob("*.py"))
    assert files
    wrong = {
        (str(path.relative_to(ROOT)), name)
        for path in files
        for name in imported(path)
        if any(name == other or name.startswith(other + ".") for other in FORBIDDEN[part])
    }
    assert not wrong


def test_pyplot_is_never_imported():
    assert not [path for path in ROOT.rglob("*.py") if "matplotlib.pyplot" in imported(path)]
