// A small graph: curves, bands and stems in a stretched picture, with numbers beside it as text.
"use strict";
const makeGraph = (host, across, up) => {
  const WIDE = 1000, TALL = 100, DECADES = 4;
  const picture = host.querySelector("svg"), numbers = host.querySelector(".ticks");
  const svg = (tag, given) => {
    const made = document.createElementNS("http://www.w3.org/2000/svg", tag);
    for (const [key, value] of Object.entries(given)) made.setAttribute(key, value);
    return made;
  };
  const tick = (kind, at, text) => {
    const span = document.createElement("span");
    span.className = kind;
    span.style.setProperty("--at", at);
    span.textContent = text;
    return span;
  };
  // Shapes are { kind: "curve", "band" or "stem", points, look }; a band has its points around it.
  const draw = ({ x, y, logarithmic, shapes }) => {
    const least = logarithmic ? Math.max(y[0], y[1] * 10 ** -DECADES) : y[0];
    const scaled = logarithmic ? (v) => Math.log10(Math.max(v, least)) : (v) => v;
    const [low, high] = [scaled(least), scaled(y[1])];
    const share = (v) => (scaled(v) - low) / (high - low || 1), place = (u) => (u - x[0]) / (x[1] - x[0] || 1);
    const put = ([u, v]) => `${(WIDE * place(u)).toFixed(2)},${(TALL * (1 - share(v))).toFixed(2)}`;
    const heights = logarithmic
      ? Array.from({ length: Math.floor(high) - Math.ceil(low - 1e-9) + 1 }, (_, k) => 10 ** (Math.ceil(low - 1e-9) + k))
      : steps(y[0], y[1], 4);
    const drawn = shapes.map(({ kind, points, look }) => kind === "stem"
      ? svg("path", { d: "M" + points.map(put).join("L"), class: look })
      : svg(kind === "band" ? "polygon" : "polyline", { points: points.map(put).join(" "), class: look }));
    const lines = heights.map((v) => svg("path", { d: `M0,${TALL * (1 - share(v))}H${WIDE}`, class: "grid" }));
    picture.replaceChildren(...lines, ...drawn);
    const wide = host.clientWidth || 600;
    numbers.replaceChildren(
      ...steps(x[0], x[1], Math.max(2, Math.floor(wide / 70))).map((u) => tick("x", place(u), written(u))),
      ...heights.map((v) => tick("y", share(v), written(Number(v.toPrecision(6))))),
      tick("x name", 0.5, across()), tick("y name", 0.5, up()));
  };
  // Where a place in the window lies across the graph.
  const across_at = (event, [from, to]) => {
    const box = picture.getBoundingClientRect();
    return from + (event.clientX - box.left) / box.width * (to - from);
  };
  return { draw, across_at };
};
