"use strict";
// Curves over the steps of an episode, and the wind as an arrow seen from the camera.

const CURVES = ["#c5382c", "#2f62c4", "#d99a1c", "#1f9d58", "#8452b8"];

function sharpen(canvas) {
  const ratio = window.devicePixelRatio || 1, w = canvas.clientWidth, h = canvas.clientHeight;
  if (canvas.width !== Math.round(w * ratio)) { canvas.width = Math.round(w * ratio); canvas.height = Math.round(h * ratio); }
  const c = canvas.getContext("2d");
  c.setTransform(ratio, 0, 0, ratio, 0, 0);
  c.clearRect(0, 0, w, h);
  return [c, w, h];
}

// curves: [{name, values, colour, dashed}]; mark: a level drawn across; at: a step drawn as an upright line.
function plot(canvas, curves, { length, mark = null, at = null, percent = false }) {
  const [c, w, h] = sharpen(canvas), left = 36, top = 16, right = w - 4, bottom = h - 5;
  const all = curves.flatMap((curve) => curve.values);
  if (mark !== null) all.push(1.6 * mark);
  let low = Math.min(0, ...all), high = Math.max(1e-3, ...all);
  const room = 0.06 * (high - low);
  high += room; if (low < 0) low -= room;
  const x = (k) => left + (right - left) * k / Math.max(1, length - 1), y = (v) => bottom - (bottom - top) * (v - low) / (high - low);
  const name = (v) => percent ? `${(100 * v).toFixed(0)} %` : v.toPrecision(2);
  c.font = "10px system-ui, sans-serif"; c.textBaseline = "middle"; c.textAlign = "right";
  c.strokeStyle = "rgba(35,43,51,0.14)"; c.fillStyle = "#66717c"; c.lineWidth = 1;
  for (const v of [0, high - room].concat(low < 0 ? [low + room] : [])) {
    c.beginPath(); c.moveTo(left, y(v)); c.lineTo(right, y(v)); c.stroke();
    if (v === 0 || Math.abs(y(v) - y(0)) > 11) c.fillText(name(v), left - 5, y(v));
  }
  if (mark !== null) {
    c.strokeStyle = "#1f9d58"; c.setLineDash([2, 3]);
    c.beginPath(); c.moveTo(left, y(mark)); c.lineTo(right, y(mark)); c.stroke(); c.setLineDash([]);
  }
  if (at !== null) { c.strokeStyle = "rgba(35,43,51,0.45)"; c.beginPath(); c.moveTo(x(at), top); c.lineTo(x(at), bottom); c.stroke(); }
  c.textAlign = "left";
  let label = left;
  curves.forEach((curve, k) => {
    c.strokeStyle = c.fillStyle = curve.colour || CURVES[k % CURVES.length];
    c.lineWidth = curve.dashed ? 1.2 : 1.8; c.setLineDash(curve.dashed ? [4, 3] : []);
    c.beginPath();
    curve.values.forEach((v, step) => step ? c.lineTo(x(step), y(v)) : c.moveTo(x(step), y(v)));
    c.stroke(); c.setLineDash([]);
    c.fillText(curve.name, label, 6);
    label += c.measureText(curve.name).width + 12;
  });
}

// The wind, (x, y, z) as a share of a full arrow, from the camera's side; the rings, of half and full strength, lie in the ground.
// Seen from 35 degrees up or more: from lower down a wind to or from the eye would be a point.
function compass(canvas, wind, view) {
  const [c, w, h] = sharpen(canvas), r = 0.40 * Math.min(w, h), cx = w / 2, cy = 0.55 * h;
  const axes = view.axes(Math.max(35, view.elevation));
  const seen = (p) => [cx + r * V.dot(p, axes.right), cy - r * V.dot(p, axes.up), V.dot(p, axes.back)];
  c.strokeStyle = "rgba(35,43,51,0.30)"; c.lineWidth = 1.2;
  for (const [size, width] of [[0.5, 0.6], [1, 1.2]]) {
    c.lineWidth = width;
    c.beginPath();
    for (let k = 0; k <= 64; k++) { const p = seen([size * Math.cos(k * Math.PI / 32), size * Math.sin(k * Math.PI / 32), 0]); k ? c.lineTo(p[0], p[1]) : c.moveTo(p[0], p[1]); }
    c.stroke();
  }
  c.font = "9px system-ui, sans-serif"; c.fillStyle = "#66717c"; c.textAlign = "center"; c.textBaseline = "middle";
  for (const [name, p] of [["x", [1, 0, 0]], ["y", [0, 1, 0]]]) { const q = seen(V.scale(p, 1.16)); c.fillText(name, q[0], q[1]); }
  const long = Math.hypot(...wind), tip = long > 1 ? V.scale(wind, 1 / long) : wind, foot = seen([tip[0], tip[1], 0]), end = seen(tip), mid = seen([0, 0, 0]);
  c.setLineDash([2, 2]); c.beginPath(); c.moveTo(mid[0], mid[1]); c.lineTo(foot[0], foot[1]); c.lineTo(end[0], end[1]); c.stroke(); c.setLineDash([]);
  const dx = end[0] - mid[0], dy = end[1] - mid[1], flat = Math.hypot(dx, dy), turn = Math.atan2(dy, dx);
  const deep = 0.5 + 0.5 * Math.max(-1, Math.min(1, end[2]));   // towards the viewer: wider, stronger
  c.strokeStyle = c.fillStyle = `rgb(${47 - 20 * deep}, ${98 - 30 * deep}, ${196 + 10 * deep})`;
  c.lineWidth = 2.2 + 2 * deep; c.lineCap = "round";
  const head = Math.min(11, 4 + 0.6 * Math.hypot(...tip) * r);
  if (flat > 0.7 * head) { c.beginPath(); c.moveTo(mid[0], mid[1]); c.lineTo(end[0] - 0.6 * head * dx / flat, end[1] - 0.6 * head * dy / flat); c.stroke(); }
  c.beginPath();
  if (flat > 0.25 * head) {
    for (const side of [0, 2.55, -2.55]) { const s = side ? 0.8 * head : 0.3 * head; c.lineTo(end[0] + s * Math.cos(turn + side), end[1] + s * Math.sin(turn + side)); }
  } else c.arc(end[0], end[1], 2.5 + 3 * deep * Math.min(1, Math.hypot(...tip)), 0, 7);
  c.fill();
}

// The buttons for what is drawn, and the legend that goes with it.
class Modes {
  constructor(bar, painter, legend) {
    this.painter = painter; this.legend = legend;
    const names = { cloth: "Cloth", balls: "Balls and rods", strain: "Strain" };
    this.buttons = Object.fromEntries(MODES.map((mode) => [mode, Object.assign(document.createElement("button"), { textContent: names[mode], id: `mode-${mode}`, onclick: () => this.set(mode) })]));
    bar.append(...Object.values(this.buttons));
    this.set("cloth");
  }

  set(mode) {
    this.painter.mode = mode;
    for (const [name, button] of Object.entries(this.buttons)) button.classList.toggle("on", name === mode);
    this.setScene(this.painter.scene);
  }

  setScene(scene) {
    this.legend.hidden = true;
    if (!scene) return;
    const mode = this.painter.cloth ? this.painter.mode : "balls";
    for (const [name, button] of Object.entries(this.buttons)) button.hidden = !this.painter.cloth && name !== "balls";
    if (mode === "balls") {
      const rows = [...new Set(scene.families.map((f) => f[0]))].map((name) => {
        const box = Object.assign(document.createElement("input"), { type: "checkbox", checked: !this.painter.hidden.has(name), onchange: () => box.checked ? this.painter.hidden.delete(name) : this.painter.hidden.add(name) });
        const row = document.createElement("label"), rod = document.createElement("i");
        rod.style.background = `rgb(${(FAMILY_COLOURS[name] || [0.5, 0.5, 0.5]).map((v) => 255 * v).join()})`;
        row.append(box, rod, name.replace("CrossLayer", "Cross-layer"));
        return row;
      });
      this.legend.replaceChildren(...rows);
      this.legend.hidden = rows.length === 0;
    } else if (mode === "strain") {
      const ramp = document.createElement("div"), ends = document.createElement("div");
      ramp.className = "ramp"; ends.className = "ends";
      this.ends = ["span", "span", "span"].map((tag) => ends.appendChild(document.createElement(tag)));
      this.legend.replaceChildren("strain of the links", ramp, ends);
      this.legend.hidden = false;
    }
  }

  // The scale of strains grows with them at once, and shrinks when they have become much smaller; a few torn threads do not set it.
  update() {
    const p = this.painter;
    if (p.mode !== "strain" || !p.scene) return;
    const usual = p.strain(0.97);
    if (usual > p.range || usual < 0.15 * p.range) p.range = [0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1, 2, 5].find((r) => r >= usual) || 10;
    const end = `${+(100 * p.range).toPrecision(2)} %`;
    ["-" + end, "0", "+" + end].forEach((text, k) => { if (this.ends && this.ends[k].textContent !== text) this.ends[k].textContent = text; });
  }
}
