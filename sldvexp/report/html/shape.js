// Shows a complex velocity field as a surface that moves, and what its colours say.
"use strict";
(async () => {
  const data = JSON.parse(document.getElementById("shape-data").textContent);
  const control = (name) => document.getElementById("shape-" + name);
  const [plot, stage, canvas] = [control("plot"), control("stage"), control("canvas")];

  const bytes = (text) => Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
  const floats = (text) => new Float32Array(bytes(text).buffer);
  const integers = (text) => Uint32Array.from(new Uint16Array(bytes(text || "").buffer));
  const position = floats(data.position), normal = floats(data.normal), directions = floats(data.directions);
  const nodes = position.length / 3;
  const components = data.components.length;
  const [triangles, joined] = [integers(data.triangles), integers(data.lines)];
  const maps = Object.fromEntries(Object.entries(data.maps).map(([name, text]) => [name, bytes(text)]));
  const everywhere = directions.length === 3 * components;  // the same directions at every node

  const SECONDS_A_TURN = 2.5;       // of the drawn motion
  const DRAWN_SHARE = 0.08;         // largest deflection, as a share of the surface's diagonal
  const MOST_LINES = 3000;
  const NEAR = 18;                  // pixels between a node and the pointer that means it

  const viewer = typeof DecompressionStream === "undefined" ? null : makeViewer(canvas, nodes);
  if (!viewer) {
    document.documentElement.classList.add("no-webgl");
    return;
  }

  // Numbers of the nodes: exact ones, or whole ones as differences from node to node, by bytes ------
  const NONE = -32768;
  const whole = async (text) => {
    const deflated = new Blob([bytes(text)]).stream().pipeThrough(new DecompressionStream("deflate"));
    const planes = new Uint8Array(await new Response(deflated).arrayBuffer()), count = planes.length / 2;
    const found = new Int16Array(count);
    for (let i = 0, sum = 0; i < count; i++) {
      sum = (i % nodes ? sum : 0) + (planes[i] | planes[count + i] << 8);
      found[i] = sum;
    }
    return found;
  };
  const stepped = async (text, step) =>
    Float32Array.from(await whole(text), (q, i) => q === NONE ? NaN : q * step(i));
  const parts = async (own) => {
    const here = async (name) => floats(own[name]);
    if (!data.rounded) return Promise.all([here("real"), here("imaginary"), here("bound")]);
    const limits = Float32Array.from(await whole(own.bound), (q) => q === NONE ? NaN : own.least * Math.exp(own.ratio * q));
    const step = (i) => {
      const finest = own.finest[Math.floor(i / (components * nodes))], share = own.share * limits[i];
      return share > finest ? share : finest;
    };
    return [await stepped(own.real, step), await stepped(own.imaginary, step), limits];
  };
  const [real, imaginary, bound] = await parts(data);
  const colourings = await Promise.all((data.colourings || []).map(async (own) => {
    const of = async (text) => !text ? undefined
      : data.rounded ? stepped(text, (i) => own.finest[Math.floor(i / nodes)]) : floats(text);
    return { ...own, real: await of(own.real), imaginary: await of(own.imaginary) };
  }));
  const state = { component: -1, frequency: data.strongest, colour: "now", shell: 0, size: 1, phase: 0, speed: 1,
    fade: true, node: 0 };
  let playing = false, visible = true, stale = true;

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
    const those = (keep) => all.filter(keep).flatMap((side) => side.pair);
    return [those((s) => s.faces === 1), those((s) => s.faces > 1 && !s.diagonal)];
  })();
  const low = [Infinity, Infinity, Infinity], high = low.map((x) => -x);
  position.forEach((x, i) => { low[i % 3] = Math.min(low[i % 3], x); high[i % 3] = Math.max(high[i % 3], x); });
  const diagonal = Math.hypot(...low.map((x, k) => high[k] - x)) || 1;
  const scale = () => {
    const most = largest((n) => together(amplitude, n));
    return most > 0 ? DRAWN_SHARE * diagonal / most : 0;
  };

  // What is drawn: chosen rarely, told to the graphics processor once ------------------------------
  const look = { phase: 0, scale: 0, range: [0, 1], measure: 0, fading: true, shell: 0, rest: true };
  const direction = (c, n, k) => directions[(everywhere ? c : c * nodes + n) * 3 + k];
  // All components move the surface as it does; one alone is drawn as a height along the normal.
  const move = () => {
    const motion = { motion_real: real, motion_imaginary: imaginary };
    const along = state.component < 0 ? direction : (c, n, k) => normal[3 * n + k];
    for (const [name, part] of Object.entries(motion)) {
      const values = new Float32Array(3 * nodes);
      for (const c of shown()) {
        for (let i = 0; i < 3 * nodes; i++) {
          const n = Math.floor(i / 3);
          values[i] += (part[index(c, n)] || 0) * along(c, n, i % 3);
        }
      }
      viewer.put(name, values);
    }
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
    const most = largest((n) => together(amplitude, n)) || 1;
    const all = { measure: one < 0 ? CHANGING : SIGNED, range: [one < 0 ? 0 : -most, most], unit,
      map: one < 0 ? "size" : "sign", title: name() + " now",
      real: (n, k) => k < many.length ? real[index(many[k], n)] : 0,
      imaginary: (n, k) => k < many.length ? imaginary[index(many[k], n)] : 0 };
    const still = (title, value, range, map = "size", own = unit) =>
      ({ measure: STILL, range, unit: own, map, title, real: (n, k) => k ? 0 : value(n), imaginary: () => 0 });
    const part = (values) => one < 0
      ? (n) => together((c, m) => values[index(c, m)], n) : (n) => values[index(one, n)];
    const signed = one < 0 ? [0, most] : [-most, most], map = one < 0 ? "size" : "sign";
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
    tell(look.fading ? below.reduce((sum, b) => sum + b, 0) : 0);
    spectrum();
    stale = true;
  };

  const three = (value) => written(Number(value.toPrecision(3)));
  const tell = (below) => {
    const most = largest((n) => together(amplitude, n));
    const strong = strongest(), unit = data.velocity_unit;
    const own = [...Array(nodes).keys()].map((n) => bounds(strong, n)).filter(Number.isFinite);
    const rms = Math.sqrt(own.reduce((sum, b) => sum + b * b, 0) / Math.max(1, own.length));
    control("told").textContent =
      "Largest " + name() + " " + three(most) + " " + unit +
      "; " + data.level + " bound of V_" + data.components[strong] + " ± " + three(rms) + " " + unit + " (r.m.s.)" +
      (state.component < 0 ? "; drawn: 1 " : "; drawn along the normal: 1 ") + unit + " as " + three(look.scale) + " " +
      data.length_unit + (below ? `; pale: below its bound, ${below} of ${nodes} nodes.` : ".");
    control("picked").textContent = state.node ? "Node " + called(state.node - 1) + ": " + shown().map((c) =>
      `V_${data.components[c]} ${three(amplitude(c, state.node - 1))} ± ${three(bounds(c, state.node - 1))}`)
      .join(", ") + " " + unit + "." : "";
  };
  const called = (n) => data.names ? data.names[n] : String(n + 1);

  // The largest amplitude of the surface, or that of the picked node with its bound, by frequency --
  const hertz = data.frequencies;
  const of_hertz = (f) => Number(f.toPrecision(6)) + " Hz";
  const along = (f) => hertz.length < 2 ? 0.5 : (f - hertz[0]) / (hertz[hertz.length - 1] - hertz[0]);
  const spectrum = () => {
    if (hertz.length < 2) return;
    const [wide, tall, foot] = [1000, 100, 4], picked = state.node - 1;
    const found = hertz.map((_, f) => picked < 0
      ? [largest((n) => together(amplitude, n, f)), 0] : [together(amplitude, picked, f), together(bounds, picked, f)]);
    const most = Math.max(...found.map(([v, b]) => (v || 0) + (b || 0))) || 1;
    const svg = (tag, given) => {
      const made = document.createElementNS("http://www.w3.org/2000/svg", tag);
      for (const [key, value] of Object.entries(given)) made.setAttribute(key, value);
      return made;
    };
    control("lines").replaceChildren(...found.flatMap(([value, own], f) => {
      const x = 12 + along(hertz[f]) * (wide - 24), y = (v) => foot + (tall - foot) * (1 - v / most);
      const line = (from, to, kind) => svg("line", { x1: x, x2: x, y1: y(from), y2: y(to), class: kind });
      const kind = f === state.frequency ? "chosen" : "";
      return [line(0, value || 0, kind), ...(own ? [line(Math.max(0, value - own), value + own, "bound")] : [])];
    }));
    control("spectrum-told").textContent = `${picked < 0 ? "Largest " + name() : name() + " of node " + called(picked)}` +
      ` by frequency, ${of_hertz(hertz[0])} to ${of_hertz(hertz[hertz.length - 1])}, up to ${three(most)} ${data.velocity_unit}` +
      (picked < 0 ? "" : `, with its ${data.level} bound`);
    const slider = control("spectrum");
    slider.setAttribute("aria-valuenow", state.frequency);
    slider.setAttribute("aria-valuetext", `${of_hertz(hertz[state.frequency])}, ${three(found[state.frequency][0] || 0)} ${data.velocity_unit}`);
  };
  const tune = (frequency) => {
    state.frequency = Math.max(0, Math.min(hertz.length - 1, frequency));
    control("frequency").value = state.frequency;
    choose();
  };

  // A frame ----------------------------------------------------------------------------------------
  const margin = 1.5 * DRAWN_SHARE * diagonal;
  const [from, to] = [low.map((x) => x - margin), high.map((x) => x + margin)];
  const camera = makeCamera(from, to);
  const axes = makeAxes(control("labels"), from, to, data.length_unit);
  const arrange = () => { viewer.frame(axes.arrange(camera)); stale = true; };
  const draw = () => {
    look.phase = state.phase;
    const degrees = Math.round(state.phase * 180 / Math.PI) % 360;
    control("phase").value = degrees;
    control("degrees").textContent = degrees + "°";
    viewer.draw(look, camera);
    stale = false;
  };
  const fit = () => {
    const narrow = camera.width < 560;
    camera.fit(narrow ? { left: 44, right: 26, top: 14, bottom: 40 } : { left: 84, right: 60, top: 12, bottom: 52 });
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
    tip.textContent = (data.names ? "point " : "node ") + called(near.n) + "\n" + where + " " + data.length_unit + "\n" + value;
    tip.style.left = Math.min(near.px + 12, camera.width - 150) + "px";
    tip.style.top = Math.max(4, near.py - 64) + "px";
  };
  const pick = (n) => {
    state.node = n === null ? 0 : n + 1;
    control("node").value = state.node || "";
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
  // The picture with what is written around it, as a file.
  const save = () => {
    const ratio = window.devicePixelRatio || 1, box = plot.getBoundingClientRect();
    const whole = document.createElement("canvas"), pen = whole.getContext("2d");
    [whole.width, whole.height] = [Math.round(box.width * ratio), Math.round(box.height * ratio)];
    pen.scale(ratio, ratio);
    pen.fillStyle = "#fff";
    pen.fillRect(0, 0, box.width, box.height);
    const within = (element) => {
      const own = element.getBoundingClientRect();
      return [own.left - box.left, own.top - box.top, own.width, own.height];
    };
    draw();
    pen.drawImage(canvas, ...within(canvas));
    const [left, top, width, height] = within(control("bar-scale")), upright = height > width;
    const shades = pen.createLinearGradient(left, upright ? top + height : top, upright ? left : left + width, top);
    const map = maps[coloured.map];
    for (let i = 0; i < map.length; i += 3) {
      shades.addColorStop(i / (map.length - 3), `rgb(${map[i]},${map[i + 1]},${map[i + 2]})`);
    }
    pen.fillStyle = shades;
    pen.fillRect(left, top, width, height);
    pen.fillStyle = "#1b1b1b";
    pen.textBaseline = "middle";
    for (const text of plot.querySelectorAll("#shape-labels span, #shape-bar-ticks span, #shape-bar-title")) {
      const [x, y, , tall] = within(text), look = getComputedStyle(text);
      pen.font = look.fontSize + " " + look.fontFamily;
      pen.fillText(text.textContent, x, y + tall / 2);
    }
    whole.toBlob((blob) => {
      const link = document.createElement("a");
      link.href = URL.createObjectURL(blob);
      link.download = "shape.png";
      link.click();
      setTimeout(() => URL.revokeObjectURL(link.href), 10000);
    });
  };
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
  };
  const many = components > 1 ? [[-1, "all, as it moves"]] : [];
  options(control("component"), [...many, ...data.components.map((c, k) => [k, "V_" + c])]);
  if (!many.length) state.component = 0;
  options(control("frequency"), hertz.map((f, k) => [k, f === null ? "" : of_hertz(f)]));
  control("frequency").value = state.frequency;
  colourings.forEach((own, k) => control("colour").add(new Option(own.text, "strain" + k)));
  (data.views || []).forEach((own, k) => {
    VIEWS["view" + k] = { azimuth: own.azimuth, elevation: own.elevation };
    control("view").add(new Option("from view " + own.name, "view" + k));
  });
  for (const key of ["component", "frequency", "shell", "size", "node", "speed"]) {
    control(key).addEventListener("input", (event) => {
      state[key] = Number(event.target.value);
      state.node = Math.max(0, Math.min(nodes, Math.floor(state.node) || 0));
      choose();
    });
  }
  control("node").max = nodes;
  control("colour").addEventListener("input", (event) => { state.colour = event.target.value; choose(); });
  control("phase").addEventListener("input", (event) => {
    play(false);
    state.phase = event.target.value * Math.PI / 180;
    draw();
  });
  for (const [key, part] of [["fade", state], ["rest", look], ["flat", camera]]) {
    control(key).addEventListener("input", (event) => { part[key] = event.target.checked; choose(); arrange(); });
  }
  control("view").addEventListener("input", (event) => view(event.target.value));
  control("reset").addEventListener("click", () => view(control("view").value));
  control("save").addEventListener("click", save);
  control("play").addEventListener("click", () => play(!playing));
  const slider = control("spectrum");
  slider.parentElement.hidden = hertz.length < 2;
  slider.setAttribute("aria-valuemax", hertz.length - 1);
  slider.addEventListener("click", (event) => {
    const box = slider.getBoundingClientRect(), share = (event.clientX - box.left) / box.width;
    const away = hertz.map((f) => Math.abs((12 + along(f) * 976) / 1000 - share));
    tune(away.indexOf(Math.min(...away)));
  });
  slider.addEventListener("keydown", (event) => {
    const step = { ArrowRight: 1, ArrowUp: 1, ArrowLeft: -1, ArrowDown: -1, Home: -hertz.length, End: hertz.length }[event.key];
    if (!step) return;
    event.preventDefault();
    tune(state.frequency + step);
  });

  viewer.put("position", position);
  viewer.join("triangles", triangles);
  viewer.join("rest", Uint32Array.from([...rim, ...joined]));
  viewer.join("lines", Uint32Array.from([...rim, ...(rim.length + inner.length <= 2 * MOST_LINES ? inner : []), ...joined]));
  // Points are seen, whatever joins them.
  viewer.join("dots", Uint32Array.from(data.names ? [...Array(nodes).keys()] : []));
  const seen = (n) => camera.projector()(...viewer.drawn(look).slice(4 * n, 4 * n + 3));
  plot.shape = { draw, seen, joined: viewer.joined, drawn: (offset = 0) => viewer.drawn({ ...look, phase: state.phase, offset }) };
  choose();
  resize();
  new ResizeObserver(resize).observe(stage);
  new IntersectionObserver((seen) => { visible = seen[seen.length - 1].isIntersecting; }).observe(plot);
  plot.dataset.ready = "yes";
  play(!matchMedia("(prefers-reduced-motion: reduce)").matches);
  requestAnimationFrame(frame);
})();
