// The box around a shape: lines on its far sides, ticks and names along three of its edges.
"use strict";
// Round numbers between two, as many as `most` or fewer.
const steps = (from, to, most) => {
  const raw = (to - from) / Math.max(1, most), power = 10 ** Math.floor(Math.log10(raw));
  const step = power * [1, 2, 5, 10].find((s) => s * power >= raw * 0.999);
  const found = [];
  for (let n = Math.ceil(from / step); n * step <= to; n++) found.push(Number((n * step).toPrecision(6)));
  return found;
};
const written = (value) => String(value).replace("-", "−");

const makeAxes = (labels, low, high, unit) => {
  const PIXELS_A_TICK = 48, LEAST_PIXELS = 40;
  const middle = low.map((x, k) => (x + high[k]) / 2);

  // Place names anew, and those of other places, and give the lines' ends, six numbers a line.
  const arrange = (camera, others = []) => {
    const toward = camera.toward(), project = camera.projector();
    const far = toward.map((t, k) => (t > -1e-9 ? low : high)[k]), near = toward.map((t, k) => (t > -1e-9 ? high : low)[k]);
    const at = (k, value, rest) => { const p = [...rest]; p[k] = value; return p; };
    const upright = [[near[0], far[1], 0], [far[0], near[1], 0]];
    const left = ([x, y]) => project(x, y, middle[2])[0];
    const edges = [[0, near[1], far[2]], [near[0], 0, far[2]], left(upright[0]) < left(upright[1]) ? upright[0] : upright[1]];
    const centre = project(...middle), spans = [], texts = [];
    edges.forEach((edge, k) => {
      const [from, to] = [low[k], high[k]].map((x) => project(...at(k, x, edge)));
      const along = [to[0] - from[0], to[1] - from[1]], length = Math.hypot(...along);
      spans.push(length < 1 ? [] : steps(low[k], high[k], Math.min(6, Math.max(1, Math.floor(length / PIXELS_A_TICK)))));
      if (length < LEAST_PIXELS) return;
      let out = [-along[1] / length, along[0] / length];
      const mid = [(from[0] + to[0]) / 2, (from[1] + to[1]) / 2];
      if (out[0] * (mid[0] - centre[0]) + out[1] * (mid[1] - centre[1]) < 0) out = out.map((x) => -x);
      const inside = (x) => Math.max(24, Math.min(camera.width - 24, x));
      const put = (text, [x, y], gap, kind) =>
        texts.push({ text, kind, x: inside(x + gap[0] * out[0]), y: y + gap[1] * out[1] });
      for (const tick of spans[k]) put(written(tick), project(...at(k, tick, edge)), [20, 13], "tick");
      const beyond = mid[0] + 62 * out[0], tip = from[1] < to[1] ? from : to;
      // where there is no room beside the ticks of the upright edge, its name stands above it
      if (k === 2 && inside(beyond) !== beyond) put("z, " + unit, tip, [0, 0], "name above");
      else put("xyz"[k] + ", " + unit, mid, [62, 34], "name");
    });
    for (const { text, place } of others) {
      const [x, y] = project(...place);
      texts.push({ text, kind: "stand", x, y });
    }
    const lines = [];
    for (let k = 0; k < 3; k++) {
      const across = [0, 1, 2].filter((j) => j !== k);
      across.forEach((j, n) => {
        const other = across[1 - n];
        for (const value of [low[j], ...spans[j], high[j]]) {
          const foot = at(j, value, at(k, far[k], far));
          lines.push(...at(other, low[other], foot), ...at(other, high[other], foot));
        }
      });
    }
    labels.replaceChildren(...texts.map(({ text, kind, x, y }) => {
      const span = document.createElement("span");
      span.className = kind;
      span.textContent = text;
      span.style.left = x.toFixed(1) + "px";
      span.style.top = y.toFixed(1) + "px";
      return span;
    }));
    return new Float32Array(lines);
  };
  return { arrange };
};
