// Draws a complex velocity field as a surface that moves: p + scale Re(V exp(i phase)).
"use strict";
(() => {
  const data = JSON.parse(document.getElementById("shape-data").textContent);
  const plot = document.getElementById("shape-plot");
  const control = (name) => document.getElementById("shape-" + name);

  const bytes = (text) => Uint8Array.from(atob(text), (c) => c.charCodeAt(0)).buffer;
  const position = new Float32Array(bytes(data.position));
  const triangles = new Int32Array(bytes(data.triangles));
  const directions = new Float32Array(bytes(data.directions));
  const normal = new Float32Array(bytes(data.normal));
  const real = new Float32Array(bytes(data.real));
  const imaginary = new Float32Array(bytes(data.imaginary));
  const bound = new Float32Array(bytes(data.bound));
  const colourings = (data.colourings || []).map((own) => ({ ...own,
    real: new Float32Array(bytes(own.real)), imaginary: own.imaginary && new Float32Array(bytes(own.imaginary)) }));
  const joined = new Int32Array(bytes(data.lines || ""));
  const nodes = position.length / 3;
  const components = data.components.length;

  const SECONDS_A_TURN = 2.5;       // of the drawn motion
  const MILLISECONDS_A_FRAME = 40;
  const DRAWN_SHARE = 0.08;         // largest deflection, as a share of the surface's diagonal
  const MOST_LINES = 3000;
  const LIFTED = 0.0015;            // lines above and below the surface, as a share of its diagonal
  const SURFACE = 0, LINES = 1, SHELLS = [2, 3], UNDETERMINED = 4, REST = 5, DOTS = 6;

  const state = { component: -1, frequency: data.strongest, colour: "now", shell: 0, size: 1, phase: 0 };
  let playing = false, visible = true;

  // The field at one node ------------------------------------------------------------------------
  const index = (c, n) => (state.frequency * components + c) * nodes + n;
  const shown = () => state.component < 0 ? [...data.components.keys()] : [state.component];
  const at = (c, n) => {
    const i = index(c, n);
    return real[i] * Math.cos(state.phase) - imaginary[i] * Math.sin(state.phase);
  };
  const amplitude = (c, n) => Math.hypot(real[index(c, n)], imaginary[index(c, n)]);
  const together = (f, n) => Math.hypot(...shown().map((c) => f(c, n)));
  const largest = (f) => {
    let found = 0;
    for (let n = 0; n < nodes; n++) { const v = f(n); if (v > found) found = v; }
    return found;
  };
  const strongest = () => shown().reduce((best, c) =>
    largest((n) => amplitude(c, n)) > largest((n) => amplitude(best, n)) ? c : best);

  // The surface's lines: its rim, and within it all edges but the diagonals of its cells ----------
  const [rim, inner] = (() => {
    const length = (a, b) => Math.hypot(...[0, 1, 2].map((k) => position[3 * a + k] - position[3 * b + k]));
    const found = new Map();
    for (let t = 0; t < triangles.length; t += 3) {
      const corner = [triangles[t], triangles[t + 1], triangles[t + 2]];
      const sides = [[0, 1], [1, 2], [2, 0]].map(([a, b]) => [corner[a], corner[b]]);
      const lengths = sides.map(([a, b]) => length(a, b));
      const sorted = [...lengths].sort((a, b) => b - a);
      sides.forEach(([a, b], k) => {
        const key = Math.min(a, b) * nodes + Math.max(a, b);
        const side = found.get(key) || { pair: [a, b], faces: 0, diagonal: true };
        side.faces += 1;
        side.diagonal = side.diagonal && lengths[k] === sorted[0] && sorted[0] > 1.01 * sorted[1];
        found.set(key, side);
      });
    }
    const all = [...found.values()];
    const those = (keep) => all.filter(keep).map((side) => side.pair);
    return [those((s) => s.faces === 1), those((s) => s.faces > 1 && !s.diagonal)];
  })();
  const pairs = Array.from({ length: joined.length / 2 }, (_, p) => [joined[2 * p], joined[2 * p + 1]]);
  const lines = [...rim, ...(rim.length + inner.length <= MOST_LINES ? inner : []), ...pairs];
  const dotted = Boolean(data.names);  // points are seen, whatever joins them

  const polyline = (pairs, places, lifts) => {
    const found = [[], [], []];
    for (const lift of lifts) {
      for (const [a, b] of pairs) {
        for (let k = 0; k < 3; k++) {
          found[k].push(places[k][a] + lift * normal[3 * a + k], places[k][b] + lift * normal[3 * b + k], null);
        }
      }
    }
    return found;
  };
  const still = [0, 1, 2].map((k) => Array.from({ length: nodes }, (_, n) => position[3 * n + k]));
  const extent = still.map((along) => [Math.min(...along), Math.max(...along)]);
  const diagonal = Math.hypot(...extent.map(([low, high]) => high - low));

  // Where the surface is drawn -------------------------------------------------------------------
  const scale = () => {
    const most = largest((n) => together(amplitude, n));
    return most > 0 ? state.size * DRAWN_SHARE * diagonal / most : 0;
  };
  // All components move the surface as it does; one alone is drawn as a height along the normal.
  const deflected = (factor, offset) => [0, 1, 2].map((k) => {
    const along = new Array(nodes);
    const one = state.component, stronger = strongest();
    const direction = (c, n) => one < 0 ? directions[(c * nodes + n) * 3 + k] : normal[3 * n + k];
    for (let n = 0; n < nodes; n++) {
      let sum = offset * (bound[index(stronger, n)] || 0) * direction(stronger, n);
      for (const c of shown()) sum += (at(c, n) || 0) * direction(c, n);
      along[n] = position[3 * n + k] + factor * sum;
    }
    return along;
  });
  const undetermined = () => {
    const found = [];
    for (let n = 0; n < nodes; n++) if (shown().some((c) => Number.isNaN(at(c, n)))) found.push(n);
    return found;
  };

  // What its colours say -------------------------------------------------------------------------
  const name = () => state.component < 0 ? "|V|" : "V<sub>" + data.components[state.component] + "</sub>";
  const of_strain = (own) => {
    const first = state.frequency * nodes, [c, s] = [Math.cos(state.phase), Math.sin(state.phase)];
    const each = (f) => Array.from({ length: nodes }, (_, n) => f(first + n));
    const now = own.imaginary ? (i) => own.real[i] * c - own.imaginary[i] * s : (i) => own.real[i];
    const most = Math.max(...each((i) => Math.hypot(own.real[i], own.imaginary ? own.imaginary[i] : 0)));
    return { intensity: each(now), cmin: own.imaginary ? -most : 0, cmax: most || 1,
      title: own.title + ",<br>" + own.unit, unit: own.unit };
  };
  const colours = () => {
    const one = state.component;
    if (state.colour.startsWith("strain")) return of_strain(colourings[Number(state.colour.slice(6))]);
    const value = {
      now: (n) => one < 0 ? together(at, n) : at(one, n),
      amplitude: (n) => together(amplitude, n),
      bound: (n) => together((c, m) => bound[index(c, m)], n),
    }[state.colour];
    const most = state.colour === "bound" ? largest(value) : largest((n) => together(amplitude, n));
    const title = { now: name() + " now", amplitude: one < 0 ? "amplitude" : "amplitude of " + name(), bound: "± bound" };
    return {
      intensity: Array.from({ length: nodes }, (_, n) => value(n) || 0),
      cmin: state.colour === "now" && one >= 0 ? -most : 0,
      cmax: most || 1,
      title: title[state.colour] + ",<br>" + data.velocity_unit,
      unit: data.velocity_unit,
    };
  };

  const hover = (unit) =>
    "%{x:.3g}, %{y:.3g}, %{z:.3g} " + data.length_unit + "<br>%{intensity:.3g} " + unit + "<extra></extra>";
  const draw = () => {
    const factor = scale(), places = deflected(factor, 0), colour = colours();
    const paths = polyline(lines, places, [LIFTED * diagonal, -LIFTED * diagonal]);
    const shells = SHELLS.map((_, k) => state.shell ? deflected(factor, (k ? -1 : 1) * state.shell) : still);
    const unknown = undetermined();
    const marks = places.map((along) => unknown.map((n) => along[n]));
    const [untouched, seen] = [new Array(DOTS - 1).fill(undefined), dotted ? places : [[], [], []]];
    Plotly.update(plot, {
      x: [places[0], paths[0], shells[0][0], shells[1][0], marks[0], seen[0]],
      y: [places[1], paths[1], shells[0][1], shells[1][1], marks[1], seen[1]],
      z: [places[2], paths[2], shells[0][2], shells[1][2], marks[2], seen[2]],
      visible: [true, true, state.shell > 0, state.shell > 0, unknown.length > 0, dotted],
      "marker.color": [...untouched, colour.intensity],
      "marker.cmin": [...untouched, colour.cmin],
      "marker.cmax": [...untouched, colour.cmax],
      "marker.colorbar.title.text": [...untouched, colour.title],
      intensity: [colour.intensity, null, null, null, null],
      cmin: [colour.cmin, null, null, null, null],
      cmax: [colour.cmax, null, null, null, null],
      "colorbar.title.text": [colour.title, null, null, null, null],
      hovertemplate: [hover(colour.unit), ...new Array(DOTS - 1).fill(undefined)],
    }, {}, [SURFACE, LINES, ...SHELLS, UNDETERMINED, DOTS]);
    tell();
  };

  const three = (value) => Number(value.toPrecision(3)).toString();
  const tell = () => {
    const most = largest((n) => together(amplitude, n));
    const degrees = Math.round(state.phase * 180 / Math.PI) % 360;
    control("phase").value = degrees;
    control("degrees").textContent = degrees + "°";
    const strong = strongest(), unit = data.velocity_unit;
    let squares = 0, count = 0;
    for (let n = 0; n < nodes; n++) {
      const b = bound[index(strong, n)];
      if (Number.isFinite(b)) { squares += b * b; count += 1; }
    }
    const rms = Math.sqrt(squares / Math.max(1, count));
    control("told").textContent =
      "Largest " + (state.component < 0 ? "|V|" : "V_" + data.components[state.component]) + " " + three(most) + " " + unit +
      "; " + data.level + " bound of V_" + data.components[strong] + " ± " + three(rms) + " " + unit + " (r.m.s.)" +
      (state.component < 0 ? "; drawn: 1 " : "; drawn along the normal: 1 ") + unit + " as " + three(scale()) + " " + data.length_unit + ".";
  };

  // Axes do not move while the surface does ------------------------------------------------------
  const margin = 1.5 * DRAWN_SHARE * diagonal;
  const axis = (k) => ({
    title: { text: "xyz"[k] + ", " + data.length_unit, font: { size: 13 } },
    range: [extent[k][0] - margin, extent[k][1] + margin], autorange: false,
    backgroundcolor: "#fff", gridcolor: "#d9d9d9", zeroline: false, showspikes: false, nticks: 5,
    tickfont: { size: 11 },
  });
  const spans = extent.map(([low, high]) => high - low + 2 * margin);
  const widest = Math.max(...spans);
  const narrow = () => plot.clientWidth < 560;
  const eye = () => {
    const away = narrow() ? 1.4 : 0.92;
    return { x: -0.95 * away, y: -1.75 * away, z: 1.15 * away };
  };
  const layout = {
    autosize: true, margin: { l: 0, r: 0, t: 6, b: 6 }, showlegend: false, uirevision: "kept",
    font: { family: getComputedStyle(document.body).fontFamily, color: "#1b1b1b" },
    paper_bgcolor: "#fff",
    scene: {
      xaxis: axis(0), yaxis: axis(1), zaxis: axis(2), aspectmode: "manual",
      aspectratio: { x: 1.5 * spans[0] / widest, y: 1.5 * spans[1] / widest, z: 1.5 * spans[2] / widest },
      camera: { eye: eye(), center: narrow() ? { x: -0.13, y: 0.07, z: -0.05 } : { x: 0, y: 0, z: -0.2 } },
    },
  };
  const bar = () => narrow()
    ? { orientation: "h", y: -0.02, yanchor: "top", len: 0.9, thickness: 12, title: { side: "top", font: { size: 12 } } }
    : { len: 0.75, thickness: 16, x: 1, title: { side: "top", font: { size: 13 } } };
  const faces = [0, 1, 2].map((k) => Array.from({ length: triangles.length / 3 }, (_, t) => triangles[3 * t + k]));
  const mesh = { type: "mesh3d", x: still[0], y: still[1], z: still[2], i: faces[0], j: faces[1], k: faces[2] };
  const light = { ambient: 0.85, diffuse: 0.35, specular: 0.05, fresnel: 0.05, roughness: 0.9 };
  const shell = { ...mesh, color: "#444", opacity: 0.3, hoverinfo: "skip", visible: false };
  const resting = polyline([...rim, ...pairs], still, [0]);
  const told = data.names || [];
  const traces = [
    { ...mesh, intensity: new Array(nodes).fill(0), colorscale: "Cividis", lighting: light, colorbar: bar(),
      hovertemplate: hover(data.velocity_unit) },
    { type: "scatter3d", mode: "lines", x: [], y: [], z: [], line: { color: "#111", width: 1 }, hoverinfo: "skip" },
    shell, { ...shell },
    { type: "scatter3d", mode: "markers", x: [], y: [], z: [], marker: { size: 4, color: "#000", symbol: "x" },
      hovertemplate: "not determined by these views<extra></extra>", visible: false },
    { type: "scatter3d", mode: "lines", x: resting[0], y: resting[1], z: resting[2],
      line: { color: "#777", width: 2 }, hoverinfo: "skip" },
    { type: "scatter3d", mode: "markers", x: [], y: [], z: [], text: told, visible: dotted,
      marker: { size: 5, color: [], colorscale: "Cividis", line: { color: "#111", width: 1 },
        showscale: dotted && !triangles.length, colorbar: bar() },
      hovertemplate: "point %{text}<br>%{marker.color:.3g} " + data.velocity_unit + "<extra></extra>" },
  ];

  // Controls -------------------------------------------------------------------------------------
  const options = (select, entries) => {
    for (const [value, text] of entries) select.add(new Option(text, value));
    select.parentElement.hidden = entries.length < 2;
  };
  const play = (wanted) => {
    playing = wanted;
    control("play").textContent = playing ? "❚❚ Pause" : "▶ Play";
    control("play").setAttribute("aria-pressed", String(playing));
  };
  const many = components > 1 ? [[-1, "all, as it moves"]] : [];
  options(control("component"), [...many, ...data.components.map((c, k) => [k, "V_" + c])]);
  if (!many.length) state.component = 0;
  options(control("frequency"), data.frequencies.map((f, k) => [k, f === null ? "" : f + " Hz"]));
  control("frequency").value = state.frequency;
  colourings.forEach((own, k) => control("colour").add(new Option(own.text, "strain" + k)));
  for (const key of ["component", "frequency", "shell", "size"]) {
    control(key).addEventListener("input", (event) => { state[key] = Number(event.target.value); draw(); });
  }
  control("colour").addEventListener("input", (event) => { state.colour = event.target.value; draw(); });
  control("phase").addEventListener("input", (event) => {
    play(false);
    state.phase = event.target.value * Math.PI / 180;
    draw();
  });
  control("play").addEventListener("click", () => play(!playing));
  new IntersectionObserver((seen) => { visible = seen[seen.length - 1].isIntersecting; }).observe(plot);

  let last = 0;
  const frame = (now) => {
    if (playing && visible && now - last >= MILLISECONDS_A_FRAME) {
      const passed = Math.min(now - last, 4 * MILLISECONDS_A_FRAME) / 1000;
      state.phase = (state.phase + 2 * Math.PI * passed / SECONDS_A_TURN) % (2 * Math.PI);
      last = now;
      draw();
    }
    requestAnimationFrame(frame);
  };

  const buttons = { responsive: true, displaylogo: false, displayModeBar: true,
    modeBarButtons: [["toImage", "zoom3d", "pan3d", "orbitRotation", "resetCameraDefault3d"]],
    toImageButtonOptions: { scale: 2 } };
  Plotly.newPlot(plot, traces, layout, buttons).then(() => {
    draw();
    plot.dataset.ready = "yes";
    play(!matchMedia("(prefers-reduced-motion: reduce)").matches);
    requestAnimationFrame(frame);
  });
})();
