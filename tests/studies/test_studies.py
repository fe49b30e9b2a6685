"""The studies' baselines compute the right thing, and the studies write what they say."""

import dataclasses
import inspect
import json
import subprocess
import sys

import numpy as np
import pytest

from flag_env.physics import Simulator, effects, presets
from flag_env.physics.integrators import Leapfrog
from flag_env.studies import effects as effects_study
from flag_env.studies import gallery, report
from flag_env.studies.plain import PlainFlag
from flag_env.studies.speed_rows import Row, median
from flag_env.studies.timing import fastest


def test_the_plain_flag_is_the_same_flag():
    """Two programs that share no code agree after 500 steps."""
    scene = presets.flag(6, 9, perturbation=1e-3, integrator=Leapfrog()).without(effects.AirDrag, effects.CosineWind)
    simulator = Simulator(scene)
    links = [effect for effect in scene.effects if isinstance(effect, effects.LinkEffect)]
    lattice = scene.lattice
    plain = PlainFlag(
        6,
        9,
        lattice.spacings[:2],
        lattice.masses,
        tuple(link.stiffness for link in links),
        tuple(link.viscosity for link in links),
        simulator.timestep,
        "float64",
    )
    plain.x[:] = simulator.positions.reshape(-1, 3)
    simulator.step(500)
    plain.step(500)
    np.testing.assert_allclose(plain.x, simulator.positions.reshape(-1, 3), rtol=0, atol=1e-10)
    assert np.abs(plain.x - lattice.rest_positions.reshape(-1, 3)).max() > 0.1


def test_jobs_take_turns_and_the_first_turn_does_not_count():
    order = []
    times = fastest({"a": lambda: order.append("a"), "b": lambda: order.append("b")}, rounds=2)
    assert order == ["a", "b"] * 3
    assert set(times) == {"a", "b"}
    assert min(times.values()) > 0


def test_table_is_markdown():
    lines = report.table([{"name": "x", "value": 1.23456}, {"name": "longer", "value": 20.0}]).splitlines()
    assert lines[0] == "| name   | value |"
    assert lines[2] == "| x      | 1.23  |"
    assert len({len(line) for line in lines}) == 1


def test_a_speed_row_says_what_is_reached():
    assert [Row("", "x", value, 2.0, 4.0).reached for value in (1.9, 2.0, 4.0)] == ["no", "bar", "aim"]
    assert [Row("", "ms", value, 4.0, 2.0, less=True).reached for value in (4.1, 4.0, 2.0)] == ["no", "bar", "aim"]
    assert Row("", "x", 1.0).reached == ""


def test_of_some_passes_the_median_counts():
    row = median([Row("a", "x", value) for value in (3.0, 1.0, 7.0)])
    assert (row.measured, row.least, row.most) == (3.0, 1.0, 7.0)
    assert median([Row("a", "x", 2.0)]) == Row("a", "x", 2.0)


def test_effects_rows_sum_up():
    flag = presets.flag(4, 5)
    rows = effects_study.measure("flag", flag.replace(effects=flag.effects[:2]), rounds=2)
    assert [row["part"] for row in rows] == ["integrator", "Gravity", "Structural", "sum", "whole step"]
    *parts, total, whole = (row["ns per particle-step"] for row in rows)
    assert total == pytest.approx(sum(parts))
    (told,) = effects_study.agreement(rows)
    assert told["sum / whole step"] == pytest.approx(total / whole)


def test_every_effect_of_the_catalogue_is_taken_apart():
    held = {type(effect) for scene in effects_study.scenes().values() for effect in scene.effects}
    public = {getattr(effects, name) for name in effects.__all__}
    catalogue = {kind for kind in public if isinstance(kind, type) and issubclass(kind, effects.Effect)}
    shared = {effects.Effect, effects.LinkEffect, effects.Wind}
    assert held == catalogue - shared - {effects.Attachment}  # which holds one particle: there is nothing to measure
    for scene in effects_study.scenes().values():
        assert abs(len(effects_study.other(scene).effects) - len(scene.effects)) == 1


def test_the_gallery_shows_every_preset_in_motion():
    from flag_env.render import Renderer

    named = {name.partition("(")[0] for name in gallery.shots()}
    made = {name for name, value in vars(presets).items() if inspect.isfunction(value) and value.__module__ == presets.__name__}
    assert named == {name for name in made if not name.startswith("_")}
    for name, shot in gallery.shots().items():
        if name.startswith(("two_layer", "storm")):
            few = shot.scene.replace(effects=shot.scene.effects[:2])  # compiles sooner
            shot = dataclasses.replace(shot, scene=few, wind=(0.0, 0.0, 0.0))
        frames = list(gallery.film(shot, Renderer(64, 64), seconds=0.08))
        assert len(frames) == 2, name
        assert (frames[0] != frames[1]).any(), name


def test_writing_leaves_whole_files(tmp_path):
    from matplotlib.figure import Figure

    report.write(tmp_path, "study", [{"a": 1}], Figure(), more=2)
    written = json.loads((tmp_path / "study.json").read_text())
    assert written["rows"] == [{"a": 1}]
    assert written["more"] == 2
    assert {"processor", "cores", "versions", "date"} <= set(written["machine"])
    assert sorted(path.name for path in tmp_path.iterdir()) == ["study.json", "study.png"]


@pytest.mark.parametrize("command", ["accuracy", "effects", "flutter", "gradients", "record", "speed", "stability", "targets"])
def test_commands_explain_themselves(command):
    code = "from flag_env.cli import main; main()"
    told = subprocess.run([sys.executable, "-c", code, command, "--help"], capture_output=True, text=True, check=True).stdout
    assert "--quick" in told
    assert "--output" in told
