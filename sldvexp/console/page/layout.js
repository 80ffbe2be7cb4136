// Which mark is which: a drawing of the calibration object, each circle with its number beside it.

const WIDE = 200, TALL = 110, ASIDE = 13;

/** Make a part of a drawing. */
function drawn(kind, attributes, ...content) {
  const made = document.createElementNS("http://www.w3.org/2000/svg", kind);
  for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, value);
  made.append(...content);
  return made;
}

/** Draw marks into a box: {kind, number, at, rim}, x to the right and y up; a rim may be empty. */
export function drawLayout(svg, marks, chosen) {
  const points = marks.flatMap(({ at, rim }) => [at, ...rim]);
  const ends = [0, 1].map((k) => [Math.min, Math.max].map((limit) => limit(...points.map((p) => p[k]))));
  const scale = Math.min((WIDE - 2 * ASIDE) / (ends[0][1] - ends[0][0] || 1e-9), (TALL - 2 * ASIDE) / (ends[1][1] - ends[1][0] || 1e-9));
  const middle = ends.map(([low, high]) => (low + high) / 2);
  const flat = ([x, y]) => [WIDE / 2 + (x - middle[0]) * scale, TALL / 2 - (y - middle[1]) * scale];
  const shapes = marks.map(({ kind, number, at, rim }) => {
    const place = flat(at), edge = rim.map(flat);
    const box = boxOf(edge.length > 2 ? edge : [[place[0] - 3, place[1] - 3], [place[0] + 3, place[1] + 3]]);
    return { kind, number, place, edge, box };
  });
  const labels = [];
  for (const shape of shapes) labels.push(labelBeside(shape, shapes.map(({ box }) => box), labels));
  svg.setAttribute("viewBox", `0 0 ${WIDE} ${TALL}`);
  svg.replaceChildren(...shapes.map(({ kind, number, place, edge }, i) => {
    const [left, , , bottom] = labels[i];
    const shape = edge.length > 2 ? drawn("polygon", { points: edge.map((p) => p.map((v) => v.toFixed(1)).join()).join(" ") }) : drawn("circle", { cx: place[0], cy: place[1], r: 3 });
    const group = drawn("g", {}, shape, drawn("text", { x: left + wide(number) / 2, y: bottom - 1 }, String(number)));
    if (kind === chosen?.kind && number === chosen?.number) group.setAttribute("class", "chosen");
    return group;
  }));
}

function boxOf(points) {
  return [0, 1].map((k) => Math.min(...points.map((p) => p[k]))).concat([0, 1].map((k) => Math.max(...points.map((p) => p[k]))));
}

function wide(number) { return 6 * String(number).length; }

/** Find a box for a number beside its shape, where it covers least of shapes and other numbers. */
function labelBeside({ number, box: [a, b, c, d] }, boxes, labels) {
  const w = wide(number), h = 8, middle = [(a + c - w) / 2, (b + d - h) / 2];
  const covered = ([e, f, g, i], [k, l, m, n]) => Math.max(0, Math.min(g, m) - Math.max(e, k)) * Math.max(0, Math.min(i, n) - Math.max(f, l));
  let best = null;
  for (const gap of [2, 6, 11]) {
    for (const [left, top] of [[c + gap, middle[1]], [a - gap - w, middle[1]], [middle[0], b - gap - h], [middle[0], d + gap], [c + gap, b - gap - h], [a - gap - w, b - gap - h], [c + gap, d + gap], [a - gap - w, d + gap]]) {
      const own = [left, top, left + w, top + h], out = w * h - covered(own, [0, 0, WIDE, TALL]);
      const cost = [...boxes, ...labels].reduce((sum, other) => sum + covered(own, other), 2 * out) + gap / 10;
      if (!best || cost < best.cost) best = { cost, own };
    }
  }
  return best.own;
}
