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
uniform float fading, paper;
uniform int kind;
out vec4 shown;
void main() {
  vec2 from = gl_PointCoord - 0.5;
  if (kind == 3 && abs(abs(from.x) - abs(from.y)) > 0.12) discard;
  if (kind == 2 && length(from) > 0.5) discard;
  float share = clamp((value - range.x) / (range.y - range.x), 0.0, 1.0);
  float texels = float(textureSize(colours, 0).x);
  vec3 colour = texture(colours, vec2((share * (texels - 1.0) + 0.5) / texels, 0.5)).rgb;
  colour = mix(colour, vec3(paper), fading * pale);
  vec3 normal = cross(dFdx(place), dFdy(place));
  float lit = abs(dot(normalize(normal + 1e-20), light));
  if (kind == 0) shown = vec4(colour * (0.78 + 0.22 * lit), 1.0);
  else if (kind == 2 && length(from) < 0.4) shown = vec4(colour, 1.0);
  else shown = ink;
}`;

// Paths and arrows of nodes, an instance a node: what moves is one number, the phase.
const PATHS = 0, ARROWS = 1;
const GLYPH = `#version 300 es
precision highp float;
in vec3 position, motion_real, motion_imaginary;
uniform mat4 matrix;
uniform vec2 turn, pixels;
uniform float scale, head;
uniform int kind, steps;
void main() {
  float angle = 6.283185307 * float(gl_VertexID) / float(steps);
  vec2 own = kind == 0 ? vec2(cos(angle), sin(angle)) : turn;
  vec4 from = matrix * vec4(position, 1.0);
  vec4 to = matrix * vec4(position + scale * (own.x * motion_real - own.y * motion_imaginary), 1.0);
  gl_Position = kind == 1 && gl_VertexID == 0 ? from : to;
  if (kind == 1 && (gl_VertexID == 3 || gl_VertexID == 5)) {
    vec2 along = (to.xy / to.w - from.xy / from.w) * pixels, unit = along / max(length(along), 1e-6);
    vec2 back = -unit + (gl_VertexID == 3 ? 0.45 : -0.45) * vec2(-unit.y, unit.x);
    gl_Position.xy += back * min(head, 0.5 * length(along)) / pixels * to.w;
  }
}`;
const INK = `#version 300 es
precision highp float;
uniform vec4 ink;
out vec4 shown;
void main() { shown = ink; }`;

// None where a browser has no WebGL2.
const makeViewer = (canvas, nodes, { pale, paleness }) => {
  const ATTRIBUTES = { position: 3, motion_real: 3, motion_imaginary: 3, margin: 3, value_real: 3,
    value_imaginary: 3, below: 1 };
  const SURFACE = 0, PLAIN = 1, DISC = 2, CROSS = 3;
  const gl = canvas.getContext("webgl2", { antialias: true, premultipliedAlpha: true });
  if (!gl) return null;
  const kept = { attributes: {}, indices: {}, own: {}, map: null };
  const STEPS = 48, ARROW = 6;  // corners of a path and of an arrow
  let program, glyphs, at, uniform, of_glyph, cloud, buffers, sets, texture, told;

  const link = (vertex, fragment, fed = []) => {
    const made = gl.createProgram();
    for (const [kind, source] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
      const part = gl.createShader(kind);
      gl.shaderSource(part, source);
      gl.compileShader(part);
      gl.attachShader(made, part);
    }
    // Of both programs these numbers stand at the same places.
    ["position", "motion_real", "motion_imaginary"].forEach((name, k) => gl.bindAttribLocation(made, k, name));
    if (fed.length) gl.transformFeedbackVaryings(made, fed, gl.INTERLEAVED_ATTRIBS);
    gl.linkProgram(made);
    if (!gl.getProgramParameter(made, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(made));
    return made;
  };
  const uniforms = (of, names) => Object.fromEntries(names.map((name) => [name, gl.getUniformLocation(of, name)]));
  const build = () => {
    program = link(VERTEX, FRAGMENT, ["place", "value"]);
    glyphs = link(GLYPH, INK);
    gl.useProgram(program);
    at = (name) => gl.getAttribLocation(program, name);
    uniform = uniforms(program, ["matrix", "turn", "scale", "offset", "size", "measure", "range", "ink", "light",
      "fading", "paper", "kind"]);
    of_glyph = uniforms(glyphs, ["matrix", "turn", "pixels", "scale", "head", "kind", "steps", "ink"]);
    [cloud, texture, told] = [gl.createVertexArray(), gl.createTexture(), gl.createBuffer()];
    [buffers, sets] = [{}, {}];
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
    for (const [name, [parts, each]] of Object.entries(kept.own)) own.set(name, parts, each);
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
  // Points of their own, such as the box, with their motion if they have one.
  own.set = (name, parts, each = 0) => {
    kept.own[name] = [parts, each];
    sets[name] = sets[name] || { array: gl.createVertexArray(), buffers: parts.map(() => gl.createBuffer()) };
    sets[name].count = parts[0].length / 3;
    gl.bindVertexArray(sets[name].array);
    parts.forEach((values, k) => {
      gl.bindBuffer(gl.ARRAY_BUFFER, sets[name].buffers[k]);
      gl.bufferData(gl.ARRAY_BUFFER, values, gl.DYNAMIC_DRAW);
      gl.enableVertexAttribArray(k);
      gl.vertexAttribPointer(k, 3, gl.FLOAT, false, 0, 0);
      gl.vertexAttribDivisor(k, each);
    });
  };
  own.count = (name) => sets[name] ? sets[name].count : 0;
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
  const points = (mode, name, ink) => {
    if (!own.count(name)) return;
    gl.bindVertexArray(sets[name].array);
    gl.uniform1i(uniform.kind, PLAIN);
    gl.uniform4fv(uniform.ink, ink);
    gl.drawArrays(mode, 0, sets[name].count);
  };
  const instances = (look, matrix, ratio) => {
    if (!own.count("glyphs")) return;
    gl.useProgram(glyphs);
    gl.uniformMatrix4fv(of_glyph.matrix, false, matrix);
    gl.uniform2f(of_glyph.turn, Math.cos(look.phase), Math.sin(look.phase));
    gl.uniform2f(of_glyph.pixels, canvas.width / 2, canvas.height / 2);
    gl.uniform1f(of_glyph.scale, look.scale);
    gl.uniform1f(of_glyph.head, 9 * ratio);
    gl.uniform1i(of_glyph.kind, look.glyph);
    gl.uniform1i(of_glyph.steps, STEPS);
    gl.uniform4fv(of_glyph.ink, [0.78, 0.16, 0.08, 1]);
    gl.bindVertexArray(sets.glyphs.array);
    if (look.glyph === PATHS) gl.drawArraysInstanced(gl.LINE_LOOP, 0, STEPS, sets.glyphs.count);
    else gl.drawArraysInstanced(gl.LINES, 0, ARROW, sets.glyphs.count);
    gl.useProgram(program);
  };
  own.draw = (look, camera) => {
    const ratio = window.devicePixelRatio || 1, matrix = camera.matrix(), grey = (x) => [x, x, x, 1];
    gl.viewport(0, 0, canvas.width, canvas.height);
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.uniformMatrix4fv(uniform.matrix, false, matrix);
    gl.uniform3fv(uniform.light, camera.toward());
    gl.uniform2f(uniform.range, look.range[0], look.range[1]);
    gl.uniform1f(uniform.fading, look.fading ? paleness : 0);
    gl.uniform1f(uniform.paper, look.dark ? 0.25 : pale);
    gl.uniform1f(uniform.size, 11 * ratio);
    state({ ...look, scale: 0 });
    points(gl.LINES, "box", grey(look.dark ? 0.3 : 0.84));
    if (look.stands) points(gl.LINES, "beams", look.dark ? [0.45, 0.7, 0.95, 1] : [0.1, 0.4, 0.7, 1]);
    gl.bindVertexArray(cloud);
    if (look.rest) elements(gl.LINES, "rest", PLAIN, grey(look.dark ? 0.6 : 0.47));
    state(look);
    gl.enable(gl.POLYGON_OFFSET_FILL);
    gl.polygonOffset(1, 1);
    elements(gl.TRIANGLES, "triangles", SURFACE, [0, 0, 0, 1]);
    gl.disable(gl.POLYGON_OFFSET_FILL);
    elements(gl.LINES, "lines", PLAIN, grey(look.dark && !kept.indices.triangles.length ? 0.8 : 0.07));
    elements(gl.POINTS, "dots", DISC, [0.07, 0.07, 0.07, 1]);
    gl.disable(gl.DEPTH_TEST);
    elements(gl.POINTS, "marks", CROSS, [0, 0, 0, 1]);
    gl.uniform1f(uniform.size, 15 * ratio);
    elements(gl.POINTS, "picked", DISC, [0.82, 0.3, 0, 1]);
    gl.uniform1f(uniform.size, 4 * ratio);
    points(gl.LINE_STRIP, "cut", [0.82, 0.1, 0.4, 1]);
    points(gl.POINTS, "cut", [0.82, 0.1, 0.4, 1]);
    instances(look, matrix, ratio);
    gl.enable(gl.DEPTH_TEST);
    if (look.shell) {
      gl.bindVertexArray(cloud);
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
