// Draws p + s Re(V exp(i phase)) on the graphics processor: a frame sends it a phase, no nodes.
"use strict";
const VERTEX = `#version 300 es
precision highp float;
in vec3 position, motion_real, motion_imaginary, margin, value_real, value_imaginary;
in float below;
uniform mat4 matrix;
uniform vec2 turn;
uniform float scale, offset, size;
uniform int measure;
out vec3 place;
out float value, pale;
void main() {
  place = position + scale * (turn.x * motion_real - turn.y * motion_imaginary + offset * margin);
  vec3 now = turn.x * value_real - turn.y * value_imaginary;
  value = measure == 0 ? length(now) : measure == 1 ? now.x : value_real.x;
  pale = below;
  gl_Position = matrix * vec4(place, 1.0);
  gl_PointSize = size;
}`;
const FRAGMENT = `#version 300 es
precision highp float;
in vec3 place;
in float value, pale;
uniform sampler2D colours;
uniform vec2 range;
uniform vec4 ink;
uniform vec3 light;
uniform float fading;
uniform int kind;
out vec4 shown;
void main() {
  vec2 from = gl_PointCoord - 0.5;
  if (kind == 3 && abs(abs(from.x) - abs(from.y)) > 0.12) discard;
  if (kind == 2 && length(from) > 0.5) discard;
  float share = clamp((value - range.x) / (range.y - range.x), 0.0, 1.0);
  float texels = float(textureSize(colours, 0).x);
  vec3 colour = texture(colours, vec2((share * (texels - 1.0) + 0.5) / texels, 0.5)).rgb;
  colour = mix(colour, vec3(0.93), 0.75 * fading * pale);
  vec3 normal = cross(dFdx(place), dFdy(place));
  float lit = abs(dot(normalize(normal + 1e-20), light));
  if (kind == 0) shown = vec4(colour * (0.78 + 0.22 * lit), 1.0);
  else if (kind == 2 && length(from) < 0.4) shown = vec4(colour, 1.0);
  else shown = ink;
}`;

// None where a browser has no WebGL2.
const makeViewer = (canvas, nodes) => {
  const ATTRIBUTES = { position: 3, motion_real: 3, motion_imaginary: 3, margin: 3, value_real: 3,
    value_imaginary: 3, below: 1 };
  const SURFACE = 0, PLAIN = 1, DISC = 2, CROSS = 3;
  const gl = canvas.getContext("webgl2", { antialias: true, premultipliedAlpha: true });
  if (!gl) return null;
  const kept = { attributes: {}, indices: {}, box: new Float32Array(0), map: null };
  let program, at, uniform, cloud, buffers, boxed, box, texture, told;

  const shader = (kind, source) => {
    const made = gl.createShader(kind);
    gl.shaderSource(made, source);
    gl.compileShader(made);
    gl.attachShader(program, made);
  };
  const build = () => {
    program = gl.createProgram();
    shader(gl.VERTEX_SHADER, VERTEX);
    shader(gl.FRAGMENT_SHADER, FRAGMENT);
    gl.transformFeedbackVaryings(program, ["place", "value"], gl.INTERLEAVED_ATTRIBS);
    gl.linkProgram(program);
    if (!gl.getProgramParameter(program, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(program));
    gl.useProgram(program);
    at = (name) => gl.getAttribLocation(program, name);
    uniform = Object.fromEntries(["matrix", "turn", "scale", "offset", "size", "measure", "range", "ink", "light",
      "fading", "kind"].map((name) => [name, gl.getUniformLocation(program, name)]));
    [cloud, boxed, box, texture, told] = [gl.createVertexArray(), gl.createVertexArray(), gl.createBuffer(),
      gl.createTexture(), gl.createBuffer()];
    buffers = {};
    gl.bindVertexArray(boxed);
    gl.bindBuffer(gl.ARRAY_BUFFER, box);
    gl.enableVertexAttribArray(at("position"));
    gl.vertexAttribPointer(at("position"), 3, gl.FLOAT, false, 0, 0);
    gl.bindBuffer(gl.TRANSFORM_FEEDBACK_BUFFER, told);
    gl.bufferData(gl.TRANSFORM_FEEDBACK_BUFFER, 16 * nodes, gl.STREAM_READ);
    gl.bindBuffer(gl.TRANSFORM_FEEDBACK_BUFFER, null);
    gl.bindTexture(gl.TEXTURE_2D, texture);
    for (const [key, value] of [[gl.TEXTURE_MIN_FILTER, gl.LINEAR], [gl.TEXTURE_MAG_FILTER, gl.LINEAR],
      [gl.TEXTURE_WRAP_S, gl.CLAMP_TO_EDGE], [gl.TEXTURE_WRAP_T, gl.CLAMP_TO_EDGE]]) {
      gl.texParameteri(gl.TEXTURE_2D, key, value);
    }
    gl.enable(gl.DEPTH_TEST);
    gl.blendFuncSeparate(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA, gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
    for (const [name, values] of Object.entries(kept.attributes)) own.put(name, values);
    for (const [name, values] of Object.entries(kept.indices)) own.join(name, values);
    if (kept.map) own.paint(kept.map);
    own.frame(kept.box);
  };

  const own = {};
  // Numbers of the nodes, and which of them are joined by what.
  own.put = (name, values) => {
    kept.attributes[name] = values;
    gl.bindVertexArray(cloud);
    buffers[name] = buffers[name] || gl.createBuffer();
    gl.bindBuffer(gl.ARRAY_BUFFER, buffers[name]);
    gl.bufferData(gl.ARRAY_BUFFER, values, gl.DYNAMIC_DRAW);
    if (at(name) < 0) return;
    gl.enableVertexAttribArray(at(name));
    gl.vertexAttribPointer(at(name), ATTRIBUTES[name], gl.FLOAT, false, 0, 0);
  };
  own.join = (name, values) => {
    kept.indices[name] = values;
    gl.bindVertexArray(cloud);
    buffers[name] = buffers[name] || gl.createBuffer();
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, buffers[name]);
    gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, values, gl.DYNAMIC_DRAW);
  };
  own.joined = (name) => kept.indices[name];
  own.frame = (lines) => {
    kept.box = lines;
    gl.bindBuffer(gl.ARRAY_BUFFER, box);
    gl.bufferData(gl.ARRAY_BUFFER, lines, gl.DYNAMIC_DRAW);
  };
  own.paint = (map) => {
    kept.map = map;
    gl.pixelStorei(gl.UNPACK_ALIGNMENT, 1);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGB8, map.length / 3, 1, 0, gl.RGB, gl.UNSIGNED_BYTE, map);
  };

  const state = (look) => {
    gl.uniform2f(uniform.turn, Math.cos(look.phase), Math.sin(look.phase));
    gl.uniform1f(uniform.scale, look.scale);
    gl.uniform1f(uniform.offset, look.offset || 0);
    gl.uniform1i(uniform.measure, look.measure);
  };
  const elements = (mode, name, kind, ink) => {
    if (!kept.indices[name].length) return;
    gl.uniform1i(uniform.kind, kind);
    gl.uniform4fv(uniform.ink, ink);
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, buffers[name]);
    gl.drawElements(mode, kept.indices[name].length, gl.UNSIGNED_INT, 0);
  };
  own.draw = (look, camera) => {
    const ratio = window.devicePixelRatio || 1;
    gl.viewport(0, 0, canvas.width, canvas.height);
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.uniformMatrix4fv(uniform.matrix, false, camera.matrix());
    gl.uniform3fv(uniform.light, camera.toward());
    gl.uniform2f(uniform.range, look.range[0], look.range[1]);
    gl.uniform1f(uniform.fading, look.fading ? 1 : 0);
    gl.uniform1f(uniform.size, 11 * ratio);
    state({ ...look, scale: 0 });
    gl.bindVertexArray(boxed);
    gl.uniform1i(uniform.kind, PLAIN);
    gl.uniform4fv(uniform.ink, [0.84, 0.84, 0.84, 1]);
    gl.drawArrays(gl.LINES, 0, kept.box.length / 3);
    gl.bindVertexArray(cloud);
    if (look.rest) elements(gl.LINES, "rest", PLAIN, [0.47, 0.47, 0.47, 1]);
    state(look);
    gl.enable(gl.POLYGON_OFFSET_FILL);
    gl.polygonOffset(1, 1);
    elements(gl.TRIANGLES, "triangles", SURFACE, [0, 0, 0, 1]);
    gl.disable(gl.POLYGON_OFFSET_FILL);
    elements(gl.LINES, "lines", PLAIN, [0.07, 0.07, 0.07, 1]);
    elements(gl.POINTS, "dots", DISC, [0.07, 0.07, 0.07, 1]);
    gl.disable(gl.DEPTH_TEST);
    elements(gl.POINTS, "marks", CROSS, [0, 0, 0, 1]);
    gl.uniform1f(uniform.size, 15 * ratio);
    elements(gl.POINTS, "picked", DISC, [0.82, 0.3, 0, 1]);
    gl.enable(gl.DEPTH_TEST);
    if (look.shell) {
      gl.enable(gl.BLEND);
      gl.depthMask(false);
      for (const offset of [look.shell, -look.shell]) {
        gl.uniform1f(uniform.offset, offset);
        elements(gl.TRIANGLES, "triangles", PLAIN, [0.27, 0.27, 0.27, 0.3]);
      }
      gl.depthMask(true);
      gl.disable(gl.BLEND);
    }
  };
  // Place and value of every node as they are drawn, four numbers each.
  own.drawn = (look) => {
    state(look);
    gl.bindVertexArray(cloud);
    gl.bindBufferBase(gl.TRANSFORM_FEEDBACK_BUFFER, 0, told);
    gl.enable(gl.RASTERIZER_DISCARD);
    gl.beginTransformFeedback(gl.POINTS);
    gl.drawArrays(gl.POINTS, 0, nodes);
    gl.endTransformFeedback();
    gl.disable(gl.RASTERIZER_DISCARD);
    const found = new Float32Array(4 * nodes);
    gl.getBufferSubData(gl.TRANSFORM_FEEDBACK_BUFFER, 0, found);
    gl.bindBufferBase(gl.TRANSFORM_FEEDBACK_BUFFER, 0, null);
    return found;
  };
  canvas.addEventListener("webglcontextlost", (event) => event.preventDefault());
  canvas.addEventListener("webglcontextrestored", build);
  build();
  return own;
};
