"use strict";
// A smooth surface through the particles (Catmull-Rom, finer than a coarse lattice) with normals of its own: flat triangles between
// the particles would look like pyramids.

const VERTICES = 3200;   // of a layer, about

// For each of `count` places along a line of particles: four particles, their weights, and those of the slope there.
function spline(particles, fine) {
  const all = [];
  for (let k = 0; k <= fine * (particles - 1); k++) {
    const left = Math.min(Math.floor(k / fine), particles - 2), t = k / fine - left, t2 = t * t, t3 = t2 * t;
    const w = [-t + 2 * t2 - t3, 2 - 5 * t2 + 3 * t3, t + 4 * t2 - 3 * t3, -t2 + t3];
    const d = [-1 + 4 * t - 3 * t2, -10 * t + 9 * t2, 1 + 8 * t - 9 * t2, -2 * t + 3 * t2];
    const at = [left - 1, left, left + 1, left + 2];
    for (const [out, end, next] of [[0, 1, 2], [3, 2, 1]])   // beyond both ends the line goes on straight
      if (at[out] < 0 || at[out] >= particles) {
        for (const x of [w, d]) { x[end] += 2 * x[out]; x[next] -= x[out]; x[out] = 0; }
        at[out] = at[end];
      }
    all.push([at, w.map((x) => x / 2), d.map((x) => x / 2)]);
  }
  return all;
}

class Surface {
  constructor(gl, [layers, rows, cols]) {
    this.gl = gl; this.shape = [layers, rows, cols];
    const fine = Math.max(1, Math.min(5, Math.round(Math.sqrt(VERTICES / (rows * cols)))));
    this.up = spline(rows, fine); this.along = spline(cols, fine);
    const m = this.up.length, n = this.along.length;
    this.per = m * n;
    const uv = new Float32Array(2 * layers * m * n), numbers = new Uint32Array(6 * (m - 1) * (n - 1));
    for (let k = 0; k < layers * m * n; k++) uv.set([k % n / (n - 1), Math.floor(k / n) % m / (m - 1)], 2 * k);
    let next = 0;
    for (let j = 0; j < m - 1; j++)
      for (let i = 0; i < n - 1; i++, next += 6) { const at = j * n + i; numbers.set([at, at + 1, at + n + 1, at, at + n + 1, at + n], next); }
    this.numbers = numbers.length;
    this.data = new Float32Array(7 * layers * m * n);
    this.lines = new Float32Array(4 * rows * n); this.slopes = new Float32Array(3 * rows * n);
    this.buffer = gl.createBuffer();
    const elements = gl.createBuffer(), places = gl.createBuffer();
    gl.bindBuffer(gl.ARRAY_BUFFER, places); gl.bufferData(gl.ARRAY_BUFFER, uv, gl.STATIC_DRAW);
    this.arrays = [...Array(layers).keys()].map((layer) => {
      const array = gl.createVertexArray(), first = layer * m * n;
      gl.bindVertexArray(array);
      gl.bindBuffer(gl.ARRAY_BUFFER, this.buffer);
      gl.enableVertexAttribArray(0); gl.vertexAttribPointer(0, 4, gl.FLOAT, false, 28, 28 * first);
      gl.enableVertexAttribArray(1); gl.vertexAttribPointer(1, 3, gl.FLOAT, false, 28, 28 * first + 16);
      gl.bindBuffer(gl.ARRAY_BUFFER, places);
      gl.enableVertexAttribArray(2); gl.vertexAttribPointer(2, 2, gl.FLOAT, false, 8, 8 * first);
      gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, elements);
      if (layer === 0) gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, numbers, gl.STATIC_DRAW);
      return array;
    });
    gl.bindVertexArray(null);
  }

  // texels: x, y, z, strain of every particle
  update(texels) {
    const gl = this.gl, [layers] = this.shape;
    for (let layer = 0; layer < layers; layer++) { this._across(texels, layer); this._upwards(layer); }
    gl.bindBuffer(gl.ARRAY_BUFFER, this.buffer); gl.bufferData(gl.ARRAY_BUFFER, this.data, gl.DYNAMIC_DRAW);
  }

  _across(texels, layer) {
    const [, rows, cols] = this.shape, { along, lines, slopes } = this, n = along.length;
    for (let row = 0; row < rows; row++)
      for (let i = 0; i < n; i++) {
        const [at, w, d] = along[i], base = (layer * rows + row) * cols, to = row * n + i;
        const a = 4 * (base + at[0]), b = 4 * (base + at[1]), c = 4 * (base + at[2]), e = 4 * (base + at[3]);
        for (let k = 0; k < 4; k++) {
          lines[4 * to + k] = w[0] * texels[a + k] + w[1] * texels[b + k] + w[2] * texels[c + k] + w[3] * texels[e + k];
          if (k < 3) slopes[3 * to + k] = d[0] * texels[a + k] + d[1] * texels[b + k] + d[2] * texels[c + k] + d[3] * texels[e + k];
        }
      }
  }

  _upwards(layer) {
    const { up, lines, slopes, data } = this, m = up.length, n = this.along.length, x = [0, 0, 0], y = [0, 0, 0];
    for (let j = 0; j < m; j++)
      for (let i = 0; i < n; i++) {
        const [at, w, d] = up[j], to = 7 * ((layer * m + j) * n + i);
        const a = at[0] * n + i, b = at[1] * n + i, c = at[2] * n + i, e = at[3] * n + i;
        for (let k = 0; k < 4; k++) data[to + k] = w[0] * lines[4 * a + k] + w[1] * lines[4 * b + k] + w[2] * lines[4 * c + k] + w[3] * lines[4 * e + k];
        for (let k = 0; k < 3; k++) {
          x[k] = w[0] * slopes[3 * a + k] + w[1] * slopes[3 * b + k] + w[2] * slopes[3 * c + k] + w[3] * slopes[3 * e + k];
          y[k] = d[0] * lines[4 * a + k] + d[1] * lines[4 * b + k] + d[2] * lines[4 * c + k] + d[3] * lines[4 * e + k];
        }
        const nx = x[1] * y[2] - x[2] * y[1], ny = x[2] * y[0] - x[0] * y[2], nz = x[0] * y[1] - x[1] * y[0], size = Math.hypot(nx, ny, nz) || 1;
        data[to + 4] = nx / size; data[to + 5] = ny / size; data[to + 6] = nz / size;
      }
  }

  draw(layer) {
    this.gl.bindVertexArray(this.arrays[layer]);
    this.gl.drawElements(this.gl.TRIANGLES, this.numbers, this.gl.UNSIGNED_INT, 0);
  }
}
