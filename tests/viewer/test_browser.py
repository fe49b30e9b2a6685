"""The page and the replays in a real browser, with software WebGL: what moves what, never how fast."""

from __future__ import annotations

import base64

import numpy as np
import pytest

from flag_env.viewer import STAGES, Task, of_episode, of_stage, save

LIT = """(() => {  // colours of the picture, drawn and read within one frame
  const shown = window.live || window.player, gl = shown.painter.gl;
  shown.painter.draw(shown.view);
  const [w, h] = [gl.canvas.width, gl.canvas.height], all = new Uint8Array(4 * w * h);
  gl.readPixels(0, 0, w, h, gl.RGBA, gl.UNSIGNED_BYTE, all);
  let text = "";
  for (let k = 0; k < all.length; k += 8192) text += String.fromCharCode(...all.subarray(k, k + 8192));
  return [w, h, btoa(text)];
})()"""


def picture(tab) -> np.ndarray:
    """What is drawn, (height, width, 3)."""
    width, height, data = tab.value(LIT)
    return np.frombuffer(base64.b64decode(data), np.uint8).reshape(height, width, 4)[::-1, :, :3].astype(np.int16)


def drawn(tab) -> np.ndarray:
    """The positions in the picture, (particles, 3)."""
    return np.reshape(tab.value("Array.from(live.painter.texels)"), (-1, 4))[:, :3]


def share_of(pixels: np.ndarray, colour: tuple[int, int, int]) -> float:
    """Share of the pixels that have about the hue of a colour."""
    unit = pixels / np.maximum(np.linalg.norm(pixels, axis=-1, keepdims=True), 1.0)
    return float((unit @ (np.array(colour) / np.linalg.norm(colour)) > 0.985).mean())


RED = (204, 43, 41)


@pytest.fixture
def live(served, tab):
    session, address = served
    page = tab(address)
    page.wait("window.live && live.drawn > 2 && live.panel.sliders && live.panel.sliders.stiffness")
    return session, page


def slide(page, name: str, share: float) -> None:
    """Move a slider to a share of its way, as a hand does."""
    page.value(f"""(() => {{ const s = document.getElementById("slider-{name}"); s.value = {share} * s.max;
      s.dispatchEvent(new Event("input", {{ bubbles: true }})); }})()""")


def test_the_page_loads_without_an_error_or_an_outside_request(live, wait_for):
    session, page = live
    origin = page.value("location.origin")
    assert all(url.startswith((origin, "data:")) for url in page.requests), page.requests
    wait_for(lambda: share_of(picture(page), RED) > 0.01)  # it may swing edge-on for a moment
    before = page.value("live.received")
    page.wait(f"live.received > {before} + 5")
    assert page.value("live.owed") <= 2
    assert page.value("live.painter.count") == session.flight.scene.lattice.size


def test_what_is_drawn_are_the_positions_that_were_sent(live, wait_for):
    session, page = live
    page.page.click("#pause")
    page.wait("live.status.paused")
    expected = session.flight.running.simulator.positions[0].reshape(-1, 3)
    wait_for(lambda: np.allclose(drawn(page), expected, atol=1e-5))


def test_every_slider_moves_what_it_names(live, wait_for):
    session, page = live
    names = list(session.flight.settings.sliders())
    assert set(page.value("Object.keys(live.panel.sliders)")) == set(names)
    for name in names:
        slide(page, name, 0.6)
    wait_for(lambda: len(session.flight.settings.numbers) == len(names))
    for name, slider in session.flight.settings.sliders().items():
        expected = slider.low * (slider.high / slider.low) ** 0.6 if slider.log else slider.low + 0.6 * (slider.high - slider.low)
        assert slider.value == pytest.approx(expected), name
        assert slider.unit in page.value(f"live.panel.sliders['{name}'].unit"), name
    wait_for(lambda: not session.flight.settings.needs_rebuild(session.flight.running.settings))
    scene = session.flight.running.simulator.scene
    assert {type(effect).__name__: effect for effect in scene.effects}["Gravity"].acceleration == pytest.approx(0.6 * 2 * 9.81)


def test_stiffness_times_five_builds_another_run_while_the_flag_flies(live, wait_for):
    session, page = live
    old = session.flight.running
    slide(page, "stiffness", 1.0)
    wait_for(lambda: session.flight.running is not old)
    assert session.flight.running.simulator.timestep < old.simulator.timestep
    page.wait(
        f"live.status.readouts && Math.abs(live.status.readouts.timestep - {session.flight.running.simulator.timestep}) < 1e-9"
    )
    assert "Structural" in page.page.inner_text("#readouts")


def test_an_effect_goes_off_and_on(live, wait_for):
    session, page = live
    families = page.value("live.scene.families.length")
    page.page.click("#effect-Shear")
    wait_for(lambda: "Shear" not in {type(effect).__name__ for effect in session.flight.running.simulator.scene.effects})
    page.wait(f"live.scene.families.length === {families} - 2")
    page.page.click("#effect-Shear")
    page.wait(f"live.scene.families.length === {families}")


def test_the_mast_follows_a_hand_and_keys(live, wait_for):
    session, page = live
    x, y, _ = page.value(
        "(() => { const [foot, top] = live.painter.poles()[0]; return live.view.project(V.scale(V.add(foot, top), 0.5)); })()"
    )
    azimuth = page.value("live.view.azimuth")
    mouse = page.page.mouse
    mouse.move(x, y)
    mouse.down()
    mouse.move(x + 40, y - 30, steps=4)
    mouse.up()
    wait_for(lambda: session.flight.pose[2] > 0.05)
    assert np.abs(session.flight.pose[:2]).max() > 0.05
    assert page.value("live.view.azimuth") == azimuth
    height = session.flight.pose[2]
    page.page.focus("#picture")
    page.page.keyboard.press("ArrowUp")
    wait_for(lambda: session.flight.pose[2] > height + 0.05)
    page.page.keyboard.press("Shift+ArrowRight")
    wait_for(lambda: session.flight.pose[4] > 0.05)


def test_dragging_elsewhere_turns_the_view_alone(live):
    session, page = live
    azimuth = page.value("live.view.azimuth")
    mouse = page.page.mouse
    mouse.move(60, 400)
    mouse.down()
    mouse.move(160, 420, steps=3)
    mouse.up()
    assert page.value("live.view.azimuth") != azimuth
    assert not session.flight.pose.any()
    distance = page.value("live.view.distance")
    mouse.wheel(0, 300)
    page.wait(f"live.view.distance > {distance}")


def test_a_refused_and_a_diverging_setting_are_told_in_the_page(live, wait_for):
    session, page = live
    page.value('live.post({do: "set", values: {stiffness: 99}})')
    page.wait('document.getElementById("message").textContent.includes("stiffness must be")')
    wait_for(lambda: session.flight._good is not None)
    good = session.flight.settings
    slide(page, "step", 1.0)
    page.wait('document.getElementById("message").textContent.includes("diverged")')
    assert session.flight.settings == good
    received = page.value("live.received")
    page.wait(f"live.received > {received} + 5")


def test_two_tabs_a_reload_and_one_that_stops_reading(served, tab):
    _, address = served
    one, other = tab(address), tab(address)
    for page in (one, other):
        page.wait("window.live && live.drawn > 1 && live.panel.sliders")
    slide(one, "gravity", 0.25)
    other.wait("Math.abs(live.status.sliders.gravity[5] - 0.5 * 9.81) < 1e-6")
    one.value("live.acknowledge = () => {}")
    received = other.value("live.received")
    other.wait(f"live.received > {received} + 20")
    stuck = one.value("live.received")
    other.wait(f"live.received > {received} + 40")
    assert one.value("live.received") == stuck
    other.page.reload()
    other.wait("window.live && live.drawn > 1 && Math.abs(live.status.sliders.gravity[5] - 0.5 * 9.81) < 1e-6")


def test_a_page_of_another_origin_gets_nothing(served, tab):
    address = served[1].replace("http", "ws")
    page = tab("about:blank")
    page.value(
        f"""void (window.closed_ = null, new WebSocket("{address}socket").onclose = (e) => {{ window.closed_ = e.code; }})"""
    )
    page.wait("window.closed_ !== null")
    assert page.value("window.closed_") == 1006
    page.errors.clear()  # Chromium reports the refusal


def test_draw_modes_differ_and_pinned_balls_are_red(live, wait_for):
    _, page = live
    wait_for(lambda: share_of(picture(page), RED) > 0.01)  # it may swing edge-on for a moment
    page.page.click("#pause")
    page.wait("live.status.paused")
    shown = {}
    for mode in ("cloth", "balls", "strain"):
        page.page.click(f"#mode-{mode}")
        shown[mode] = picture(page)
    for mode in ("balls", "strain"):
        assert (np.abs(shown["cloth"] - shown[mode]).max(axis=-1) > 40).mean() > 0.5 * share_of(shown["cloth"], RED)
    assert page.page.inner_text("#legend").count("%") == 2
    page.page.click("#mode-balls")
    for particle, pinned in ((10 * 32, True), (10 * 32 + 1, False)):
        page.value(f"void (live.view.target = live.painter.at({particle}), live.view.distance = 0.4)")
        near = picture(page)
        scale = near.shape[1] / page.value("innerWidth")
        x, y = (round(scale * place) for place in page.value(f"live.view.project(live.painter.at({particle}))")[:2])
        red, green = near[y - 1 : y + 2, x - 1 : x + 2, :2].mean(axis=(0, 1))
        assert (red > 1.5 * green) if pinned else (green > 1.5 * red), (particle, red, green)


def test_watching_shows_the_ghost_the_plots_and_the_score(live):
    _, page = live
    page.page.click("text=Task")
    page.wait('live.scene.mode === "watch" && live.painter.hasTarget && live.status.episode && live.status.episode.steps > 20')
    assert page.value('document.getElementById("distance").width') > 100
    assert "witness" in page.page.inner_text("#score")
    page.page.select_option("#driver", "hand")
    page.wait('live.status.episode && live.status.episode.driver === "hand" && live.panel.acting')
    slide(page, "action-1", 1.0)
    page.wait("live.status.episode.action[1] === 1")
    target = page.value("live.status.episode.target")
    page.page.click("#next")
    page.wait(f"live.status.episode && live.status.episode.target === {target} + 1")
    page.page.click("text=Fly")
    page.wait('live.scene.mode === "fly" && !live.painter.hasTarget')


def test_a_replay_plays_pauses_scrubs_and_turns_from_disk_offline(tab, tmp_path):
    motion = of_stage("flag", 1.0)
    page = tab(save(motion, tmp_path / "flag.html").as_uri(), offline=True)
    page.wait("window.player && player.drawn > 3 && player.time > 0.1")
    assert [url for url in page.requests if not url.startswith(("file:", "data:"))] == []
    page.page.click("#play")
    page.wait("!player.playing")
    page.value(
        """(() => { const s = document.getElementById("scrub"); s.value = 500; s.dispatchEvent(new Event("input")); })()"""
    )
    page.wait("Math.abs(player.time - 0.5 * player.length) < 1e-9")
    drawn = page.value("player.drawn")
    page.wait(f"player.drawn > {drawn} + 1")
    np.testing.assert_allclose(page.value("Array.from(player.positions)"), motion.frames[12].ravel(), atol=6e-5)
    first = picture(page)
    page.page.mouse.move(500, 300)
    page.page.mouse.down()
    page.page.mouse.move(650, 300, steps=3)
    page.page.mouse.up()
    turned = picture(page)
    assert (np.abs(turned - first).max(axis=-1) > 30).mean() > 0.01
    page.page.click("#mode-balls")
    assert (np.abs(picture(page) - turned).max(axis=-1) > 30).mean() > 0.01
    page.page.select_option("#speed", "0.1")
    assert page.value("player.speed") == 0.1


def test_every_frame_of_a_replay_comes_back(tab, tmp_path):
    motion = of_stage("two-layer", 0.4)
    page = tab(save(motion, tmp_path / "two.html").as_uri(), offline=True)
    page.wait("window.player && player.drawn > 1")
    frames = np.reshape(page.value("player.frames.map((f) => Array.from(f))"), motion.frames.shape)
    np.testing.assert_allclose(frames, motion.frames, atol=5.1e-5)


def test_an_episodes_replay_shows_its_target_and_runs_in_a_notebooks_frame(tab, tmp_path):
    from flag_env.viewer import Replay

    motion = of_episode(Task(), "witness", 5)
    notebook = tmp_path / "notebook.html"
    notebook.write_text(f"<!doctype html><meta charset='utf-8'>{Replay(motion)._repr_html_()}", encoding="utf-8")
    page = tab(notebook.as_uri(), offline=True)
    frame = page.page.frames[1]
    frame.wait_for_function("() => window.player && player.drawn > 2 && player.painter.hasTarget", timeout=120_000)
    assert frame.evaluate("player.about.distance.length") == 76


@pytest.mark.parametrize("stage", ["rope", "report-1", "report-2"])
def test_other_stages_fly_in_the_page(live, wait_for, stage):
    session, page = live
    page.page.select_option("#stage", stage)
    wait_for(lambda: session.flight.running.settings.stage == stage)
    page.wait(f"live.painter.count === {session.flight.scene.lattice.size} && live.scene.version === {session.version}")
    drawn = page.value("live.drawn")
    page.wait(f"live.drawn > {drawn} + 2")
    assert page.page.inner_text(f"#stage option[value={stage}]").startswith(STAGES[stage].title)
    assert np.isfinite(page.value("Array.from(live.painter.texels)")).all()


def test_the_environments_human_mode_shows_its_flag(tab, monkeypatch, wait_for):
    import gymnasium

    import flag_env  # noqa: F401  registers the ids
    from flag_env.viewer import window

    opened = []
    monkeypatch.setattr(window, "open_browser", lambda address: bool(opened.append(address)) or True)
    env = gymnasium.make("Flag-v0", render_mode="human")
    env.reset(seed=0)
    page = tab(opened[0])
    page.wait("window.live && live.scene")
    for _ in range(10):
        env.step(env.action_space.sample())
    page.wait("live.drawn > 1 && live.painter.hasTarget && live.status.episode.steps === 10")
    assert env.render() is None
    expected = env.unwrapped.simulator.positions[0].reshape(-1, 3)
    wait_for(lambda: np.allclose(drawn(page), expected, atol=1e-4))
    env.close()
    page.wait('document.getElementById("message").textContent.includes("No connection")')
    page.errors.clear()  # of the lost connection
