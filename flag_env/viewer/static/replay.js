"use strict";
// A replay: unpacks the motion that the page carries, and plays it.

const SPEEDS = [0.1, 0.25, 0.5, 1, 2, 4];

// Frames of positions [m] from bytes in planes, zigzag, and differences along columns, rows and, twice, time.
function unpack(bytes, { shape, frames, planes, grid }) {
  const [layers, rows, cols] = shape, lattice = layers * rows * cols, one = frames * lattice, all = 3 * one, plain = new Int32Array(all);
  for (let plane = 0; plane < planes; plane++) for (let k = 0; k < all; k++) plain[k] |= bytes[plane * all + k] << 8 * plane;
  for (let k = 0; k < all; k++) plain[k] = plain[k] >>> 1 ^ -(plain[k] & 1);
  for (let k = 0; k < all; k++) if (k % cols) plain[k] += plain[k - 1];
  for (let k = 0; k < all; k++) if (Math.floor(k / cols) % rows) plain[k] += plain[k - cols];
  for (let turn = 0; turn < 2; turn++)
    for (let axis = 0; axis < 3; axis++) for (let k = axis * one + lattice; k < (axis + 1) * one; k++) plain[k] += plain[k - lattice];
  return [...Array(frames).keys()].map((frame) => {
    const positions = new Float32Array(3 * lattice);
    for (let t = 0; t < lattice; t++) for (let axis = 0; axis < 3; axis++) positions[3 * t + axis] = grid * plain[axis * one + frame * lattice + t];
    return positions;
  });
}

async function inflate(base64) {
  const packed = Uint8Array.from(atob(base64), (c) => c.charCodeAt(0));
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("deflate"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

class Player {
  constructor(about, frames) {
    const $ = (id) => document.getElementById(id);
    this.$ = $; this.about = about; this.frames = frames; this.time = 0; this.playing = true; this.speed = 1; this.drawn = 0;
    this.length = Math.max(1, frames.length - 1) / about.fps;
    this.view = new View($("picture")); this.painter = new Painter($("picture"));
    this.modes = new Modes($("modes"), this.painter, $("legend"));
    this.painter.setScene(about); this.modes.setScene(about);
    const [length, height] = about.extent, size = Math.hypot(length, height), rope = height === 0;
    this.view.frame(rope ? [0.5 * length, 0, 0] : [0.50 * length, 0, 0.5 * height - 0.18 * length], (rope ? 2.2 : 2.5) * size);
    $("sign").hidden = !about.wind; $("curve").hidden = !about.distance.length;
    $("told").append(Object.assign(document.createElement("b"), { textContent: about.title }), about.told);
    this.controls();
    document.addEventListener("keydown", (e) => this.key(e));
    let last = performance.now();
    const loop = (now) => { this.tick(Math.min(0.1, Math.max(0, now - last) / 1000)); last = now; requestAnimationFrame(loop); };
    requestAnimationFrame(loop);
  }

  controls() {
    const add = (tag, properties) => this.$("player").appendChild(Object.assign(document.createElement(tag), properties));
    this.button = add("button", { id: "play", className: "plain", onclick: () => this.toggle() });
    this.scrub = add("input", { id: "scrub", type: "range", min: 0, max: 1000, value: 0, oninput: () => { this.playing = false; this.time = this.scrub.valueAsNumber / 1000 * this.length; } });
    this.scrub.setAttribute("aria-label", "time");
    this.clock = add("output", {});
    this.pace = add("select", { id: "speed", onchange: () => { this.speed = Number(this.pace.value); } });
    this.pace.setAttribute("aria-label", "speed");
    for (const speed of SPEEDS) this.pace.append(Object.assign(document.createElement("option"), { value: speed, textContent: `${speed} x`, selected: speed === 1 }));
  }

  toggle() { this.playing = !this.playing; }

  key(event) {
    if (/^(INPUT|SELECT|BUTTON)$/.test(event.target.tagName)) return;
    const step = { ".": 1, ",": -1, ArrowRight: 1, ArrowLeft: -1 }[event.key];
    if (event.key === " ") this.toggle();
    else if (step) { this.playing = false; this.time = Math.min(this.length, Math.max(0, this.time + step / this.about.fps)); }
    else if (MODES[Number(event.key) - 1]) this.modes.set(MODES[Number(event.key) - 1]);
    else return;
    event.preventDefault();
  }

  // The flag at the time of now: between two frames, on the straight way from one to the other.
  tick(seconds) {
    if (this.playing) { this.time += seconds * this.speed; if (this.time > this.length + 0.6) this.time = 0; }
    const at = Math.min(this.time, this.length) * this.about.fps, k = Math.min(Math.floor(at), this.frames.length - 1), next = this.frames[Math.min(k + 1, this.frames.length - 1)];
    const part = at - k, one = this.frames[k];
    this.positions = part > 0 ? one.map((v, j) => v + part * (next[j] - v)) : one;
    this.painter.reached = this.about.distance.length > 0 && this.about.distance[k] < this.about.tolerance;
    this.painter.setFrame(this.positions);
    this.painter.draw(this.view);
    this.modes.update();
    if (this.about.wind) compass(this.$("compass"), this.about.winds.slice(3 * k, 3 * k + 3), this.view);
    if (this.about.distance.length) plot(this.$("distance"), [{ name: "distance to the target", values: this.about.distance }], { length: this.frames.length, mark: this.about.tolerance, at: k, percent: true });
    this.button.textContent = this.playing ? "Pause" : "Play";
    if (this.playing) this.scrub.value = 1000 * Math.min(1, this.time / this.length);
    const shown = this.about.pace * Math.min(this.time, this.length);
    this.clock.textContent = `${shown.toPrecision(3)} s${this.about.pace === 1 ? "" : ` (${this.about.pace} x)`}`;
    this.drawn++;
  }
}

(async () => {
  try {
    const text = (id) => document.getElementById(id).textContent, about = JSON.parse(text("about"));
    window.player = new Player(about, unpack(await inflate(text("data")), about));
  } catch (error) {
    const box = document.getElementById("message");
    box.textContent = `This replay needs WebGL 2 and DecompressionStream (Chrome or Edge 80, Safari 16.4, Firefox 113): ${error.message}`;
    box.classList.add("shown");
    throw error;
  }
})();
