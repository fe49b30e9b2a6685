"use strict";
// GLSL of the page and of replays. Positions come from one texture, a texel a particle (x, y, z, strain), whatever is drawn.

const GLSL_COMMON = `#version 300 es
precision highp float;
precision highp int;
precision highp sampler2D;
const vec3 SUN = normalize(vec3(-0.34, -0.74, 0.58));
uniform mat4 u_view;
uniform mat4 u_projection;
uniform vec3 u_eye;
`;

const GLSL_LIGHT = `
vec3 lit(vec3 albedo, vec3 normal, vec3 toward, float through) {
  float sun = dot(normal, SUN);
  float direct = max((sun + 0.3) / 1.3, 0.0) + through * max(-sun, 0.0);  // cloth scatters light a little way round and through
  vec3 sky = mix(vec3(0.50, 0.47, 0.45), vec3(0.58, 0.62, 0.68), 0.5 + 0.5 * normal.z);
  float rim = pow(1.0 - abs(dot(normal, toward)), 3.0);
  return 0.95 * albedo * (sky + vec3(0.66, 0.63, 0.57) * direct) + 0.05 * rim * vec3(0.9, 0.95, 1.0);
}
`;

const GLSL_LATTICE = `
uniform sampler2D u_positions;
uniform ivec3 u_shape;  // layers, rows, columns
// Corners of a square, six in a row: a vertex each, since software renderers are slow at instances.
vec2 corner() {
  int k = gl_VertexID % 6;
  return vec2(k == 1 || k == 3 || k == 4 ? 1.0 : -1.0, k == 2 || k >= 4 ? 1.0 : -1.0);
}
vec4 particle(int layer, int row, int col) {
  return texelFetch(u_positions, ivec2(col, layer * u_shape.y + row), 0);
}
`;

const CLOTH_VERTEX = GLSL_COMMON + `
layout(location = 0) in vec4 a_world;   // place, strain
layout(location = 1) in vec3 a_normal;
layout(location = 2) in vec2 a_uv;
out vec3 v_world; out vec3 v_normal; out vec2 v_uv; out float v_strain;
void main() {
  v_world = a_world.xyz; v_strain = a_world.w; v_normal = a_normal; v_uv = a_uv;
  gl_Position = u_projection * u_view * vec4(v_world, 1.0);
}`;

const CLOTH_FRAGMENT = GLSL_COMMON + GLSL_LIGHT + `
in vec3 v_world; in vec3 v_normal; in vec2 v_uv; in float v_strain;
uniform int u_paint;        // 0 pattern, 1 strain, 2 one colour
uniform vec4 u_colour;
uniform float u_range;      // strain of the scale's end
uniform vec2 u_size;        // of the cloth [m]
uniform float u_thread;     // width of a thread [m]
uniform sampler2D u_cells;  // whole cells
uniform bool u_torn;
uniform ivec3 u_shape;
uniform int u_layer;
out vec4 colour;
float band(float x, float at, float half_width) {
  float w = fwidth(x);
  return smoothstep(-w, w, half_width - abs(x - at));
}
float beyond(float x, float at) { float w = fwidth(x); return smoothstep(-w, w, x - at); }
vec3 pattern(vec2 uv) {
  vec3 red = vec3(0.80, 0.17, 0.16), gold = vec3(0.96, 0.64, 0.18), cream = vec3(0.97, 0.93, 0.85);
  float right = beyond(uv.x, 0.38), top = beyond(uv.y, 0.5);
  vec3 c = mix(mix(red, gold, right), mix(gold, red, right), top);
  float cross_ = max(band(uv.y, 0.5, 0.085), band(uv.x, 0.38, 0.057));
  float seam = max(band(uv.y, 0.5, 0.093), band(uv.x, 0.38, 0.063));
  c = mix(c, cream * 0.80, seam);
  c = mix(c, cream, cross_);
  c = mix(c, cream * 0.93, 1.0 - beyond(uv.x, 0.035));
  vec2 edge = min(uv, 1.0 - uv) * u_size / u_size.y;
  float hem = 1.0 - min(beyond(edge.x, 0.016), beyond(edge.y, 0.016));
  c *= 1.0 - 0.10 * hem;
  vec2 at = uv * u_size / u_thread;   // a weave, faded out before it would flicker
  vec2 fade = clamp(1.2 - 2.4 * fwidth(at), 0.0, 1.0);
  vec2 thread = 0.5 + 0.5 * cos(6.2832 * at);
  return c * (1.0 - 0.07 * fade.x * fade.y * (thread.x + thread.y - 2.0 * thread.x * thread.y));
}
vec3 strain_colour(float s) {
  vec3 mid = vec3(0.93, 0.93, 0.90);
  vec3 hot = s < 0.5 ? mix(mid, vec3(0.96, 0.67, 0.33), 2.0 * s) : mix(vec3(0.96, 0.67, 0.33), vec3(0.72, 0.09, 0.13), 2.0 * s - 1.0);
  float c = -s;
  vec3 cold = c < 0.5 ? mix(mid, vec3(0.45, 0.71, 0.84), 2.0 * c) : mix(vec3(0.45, 0.71, 0.84), vec3(0.10, 0.25, 0.55), 2.0 * c - 1.0);
  return s < 0.0 ? cold : hot;
}
void main() {
  if (u_torn) {
    ivec2 n = u_shape.zy - 1;
    ivec2 cell = clamp(ivec2(v_uv * vec2(n)), ivec2(0), n - 1);
    if (texelFetch(u_cells, ivec2(cell.x, u_layer * n.y + cell.y), 0).r < 0.5) discard;
  }
  vec3 toward = normalize(u_eye - v_world);
  vec3 normal = normalize(v_normal);
  bool back = dot(normal, toward) < 0.0;
  if (back) normal = -normal;
  vec3 albedo = u_paint == 0 ? pattern(v_uv) : u_paint == 1 ? strain_colour(clamp(v_strain / u_range, -1.0, 1.0)) : u_colour.rgb;
  if (back && u_paint == 0) albedo *= 0.93;
  colour = vec4(lit(albedo, normal, toward, 0.42), 1.0);
  if (u_paint == 2) {   // a target: seen through, with a firm edge
    vec2 in_ = min(v_uv, 1.0 - v_uv) * u_size / u_size.y;
    float edge = 1.0 - min(beyond(in_.x, 0.010), beyond(in_.y, 0.010));
    colour = vec4(mix(colour.rgb, 0.65 * u_colour.rgb, edge), mix(u_colour.a, 0.9, edge));
  }
}`;

// Balls and rods are squares that face the eye; each pixel finds its own place on the round body.
const BALL_VERTEX = GLSL_COMMON + GLSL_LATTICE + `
layout(location = 0) in vec4 a_ball;   // column, layer * rows + row, radius, pinned
uniform vec4 u_single;                 // one ball at a place, if its radius is not 0
out vec2 v_corner; out vec3 v_centre; out float v_radius; out float v_pinned;
void main() {
  bool one = u_single.w > 0.0;
  vec3 centre = one ? u_single.xyz : texelFetch(u_positions, ivec2(a_ball.xy), 0).xyz;
  v_radius = one ? u_single.w : a_ball.z;
  v_pinned = one ? 2.0 : a_ball.w;
  v_centre = (u_view * vec4(centre, 1.0)).xyz;
  v_corner = 1.12 * corner();
  gl_Position = u_projection * vec4(v_centre + v_radius * vec3(v_corner, 0.0), 1.0);
}`;

const BALL_FRAGMENT = GLSL_COMMON + GLSL_LIGHT + `
in vec2 v_corner; in vec3 v_centre; in float v_radius; in float v_pinned;
out vec4 colour;
void main() {
  vec3 ray = normalize(v_centre + v_radius * vec3(v_corner, 0.0));
  float b = dot(ray, v_centre), c = dot(v_centre, v_centre) - v_radius * v_radius, d = b * b - c;
  if (d < 0.0) discard;
  vec3 at = (b - sqrt(d)) * ray;
  vec4 clip = u_projection * vec4(at, 1.0);
  gl_FragDepth = 0.5 + 0.5 * clip.z / clip.w;
  mat3 world = transpose(mat3(u_view));
  vec3 normal = world * ((at - v_centre) / v_radius);
  vec3 albedo = v_pinned > 1.5 ? vec3(0.90, 0.68, 0.24) : v_pinned > 0.5 ? vec3(0.84, 0.16, 0.15) : vec3(0.30, 0.64, 0.31);
  vec3 toward = world * -ray;
  float gloss = pow(max(dot(reflect(-SUN, normal), toward), 0.0), 30.0);
  colour = vec4(lit(albedo, normal, toward, 0.0) + 0.25 * gloss, 1.0);
}`;

const ROD_VERTEX = GLSL_COMMON + GLSL_LATTICE + `
uniform ivec3 u_direction;    // layers, rows, columns from a link's first to its second end
uniform vec3 u_from, u_to;    // one rod between two places, if u_one
uniform bool u_one;
uniform float u_radius;
uniform vec3 u_shift;
uniform bool u_torn;
uniform highp usampler2D u_links;
uniform int u_bit;
out float v_across; out vec3 v_at; out vec3 v_side; out vec3 v_front;
void main() {
  vec2 a_corner = corner();
  vec3 a = u_from, b = u_to;
  bool hidden = false;
  if (!u_one) {
    int t = gl_VertexID / 6, per = u_shape.y * u_shape.z;
    ivec3 p = ivec3(t / per, t % per / u_shape.z, t % u_shape.z), q = p + u_direction;
    hidden = any(lessThan(q, ivec3(0))) || any(greaterThanEqual(q, u_shape));
    q = clamp(q, ivec3(0), u_shape - 1);
    if (u_torn) hidden = hidden || (texelFetch(u_links, ivec2(p.z, p.x * u_shape.y + p.y), 0).r >> uint(u_bit) & 1u) == 0u;
    a = particle(p.x, p.y, p.z).xyz + u_shift; b = particle(q.x, q.y, q.z).xyz + u_shift;
  }
  vec3 va = (u_view * vec4(a, 1.0)).xyz, vb = (u_view * vec4(b, 1.0)).xyz;
  vec3 at = mix(va, vb, 0.5 + 0.5 * a_corner.y);
  vec3 side = cross(vb - va, at);
  side /= max(length(side), 1e-9);
  v_side = side; v_front = normalize(cross(side, vb - va));
  v_across = a_corner.x;
  v_at = at + u_radius * a_corner.x * side;
  gl_Position = hidden ? vec4(2.0, 2.0, 2.0, 1.0) : u_projection * vec4(v_at, 1.0);
}`;

const ROD_FRAGMENT = GLSL_COMMON + GLSL_LIGHT + `
in float v_across; in vec3 v_at; in vec3 v_side; in vec3 v_front;
uniform vec4 u_colour;
uniform float u_radius;
out vec4 colour;
void main() {
  float out_ = sqrt(max(1.0 - v_across * v_across, 0.0));
  vec3 front = dot(v_front, v_at) > 0.0 ? -v_front : v_front;
  vec3 at = v_at + u_radius * out_ * front;
  vec4 clip = u_projection * vec4(at, 1.0);
  gl_FragDepth = 0.5 + 0.5 * clip.z / clip.w;
  mat3 world = transpose(mat3(u_view));
  colour = vec4(lit(u_colour.rgb, world * (v_across * v_side + out_ * front), world * normalize(-v_at), 0.0), u_colour.a);
}`;

const ROOM_VERTEX = GLSL_COMMON + `
layout(location = 0) in vec2 a_corner;
uniform vec4 u_fan;  // the view's tangents, and its shift
uniform mat3 u_turn; // from the view to the world
out vec3 v_ray;
void main() {
  v_ray = u_turn * vec3((a_corner + u_fan.zw) * u_fan.xy, -1.0);
  gl_Position = vec4(a_corner, 1.0, 1.0);
}`;

const ROOM_FRAGMENT = GLSL_COMMON + `
in vec3 v_ray;
uniform float u_ground, u_reach, u_grid;
out vec4 colour;
void main() {
  vec3 ray = normalize(v_ray);
  vec3 horizon = vec3(0.925, 0.940, 0.945), zenith = vec3(0.530, 0.690, 0.860);
  vec3 sky = mix(horizon, zenith, pow(clamp(ray.z / 0.45, 0.0, 1.0), 0.8));
  float far = (u_ground - u_eye.z) / min(ray.z, -1e-4);
  vec2 cell = (u_eye.xy + far * ray.xy) / u_grid, width = max(fwidth(cell), 1e-5), off = abs(fract(cell - 0.5) - 0.5);
  vec2 line = clamp((0.012 + 0.5 * width - off) / width, 0.0, 1.0) * clamp(1.5 - 5.0 * width, 0.0, 1.0);
  vec3 ground = mix(vec3(0.850, 0.838, 0.805), vec3(0.735, 0.722, 0.690), max(line.x, line.y));
  float haze = 1.0 - exp(-pow(max(far / u_reach - 0.8, 0.0), 2.0) / 5.0);
  colour = vec4(mix(mix(ground, horizon, clamp(haze, 0.0, 1.0)), sky, smoothstep(-0.004, 0.0, ray.z)), 1.0);
  vec2 noise = fract(sin(vec2(dot(gl_FragCoord.xy, vec2(12.99, 78.23)), dot(gl_FragCoord.yx, vec2(39.35, 11.14)))) * 43758.5);
  colour.rgb += (noise.x - noise.y) / 255.0;  // no bands
}`;

const STILL_FRAGMENT = GLSL_COMMON + `
uniform sampler2D u_picture;
out vec4 colour;
void main() { colour = texelFetch(u_picture, ivec2(gl_FragCoord.xy), 0); }`;

const SHADOW_VERTEX = GLSL_COMMON + `
layout(location = 0) in vec2 a_corner;
uniform vec4 u_plot;  // corner and size of the ground that the shadow's picture covers
uniform float u_ground;
out vec2 v_uv;
void main() {
  v_uv = 0.5 + 0.5 * a_corner;
  gl_Position = u_projection * u_view * vec4(u_plot.xy + v_uv * u_plot.zw, u_ground, 1.0);
}`;

const SHADOW_FRAGMENT = GLSL_COMMON + `
in vec2 v_uv;
uniform sampler2D u_shadow;
uniform vec2 u_blur;
uniform int u_taps;
out vec4 colour;
void main() {
  float dark = 0.0;
  for (int i = 0; i < u_taps; i++) {
    float turn = 2.4 * float(i), r = sqrt((float(i) + 0.5) / float(u_taps));
    dark += textureLod(u_shadow, v_uv + u_blur * r * vec2(cos(turn), sin(turn)), 0.0).r;
  }
  colour = vec4(0.09, 0.10, 0.16, 0.36 * dark / float(u_taps));
}`;

const SHADE_FRAGMENT = GLSL_COMMON + `
out vec4 colour;
void main() { colour = vec4(1.0); }`;
