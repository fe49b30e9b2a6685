"""A scene's machine code and memory hold what its effects call for, and nothing else."""

import re

import numba
import numpy as np
import pytest

from flag_env.physics import Lattice, Scene, Simulator, effects, presets
from flag_env.physics.compiling import step


def compiled(scene, monkeypatch):
    """The scene's step, compiled here and now, and the types of its arguments."""
    run = numba.njit(error_model="numpy", nogil=True, _nrt=False)(step.make_run())
    monkeypatch.setattr("flag_env.physics.runtime.run.compiled_run", lambda method, data: run)
    Simulator(scene).step(1)
    (signature,) = run.signatures
    return run, signature


def machine_code(scene, monkeypatch) -> str:
    """Assembly of the scene's step."""
    run, signature = compiled(scene, monkeypatch)
    return run.inspect_asm(signature)


def has(code: str, what: str) -> bool:
    patterns = {  # of x86-64, and of AArch64
        "square root": r"\bv?sqrt[ps][sd]\b|\bfsqrt\b",
        "division": r"\bv?div[ps][sd]\b|\bfdiv\b",
        "cosine": r"\b_?cos\b",
        "double": r"\bv?(add|mul|sub|fmadd\w*)[ps]d\b|\bf(add|mul|sub|madd|mla)\b.*(\bd\d|\.2d\b)",
    }
    return re.search(patterns[what], code) is not None


def instructions(code: str) -> int:
    return len(re.findall(r"^\t[a-z]", code, re.MULTILINE))


FLAG = presets.flag(4, 5)


@pytest.mark.parametrize(
    ("scene", "present", "absent"),
    [
        (Scene(FLAG.lattice, (effects.Gravity(),)), [], ["square root", "division", "cosine"]),
        (FLAG, ["square root", "division", "cosine"], []),
        (FLAG.without(effects.CosineWind), ["square root", "division"], ["cosine"]),
        (FLAG.without(effects.LinkEffect), ["cosine"], ["square root", "division"]),
        (presets.rope(9), [], ["square root", "division", "cosine"]),
        (Scene(FLAG.lattice, (effects.Gravity(),), dtype="float32"), [], ["square root", "double", "cosine"]),
    ],
    ids=["gravity", "flag", "calm", "no springs", "rope", "float32"],
)
def test_machine_code(scene, present, absent, monkeypatch):
    run, signature = compiled(scene, monkeypatch)
    kinds = [kind.instance_class for kind in signature[1].types]
    assert kinds == [type(data) for data in Simulator(scene).run.effects]  # nothing else is handed over
    assert len(kinds) == len(scene.effects)
    code = run.inspect_asm(signature)
    assert [what for what in present if not has(code, what)] == []
    assert [what for what in absent if has(code, what)] == []


def test_each_effect_adds_code_of_its_own(monkeypatch):
    lengths = []
    scene = Scene(FLAG.lattice)
    for effect in (effects.Gravity(), effects.AirDrag(), effects.Structural()):
        scene = scene.adding(effect)
        lengths.append(instructions(machine_code(scene, monkeypatch)))
    assert lengths == sorted(set(lengths))


def test_a_rope_touches_one_coordinate_and_one_layer_no_cross_links():
    """By what the compiled step reads: rows of coordinates poisoned beyond the first, and links that lead across layers."""
    rope = Simulator(presets.rope(9))
    assert rope.run.x.shape == rope.run.v.shape == (1, 1, 9)
    forces, effect_work, _ = rope.run._work[0]
    forces[:] = effect_work[:] = np.nan
    rope.step(10)
    assert forces.shape == (1, 9)
    assert np.isfinite(forces).all()
    assert np.isfinite(effect_work[0, : 9 + 1]).all()
    assert np.isnan(effect_work[0, 9 + 1 :]).all()
    assert np.isnan(effect_work[1:]).all()

    def crossing(scene):
        offsets = [o for data in Simulator(scene).run.effects if hasattr(data, "offset") for o in data.offset]
        return sum(offset >= scene.lattice.rows * scene.lattice.cols - scene.lattice.cols - 1 for offset in offsets)

    assert crossing(FLAG) == 0
    assert crossing(presets.two_layer_flag(4, 5)) == 5  # the strut and the four diagonals of a cube


def arrays(value) -> list[np.ndarray]:
    return [entry for entry in value if isinstance(entry, np.ndarray)]


def test_memory_held_is_the_sum_over_the_effects():
    """A one-layer scene holds no cross links; a scene without an effect holds none of its arrays."""
    whole = Simulator(FLAG)
    kinds = [type(data).__name__ for data in whole.run.effects]
    assert kinds == ["GravityData", "Isotropic3", "Isotropic3", "Isotropic3", "AirDragData", "CosineWindData"]
    bytes_of = {
        type(effect): sum(array.nbytes for array in arrays(data))
        for effect, data in zip(FLAG.effects, whole.run.effects, strict=True)
    }
    for effect in FLAG.effects:
        cut = Simulator(FLAG.without(type(effect)))
        held = sum(array.nbytes for data in cut.run.effects for array in arrays(data))
        assert held == sum(bytes_of.values()) - bytes_of[type(effect)]


def test_undamped_links_carry_no_viscosity():
    (springs,) = Simulator(Scene(Lattice(1, 3, 3), (effects.Structural(viscosity=0.0),))).run.effects
    (dampers,) = Simulator(Scene(Lattice(1, 3, 3), (effects.Structural(viscosity=0.1),))).run.effects
    assert "viscosity" not in springs._fields
    assert "viscosity" in dampers._fields
