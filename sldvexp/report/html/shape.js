// Shows a complex velocity field as a surface that moves, and what its colours say.
"use strict";
const showShape = async (root) => {
  const control = (name) => document.getElementById(root.dataset.name + "-" + name);
  const data = JSON.parse(control("data").textContent);
  const [plot, stage, canvas] = [control("plot"), control("stage"), control("canvas")];
  const normal = floats(data.normal), directions = floats(data.directions);
  const nodes = floats(data.position).length / 3;
  const components = data.components.length;
  const [triangles, joined] = [integers(data.triangles), integers(data.lines)];
  const maps = Object.fromEntries(Object.entries(data.maps).map(([name, text]) => [name, bytes(text)]));
  const everywhere = directions.length === 3 * components;  // the same directions at every node

  const { seconds: SECONDS_A_TURN, share: DRAWN_SHARE } = data.look;
  const MOST_LINES = 3000;
  const MOST_GLYPHS = 400;          // paths or arrows, beyond which none can be told from others
  const NEAR = 18;                  // pixels between a node and the pointer that means it

  const viewer = typeof DecompressionStream === "undefined" ? null : makeViewer(canvas, nodes, data.look);
  if (!viewer) {
    document.documentElement.classList.add("no-webgl");
    return null;
  }
  const { layers, colourings } = await readNumbers(data, nodes);
  let { position, real, imaginary, bound } = layers[0];
  const state = { component: -1, frequency: data.strongest, colour: "now", shell: 0, size: 1, phase: 0, speed: 1,
    fade: true, node: 0, layer: 0, glyph: -1, common: true, logarithmic: false, from: 0, to: 0 };
  let playing = false, visible = true, stale = true, cutting = false;
  const own = {};  // for tests, and for a shape beside this one

  // The field at one node ------------------------------------------------------------------------
  const index = (c, n, f = state.frequency) => (f * components + c) * nodes + n;
  const shown = () => state.component < 0 ? [...data.components.keys()] : [state.component];
  const amplitude = (c, n, f) => { const i = index(c, n, f); return Math.hypot(real[i], imaginary[i]); };
  const bounds = (c, n, f) => bound[index(c, n, f)];
  const together = (part, n, f) => Math.hypot(...shown().map((c) => part(c, n, f)));
  const largest = (f) => {
    let found = 0;
    for (let n = 0; n < nodes; n++) { const v = f(n); if (v > found) found = v; }
    return found;
  };
  const greatest = (c) => largest((n) => amplitude(c, n));
  const strongest = () => shown().reduce((best, c) => greatest(c) > greatest(best) ? c : best);
  // What all components are measured by, or each by itself.
  const measure = () => state.component >= 0 && state.common
    ? Math.max(...data.components.map((_, c) => greatest(c))) : largest((n) => together(amplitude, n));

  const mesh = makeMesh(position, triangles), { rim, inner } = mesh;
  const low = [Infinity, Infinity, Infinity], high = low.map((x) => -x);
  position.forEach((x, i) => { low[i % 3] = Math.min(low[i % 3], x); high[i % 3] = Math.max(high[i % 3], x); });
  const diagonal = Math.hypot(...low.map((x, k) => high[k] - x)) || 1;
  const scale = () => {
    const most = measure();
    return most > 0 ? DRAWN_SHARE * diagonal / most : 0;
  };

  // What is drawn: chosen rarely, told to the graphics processor once ------------------------------
  const look = { phase: 0, scale: 0, range: [0, 1], measure: 0, fading: true, shell: 0, rest: true, stands: false,
    glyph: 0, dark: false };
  const direction = (c, n, k) => directions[(everywhere ? c : c * nodes + n) * 3 + k];
  // The way between two nodes over the surface: where it moves, and the chosen values along it.
  const profile = [];
  const cut = (motion) => {
    const [a, b] = [state.from - 1, state.to - 1], there = a >= 0 && b >= 0 && a !== b;
    const upward = [0, 1, 2].map((k) => normal[(3 * a + k) % normal.length] + normal[(3 * b + k) % normal.length]);
    const path = there ? mesh.cut(a, b, upward) : [];
    const between = (values, { a: p, b: q, share }, k) => values[3 * p + k] + share * (values[3 * q + k] - values[3 * p + k]);
    viewer.set("cut", [position, ...motion].map((values) =>
      Float32Array.from(path.flatMap((point) => [0, 1, 2].map((k) => between(values, point, k))))));
    const part = (values, c, { a: p, b: q, share }) =>
      values[index(c, p)] + share * (values[index(c, q)] - values[index(c, p)]);
    const one = state.component, signed = one >= 0 && { real, imaginary }[state.colour];
    profile.splice(0, profile.length, ...path.map((point) => ({
      distance: point.distance,
      value: signed ? part(signed, one, point)
        : Math.hypot(...shown().map((c) => Math.hypot(part(real, c, point), part(imaginary, c, point)))),
      bound: Math.hypot(...shown().map((c) => part(bound, c, point))),
    })).filter(({ value }) => !Number.isNaN(value)));
    profile.title = (signed ? state.colour + " part of " : "amplitude of ") + name();
  };
  const graph_of_cut = makeGraph(control("profile"), () => "distance, " + data.length_unit, () => data.velocity_unit);
  const draw_profile = () => {
    const host = control("profile"), path = profile;
    host.parentElement.hidden = path.length < 2;
    if (path.length < 2) return;
    const least = profile.title.startsWith("amplitude") ? 0 : -Infinity;
    const limit = ({ value, bound: own }, sign) => Math.max(least, value + sign * (own || 0));
    const upper = path.map((p) => [p.distance, limit(p, 1)]), lower = path.map((p) => [p.distance, limit(p, -1)]);
    const heights = [...upper, ...lower].map(([, v]) => v);
    const range = [Math.min(0, ...heights), Math.max(0, ...heights) || 1];
    graph_of_cut.draw({ x: [0, path[path.length - 1].distance], y: range, shapes: [
      { kind: "band", points: [...upper, ...lower.reverse()], look: "band" },
      { kind: "curve", points: path.map((p) => [p.distance, p.value]), look: "curve" }] });
    const top = path.reduce((best, p) => Math.abs(p.value) > Math.abs(best.value) ? p : best);
    control("profile-told").textContent = `Cut from node ${called(state.from - 1)} to ${called(state.to - 1)}: ${profile.title}` +
      ` with its ${data.level} bound, largest ${three(top.value)}${give_or_take(top.bound)} ${data.velocity_unit}` +
      ` at ${three(top.distance)} ${data.length_unit}.`;
  };

  // All components move the surface as it does; one alone is drawn as a height along the normal.
  const move = () => {
    const along = state.component < 0 ? direction : (c, n, k) => normal[(3 * n + k) % normal.length];
    const motion = [real, imaginary].map((part) => {
      const values = new Float32Array(3 * nodes);
      for (const c of shown()) {
        for (let i = 0; i < 3 * nodes; i++) {
          const n = Math.floor(i / 3);
          values[i] += (part[index(c, n)] || 0) * along(c, n, i % 3);
        }
      }
      return values;
    });
    viewer.put("motion_real", motion[0]);
    viewer.put("motion_imaginary", motion[1]);
    const every = Math.ceil(nodes / MOST_GLYPHS), some = (values) => values.filter((_, i) => Math.floor(i / 3) % every === 0);
    viewer.set("glyphs", state.glyph < 0 ? [0, 1, 2].map(() => new Float32Array(0)) : [position, ...motion].map(some), 1);
    cut(motion);
    const strong = strongest();
    viewer.put("margin", Float32Array.from({ length: 3 * nodes }, (_, i) => {
      const n = Math.floor(i / 3);
      return (bounds(strong, n) || 0) * along(strong, n, i % 3);
    }));
  };

  const CHANGING = 0, SIGNED = 1, STILL = 2;
  const name = () => state.component < 0 ? "|V|" : "V_" + data.components[state.component];
  // Values of a node: complex ones by component if they change, else one number each.
  const colours = () => {
    const one = state.component, unit = data.velocity_unit, many = shown();
    const most = measure() || 1;
    const all = { measure: one < 0 ? CHANGING : SIGNED, range: [one < 0 ? 0 : -most, most], unit,
      map: one < 0 ? "size" : "sign", title: name() + " now",
      real: (n, k) => k < many.length ? real[index(many[k], n)] : 0,
      imaginary: (n, k) => k < many.length ? imaginary[index(many[k], n)] : 0 };
    const still = (title, value, range, map = "size", own = unit) =>
      ({ measure: STILL, range, unit: own, map, title, real: (n, k) => k ? 0 : value(n), imaginary: () => 0 });
    const part = (values) => one < 0
      ? (n) => together((c, m) => values[index(c, m)], n) : (n) => values[index(one, n)];
    const signed = one < 0 ? [0, most] : [-most, most], map = one < 0 ? "size" : "sign";
    if (state.colour.startsWith("strain") && state.layer) return all;
    if (state.colour.startsWith("strain")) return of_strain(colourings[Number(state.colour.slice(6))]);
    if (state.colour === "phase" && one < 0) return all;
    return {
      now: () => all,
      amplitude: () => still(one < 0 ? "amplitude" : "amplitude of " + name(), (n) => together(amplitude, n), [0, most]),
      bound: () => still("± bound", (n) => together(bounds, n), [0, largest((n) => together(bounds, n)) || 1]),
      real: () => still("real part of " + name(), part(real), signed, map),
      imaginary: () => still("imaginary part of " + name(), part(imaginary), signed, map),
      phase: () => still("phase of " + name(), (n) =>
        Math.atan2(imaginary[index(one, n)], real[index(one, n)]) * 180 / Math.PI, [-180, 180], "phase", "°"),
    }[state.colour]();
  };
  const of_strain = (own) => {
    const first = state.frequency * nodes, changes = Boolean(own.imaginary);
    const most = largest((n) => Math.hypot(own.real[first + n], changes ? own.imaginary[first + n] : 0)) || 1;
    return { measure: changes ? SIGNED : STILL, range: [changes ? -most : 0, most], unit: own.unit,
      map: changes ? "sign" : "size", title: own.title,
      real: (n, k) => k ? 0 : own.real[first + n], imaginary: (n, k) => changes && !k ? own.imaginary[first + n] : 0 };
  };
  let coloured = null;
  const colour = () => {
    coloured = colours();
    coloured.of_velocity = state.colour !== "bound" && !state.colour.startsWith("strain");
    const of = (part) => Float32Array.from({ length: 3 * nodes }, (_, i) => part(Math.floor(i / 3), i % 3) || 0);
    viewer.put("value_real", of(coloured.real));
    viewer.put("value_imaginary", of(coloured.imaginary));
    viewer.paint(maps[coloured.map]);
    Object.assign(look, { measure: coloured.measure, range: coloured.range });
    bar();
  };

  const bar = () => {
    const map = maps[coloured.map], [from, to] = coloured.range, stops = [];
    for (let i = 0; i < map.length; i += 3) stops.push(`rgb(${map[i]},${map[i + 1]},${map[i + 2]})`);
    control("bar").style.setProperty("--stops", stops.join(","));
    control("bar-title").textContent = coloured.title + ", " + coloured.unit;
    const ticks = coloured.unit === "°" ? [-180, -90, 0, 90, 180] : steps(from, to, 5);
    control("bar-ticks").replaceChildren(...ticks.map((tick) => {
      const span = document.createElement("span");
      span.textContent = written(tick);
      span.style.setProperty("--at", (tick - from) / (to - from));
      return span;
    }));
  };

  const choose = () => {
    move();
    colour();
    const all = [...Array(nodes).keys()];
    const unknown = all.filter((n) => shown().some((c) => Number.isNaN(amplitude(c, n))));
    const below = Float32Array.from(all, (n) => together(amplitude, n) < together(bounds, n) ? 1 : 0);
    viewer.put("below", below);
    viewer.join("marks", Uint32Array.from(unknown));
    viewer.join("picked", Uint32Array.from(state.node ? [state.node - 1] : []));
    Object.assign(look, { scale: state.size * scale(), shell: state.shell,
      fading: state.fade && coloured.of_velocity });
    look.glyph = Math.max(0, state.glyph);
    look.dark = dark();
    tell(look.fading ? below.reduce((sum, b) => sum + b, 0) : 0);
    spectrum();
    draw_profile();
    stale = true;
  };

  // Dark is what has light letters.
  const dark = () => {
    const [r, g, b] = getComputedStyle(stage).color.match(/[\d.]+/g).map(Number);
    return r + g + b > 384;
  };
  const three = (value) => written(Number(value.toPrecision(3)));
  // What has no bound has none to be told, and not one of zero.
  const give_or_take = (bound) => Number.isFinite(bound) && bound > 0 ? " ± " + three(bound) : " (no bound)";
  const tell = (below) => {
    const most = largest((n) => together(amplitude, n));
    const strong = strongest(), unit = data.velocity_unit;
    const own = [...Array(nodes).keys()].map((n) => bounds(strong, n)).filter((b) => b > 0);
    const rms = Math.sqrt(own.reduce((sum, b) => sum + b * b, 0) / Math.max(1, own.length));
    control("told").textContent =
      "Largest " + name() + " " + three(most) + " " + unit +
      (own.length ? "; " + data.level + " bound of V_" + data.components[strong] + " ± " + three(rms) + " " + unit +
        " (r.m.s.)" : "; V_" + data.components[strong] + " has no bounds") +
      (state.component < 0 ? "; drawn: 1 " : "; drawn along the normal: 1 ") + unit + " as " + three(look.scale) + " " +
      data.length_unit + (below ? `; pale: below its bound, ${below} of ${nodes} nodes.` : ".");
    control("picked").textContent = state.node ? "Node " + called(state.node - 1) + ": " + shown().map((c) =>
      `V_${data.components[c]} ${three(amplitude(c, state.node - 1))}${give_or_take(bounds(c, state.node - 1))}`)
      .join(", ") + " " + unit + "." : "";
  };
  // Nodes count from 0 over the whole volume, points from 1.
  const first = () => data.names ? 1 : layers[state.layer].first || 0;
  // Of few nodes that are drawn for all, each has the number that it has among these.
  const few = data.names ? null : data.few;
  const among = (n) => first() + (few ? few.nodes[n] : n);
  const called = (n) => data.names ? data.names[n] : String(among(n));
  const number = (one) => one ? String(among(one - 1)) : "";
  const drawn = (n) => few ? few.nodes.findIndex((one) => one >= n) : n;

  // The largest amplitude of the surface, or that of the picked node with its bound, by frequency --
  const hertz = data.frequencies;
  const of_hertz = (f) => Number(f.toPrecision(6)) + " Hz";
  const reach = (() => {
    const room = 0.015 * (hertz[hertz.length - 1] - hertz[0]);
    return [hertz[0] - room, hertz[hertz.length - 1] + room];
  })();
  const slider = control("spectrum");
  const graph = makeGraph(slider, () => "Hz", () => data.velocity_unit);
  const spectrum = () => {
    if (hertz.length < 2) return;
    const picked = state.node - 1;
    const found = hertz.map((_, f) => picked < 0
      ? [largest((n) => together(amplitude, n, f)), 0] : [together(amplitude, picked, f), together(bounds, picked, f)]);
    const most = Math.max(...found.map(([v, b]) => (v || 0) + (b || 0))) || 1;
    const stem = (f, from, to, look) => ({ kind: "stem", points: [[hertz[f], from], [hertz[f], to]], look });
    graph.draw({ x: reach, y: [0, most], logarithmic: state.logarithmic, shapes: found.flatMap(([value, own], f) =>
      [stem(f, 0, value || 0, f === state.frequency ? "stem chosen" : "stem"),
        ...(own ? [stem(f, Math.max(0, value - own), value + own, "bound")] : [])]) });
    control("spectrum-told").textContent = `${picked < 0 ? "Largest " + name() : name() + " of node " + called(picked)}` +
      ` by frequency, up to ${three(most)} ${data.velocity_unit}` + (picked < 0 ? "." : `, with its ${data.level} bound.`);
    slider.setAttribute("aria-valuenow", state.frequency);
    slider.setAttribute("aria-valuetext", `${of_hertz(hertz[state.frequency])}, ${three(found[state.frequency][0] || 0)} ${data.velocity_unit}`);
    plot.spectrum = found;
  };
  const tune = (frequency) => {
    state.frequency = Math.max(0, Math.min(hertz.length - 1, frequency));
    control("frequency").value = state.frequency;
    choose();
    if (own.tuned) own.tuned(state.frequency);
  };

  // A frame ----------------------------------------------------------------------------------------
  const margin = 1.5 * DRAWN_SHARE * diagonal;
  const [from, to] = [low.map((x) => x - margin), high.map((x) => x + margin)];
  const camera = makeCamera(from, to, data.look);
  const axes = makeAxes(control("labels"), from, to, data.length_unit);
  // Where the instrument stood: an edge from there along its axis, and beams to the object's ends.
  const stands = data.stands || [];
  const span = (origin) => {
    const middle = low.map((x, k) => (x + high[k]) / 2), toward = middle.map((x, k) => x - origin[k]);
    const side = [-toward[1], toward[0], 0], over = [-toward[0] * toward[2], -toward[1] * toward[2], toward[0] ** 2 + toward[1] ** 2];
    const of = (direction, sign) => {
      let best = 0, most = -Infinity;
      for (let n = 0; n < nodes; n++) {
        const own = sign * direction.reduce((sum, d, k) => sum + d * position[3 * n + k], 0);
        if (own > most) { most = own; best = n; }
      }
      return [0, 1, 2].map((k) => position[3 * best + k]);
    };
    return [of(side, 1), of(side, -1), of(over, 1), of(over, -1)];
  };
  const beams = stands.flatMap(({ origin, axis }) => {
    const away = Math.hypot(...low.map((x, k) => (x + high[k]) / 2 - origin[k]));
    return [origin.map((x, k) => x + away * axis[k]), ...span(origin)].flatMap((end) => [...origin, ...end]);
  });
  const arrange = () => {
    const named = look.stands ? stands.map(({ name: text, origin: place }) => ({ text: "view " + text, place })) : [];
    viewer.set("box", [axes.arrange(camera, named)]);
    stale = true;
    if (own.arranged) own.arranged();
  };
  const draw = () => {
    look.phase = state.phase;
    const degrees = Math.round(state.phase * 180 / Math.PI) % 360;
    control("phase").value = degrees;
    control("degrees").textContent = degrees + "°";
    viewer.draw(look, camera);
    stale = false;
  };
  const fit = () => {
    const every = look.stands ? stands.map((one) => one.origin) : [];
    camera.around(...[[from, Math.min], [to, Math.max]].map(([box, pick]) => box.map((x, k) => pick(x, ...every.map((o) => o[k])))));
    const narrow = camera.width < 560;
    camera.fit(narrow ? { left: camera.width < 380 ? 44 : 78, right: 26, top: 14, bottom: 40 } : { left: 84, right: 60, top: 12, bottom: 52 });
    arrange();
  };
  const resize = () => {
    const ratio = window.devicePixelRatio || 1;
    [camera.width, camera.height] = [stage.clientWidth || 1, stage.clientHeight || 1];
    [canvas.width, canvas.height] = [Math.round(camera.width * ratio), Math.round(camera.height * ratio)];
    fit();
    draw();
  };
  let last = 0;
  const frame = (now) => {
    if (playing && visible) {
      const passed = Math.min(now - last, 160) / 1000;
      state.phase = (state.phase + 2 * Math.PI * state.speed * passed / SECONDS_A_TURN) % (2 * Math.PI);
      stale = true;
    }
    last = now;
    if (stale) draw();
    requestAnimationFrame(frame);
  };

  // Mouse, finger and keys -------------------------------------------------------------------------
  const nearest = (event) => {
    const box = canvas.getBoundingClientRect(), project = camera.projector(), found = viewer.drawn(look);
    const [x, y] = [event.clientX - box.left, event.clientY - box.top];
    let best = null;
    for (let n = 0; n < nodes; n++) {
      const [px, py, depth] = project(found[4 * n], found[4 * n + 1], found[4 * n + 2]);
      const away = Math.hypot(px - x, py - y);
      if (away < NEAR && (!best || away < best.away - 4 || (away < best.away + 4 && depth < best.depth))) {
        best = { n, away, depth, px, py, at: found.slice(4 * n, 4 * n + 4) };
      }
    }
    return best;
  };
  const hover = (event) => {
    const near = nearest(event), tip = control("tip");
    tip.hidden = !near;
    if (!near) return;
    const where = [0, 1, 2].map((k) => three(position[3 * near.n + k])).join(", ");
    const known = shown().every((c) => !Number.isNaN(amplitude(c, near.n)));
    const value = known ? three(near.at[3]) + " " + coloured.unit : "not determined by these views";
    tip.textContent = (data.names ? (data.dots === false ? "pixel " : "point ") : "node ") + called(near.n) + "\n" + where + " " + data.length_unit + "\n" + value;
    tip.style.left = Math.min(near.px + 12, camera.width - 150) + "px";
    tip.style.top = Math.max(4, near.py - 64) + "px";
  };
  const pick = (n) => {
    if (cutting && n !== null) { end_cut(n); return; }
    state.node = n === null ? 0 : n + 1;
    control("node").value = number(state.node);
    choose();
  };
  const held = new Map();
  let moved = 0;
  stage.addEventListener("pointerdown", (event) => {
    held.set(event.pointerId, [event.clientX, event.clientY]);
    stage.setPointerCapture(event.pointerId);
    moved = 0;
    control("tip").hidden = true;
  });
  stage.addEventListener("pointermove", (event) => {
    if (!held.has(event.pointerId)) { hover(event); return; }
    const apart = () => { const [a, b] = [...held.values()]; return Math.hypot(a[0] - b[0], a[1] - b[1]) || 1; };
    const [x, y] = held.get(event.pointerId), before = held.size === 2 ? apart() : 1;
    const [right, down] = [event.clientX - x, event.clientY - y];
    held.set(event.pointerId, [event.clientX, event.clientY]);
    moved += Math.abs(right) + Math.abs(down);
    if (held.size === 2) camera.zoom(apart() / before);
    if (event.shiftKey || event.buttons & 2) camera.move(right, down);
    else camera.turn(0.4 * right / held.size, 0.4 * down / held.size);
    arrange();
  });
  for (const kind of ["pointerup", "pointercancel"]) {
    stage.addEventListener(kind, (event) => {
      if (held.delete(event.pointerId) && kind === "pointerup" && moved < 5) {
        const near = nearest(event);
        pick(near && near.n);
      }
    });
  }
  stage.addEventListener("pointerleave", () => { control("tip").hidden = true; });
  stage.addEventListener("contextmenu", (event) => event.preventDefault());
  stage.addEventListener("wheel", (event) => {
    if (!event.ctrlKey) return;  // the wheel alone scrolls the page
    event.preventDefault();
    camera.zoom(Math.exp(-event.deltaY / 300));
    arrange();
  }, { passive: false });
  const KEYS = { ArrowLeft: () => camera.turn(-6, 0), ArrowRight: () => camera.turn(6, 0), ArrowUp: () => camera.turn(0, -6),
    ArrowDown: () => camera.turn(0, 6), "+": () => camera.zoom(1.15), "=": () => camera.zoom(1.15),
    "-": () => camera.zoom(1 / 1.15), Home: () => view("start"), " ": () => play(!playing) };
  stage.addEventListener("keydown", (event) => {
    if (!KEYS[event.key] || event.ctrlKey || event.altKey || event.metaKey) return;
    event.preventDefault();
    KEYS[event.key]();
    arrange();
  });
  const VIEWS = { start: camera.start, x: { azimuth: 0, elevation: 0 }, y: { azimuth: -90, elevation: 0 },
    z: { azimuth: -90, elevation: 90 } };
  const view = (wanted) => { Object.assign(camera, VIEWS[wanted]); fit(); };

  // Controls -------------------------------------------------------------------------------------
  const options = (select, entries) => {
    for (const [value, text] of entries) select.add(new Option(text, value));
    select.parentElement.hidden = entries.length < 2;
  };
  const play = (wanted) => {
    playing = wanted;
    control("play").textContent = playing ? "❚❚ Pause" : "▶ Play";
    control("play").setAttribute("aria-pressed", String(playing));
    if (own.played) own.played(playing);
  };
  const many = components > 1 ? [[-1, "all, as it moves"]] : [];
  options(control("component"), [...many, ...data.components.map((c, k) => [k, "V_" + c])]);
  if (!many.length) state.component = 0;
  options(control("frequency"), hertz.map((f, k) =>
    [k, f === null ? "" : (data.numbers ? "mode " + data.numbers[k] + ": " : "") + of_hertz(f)]));
  control("frequency").value = state.frequency;
  const depths = (data.layers || []).map(({ text }, k) => [k + 1, text]);
  options(control("layer"), [[0, "given surface"], ...depths]);
  colourings.forEach((one, k) => control("colour").add(new Option(one.text, "strain" + k)));
  stands.forEach((one, k) => {
    VIEWS["view" + k] = { azimuth: one.azimuth, elevation: one.elevation };
    control("view").add(new Option("from view " + one.name, "view" + k));
  });
  const hide = (key, when) => { control(key).closest("label").hidden = when; };
  hide("stands", !stands.length);
  hide("common", components < 2);
  hide("logarithmic", hertz.length < 2);
  hide("from", !triangles.length);
  hide("to", !triangles.length);
  control("cut").hidden = !triangles.length;
  control("frequency").addEventListener("input", (event) => tune(Number(event.target.value)));
  for (const key of ["component", "shell", "size", "speed", "glyph"]) {
    control(key).addEventListener("input", (event) => {
      state[key] = Number(event.target.value);
      choose();
    });
  }
  for (const key of ["node", "from", "to"]) {
    control(key).addEventListener("input", (event) => {
      const { value } = event.target, last = few ? few.nodes[nodes - 1] : nodes - 1;
      const wanted = Math.max(0, Math.min(last, Math.floor(value) - first()));
      state[key] = value === "" ? 0 : drawn(wanted) + 1;
      choose();
    });
  }
  const renumber = () => {
    for (const key of ["node", "from", "to"]) {
      [control(key).min, control(key).max] = [among(0), among(nodes - 1)];
      control(key).value = number(state[key]);
    }
  };
  renumber();
  control("layer").addEventListener("input", (event) => {
    state.layer = Number(event.target.value);
    ({ position, real, imaginary, bound } = layers[state.layer]);
    viewer.put("position", position);
    renumber();
    choose();
  });
  control("colour").addEventListener("input", (event) => { state.colour = event.target.value; choose(); });
  control("phase").addEventListener("input", (event) => {
    play(false);
    state.phase = event.target.value * Math.PI / 180;
    draw();
  });
  for (const [key, part] of [["fade", state], ["common", state], ["logarithmic", state], ["rest", look], ["flat", camera],
    ["stands", look]]) {
    control(key).addEventListener("input", (event) => {
      part[key] = event.target.checked;
      choose();
      if (key === "stands") fit(); else arrange();
    });
  }
  control("view").addEventListener("input", (event) => view(event.target.value));
  control("reset").addEventListener("click", () => view(control("view").value));
  control("save").addEventListener("click", () => { draw(); savePicture(plot, maps[coloured.map]); });
  control("play").addEventListener("click", () => play(!playing));
  // The first click is where a cut begins, the second where it ends; pressed again there is none.
  const press = (wanted) => {
    cutting = wanted;
    control("cut").setAttribute("aria-pressed", String(cutting));
    control("cut").textContent = cutting ? (state.from ? "Click its end" : "Click its beginning") : "Cut by two clicks";
  };
  const ends = (from, to) => {
    Object.assign(state, { from, to });
    [control("from").value, control("to").value] = [number(from), number(to)];
    choose();
  };
  const end_cut = (n) => {
    const begun = state.from && !state.to;
    ends(begun ? state.from : n + 1, begun ? n + 1 : 0);
    press(!begun);
  };
  control("cut").addEventListener("click", () => { ends(0, 0); press(!cutting); });
  slider.parentElement.hidden = hertz.length < 2;
  slider.setAttribute("aria-valuemax", hertz.length - 1);
  slider.addEventListener("click", (event) => {
    const wanted = graph.across_at(event, reach), away = hertz.map((f) => Math.abs(f - wanted));
    tune(away.indexOf(Math.min(...away)));
  });
  slider.addEventListener("keydown", (event) => {
    const step = { ArrowRight: 1, ArrowUp: 1, ArrowLeft: -1, ArrowDown: -1, PageUp: 10, PageDown: -10,
      Home: -hertz.length, End: hertz.length }[event.key];
    if (!step) return;
    event.preventDefault();
    tune(state.frequency + step);
  });

  viewer.put("position", position);
  viewer.join("triangles", triangles);
  viewer.join("rest", Uint32Array.from([...rim, ...joined]));
  viewer.join("lines", Uint32Array.from([...rim, ...(rim.length + inner.length <= 2 * MOST_LINES ? inner : []), ...joined]));
  // Points are seen, whatever joins them; pixels are too many.
  viewer.join("dots", Uint32Array.from(data.names && data.dots !== false && !data.few ? [...Array(nodes).keys()] : []));
  viewer.set("beams", [Float32Array.from(beams)]);
  const seen = (n) => camera.projector()(...viewer.drawn(look).slice(4 * n, 4 * n + 3));
  Object.assign(own, { partners: data.partners, root, camera, look, control, hertz, tune, play, draw, seen, state, profile, joined: viewer.joined,
    count: viewer.count, drawn: (offset = 0) => viewer.drawn({ ...look, phase: state.phase, offset }),
    look_from: (other) => { Object.assign(camera, other); arrange(); } });
  plot.shape = own;
  choose();
  resize();
  new ResizeObserver(resize).observe(stage);
  new IntersectionObserver((seen) => { visible = seen[seen.length - 1].isIntersecting; }).observe(plot);
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => { look.dark = dark(); stale = true; });
  plot.dataset.ready = "yes";
  play(!matchMedia("(prefers-reduced-motion: reduce)").matches);
  requestAnimationFrame(frame);
  return own;
};
const SHAPES = Promise.all([...document.querySelectorAll(".shape")].map(showShape));
