"use strict";
// The camera: orbits a point, z up; 4 x 4 matrices by columns.

const V = {
  add: (a, b) => [a[0] + b[0], a[1] + b[1], a[2] + b[2]],
  scale: (a, s) => [a[0] * s, a[1] * s, a[2] * s],
  dot: (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2],
  cross: (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]],
  unit: (a) => V.scale(a, 1 / (Math.hypot(...a) || 1)),
};

class View {
  constructor(canvas) {
    this.canvas = canvas;
    this.home = { target: [0.6, 0, 0.2], distance: 5, azimuth: -62, elevation: 13 };
    this.reset();
    this.changed = () => {};
    this.covered = () => [0, 0];   // pixels at the right and at the bottom that a panel covers
    this._pointers = new Map();
    this._grab = null;
    canvas.style.touchAction = "none";
    canvas.addEventListener("pointerdown", (e) => this._down(e));
    canvas.addEventListener("pointermove", (e) => this._move(e));
    for (const end of ["pointerup", "pointercancel"]) canvas.addEventListener(end, (e) => this._up(e));
    canvas.addEventListener("dblclick", () => { this.reset(); this.changed(); });
    canvas.addEventListener("contextmenu", (e) => e.preventDefault());
    canvas.addEventListener("wheel", (e) => { e.preventDefault(); this.zoom(Math.exp(0.0012 * e.deltaY)); }, { passive: false });
  }

  // Something that a pointer may take hold of instead of the camera: at(x, y) -> {move(x, y), end()} or null.
  set holdable(at) { this._holdable = at; }

  frame(target, distance) {
    Object.assign(this.home, { target, distance });
    this.reset();
  }

  reset() { Object.assign(this, this.home, { target: [...this.home.target] }); }

  zoom(factor) {
    const least = 0.15 * this.home.distance, most = 5 * this.home.distance;
    this.distance = Math.min(most, Math.max(least, this.distance * factor));
    this.changed();
  }

  orbit(dx, dy) {
    this.azimuth -= 0.35 * dx;
    this.elevation = Math.min(88, Math.max(-20, this.elevation + 0.35 * dy));
    this.changed();
  }

  pan(dx, dy) {
    const { right, up } = this.axes(), s = this.metresPerPixel();
    this.target = V.add(this.target, V.add(V.scale(right, -dx * s), V.scale(up, dy * s)));
    this.changed();
  }

  metresPerPixel(distance = this.distance) { return distance * 2 * this._tangent()[1] / this.canvas.clientHeight; }

  axes(elevation = this.elevation) {
    const a = this.azimuth * Math.PI / 180, e = elevation * Math.PI / 180;
    const back = [Math.cos(e) * Math.cos(a), Math.cos(e) * Math.sin(a), Math.sin(e)];
    const right = [-Math.sin(a), Math.cos(a), 0];
    return { right, up: V.cross(back, right), back };
  }

  _tangent() {
    const [right, bottom] = this.covered(), wide = Math.max(1, this.canvas.clientWidth), high = Math.max(1, this.canvas.clientHeight);
    const narrow = Math.min(1, (wide - right) / (high - bottom) / 1.25), y = 0.30 / narrow * high / (high - bottom);   // in a tall window the sides decide
    return [y * wide / high, y];
  }

  matrices() {
    const { right, up, back } = this.axes(), eye = V.add(this.target, V.scale(back, this.distance));
    const [hidden, below] = this.covered(), shift = [hidden / Math.max(1, this.canvas.clientWidth), -below / Math.max(1, this.canvas.clientHeight)];
    const [tx, ty] = this._tangent(), near = 0.02 * this.home.distance, far = 60 * this.home.distance;
    const view = new Float32Array([
      right[0], up[0], back[0], 0, right[1], up[1], back[1], 0, right[2], up[2], back[2], 0,
      -V.dot(right, eye), -V.dot(up, eye), -V.dot(back, eye), 1,
    ]);
    const projection = new Float32Array([
      1 / tx, 0, 0, 0, 0, 1 / ty, 0, 0, ...shift, -(far + near) / (far - near), -1, 0, 0, -2 * far * near / (far - near), 0,
    ]);
    return { view, projection, eye, fan: [tx, ty], shift, turn: new Float32Array([...right, ...up, ...back]), right, up, back };
  }

  // Where a place is seen [pixel of the page], and how far away.
  project(p) {
    const { right, up, back, eye, fan, shift } = this.matrices(), d = V.add(p, V.scale(eye, -1)), depth = -V.dot(back, d);
    const w = this.canvas.clientWidth, h = this.canvas.clientHeight;
    return [w / 2 * (1 - shift[0] + V.dot(right, d) / depth / fan[0]), h / 2 * (1 + shift[1] - V.dot(up, d) / depth / fan[1]), depth];
  }

  _place(e) {
    const box = this.canvas.getBoundingClientRect();
    return [e.clientX - box.left, e.clientY - box.top];
  }

  _down(e) {
    this.canvas.setPointerCapture(e.pointerId);
    const at = this._place(e);
    this._pointers.set(e.pointerId, at);
    if (this._pointers.size === 1 && e.button === 0) this._grab = this._holdable ? this._holdable(...at) : null;
    this._panning = e.button === 2 || e.shiftKey;
  }

  _move(e) {
    const at = this._place(e), before = this._pointers.get(e.pointerId);
    if (!before) {
      this.canvas.style.cursor = this._holdable && this._holdable(...at) ? "grab" : "";
      return;
    }
    const dx = at[0] - before[0], dy = at[1] - before[1];
    if (this._pointers.size === 2) {
      const other = [...this._pointers].find(([id]) => id !== e.pointerId)[1];
      const gap = (p) => Math.hypot(p[0] - other[0], p[1] - other[1]) || 1;
      this.zoom(gap(before) / gap(at));
      this.pan(dx / 2, dy / 2);
    } else if (this._grab) this._grab.move(...at);
    else if (this._panning) this.pan(dx, dy);
    else this.orbit(dx, dy);
    this._pointers.set(e.pointerId, at);
  }

  _up(e) {
    this._pointers.delete(e.pointerId);
    if (this._grab) this._grab.end();
    this._grab = null;
  }
}
