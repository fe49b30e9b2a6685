"use strict";
// Draws a scene with WebGL 2: cloth, or balls and rods, or strain, from one texture of positions.

const FAMILY_COLOURS = {
  Structural: [0.30, 0.50, 0.86], Shear: [0.20, 0.70, 0.64], Bending: [0.94, 0.26, 0.22], CrossLayer: [0.64, 0.42, 0.88],
};
const MODES = ["cloth", "balls", "strain"];
const SHADOW = 256;

class Painter extends Graphics {
  constructor(canvas) {
    super(canvas);
    const gl = this.gl;
    this.mode = "cloth"; this.hidden = new Set(); this.range = 0.02;
    this.programs = {
      cloth: this._program(CLOTH_VERTEX, CLOTH_FRAGMENT), ball: this._program(BALL_VERTEX, BALL_FRAGMENT),
      rod: this._program(ROD_VERTEX, ROD_FRAGMENT), room: this._program(ROOM_VERTEX, ROOM_FRAGMENT),
      still: this._program(ROOM_VERTEX, STILL_FRAGMENT), ground: this._program(SHADOW_VERTEX, SHADOW_FRAGMENT),
      clothShade: this._program(CLOTH_VERTEX, SHADE_FRAGMENT),
    };
    this.square = this._buffer(new Float32Array([-1, -1, 1, -1, -1, 1, 1, 1]));
    this.textures = Object.fromEntries(["positions", "cells", "links", "shadow", "still"].map((name) => [name, this._texture()]));
    for (const name of ["balls", "corners", "bare"]) this[name] = gl.createVertexArray();
    gl.bindVertexArray(this.corners); this._attribute(0, this.square, 2);
    gl.bindTexture(gl.TEXTURE_2D, this.textures.shadow);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA8, SHADOW, SHADOW, 0, gl.RGBA, gl.UNSIGNED_BYTE, null);
    for (const side of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) gl.texParameteri(gl.TEXTURE_2D, side, gl.LINEAR);
    gl.bindTexture(gl.TEXTURE_2D, this.textures.links);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.R16UI, 1, 1, 0, gl.RED_INTEGER, gl.UNSIGNED_SHORT, new Uint16Array(1));
    this.shadow = this._target("shadow"); this.still = this._target("still");
  }

  // -- what is drawn --------------------------------------------------------------------------------------------------------

  setScene(scene) {
    const gl = this.gl, [layers, rows, cols] = scene.shape, pinned = new Set(scene.pinned);
    this.scene = scene; this.cloth = rows > 1 && cols > 1; this.count = layers * rows * cols;
    this.texels = new Float32Array(4 * this.count);
    this.least = Math.min(...scene.spacing.slice(0, rows > 1 ? 2 : 1)) || 1;
    this.size = Math.hypot(...scene.extent) || this.least;
    this.pole = Math.max(0.006 * this.size, 0.10 * this.least);
    this.ground = -(rows > 1 ? Math.max(0.9 * scene.extent[0], 0.7 * scene.extent[1]) : 0.42 * scene.extent[0]);
    const balls = new Float32Array(24 * this.count);
    for (let k = 0; k < 6 * this.count; k++) {
      const t = Math.floor(k / 6);
      balls.set([t % cols, Math.floor(t / cols), scene.radius[t % cols], pinned.has(t) ? 1 : 0], 4 * k);
    }
    gl.bindVertexArray(this.balls);
    this._attribute(0, this._buffer(balls), 4);
    this.surfaces = this.cloth ? { positions: new Surface(gl, scene.shape), target: new Surface(gl, scene.shape) } : {};
    this.setTarget(scene.target);
    this.links = scene.families.filter((f) => f[1] === 0 && f[0] === "Structural");
  }

  setTarget(target) {
    this.hasTarget = Boolean(target);
    if (target && this.cloth) this.surfaces.target.update(this._texels(target, new Float32Array(4 * this.count)));
  }

  setFrame(positions, torn = null) {
    this._texels(positions, this.texels);
    this._strains(positions);
    this._upload("positions", this.texels);
    if (this.cloth) this.surfaces.positions.update(this.texels);
    this.torn = torn;
    if (torn) {
      const gl = this.gl, [layers, rows, cols] = this.scene.shape;
      gl.bindTexture(gl.TEXTURE_2D, this.textures.links);
      gl.pixelStorei(gl.UNPACK_ALIGNMENT, 1);
      gl.texImage2D(gl.TEXTURE_2D, 0, gl.R16UI, cols, layers * rows, 0, gl.RED_INTEGER, gl.UNSIGNED_SHORT, torn.links);
      gl.bindTexture(gl.TEXTURE_2D, this.textures.cells);
      const cells = torn.cells.map((whole) => 255 * whole);
      gl.texImage2D(gl.TEXTURE_2D, 0, gl.R8, cols - 1, layers * (rows - 1), 0, gl.RED, gl.UNSIGNED_BYTE, cells);
    }
  }

  // Each particle's texel holds the strain of the link at it that is farthest from rest.
  _strains(p) {
    const [, rows, cols] = this.scene.shape, out = this.texels;
    for (const [, , up, along, length] of this.links || []) {
      const offset = up * cols + along;
      for (let t = 0; t + offset < this.count; t++) {
        if (t % cols + along >= cols || Math.floor(t / cols) % rows + up >= rows) continue;
        const a = 3 * t, b = 3 * (t + offset), dx = p[b] - p[a], dy = p[b + 1] - p[a + 1], dz = p[b + 2] - p[a + 2];
        const s = Math.sqrt(dx * dx + dy * dy + dz * dz) / length - 1;
        for (const k of [4 * t + 3, 4 * (t + offset) + 3]) if (Math.abs(s) > Math.abs(out[k])) out[k] = s;
      }
    }
  }

  // The strain, either way, that this share of the particles does not exceed.
  strain(share) {
    const all = Float32Array.from({ length: this.count }, (_, t) => Math.abs(this.texels[4 * t + 3])).sort();
    return all[Math.min(this.count - 1, Math.floor(share * this.count))];
  }

  _texels(p, texels) {
    for (let t = 0; t < this.count; t++) {
      texels[4 * t] = p[3 * t]; texels[4 * t + 1] = p[3 * t + 1]; texels[4 * t + 2] = p[3 * t + 2]; texels[4 * t + 3] = 0;
    }
    return texels;
  }

  at(t) { return Array.from(this.texels.subarray(4 * t, 4 * t + 3)); }

  // Poles: from below the pinned ends of the lowest row to above the highest.
  poles() {
    const [, rows, cols] = this.scene.shape, pinned = new Set(this.scene.pinned);
    return [0, cols - 1].filter((col, k, all) => pinned.has(col) && all.indexOf(col) === k).map((col) => {
      const foot = this.at(col), top = this.at((rows - 1) * cols + col), tall = V.add(top, V.scale(foot, -1));
      const axis = rows > 1 ? V.unit(tall) : [0, 0, 1];
      const drop = axis[2] > 0.05 ? Math.max(0, foot[2] - this.ground) / axis[2] : this.size;
      return [V.add(foot, V.scale(axis, -drop)), V.add(top, V.scale(axis, 0.05 * this.size))];
    });
  }

  // -- drawing --------------------------------------------------------------------------------------------------------------

  draw(view) {
    const gl = this.gl, canvas = this.canvas, sharp = (this.soft ? 0.75 : 1) * Math.min(window.devicePixelRatio || 1, 2);
    const width = Math.round(canvas.clientWidth * sharp), height = Math.round(canvas.clientHeight * sharp);
    if (canvas.width !== width || canvas.height !== height) { canvas.width = width; canvas.height = height; }
    this.camera = view.matrices();
    this._drawShadow();
    gl.viewport(0, 0, width, height);
    gl.clear(gl.DEPTH_BUFFER_BIT);
    gl.disable(gl.DEPTH_TEST);
    this._drawRoom(width, height);
    gl.enable(gl.DEPTH_TEST); gl.depthFunc(gl.LEQUAL);
    this._drawPoles();
    if (this.mode === "balls" || !this.cloth) this._drawLinks();
    else this._drawCloth("positions", this.mode === "strain" ? 1 : 0);
    if (this.hasTarget) this._drawGhost();
  }

  _drawGhost() {
    const gl = this.gl;
    const colour = this.reached ? [0.20, 0.72, 0.38, 0.42] : [0.24, 0.44, 0.90, 0.36];
    gl.colorMask(false, false, false, false);
    this._drawCloth("target", 2, colour);
    gl.colorMask(true, true, true, true);
    gl.enable(gl.BLEND); gl.blendFunc(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA);
    this._drawCloth("target", 2, colour);
    gl.disable(gl.BLEND);
  }

  _drawCloth(source, paint, colour = [1, 1, 1, 1], program = this.programs.cloth) {
    const gl = this.gl, { shape, extent } = this.scene;
    this._use(program, {
      u_shape: shape, u_paint: paint, u_colour: colour, u_range: this.range,
      u_size: extent, u_thread: extent[1] / 110, u_cells: this._bind(1, "cells"), u_torn: Boolean(this.torn) && source === "positions",
    });
    for (let layer = 0; layer < shape[0]; layer++) {
      gl.uniform1i(program.places.u_layer ? program.places.u_layer.place : null, layer);
      this.surfaces[source].draw(layer);
    }
  }

  _drawLinks() {
    const gl = this.gl, { shape, families } = this.scene, thin = this.cloth ? 1 : 1.6;
    gl.bindVertexArray(this.bare);
    families.forEach(([name, layers, rows, cols], bit) => {
      if (this.hidden.has(name)) return;
      const bending = name === "Bending";
      this._use(this.programs.rod, {
        u_positions: this._bind(0, "positions"), u_shape: shape, u_direction: [layers, rows, cols], u_one: false,
        u_radius: thin * this.least * (name === "Structural" ? 0.055 : 0.032),
        u_shift: bending ? [0, -0.13 * this.least, 0] : [0, 0, 0],  // else they would lie within the structural links
        u_colour: [...(FAMILY_COLOURS[name] || [0.5, 0.5, 0.5]), 1], u_torn: Boolean(this.torn), u_links: this._bind(2, "links"), u_bit: bit,
      });
      gl.drawArrays(gl.TRIANGLES, 0, 6 * this.count);
    });
    gl.bindVertexArray(this.balls);
    this._use(this.programs.ball, { u_positions: this._bind(0, "positions"), u_shape: shape, u_single: [0, 0, 0, 0] });
    gl.drawArrays(gl.TRIANGLES, 0, 6 * this.count);
  }

  _drawPoles() {
    const gl = this.gl, wood = [0.86, 0.85, 0.83, 1], thick = this.pole * (this.mode === "balls" ? 0.5 : 1);   // pinned balls stand out of it
    for (const [foot, top] of this.poles()) {
      gl.bindVertexArray(this.bare);
      this._use(this.programs.rod, {
        u_positions: this._bind(0, "positions"), u_links: this._bind(2, "links"), u_shape: this.scene.shape, u_one: true, u_from: foot, u_to: top, u_radius: thick, u_shift: [0, 0, 0],
        u_colour: wood, u_torn: false,
      });
      gl.drawArrays(gl.TRIANGLES, 0, 6);
      gl.bindVertexArray(this.balls);
      this._use(this.programs.ball, { u_positions: this._bind(0, "positions"), u_shape: this.scene.shape, u_single: [...top, 2.1 * this.pole] });
      gl.drawArrays(gl.TRIANGLES, 0, 6);
    }
  }

  // What stands in the light, flattened along it into a picture of the ground it falls on.
  _drawShadow() {
    if (!this.cloth) return;
    const gl = this.gl, g = this.ground, kx = 0.22, ky = 0.26, soft = 0.035 * this.size;   // steeper than the light, to stay beneath the flag
    let [left, front, right, back] = [Infinity, Infinity, -Infinity, -Infinity];
    for (let t = 0; t < this.count; t++) {
      const x = this.texels[4 * t], y = this.texels[4 * t + 1], up = this.texels[4 * t + 2] - g;
      left = Math.min(left, x + kx * up); right = Math.max(right, x + kx * up);
      front = Math.min(front, y + ky * up); back = Math.max(back, y + ky * up);
    }
    const wide = right - left + 4 * soft, deep = back - front + 4 * soft;
    this.plot = [left - 2 * soft, front - 2 * soft, wide, deep]; this.blur = [soft / wide, soft / deep];
    const mx = 2 / wide, my = 2 / deep, seen = this.camera;
    const view = new Float32Array([
      mx, 0, 0, 0, 0, my, 0, 0, kx * mx, ky * my, 0, 0, -1 - (this.plot[0] + kx * g) * mx, -1 - (this.plot[1] + ky * g) * my, 0, 1,
    ]);
    this.camera = { ...seen, view, projection: new Float32Array([1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]) };
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.shadow);
    gl.viewport(0, 0, SHADOW, SHADOW);
    gl.disable(gl.DEPTH_TEST);
    gl.clearColor(0, 0, 0, 1); gl.clear(gl.COLOR_BUFFER_BIT);
    this._drawCloth("positions", 0, [1, 1, 1, 1], this.programs.clothShade);
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    this.camera = seen;
  }

  // Sky and ground, painted anew when the camera moves; then the shadow.
  _drawRoom(width, height) {
    const gl = this.gl, c = this.camera, key = [width, height, this.ground, this.size, ...c.shift, ...c.view].join();
    gl.bindVertexArray(this.corners);
    if (key !== this.stillKey) {
      this.stillKey = key;
      gl.activeTexture(gl.TEXTURE0 + 4); gl.bindTexture(gl.TEXTURE_2D, this.textures.still);
      gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA8, width, height, 0, gl.RGBA, gl.UNSIGNED_BYTE, null);
      gl.bindFramebuffer(gl.FRAMEBUFFER, this.still);
      this._use(this.programs.room, { u_fan: [...c.fan, ...c.shift], u_turn: c.turn, u_ground: this.ground, u_reach: 3 * this.size, u_grid: this.size / 3.6 });
      gl.drawArrays(gl.TRIANGLE_STRIP, 0, 4);
      gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    }
    this._use(this.programs.still, { u_fan: [...c.fan, ...c.shift], u_turn: c.turn, u_picture: this._bind(0, "still") });
    gl.drawArrays(gl.TRIANGLE_STRIP, 0, 4);
    if (!this.cloth || c.eye[2] < this.ground) return;
    gl.enable(gl.BLEND); gl.blendFunc(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA);
    this._use(this.programs.ground, { u_plot: this.plot, u_ground: this.ground, u_blur: this.blur, u_shadow: this._bind(3, "shadow"), u_taps: this.soft ? 6 : 16 });
    gl.drawArrays(gl.TRIANGLE_STRIP, 0, 4);
    gl.disable(gl.BLEND);
  }
}
