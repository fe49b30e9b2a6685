"use strict";
// WebGL 2 as the painter needs it: programs, buffers, textures, and what is drawn into.

// Whether WebGL runs on the processor: then smoothed edges cost more than they are worth.
function drawnBySoftware() {
  const gl = document.createElement("canvas").getContext("webgl2"), known = gl && gl.getExtension("WEBGL_debug_renderer_info");
  const soft = Boolean(known) && /swiftshader|llvmpipe|software|basic render/i.test(gl.getParameter(known.UNMASKED_RENDERER_WEBGL));
  if (gl) gl.getExtension("WEBGL_lose_context").loseContext();   // browsers keep sixteen, and a page may hold many replays
  return soft;
}

class Graphics {
  constructor(canvas) {
    this.soft = drawnBySoftware();
    const gl = canvas.getContext("webgl2", { antialias: !this.soft, alpha: false });
    if (!gl) throw new Error("This browser offers no WebGL 2, which the picture needs.");
    this.gl = gl; this.canvas = canvas;
  }

  _program(vertex, fragment) {
    const gl = this.gl, program = gl.createProgram();
    for (const [kind, source] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, source); gl.compileShader(shader);
      if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) throw new Error(gl.getShaderInfoLog(shader));
      gl.attachShader(program, shader);
    }
    gl.linkProgram(program);
    if (!gl.getProgramParameter(program, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(program));
    const places = {};
    for (let k = 0; k < gl.getProgramParameter(program, gl.ACTIVE_UNIFORMS); k++) {
      const { name, type } = gl.getActiveUniform(program, k);
      places[name] = { type, place: gl.getUniformLocation(program, name) };
    }
    return { program, places };
  }

  // Sets a program's uniforms by name; those that it does not have are left out.
  _use({ program, places }, values) {
    const gl = this.gl, c = this.camera;
    gl.useProgram(program);
    const all = { u_view: c.view, u_projection: c.projection, u_eye: c.eye, ...values };
    for (const [name, value] of Object.entries(all)) {
      if (!places[name]) continue;
      const { type, place } = places[name];
      if (type === gl.FLOAT_MAT4) gl.uniformMatrix4fv(place, false, value);
      else if (type === gl.FLOAT_MAT3) gl.uniformMatrix3fv(place, false, value);
      else if (type === gl.FLOAT) gl.uniform1f(place, value);
      else if (type === gl.INT_VEC3) gl.uniform3iv(place, value);
      else if (value.length) gl[`uniform${value.length}fv`](place, value);
      else gl.uniform1i(place, value);
    }
  }

  _buffer(data) {
    const gl = this.gl, buffer = gl.createBuffer();
    gl.bindBuffer(gl.ARRAY_BUFFER, buffer); gl.bufferData(gl.ARRAY_BUFFER, data, gl.STATIC_DRAW);
    return buffer;
  }

  _attribute(place, buffer, size) {
    const gl = this.gl;
    gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
    gl.enableVertexAttribArray(place); gl.vertexAttribPointer(place, size, gl.FLOAT, false, 0, 0);
  }

  _texture() {
    const gl = this.gl, texture = gl.createTexture();
    gl.bindTexture(gl.TEXTURE_2D, texture);
    for (const side of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) gl.texParameteri(gl.TEXTURE_2D, side, gl.NEAREST);
    for (const side of [gl.TEXTURE_WRAP_S, gl.TEXTURE_WRAP_T]) gl.texParameteri(gl.TEXTURE_2D, side, gl.CLAMP_TO_EDGE);
    return texture;
  }

  _target(name) {
    const gl = this.gl, target = gl.createFramebuffer();
    gl.bindFramebuffer(gl.FRAMEBUFFER, target);
    gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, this.textures[name], 0);
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    return target;
  }

  _upload(name, texels) {
    const gl = this.gl, [layers, rows, cols] = this.scene.shape;
    gl.bindTexture(gl.TEXTURE_2D, this.textures[name]);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA32F, cols, layers * rows, 0, gl.RGBA, gl.FLOAT, texels);
  }

  _bind(unit, name) {
    const gl = this.gl;
    gl.activeTexture(gl.TEXTURE0 + unit); gl.bindTexture(gl.TEXTURE_2D, this.textures[name]); gl.activeTexture(gl.TEXTURE0 + 4);
    return unit;
  }
}
