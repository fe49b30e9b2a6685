"use strict";
// The panel: built once for each kind of control, then only its values change. Says what is moved through `send`.

function make(tag, properties = {}, ...children) {
  const element = Object.assign(document.createElement(tag), properties);
  element.append(...children);
  return element;
}

// A number with a unit, three digits, as 1.23 mN.
function told(value, unit) {
  if (value === null || value === undefined) return "-";
  if (unit === "x" || unit === "") return `${unit}${value.toPrecision(3)}`;
  const plain = unit === "rad/s" || unit === "m/s" || unit === "m/s²";
  const size = Math.abs(value);
  const [factor, prefix] = plain || size === 0 || (size >= 0.1 && size < 1e4) ? [1, ""] : size >= 1e4 ? [1e-3, "k"] : size >= 1e-4 ? [1e3, "m"] : [1e6, "µ"];
  const scaled = factor * value;
  return `${Math.abs(scaled) >= 1000 ? scaled.toFixed(0) : scaled.toPrecision(3)} ${prefix}${unit}`;
}

const STEPS = 400;

class Range {
  constructor(name, [, label, unit, low, high, value, log], moved) {
    this.unit = unit; this.log = log; this.low = low; this.high = high;
    this.input = make("input", { type: "range", min: 0, max: STEPS, step: 1, id: `slider-${name}` });
    this.output = make("output");
    this.element = make("label", { className: "slider" }, make("span", { textContent: label }), this.input, this.output);
    this.input.addEventListener("input", () => { this.held = performance.now(); this.output.textContent = told(this.value, unit); moved(this.value); });
    this.set(value);
  }

  get value() {
    const t = this.input.valueAsNumber / STEPS;
    return this.log ? this.low * (this.high / this.low) ** t : this.low + (this.high - this.low) * t;
  }

  // Values from the server; not while a hand is on the slider.
  set(value) {
    if (performance.now() - (this.held || -1e9) < 700) return;
    const t = this.log ? Math.log(value / this.low) / Math.log(this.high / this.low) : (value - this.low) / (this.high - this.low);
    this.input.value = Math.round(STEPS * t);
    this.output.textContent = told(value, this.unit);
  }
}

class Panel {
  constructor(root, send) {
    this.root = root; this.send = send; this.key = "";
    this.scroll = make("div", { className: "scroll" });
    const tab = (name, act) => make("button", { textContent: name, onclick: act });
    this.tabs = { fly: tab("Fly", () => send({ do: "stage", name: this.stage || "flag" })), watch: tab("Task", () => this.watch({})) };
    const fold = make("button", { textContent: "☰", className: "fold", title: "fold the panel", onclick: () => root.classList.toggle("folded") });
    root.replaceChildren(make("header", {}, this.tabs.fly, this.tabs.watch, fold), this.scroll);
  }

  update(scene, status) {
    for (const [name, button] of Object.entries(this.tabs)) { button.classList.toggle("on", status.mode === name); button.hidden = Boolean(scene.only) && scene.only !== name; }
    const key = JSON.stringify([status.mode, status.stage, Object.entries(status.sliders || {}).map(([n, s]) => [n, s[2], s[3], s[4]]), scene.watch && [scene.watch.control, scene.watch.driver, scene.watch.size]]);
    if (key !== this.key) { this.key = key; status.mode === "fly" ? this._buildFly(scene, status) : this._buildWatch(scene, status); }
    this.pause.textContent = status.paused ? "Fly on" : "Pause";
    status.mode === "fly" ? this._updateFly(status) : this._updateWatch(scene, status);
  }

  _choice(label, options, value, act, id) {
    const select = make("select", { id, onchange: () => { act(select.value); select.blur(); } }, ...options.map(([v, text]) => make("option", { value: v, textContent: text })));
    select.value = value;
    return [select, make("label", { className: "row" }, make("span", { textContent: label }), select)];
  }

  _buttons(...more) {
    this.pause = make("button", { className: "plain", id: "pause", onclick: () => this.send({ do: "pause", on: !this.paused }) });
    const button = (text, message) => make("button", { className: "plain", id: text.toLowerCase().replace(" ", "-"), textContent: text, onclick: () => this.send(message) });
    return make("div", { className: "buttons" }, this.pause, button("Single step", { do: "step" }), button("Reset", { do: "reset" }), ...more);
  }

  // -- a flag in flight -----------------------------------------------------------------------------------------------------

  _buildFly(scene, status) {
    const title = (text) => make("h2", { textContent: text });
    this.stage = status.stage;
    const [, stages] = this._choice("scene", Object.entries(scene.stages).map(([k, [t, what]]) => [k, `${t} - ${what}`]), status.stage, (name) => this.send({ do: "stage", name }), "stage");
    this.sliders = {};
    const groups = {};
    for (const [name, slider] of Object.entries(status.sliders)) {
      this.sliders[name] = new Range(name, slider, (value) => this.send({ do: "set", values: { [name]: value } }));
      (groups[slider[0]] ||= []).push(this.sliders[name].element);
    }
    this.effects = {};
    const checks = Object.keys(status.effects).map((name) => {
      this.effects[name] = make("input", { type: "checkbox", id: `effect-${name}`, onchange: (e) => this.send({ do: "set", values: { [name]: e.target.checked } }) });
      return make("label", {}, this.effects[name], name.replace(/([a-z])([A-Z])/g, "$1 $2"));
    });
    const plain = (names) => names.map((name) => [name, name]);
    const accuracies = status.accuracies.map((name) => [name, name === "own" ? "own integrator and step" : name]);
    let row, accuracy;
    [this.integrator, row] = this._choice("integrator", plain(status.integrators), status.integrator, (v) => this.send({ do: "set", values: { integrator: v } }), "integrator");
    [this.accuracy, accuracy] = this._choice("accuracy", accuracies, status.accuracy, (v) => this.send({ do: "set", values: { accuracy: v } }), "accuracy");
    this.readouts = make("table", { id: "readouts" });
    this.scroll.replaceChildren(
      title("Scene"), stages, this._buttons(), title("Cloth"), ...groups.Cloth, ...(groups.Wind ? [title("Wind"), ...groups.Wind] : []),
      title("Effects"), make("div", { className: "checks" }, ...checks), title("Time"), row, accuracy, ...groups.Time,
      title("Readouts"), this.readouts,
      make("p", { className: "note", textContent: "Drag the mast, or move it with the arrow keys and Page Up / Down (with Shift: tilt it). Drag elsewhere to turn the view, with Shift to shift it; wheel to zoom; double click to go back. Space: pause, period: step, R: reset, 1 2 3: drawing." }),
    );
  }

  _updateFly(status) {
    for (const [name, slider] of Object.entries(status.sliders)) this.sliders[name].set(slider[5]);
    for (const [name, on] of Object.entries(status.effects)) this.effects[name].checked = on;
    this.paused = status.paused;
    this.integrator.value = status.integrator; this.accuracy.value = status.accuracy;
    const own = status.accuracy === "own";
    this.integrator.disabled = !own; this.sliders.step.input.disabled = !own;
    const r = status.readouts;
    if (!r) return;
    const rows = [
      ["simulated / real time", told(r.real_time, "x")], ["largest strain", r.strain === null ? "-" : `${(100 * r.strain).toPrecision(3)} %`],
      ["step", told(r.timestep, "s")], ["step limit", r.limit === null ? "none" : told(r.limit, "s")], ["set by", r.limited_by || "-"],
      ["method", `${r.integrator}, ${r.dtype}`], ["particles", r.particles], ["energy", ""],
      ...Object.entries(r.energy).map(([name, value]) => [name.replace(/_/g, " "), told(value, "J"), "sub"]),
    ];
    this.readouts.replaceChildren(...rows.map(([name, value, kind]) => make("tr", { className: kind || "" }, make("td", { textContent: name }), make("td", { textContent: value }))));
  }

  // -- an episode -----------------------------------------------------------------------------------------------------------

  watch(changes) {
    const now = { control: "wind", level: "breeze", driver: "witness", target: 0, ...this.choice, ...changes };
    this.send({ do: "watch", control: now.control, level: now.level, driver: now.driver, target: Number(now.target) });
  }

  _buildWatch(scene, status) {
    const title = (text) => make("h2", { textContent: text }), named = (names) => names.map((name) => [name, name]);
    const [, control] = this._choice("control", named(scene.controls), scene.watch.control, (v) => this.watch({ control: v, driver: "witness" }), "control");
    const [, level] = this._choice("level", named(scene.levels), scene.watch.level, (v) => this.watch({ level: v, driver: "witness" }), "level");
    const [, driver] = this._choice("acting", scene.drivers.map((d) => [d, { witness: "the witness", agent: "the agent", hand: "you" }[d]]), scene.watch.driver, (v) => this.watch({ driver: v }), "driver");
    const next = make("button", { className: "plain", id: "next", textContent: "Next target", onclick: () => this.watch({ target: (this.target + 1) % this.targets }) });
    const names = scene.watch.size === 3 ? ["wind x", "wind y", "wind z"] : scene.watch.size === 5 ? ["velocity x", "velocity y", "velocity z", "tilt rate about x", "tilt rate about y"] : [...Array(scene.watch.size).keys()].map((k) => `action ${k}`);
    this.actions = names.map((name, k) => new Range(`action-${k}`, ["", name, "", -1, 1, 0, false], () => this.send({ do: "action", values: this.actions.map((a) => a.value) })));
    this.acting = scene.watch.driver === "hand";
    for (const action of this.actions) action.input.disabled = !this.acting;
    this.score = make("div", { className: "score", id: "score" });
    this.distance = make("canvas", { className: "plot", id: "distance" }); this.rewards = make("canvas", { className: "plot", id: "rewards" });
    const choices = scene.fixed ? [] : [title("Task"), control, level, driver];
    this.scroll.replaceChildren(...choices, title("Episode"), scene.fixed ? (this._buttons(), "") : this._buttons(next), title("Score"), this.score, title("Distance to the target, in flag diagonals"), this.distance,
      title("Reward of each step"), this.rewards, title(this.acting ? "Your action" : "Action"), ...this.actions.map((a) => a.element));
  }

  _updateWatch(scene, status) {
    const e = status.episode;
    Object.assign(this, { paused: status.paused, target: e.target, targets: e.targets });
    this.choice = { ...scene.watch, target: e.target };
    if (!this.acting) e.action.forEach((value, k) => this.actions[k] && this.actions[k].set(value));
    const last = (values) => values.length ? `${(100 * values[values.length - 1]).toFixed(1)} %` : "-";
    const line = (who, score, total) => [make("b", { textContent: who }), make("span", { textContent: last(score.distance), className: score.success ? "good" : "" }), make("span", { textContent: total.toFixed(2) })];
    const you = { witness: "witness", agent: "agent", hand: "you" }[e.driver] || e.driver;
    this.score.replaceChildren(make("span", { textContent: `target ${e.target}, step ${e.steps} of ${e.length}` }), make("span", { textContent: "distance" }), make("span", { textContent: "reward" }),
      ...line(you, e, e.total), ...(e.reference && e.reference.who !== e.driver ? line(e.reference.who, e.reference, e.reference.total) : []));
    const curves = [{ name: you, values: e.distance }];
    if (e.reference && e.reference.who !== e.driver) curves.push({ name: e.reference.who, values: e.reference.distance, colour: "#66717c", dashed: true });
    plot(this.distance, curves, { length: e.length, mark: e.tolerance, percent: true });
    plot(this.rewards, Object.entries(e.terms).map(([name, values]) => ({ name: name.replace(/_/g, " "), values })), { length: e.length });
  }
}
