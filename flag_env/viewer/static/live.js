"use strict";
// The live page: frames come over a WebSocket, are drawn when the screen is ready, and acknowledged once drawn.

const HEADER = 40;

class Live {
  constructor() {
    const $ = (id) => document.getElementById(id);
    this.view = new View($("picture")); this.painter = new Painter($("picture")); this.$ = $;
    this.panel = new Panel($("panel"), (message) => this.send(message));
    this.drawn = 0; this.received = 0; this.owed = 0; this.pending = null; this.status = null; this.scene = null; this.wind = [0, 0, 0];
    this.goal = [0, 0, 0, 0, 0]; this.waiting = null;
    this.modes = new Modes($("modes"), this.painter, $("legend"));
    const panel = $("panel");
    this.view.covered = () => panel.classList.contains("folded") ? [0, 0] : window.innerWidth <= 720 ? [0, panel.offsetHeight + 8] : [panel.offsetWidth + 14, 0];
    this.view.holdable = (x, y) => this.hold(x, y);
    document.addEventListener("keydown", (e) => this.key(e));
    this.connect();
    const loop = () => { this.paint(); requestAnimationFrame(loop); };
    requestAnimationFrame(loop);
  }

  connect() {
    const socket = new WebSocket(`ws://${location.host}/socket`);
    socket.binaryType = "arraybuffer";
    socket.onmessage = (event) => this.receive(event.data);
    socket.onopen = () => { this.say(""); this.scene = null; this.owed = 0; };
    socket.onclose = () => { this.say("No connection to flag-env play; trying again ...", true); setTimeout(() => this.connect(), 1000); };
    this.socket = socket;
  }

  // Messages of one kind that have not gone out yet give way to newer ones: only the newest value counts.
  send(message) {
    if (message.do === "set" || message.do === "mast" || message.do === "action") {
      const before = this.waiting && this.waiting.do === message.do ? this.waiting : null;
      if (this.waiting && !before) this.flush();
      this.waiting = before && message.do === "set" ? { do: "set", values: { ...before.values, ...message.values } } : message;
      this.timer ||= setTimeout(() => this.flush(), 30);
    } else { this.flush(); this.post(message); }
  }

  flush() {
    clearTimeout(this.timer); this.timer = 0;
    if (this.waiting) this.post(this.waiting);
    this.waiting = null;
  }

  post(message) { if (this.socket.readyState === WebSocket.OPEN) this.socket.send(JSON.stringify(message)); }

  receive(data) {
    if (typeof data !== "string") { this.received++; this.owed++; this.pending = data; return; }
    const message = JSON.parse(data);
    if (message.type === "scene") this.take(message);
    else if (message.type === "status") { this.status = message; this.refresh(); this.told(message); }
    else if (message.type === "refused") this.say(message.message);
  }

  take(scene) {
    const framing = JSON.stringify([scene.shape, scene.extent, scene.mode]);
    this.scene = scene;
    this.painter.setScene(scene);
    this.modes.setScene(scene);
    this.$("sign").hidden = !scene.wind;
    if (framing !== this.framing) {
      this.framing = framing;
      const [length, height] = scene.extent, size = Math.hypot(length, height), rope = height === 0;
      this.view.frame(rope ? [0.5 * length, 0, 0] : [0.50 * length, 0, 0.5 * height - 0.10 * length], (rope ? 2.2 : 2.4) * size);
      this.goal = [0, 0, 0, 0, 0];
    }
    this.refresh();
  }

  // The panel, once scene and status are of one kind: after a change of kind one of them comes first.
  refresh() { if (this.scene && this.status && this.scene.mode === this.status.mode) this.panel.update(this.scene, this.status); }

  told(status) {
    if (status.message !== this.message) { this.message = status.message; this.say(status.message); }
    if (!status.message && !this.alarm) this.wait(status.building);
    if (status.pose && !this.holding) this.pose = status.pose;
    if (status.mode === "watch") this.painter.reached = status.episode.distance.slice(-1)[0] < status.episode.tolerance;
  }

  // A build takes a blink; one that takes longer compiles, which it does but once.
  wait(building) {
    if (!building) this.since = 0;
    else this.since ||= performance.now();
    this.say(building && performance.now() - this.since > 700 ? "Compiling what this scene needs: some seconds, the first time ..." : "", true);
  }

  say(text, calm = false) {
    const box = this.$("message");
    box.classList.toggle("shown", Boolean(text)); box.classList.toggle("calm", calm);
    if (text) box.textContent = text;
    clearTimeout(this.alarm); this.alarm = 0;
    if (text && !calm) this.alarm = setTimeout(() => { this.alarm = 0; this.say(""); }, 6000);
  }

  acknowledge() {
    for (; this.owed > 0; this.owed--) if (this.socket.readyState === WebSocket.OPEN) this.socket.send('{"do":"ack"}');
  }

  paint() {
    const data = this.pending;
    if (data && this.scene) {
      this.pending = null;
      const head = new DataView(data), version = head.getUint32(0, true), count = this.painter.count;
      if (version === this.scene.version && data.byteLength >= HEADER + 12 * count) {
        const positions = new Float32Array(data, HEADER, 3 * count), at = HEADER + 12 * count;
        const torn = this.scene.tears ? { links: new Uint16Array(data, at, count), cells: new Uint8Array(data, at + 2 * count) } : null;
        this.wind = [12, 16, 20].map((place) => head.getFloat32(place, true));
        this.painter.setFrame(positions, torn);
        this.ready = true;
      }
      this.acknowledge();
    }
    if (!this.ready || !this.scene) return;
    this.painter.draw(this.view);
    if (this.scene.wind) compass(this.$("compass"), this.wind, this.view);
    this.modes.update();
    this.drawn++;
  }

  // The mast under the pointer, to be dragged in the plane of the picture.
  hold(x, y) {
    if (!this.ready || !this.scene || this.scene.mode !== "fly" || !this.scene.reach.some((r) => r > 0)) return null;
    const near = this.painter.poles().some(([foot, top]) => {
      const a = this.view.project(foot), b = this.view.project(top), dx = b[0] - a[0], dy = b[1] - a[1];
      const t = Math.min(1, Math.max(0, ((x - a[0]) * dx + (y - a[1]) * dy) / (dx * dx + dy * dy || 1)));
      return Math.hypot(x - a[0] - t * dx, y - a[1] - t * dy) < 12;
    });
    if (!near) return null;
    const start = [...(this.pose || this.goal)], { right, up } = this.view.axes(), depth = this.view.project(this.painter.at(0))[2];
    const s = this.view.metresPerPixel(depth);
    return {
      move: (px, py) => {
        this.holding = true;
        const by = V.add(V.scale(right, (px - x) * s), V.scale(up, (y - py) * s));
        this.mast([start[0] + by[0], start[1] + by[1], start[2] + by[2], start[3], start[4]]);
      },
      end: () => { this.holding = false; },
    };
  }

  mast(goal) {
    this.goal = goal.map((value, k) => Math.min(this.scene.reach[k], Math.max(-this.scene.reach[k], value)));
    this.send({ do: "mast", position: this.goal.slice(0, 3), tilt: this.goal.slice(3) });
  }

  key(event) {
    if (event.ctrlKey || event.metaKey || event.altKey || /^(INPUT|SELECT|BUTTON)$/.test(event.target.tagName) && event.key !== "Escape") return;
    const act = { " ": () => this.send({ do: "pause", on: !(this.status && this.status.paused) }), ".": () => this.send({ do: "step" }), r: () => this.send({ do: "reset" }) };
    const moves = { ArrowLeft: [0, -1], ArrowRight: [0, 1], ArrowUp: [2, 1], ArrowDown: [2, -1], PageUp: [1, 1], PageDown: [1, -1] };
    const tilts = { ArrowLeft: [4, -1], ArrowRight: [4, 1], ArrowUp: [3, 1], ArrowDown: [3, -1] };
    const move = (event.shiftKey ? tilts : moves)[event.key];
    if (act[event.key]) act[event.key]();
    else if (MODES[Number(event.key) - 1]) this.modes.set(MODES[Number(event.key) - 1]);
    else if (move && this.scene && this.scene.mode === "fly") {
      const goal = [...this.goal];
      goal[move[0]] += move[1] * (move[0] < 3 ? 0.06 * this.painter.size : 0.06);
      this.mast(goal);
    } else return;
    event.preventDefault();
  }
}

try { window.live = new Live(); } catch (error) { const box = document.getElementById("message"); box.textContent = error.message; box.classList.add("shown"); throw error; }
