"""The package's import rules: one direction, rooms entered through their `__init__`, and a physics that stands alone."""

import ast
import itertools
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

TOP = Path(__file__).parents[1]
FILES = sorted((*(TOP / "flag_env").rglob("*.py"), *(TOP / "training").rglob("*.py")))


def module_of(path: Path) -> str:
    parts = path.relative_to(TOP).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


MODULES = {module_of(path): path for path in FILES}
ROOMS = {module for module, path in MODULES.items() if path.name == "__init__.py"}

LAYERS = (
    {"flag_env._validate", "flag_env._files"},
    {"flag_env.physics.lattice", "flag_env.physics.compiling"},
    {"flag_env.physics.effects", "flag_env.physics.integrators"},
    {"flag_env.physics.scene"},
    {"flag_env.physics.presets", "flag_env.physics.limits", "flag_env.physics.diagnostics"},
    {"flag_env.physics.runtime"},
    {"flag_env.physics.copies"},
    {"flag_env.physics.simulator"},
    {"flag_env.physics.accuracy", "flag_env.physics.gradients"},
    {"flag_env.physics"},
    {"flag_env.render", "flag_env.control", "flag_env.autograd"},
    {"flag_env.tasks"},
    {"flag_env.envs"},
    {"flag_env.viewer"},
    {"flag_env.studies"},
    {"training"},
    {"flag_env.cli"},
)
"""From the bottom up: a part imports from layers below its own, never from its own layer or above."""

LIBRARIES = {
    "flag_env.physics": ("gymnasium", "matplotlib", "torch", "stable_baselines3"),
    "flag_env.physics.lattice": ("numba",),
    "flag_env.physics.scene": ("numba",),
    "flag_env.physics.presets": ("numba",),
    "flag_env.render": ("gymnasium", "torch", "stable_baselines3", "numba"),
    "flag_env.control": ("gymnasium", "matplotlib", "torch", "stable_baselines3"),
    "flag_env.tasks": ("gymnasium", "matplotlib", "torch", "stable_baselines3"),
    "flag_env.envs": ("matplotlib", "torch"),
}
"""Libraries that a part of the package does not import, at any depth."""


def imported(path: Path, *, names: bool = False) -> set[str]:
    """Modules that a file imports anywhere in it, and with `names` all that it imports from them."""
    found: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import"
            submodules = {f"{node.module}.{alias.name}" for alias in node.names}
            found |= submodules if names else {name if name in MODULES else node.module for name in submodules}
    return found


def within(module: str, part: str) -> bool:
    return module == part or module.startswith(part + ".")


def layer_of(module: str) -> tuple[int, str] | None:
    parts = [(index, part) for index, layer in enumerate(LAYERS) for part in layer if within(module, part)]
    return max(parts, key=lambda found: len(found[1]), default=None)


def test_every_module_has_a_layer():
    assert {module for module in MODULES if layer_of(module) is None} == {"flag_env"}


@pytest.mark.parametrize("module", [module for module in MODULES if module != "flag_env"])
def test_imports_run_one_way(module):
    index, part = layer_of(module)
    for name in imported(MODULES[module]) & set(MODULES):
        other, target = layer_of(name) or (-1, name)
        assert target == part or other < index, f"{module} imports {name}"


@pytest.mark.parametrize("module", MODULES)
def test_a_room_is_entered_through_its_init(module):
    own_rooms = {module, *(module.rsplit(".", up)[0] for up in range(1, module.count(".") + 1))}
    for name in imported(MODULES[module]) & set(MODULES):
        room = name if name in ROOMS else name.rpartition(".")[0]
        assert name in ROOMS or room in own_rooms or name in PUBLIC_MODULES, (
            f"{module} imports {name}, which {room} keeps to itself"
        )


PUBLIC_MODULES = {
    name
    for name in MODULES
    if name.rpartition(".")[0] in {"flag_env", "flag_env.physics", "flag_env.envs", "flag_env.studies", "training"}
}
"""Modules that are rooms of their own: one file each, named in the documentation."""


def test_no_circle_of_imports():
    graph = {module: imported(path) & set(MODULES) - {module} for module, path in MODULES.items()}
    TopologicalSorter({module: others - _enclosing(module) for module, others in graph.items()}).prepare()


def _enclosing(module: str) -> set[str]:
    """Packages around a module: importing from one of them its other modules is no circle by itself."""
    return set(itertools.accumulate(module.split(".")[:-1], lambda a, b: f"{a}.{b}"))


@pytest.mark.parametrize("part", LIBRARIES)
def test_heavy_libraries_stay_where_they_belong(part):
    for module, path in MODULES.items():
        if within(module, part):
            wrong = {name for name in imported(path, names=True) for library in LIBRARIES[part] if within(name, library)}
            assert not wrong, f"{module} imports {wrong}"


def test_private_names_stay_in_their_room():
    for module, path in MODULES.items():
        for node in ast.walk(ast.parse(path.read_text())):
            if (
                isinstance(node, ast.ImportFrom)
                and node.module in MODULES
                and node.module.rpartition(".")[0] != module.rpartition(".")[0]
            ):
                private = [
                    alias.name
                    for alias in node.names
                    if alias.name.startswith("_") and f"{node.module}.{alias.name}" not in MODULES
                ]
                assert not private, f"{module} imports {private} from {node.module}"
            if isinstance(node, ast.Attribute) and node.attr == "_run":
                assert module in ("flag_env.physics.copies", "flag_env.physics.simulator"), (
                    f"{module} reaches into a simulator's run"
                )


def test_pyplot_is_never_imported():
    assert not [
        module for module, path in MODULES.items() if any(within(n, "matplotlib.pyplot") for n in imported(path, names=True))
    ]
