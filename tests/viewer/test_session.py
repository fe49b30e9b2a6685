"""A session without sockets or browser: messages in, frames out."""

from __future__ import annotations

import json

import numpy as np
import pytest

from flag_env.physics.limits import max_timestep
from flag_env.viewer import STAGES, Session
from flag_env.viewer.flight import TILT
from flag_env.viewer.settings import Settings, stage_scene

HEADER = 40


def positions(frame: bytes, session: Session) -> np.ndarray:
    lattice = session.flight.scene.lattice
    return np.frombuffer(frame, "<f4", 3 * lattice.size, HEADER).reshape(*lattice.shape, 3)


def fly(session: Session, seconds: float) -> bytes:
    for _ in range(round(seconds * 30)):
        frame = session.advance(1 / 30)
    return frame


def test_a_frame_holds_the_simulators_positions(session):
    frame = fly(session, 0.5)
    version, number = np.frombuffer(frame, "<u4", 2)
    time, *wind = np.frombuffer(frame, "<f4", 4, 8)
    simulator = session.flight.running.simulator
    assert (version, number) == (session.describe()["version"], session.number)
    assert time == pytest.approx(simulator.time)
    assert time == pytest.approx(0.5, abs=simulator.timestep)
    np.testing.assert_allclose(positions(frame, session), simulator.positions[0], atol=1e-6)
    np.testing.assert_allclose(wind, simulator.wind()[0] / session.flight.settings.wind_reach, atol=1e-6)


def test_a_description_and_a_status_are_json_whatever_flies(session, order):
    for stage in ("rope", "report-2", "flag"):
        assert order(session, "stage", name=stage) == ""
        fly(session, 0.1)
        for told in (session.describe(), session.status()):
            assert json.loads(json.dumps(told, allow_nan=False)) == told


@pytest.mark.parametrize("stage", STAGES)
def test_every_stage_starts_within_all_its_sliders(stage):
    settings = Settings.of(stage)
    for name, slider in settings.sliders().items():
        assert slider.low <= slider.value <= slider.high, name
        assert slider.unit or name == "step"
        assert settings.changed({name: slider.low}).sliders()[name].value == slider.low
    scene = settings.scene()
    assert scene.lattice == stage_scene(stage).lattice
    assert scene.timestep <= max_timestep(scene)


def test_sliders_change_what_they_name(session, order):
    before = session.flight.running.simulator.scene
    assert order(session, "set", values={"stiffness": 2.0, "viscosity": 0.5, "gravity": 3.0, "taper": 0.5}) == ""
    after = session.flight.running.simulator.scene
    expected = {type(effect).__name__: effect for effect in before.scaled(2.0, 0.5).effects}
    found = {type(effect).__name__: effect for effect in after.effects}
    assert found["Shear"] == expected["Shear"]
    assert found["Gravity"].acceleration == 3.0
    assert after.lattice.taper == 0.5
    assert after.lattice.masses.sum() == pytest.approx(before.lattice.masses.sum())


def test_stiffness_above_the_step_limit_builds_another_run_that_goes_on_from_there(session, order):
    fly(session, 0.7)
    old = session.flight.running.simulator
    with pytest.raises(ValueError, match="step limit"):
        old.set_parameters(5.0, 1.0)
    before, velocities, time = old.positions, old.velocities, old.time
    assert order(session, "set", values={"stiffness": 5.0}) == ""
    new = session.flight.running.simulator
    assert new is not old
    assert new.timestep < old.timestep
    assert new.time == pytest.approx(time, abs=new.timestep)
    np.testing.assert_allclose(new.positions, before, atol=1e-12)
    np.testing.assert_allclose(new.velocities, velocities, atol=1e-9)


@pytest.mark.parametrize("effect", ["Shear", "AirDrag", "StrainLimit"])
def test_the_winds_phase_goes_on_when_effects_come_and_go(session, order, effect):
    order(session, "set", values={"frequency_x": 3.0, "amplitude_x": 0.005, "mean_x": 0.0})
    fly(session, 0.6)
    before = session.flight.running.simulator.wind()
    present = effect in session.flight.settings.effects
    assert order(session, "set", values={effect: not present}) == ""
    after = session.flight.running.simulator
    assert any(type(known).__name__ == effect for known in after.scene.effects) != present
    np.testing.assert_allclose(after.wind(), before, rtol=1e-12)


def test_wind_is_taken_up_at_once_and_without_a_rebuild(session, order):
    fly(session, 0.2)
    simulator = session.flight.running.simulator
    order(session, "set", values={"mean_y": 0.004, "amplitude_y": 0.0})
    assert session.flight.running.simulator is simulator
    assert simulator.wind()[0, 1] == pytest.approx(0.004)


def test_a_wind_of_another_unit_takes_the_place_of_the_first(session, order):
    assert order(session, "set", values={"AirPressure": True}) == ""
    assert session.flight.settings.wind_unit == "m/s"
    assert "CosineWind" not in session.flight.settings.effects
    np.testing.assert_allclose(session.flight.running.simulator.wind()[0], [6.0, 0.0, 0.0])


def test_only_the_newest_value_is_built(session):
    for k in range(1, 41):
        session.handle(json.dumps({"do": "set", "values": {"stiffness": k / 20}}))
    built = []
    while session.flight.building:
        session.advance(0.0)
        if not built or built[-1] is not session.flight.running:
            built.append(session.flight.running)
    assert dict(session.flight.running.settings.numbers)["stiffness"] == 2.0
    assert len(built) <= 3


REFUSED = (
    ({"stiffness": 6.0}, "stiffness must be"),
    ({"stiffness": "much"}, "stiffness must be a number"),
    ({"stiffness": None}, "stiffness must be a number"),
    ({"wings": 2.0}, "'wings'"),
    ({"Shear": 1}, "Shear must be True or False"),
    ({"integrator": "Magic"}, "integrator must be one of"),
    ({"accuracy": 3}, "accuracy must be one of"),
    ({"gravity": 3.0, "viscosity": -1.0}, "viscosity must be"),
)


@pytest.mark.parametrize(("values", "message"), REFUSED)
def test_refused_settings_change_nothing(session, order, values, message):
    before = session.flight.settings, session.flight.running
    assert message in order(session, "set", values=values)
    assert (session.flight.settings, session.flight.running) == before


MALFORMED = (
    "", "{", "[]", "3", '"set"', "null", '{"do":"set"}', '{"do":"set","values":3}', '{"do":"fly away"}', '{"do":["set"]}',
    '{"do":"set","values":{"stiffness":NaN}}', '{"do":"set","values":{"stiffness":Infinity}}', '{"do":"pause","on":1}',
    '{"do":"set","values":{"stiffness":1e999}}', '{"do":"set","values":{},"more":1}', '{"do":"mast","position":[0,0],"tilt":[]}',
    '{"do":"mast","position":[0,0,"up"],"tilt":[0,0]}', '{"do":"action","values":[0,0,0]}', '{"do":"stage","name":"circus"}',
    '{"do":"stage","name":["flag"]}', '{"do":"watch","control":"feet","level":"calm","driver":"witness","target":0}',
    '{"do":"watch","control":[],"level":{},"driver":0,"target":"first"}', "[" * 4000, '{"do":"pause","on":' + "1" * 4000 + "}",
    b"\x00\x01", '{"do":"' + 5000 * "x" + '"}',
)  # fmt: skip


@pytest.mark.parametrize("text", MALFORMED)
def test_malformed_messages_are_refused_with_a_reason_and_change_nothing(session, text):
    fly(session, 0.1)
    before = session.flight.settings, session.flight.running, session.flight.paused, session.episode, session.version
    assert session.handle(text) != ""
    session.settle()
    assert (session.flight.settings, session.flight.running, session.flight.paused, session.episode, session.version) == before


def test_a_step_above_the_limit_diverges_and_the_flag_goes_on_from_its_last_good_state(session, order):
    order(session, "set", values={"stiffness": 2.0})
    fly(session, 2.0)
    good = session.flight.settings
    assert order(session, "set", values={"step": 1.5}) == ""
    for _ in range(300):
        frame = session.advance(1 / 30)
        assert np.isfinite(positions(frame, session)).all()
        if session.flight.message:
            break
    assert "diverged" in session.status()["message"]
    assert session.flight.settings == good
    start = session.flight.running.simulator.time
    moved = positions(fly(session, 0.5), session)
    assert np.isfinite(moved).all()
    assert session.flight.running.simulator.time == pytest.approx(start + 0.5, abs=0.05)


def test_a_setting_that_cannot_run_is_refused_while_the_flag_flies_on(session, order):
    fly(session, 0.2)
    running = session.flight.running
    order(session, "set", values={"integrator": "ExplicitEuler", "viscosity": 0.01, "AirDrag": False})
    message = session.flight.message
    if not message:  # stable at a tiny step
        assert session.flight.running is not running
    else:
        assert session.flight.running is running
        assert session.flight.settings == running.settings
    fly(session, 0.2)


def test_the_mast_follows_at_a_limited_speed_and_stays_within_reach(session, order):
    order(session, "mast", position=[100.0, 0.2, 0.0], tilt=[0.0, 9.0])
    lattice = session.flight.scene.lattice
    last = session.flight.running.simulator.positions[0, 0, 0, 0]
    for _ in range(60):
        session.advance(1 / 30)
        foot = session.flight.running.simulator.positions[0, 0, 0, 0]
        assert np.abs(foot - last).max() < 1.6 * lattice.diagonal / 30
        last = foot
    np.testing.assert_allclose(last, [0.6 * lattice.diagonal, 0.2, 0.0], atol=1e-9)
    top = session.flight.running.simulator.positions[0, 0, -1, 0] - last
    np.testing.assert_allclose(top, lattice.extent[1] * np.array([np.sin(TILT), 0.0, np.cos(TILT)]), atol=1e-9)


@pytest.mark.parametrize("stage", ["rope", "sheet"])
def test_the_mast_stays_in_the_coordinates_that_a_scene_has(order, stage):
    session = Session(stage)
    session.settle()
    assert order(session, "mast", position=[0.1, 0.1, 0.1], tilt=[0.1, 0.1]) == ""
    frame = fly(session, 0.5)
    assert np.isfinite(positions(frame, session)).all()
    assert session.status()["message"] == ""
    session.close()


def test_pause_single_step_and_reset(session, order):
    fly(session, 0.3)
    order(session, "pause", on=True)
    first = positions(session.advance(1 / 30), session).copy()
    np.testing.assert_array_equal(positions(fly(session, 0.2), session), first)
    simulator = session.flight.running.simulator
    before = simulator.time
    order(session, "step")
    assert simulator.time == pytest.approx(before + simulator.timestep)
    order(session, "reset")
    assert session.flight.running.simulator.time == 0.0


def test_a_torn_cloth_says_which_links_and_cells_hold(session, order):
    order(session, "set", values={"Tearing": True})
    frame = session.advance(1 / 30)
    scene = session.flight.scene
    layers, rows, cols = scene.lattice.shape
    at = HEADER + 12 * scene.lattice.size
    assert len(frame) == at + 2 * scene.lattice.size + layers * (rows - 1) * (cols - 1)
    simulator = session.flight.running.simulator
    pulled = simulator.positions
    pulled[..., 16:, 0] += 0.5
    simulator.set_positions(pulled)
    simulator.step(1)
    order(session, "pause", on=True)
    frame = session.advance(0.0)
    links = np.frombuffer(frame, "<u2", scene.lattice.size, at).reshape(rows, cols)
    cells = np.frombuffer(frame, np.uint8, offset=at + 2 * scene.lattice.size).reshape(rows - 1, cols - 1)
    families = [tuple(family[:4]) for family in session.describe()["families"]]
    along, up = (families.index(("Structural", 0, *direction)) for direction in ((0, 1), (1, 0)))
    weight = dict(zip(scene.effects, simulator.run.effects, strict=True))[scene.effects[1]].weight[0].reshape(2, rows, cols)
    assert 0 < cells.sum() < cells.size
    for row in range(rows - 1):
        for col in range(cols - 1):
            sides = weight[0, row, col], weight[0, row + 1, col], weight[1, row, col], weight[1, row, col + 1]
            assert cells[row, col] == all(side != 0 for side in sides)
            assert (links[row, col] >> along & 1, links[row, col] >> up & 1) == (sides[0] != 0, sides[2] != 0)
