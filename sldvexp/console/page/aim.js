// Aiming: the field of view, the beam, the level, and the marks.

import { Cells, atFrequency, paintRamp } from "./cells.js";
import { drawLayout } from "./layout.js";

const $ = (id) => document.getElementById(id);
const STEPS = [1, 10, 100];
const NAMES = { circle: "circle", corner: "corner", spot: "spot", fiducial: "mark" };
/** Colour of corners, and of the region between them. */
const CORNER = "#e08a00";
/** Velocity over its noise from which something moves (noise alone is beyond it once in 270 000 times), and at which its bar is full. */
const MOVES = 5, FULL = 1000;
/** The page says so often that an arrow is held, ms; the beam begins to run after a while. */
const HELD = 200, LONG = 300;
/** Parts of the whole field that are shown at most of a place that the beam goes to, and of what is shown that lie around it. */
const CLOSE = 1 / 8, AROUND = 1 / 8;

export class Aim {
  constructor(page) {
    this.page = page;
    this.map = new Cells($("map"), () => this.drawOver());
    $("map").cells = this.map;
    $("map").aim = this;
    this.beam = [0, 0];
    this.marks = { marks: [], views: [], predicted: [], outlines: [], out: [] };
    this.wanted = {};
    this.chosen = null;
    this.step = 10;
    this.raster = [];
    this.layout = [];
    paintRamp($("ramp"));
    this.topics = {
      setup: (word) => this.setUp(word),
      beam: (word) => this.showBeam(word),
      level: (word) => this.showLevel(word),
      marks: (word) => this.showMarks(word),
      looking: (word) => { this.looking = word; $("look").textContent = word ? "Stop" : "Look"; },
      written: (word) => { $("written").textContent = word; },
      suggested: (word) => { if (!$("name").value) $("name").value = word; },
    };
    this.pictures = { raster: (header, arrays) => this.showRaster(header, arrays), camera: showCamera };
    this.listen();
  }

  update(steering) {
    this.steering = steering;
    $("view").setAttribute("aria-disabled", String(!steering));
    if (!steering) return;
    $("undo").disabled = !this.marks.undo;
    $("redo").disabled = !this.marks.redo;
    $("go").disabled = !this.placeOf(this.chosen);
    $("mark").disabled = !this.chosen;
  }

  setUp(word) {
    this.wanted = word.wanted;
    this.limits = [word.low, word.high];
    this.ways = word.ways;
    this.layout = word.layout;
    this.layoutTold = word.layout_told;
    for (const cells of [this.map, $("image").cells]) cells.turn(word.ways);
    $("slide-left").dir = word.ways[1] > 0 ? "rtl" : "ltr";
    $("slide-up").dir = word.ways[0] > 0 ? "ltr" : "rtl";
    for (const slide of [$("slide-up"), $("slide-left")]) { slide.min = word.low; slide.max = word.high; }
    this.window([word.low, word.low], [word.high, word.high]);
  }

  /** Show a window of the field, a square within the board's range. */
  window(low, high) {
    const [least, most] = this.limits, side = Math.min(high[0] - low[0], most - least);
    const from = low.map((v) => Math.round(Math.min(Math.max(v, least), most - side)));
    this.map.show(from, from.map((v) => Math.round(v + side)));
    $("window").textContent = `shown: up-down ${this.map.low[0]} to ${this.map.high[0]}, left-right ${this.map.low[1]} to ${this.map.high[1]}`;
  }

  showWhole() { this.window(...this.limits.map((v) => [v, v])); }

  /** Steps of an arrow: up and left are 1. */
  steps(arrow, size) {
    return arrow.map((v, k) => v * size * this.ways[k]);
  }

  zoom(factor) {
    const { low, high } = this.map, side = Math.max(32, (high[0] - low[0]) * factor);
    const inside = this.beam.every((b, k) => b >= low[k] && b <= high[k]);
    const middle = inside && factor < 1 ? this.beam : low.map((v, k) => (v + high[k]) / 2);
    this.window(middle.map((m) => m - side / 2), middle.map((m) => m + side / 2));
  }

  showBeam(at) {
    this.beam = at;
    $("at-up").textContent = at[0];
    $("at-left").textContent = at[1];
    if (document.activeElement !== $("slide-up")) $("slide-up").value = at[0];
    if (document.activeElement !== $("slide-left")) $("slide-left").value = at[1];
    this.drawOver();
  }

  showLevel(word) {
    const told = (id, value, text) => { $(id).value = value; $(`${id}-told`).textContent = text; };
    if (!word) {
      for (const id of ["velocity", "reference", "light"]) told(id, 0, "–");
      $("flags").textContent = "";
      return;
    }
    // Of one noise nothing is shown, of FULL all of the bar: it means the same at every place.
    const times = word.noise ? word.velocity / word.noise : word.velocity ? FULL : 0, moves = times >= MOVES;
    told("velocity", Math.log(Math.min(Math.max(times, 1), FULL)) / Math.log(FULL), `${word.velocity.toFixed(3)} mm/s`);
    $("velocity").low = Math.log(MOVES) / Math.log(FULL);
    $("reference").max = Math.max($("reference").max, word.reference);
    told("reference", word.reference, `${word.reference.toFixed(3)} V`);
    told("light", word.light, `${Math.round(100 * word.light)} %`);
    $("flags").textContent = word.flags.length ? `not to be trusted: ${word.flags.join(", ").replaceAll("_", " ")}` : moves ? `good: ${Math.round(times)} times the noise` : `no more than noise: ${MOVES} times the noise tell that something moves`;
  }

  showRaster(header, arrays) {
    if (header.begin) {
      this.raster = [];
      this.map.forget();
    } else {
      this.raster.push({ cell: header.cell, arrays });
      this.looked = header;
      this.addToMap(header.cell, arrays);
    }
    this.showRange();
  }

  /** Add a part of the quick look: the velocity with its flags, or the reference's level. */
  addToMap(cell, [dac, velocity, flag, reference]) {
    if ($("shown").value === "reference") this.map.add(dac, reference, new Uint8Array(flag.length), cell);
    else this.map.add(dac, velocity, flag, cell);
  }

  showRange() {
    if (!this.raster.length) { $("range").textContent = "nothing is looked at yet: Look (l)"; return; }
    $("range").textContent = `0 to ${this.map.top.toPrecision(3)} ${$("shown").value === "reference" ? "V" : "mm/s"} ${atFrequency(this.looked)}`;
  }

  /** Show the other quantity of the same look. */
  showOther() {
    this.map.forget();
    for (const { cell, arrays } of this.raster) this.addToMap(cell, arrays);
    this.showRange();
  }

  // ---- marks ----

  /** All marks that this view wants or has. */
  list() {
    const found = [];
    for (const [kind, numbers] of Object.entries(this.wanted)) {
      const own = this.marks.marks.filter((m) => m.kind === kind).map((m) => m.number);
      const all = numbers.length ? numbers : [...own, Math.max(0, ...own) + 1];
      for (const number of all) found.push({ kind, number });
    }
    return found;
  }

  at({ kind, number }, list = this.marks.marks) { return list.find((m) => m.kind === kind && m.number === number); }

  placeOf(name) { return this.placesOf(name)[0] ?? null; }

  /** Say where a mark is, or else is predicted and may be instead. */
  placesOf(name) {
    const set = name && this.at(name), guess = name && this.at(name, this.marks.predicted);
    return set ? [set.dac] : guess ? [guess.dac, ...guess.instead] : [];
  }

  showMarks(word) {
    const other = word.view !== this.marks.view, before = this.marks.marks.length;
    this.marks = { predicted: [], outlines: [], out: [], ...word };
    this.showViews(word);
    if (other) {
      this.chosen = null;  // each view begins with its first mark
      if (this.limits) this.showWhole();  // where the last one was shown this one may have nothing
    }
    if (!this.chosen || word.marks.length > before) this.chooseNext();
    $("pose").textContent = word.pose ?? "";
    this.drawMarks();
  }

  /** List the views; the one in the list's focus keeps it. */
  showViews({ views, view }) {
    const list = $("view"), within = list.contains(document.activeElement), focused = document.activeElement.dataset?.name;
    list.replaceChildren(...views.map(({ name, marks }) => {
      const option = document.createElement("li");
      option.setAttribute("role", "option");
      option.setAttribute("aria-selected", String(name === view));
      option.dataset.name = name;
      option.setAttribute("aria-label", `${name}, ${marks} mark${marks === 1 ? "" : "s"}`);
      option.title = `${marks} mark${marks === 1 ? "" : "s"}`;
      const count = document.createElement("span");
      count.textContent = marks ? `(${marks})` : "";
      option.append(name, count);
      return option;
    }));
    const options = [...list.children];
    this.rove(options.find((o) => within && o.dataset.name === focused) ?? options.find((o) => o.dataset.name === view) ?? options[0], within);
  }

  /** Let one view be the one that Tab comes to. */
  rove(option, focus) {
    for (const each of $("view").children) each.tabIndex = each === option ? 0 : -1;
    if (focus) option?.focus();
  }

  chooseView(option) {
    if (!this.steering) return;
    this.page.wish("view", { name: option.dataset.name });
    $("field").focus({ preventScroll: true });
  }

  /** Arrows walk along the views and move no mirror; a view that is chosen sends these home, so that only Enter and space do. */
  keyOfViews(event) {
    const options = [...$("view").children], at = options.indexOf(event.target.closest("[role=option]"));
    const to = { ArrowDown: at + 1, ArrowRight: at + 1, ArrowUp: at - 1, ArrowLeft: at - 1, Home: 0, End: options.length - 1 }[event.key];
    if (event.ctrlKey || event.metaKey || event.altKey || at < 0) return;
    if (to !== undefined) this.rove(options[Math.min(Math.max(to, 0), options.length - 1)], true);
    else if (event.key === "Enter" || event.key === " ") this.chooseView(options[at]);
    else return;
    event.preventDefault();
    event.stopPropagation();
  }

  /** Choose the mark after the chosen one that is not set yet, from the first on again behind the last; else leave the choice. */
  chooseNext() {
    const all = this.list(), after = this.indexOf(this.chosen, all) + 1, list = [...all.slice(after), ...all.slice(0, after)];
    this.choose(list.find((name) => !this.at(name) && !this.at(name, this.marks.out)) ?? this.chosen ?? list[0] ?? null);
  }

  indexOf(name, list) { return list.findIndex((n) => n.kind === name?.kind && n.number === name?.number); }

  choose(name) {
    this.chosen = name;
    if (name && this.steering && this.marks.kind !== name.kind) this.page.wish("kind", { kind: name.kind });
    this.drawMarks();
  }

  chooseBy(by) {
    const list = this.list(), at = this.indexOf(this.chosen, list);
    if (list.length) this.choose(list[(at + by + list.length) % list.length]);
  }

  drawMarks() {
    const rows = this.list().map((name) => {
      const row = document.createElement("tr"), set = this.at(name), guess = this.at(name, this.marks.predicted);
      const button = document.createElement("button");
      button.type = "button";
      button.textContent = nameOf(name);
      const chosen = name.kind === this.chosen?.kind && name.number === this.chosen?.number;
      button.setAttribute("aria-pressed", String(chosen));
      button.addEventListener("click", () => this.choose(name));
      const out = this.at(name, this.marks.out);
      if (out) {
        const cell = Object.assign(document.createElement("td"), { colSpan: 3, className: "out", textContent: out.why });
        const first = document.createElement("td");
        first.append(button);
        row.append(first, cell);
        if (chosen) row.className = "chosen";
        return row;
      }
      const off = offTold(set);
      const cells = [button, ...(set ?? guess)?.dac.map(String) ?? ["–", "–"], off].map((content) => {
        const cell = document.createElement("td");
        cell.append(content);
        if (!set && guess) cell.className = "predicted";
        if (set?.beside && content === off) cell.className = "beside";
        if (set?.why && content === off) cell.title = set.why;
        return cell;
      });
      row.append(...cells);
      if (chosen) row.className = "chosen";
      return row;
    });
    $("marks").tBodies[0].replaceChildren(...rows);
    this.drawLayout();
    this.showChosen();
    this.drawOver();
    this.update(this.steering);
  }

  /** Scroll the list to the chosen mark, below its heading; never the page, which would move under the mouse. */
  showChosen() {
    const row = $("marks").querySelector("tr.chosen"), list = $("marks").parentNode;
    if (!row) return;
    const head = $("marks").tHead.offsetHeight, top = row.offsetTop - head, bottom = row.offsetTop + row.offsetHeight - list.clientHeight;
    list.scrollTop = Math.max(Math.min(list.scrollTop, top), bottom);
  }

  /** Draw which mark is which: as this view sees them where that is known, else as they lie on the object. */
  drawLayout() {
    $("layout-box").hidden = this.layout.length < 2;
    if (this.layout.length < 2) return;
    const seen = this.layoutSeen();
    drawLayout($("layout"), seen ?? this.layout, this.chosen);
    $("layout-told").textContent = `Which is which, ${seen ? `in view ${this.marks.view}` : this.layoutTold}`;
  }

  /** The same marks as this view sees them; null where not all are known. */
  layoutSeen() {
    const flat = ([up, left]) => [-this.ways[1] * left, this.ways[0] * up], { outlines } = this.marks;
    const seen = this.layout.map((mark, i) => {
      const rim = mark.rim.length ? outlines[i]?.points ?? [] : [], place = this.at(mark, this.marks.predicted)?.dac;
      return place && (!mark.rim.length || rim.length > 2) ? { ...mark, at: flat(place), rim: rim.map(flat) } : null;
    });
    return seen.every(Boolean) ? seen : null;
  }

  drawOver() {
    const canvas = $("over"), context = canvas.getContext("2d"), { width, height } = canvas;
    const at = (dac) => this.map.placeOf(dac).map((v, k) => v * [width, height][k]);
    context.clearRect(0, 0, width, height);
    context.lineWidth = 1.5;
    context.lineJoin = "round";
    for (const { points, closed } of this.marks.outlines ?? []) {
      context.strokeStyle = "#19a3a3";
      context.beginPath();
      for (const [i, dac] of points.entries()) context[i ? "lineTo" : "moveTo"](...at(dac));
      if (closed) context.closePath();
      context.stroke();
    }
    const size = Math.max(width / (canvas.clientWidth || width), 1);  // on a small screen not smaller
    context.font = `bold ${13 * size}px sans-serif`;
    this.drawRegion(context, at);
    const named = (mark, sure) => ({ ...mark, colour: sure ? "#2f9e3f" : "#19a3a3", text: `${nameOf(mark)}${sure ? "" : "?"}` });
    const open = (this.marks.predicted ?? []).filter((mark) => !this.at(mark)).map((mark) => named(mark, false));
    const taken = this.marks.marks.map((mark) => named(mark, !mark.unmoved));
    const drawn = [...open, ...taken].map((mark) => ({ ...mark, at: at(mark.dac) })).filter((mark) => mark.at[0] >= 0 && mark.at[1] >= 0 && mark.at[0] <= width && mark.at[1] <= height);
    for (const mark of drawn) drawMark(context, mark.at, mark.kind, mark.colour, size);
    this.names = placeNames(context, drawn, (this.marks.outlines ?? []).map(({ points }) => points.map(at)), at(this.beam), size);
    for (const { text, kind, colour, box } of this.names) drawName(context, text, kind === "corner" ? CORNER : colour, box);
    const [x, y] = at(this.beam);
    for (const [colour, thick] of [["#fff", 4], ["#c00000", 2]]) {
      context.strokeStyle = colour;
      context.lineWidth = thick;
      context.beginPath();
      context.arc(x, y, 6 * size, 0, 7);
      for (const [dx, dy] of [[1, 0], [-1, 0], [0, 1], [0, -1]]) { context.moveTo(x + 6 * size * dx, y + 6 * size * dy); context.lineTo(x + 14 * size * dx, y + 14 * size * dy); }
      context.stroke();
    }
  }

  /** Draw the box of the region that is imaged, around its corners as marked or predicted. */
  drawRegion(context, at) {
    const corners = (this.wanted.corner ?? []).map((number) => this.placeOf({ kind: "corner", number }));
    if (!corners.length || corners.some((dac) => !dac)) return;
    const [low, high] = [Math.min, Math.max].map((limit) => [0, 1].map((k) => limit(...corners.map((dac) => dac[k]))));
    const [a, b] = [at(low), at(high)];
    context.strokeStyle = CORNER;
    context.setLineDash([6, 5]);
    context.strokeRect(Math.min(a[0], b[0]), Math.min(a[1], b[1]), Math.abs(a[0] - b[0]), Math.abs(a[1] - b[1]));
    context.setLineDash([]);
  }

  // ---- what the person does ----

  look() {
    if (this.looking) this.page.wish("stop_look");
    else this.page.wish("look", { low: this.map.low, high: this.map.high });
  }

  mark() {
    if (this.chosen) this.page.wish("mark", this.chosen);
  }

  go() {
    const places = this.placesOf(this.chosen), at = places.findIndex((dac) => dac.every((v, k) => v === this.beam[k]));
    if (!places.length) return;
    const place = places[(at + 1) % places.length];
    this.page.wish("go", { ...this.chosen, to: place });
    const { low, high } = this.map, now = high[0] - low[0], side = Math.min(now, CLOSE * (this.limits[1] - this.limits[0]));
    // The beam goes where it can be seen, with what is around it.
    if (side < now || place.some((b, k) => b < low[k] + AROUND * side || b > high[k] - AROUND * side)) this.window(place.map((b) => b - side / 2), place.map((b) => b + side / 2));
  }

  setStep(step) {
    this.step = step;
    for (const radio of document.querySelectorAll("[name=step]")) radio.checked = Number(radio.value) === step;
  }

  listen() {
    $("field").addEventListener("click", (event) => {
      if (!this.steering) return;
      const box = $("map").getBoundingClientRect();
      this.page.wish("move", { to: this.map.stepsAt((event.clientX - box.left) / box.width, (event.clientY - box.top) / box.height) });
      $("field").focus({ preventScroll: true });
    });
    const actions = { look: () => this.look(), nearer: () => this.zoom(0.5), farther: () => this.zoom(2), mark: () => this.mark(), go: () => this.go() };
    actions.whole = () => this.showWhole();
    actions["add-view"] = () => this.page.wish("add_view");
    actions.undo = () => this.page.wish("undo");
    actions.redo = () => this.page.wish("redo");
    actions.write = () => this.page.wish("write", { name: $("name").value.trim(), replace: $("replace").checked });
    actions.start = () => this.page.wish("scan", { name: $("name").value.trim(), replace: $("replace").checked, anew: $("anew").checked });
    for (const [id, action] of Object.entries(actions)) $(id).addEventListener("click", action);
    $("shown").addEventListener("change", () => { this.showOther(); $("field").focus({ preventScroll: true }); });
    $("view").addEventListener("keydown", (event) => this.keyOfViews(event));
    $("view").addEventListener("click", (event) => { const option = event.target.closest("[role=option]"); if (option) this.chooseView(option); });
    $("view").addEventListener("focusout", (event) => { if (!$("view").contains(event.relatedTarget)) this.rove($("view").querySelector("[aria-selected=true]"), false); });
    for (const radio of document.querySelectorAll("[name=step]")) radio.addEventListener("change", () => this.setStep(Number(radio.value)));
    for (const id of ["slide-up", "slide-left"]) {
      $(id).addEventListener("input", () => this.page.wish("move", { to: [Number($("slide-up").value), Number($("slide-left").value)] }));
    }
    for (const arrow of document.querySelectorAll("[data-by]")) this.listenToArrow(arrow);
    document.addEventListener("keydown", (event) => this.key(event));
  }

  /** A press of an arrow moves once; held longer, the beam runs until it is let go. */
  listenToArrow(arrow) {
    const by = () => this.steps(arrow.dataset.by.split(",").map(Number), this.step);
    let timer = null;
    const release = () => {
      if (timer === null) return;
      clearInterval(timer);
      timer = null;
      this.page.wish("release");
    };
    arrow.addEventListener("pointerdown", (event) => {
      if (!this.steering || event.button) return;
      arrow.setPointerCapture(event.pointerId);
      this.page.wish("nudge", { by: by() });
      const begun = performance.now();
      timer = setInterval(() => { if (performance.now() - begun >= LONG) this.page.wish("hold", { by: by() }); }, HELD);
    });
    for (const end of ["pointerup", "pointercancel", "lostpointercapture", "blur"]) arrow.addEventListener(end, release);
    arrow.addEventListener("click", (event) => { if (event.detail === 0) this.page.wish("nudge", { by: by() }); });
  }

  key(event) {
    const writes = event.target.closest("input:not([type=radio]):not([type=checkbox]), select, textarea");
    const tab = event.target.closest("[role=tab]");
    if (writes || tab && event.key.startsWith("Arrow") || $("aim").hidden || event.ctrlKey || event.metaKey || event.altKey) return;
    const arrows = { ArrowUp: [1, 0], ArrowDown: [-1, 0], ArrowLeft: [0, 1], ArrowRight: [0, -1] };
    const keys = { m: () => this.mark(), n: () => this.chooseBy(1), p: () => this.chooseBy(-1), g: () => this.go(), l: () => this.look() };
    keys.u = () => this.page.wish("undo");
    keys.r = () => this.page.wish("redo");
    keys["+"] = () => this.zoom(0.5);
    keys["-"] = () => this.zoom(2);
    STEPS.forEach((step, i) => { keys[String(i + 1)] = () => this.setStep(step); });
    const arrow = arrows[event.key], action = keys[event.key];
    if (arrow && event.target.type === "radio") return;
    if (arrow && this.steering) this.page.wish("nudge", { by: this.steps(arrow, this.step * (event.shiftKey ? 10 : 1)) });
    else if (action && (this.steering || "np+-123".includes(event.key))) action();
    else return;
    event.preventDefault();
  }
}

/** Say how far a mark lies off where the others put it, and up to where that is usual. */
function offTold(set) {
  if (set?.off === undefined) return "";
  if (set.why) return "?";
  return `${set.off.toFixed(0)} ${set.off > set.usual ? ">" : "≤"} ${set.usual.toFixed(0)}`;
}

/** Name a mark, in the list and on the map alike. */
function nameOf({ kind, number }) {
  return `${NAMES[kind]} ${number}`;
}

/** Draw a mark: a ring for a circle, a square for a corner, a cross for all else. */
function drawMark(context, [x, y], kind, own, size) {
  const arm = 6 * size, colour = kind === "corner" ? CORNER : own;
  for (const [stroke, thick] of [["#fff", 4], [colour, 2]]) {
    context.strokeStyle = stroke;
    context.lineWidth = thick;
    context.beginPath();
    if (kind === "circle") context.arc(x, y, arm, 0, 7);
    else if (kind === "corner") context.rect(x - arm, y - arm, 2 * arm, 2 * arm);
    else {
      context.moveTo(x - arm, y - arm); context.lineTo(x + arm, y + arm);
      context.moveTo(x - arm, y + arm); context.lineTo(x + arm, y - arm);
    }
    context.stroke();
  }
}

/** Draw a name into its box. */
function drawName(context, text, colour, [left, , , bottom]) {
  context.lineWidth = 3;
  context.strokeStyle = "#fff";
  context.strokeText(text, left, bottom);
  context.fillStyle = colour;
  context.fillText(text, left, bottom);
}

/** Find a box for each name beside what it names: past the outline that its mark stands in, and off
 * all other marks, names and outlines. Of all places that cover as little as can be the nearest is
 * taken; a name that is drawn sooner does not move for a later one. */
function placeNames(context, marks, outlines, beam, size) {
  const arm = 8 * size, tall = 11 * size, { width, height } = context.canvas;
  const around = ([x, y], reach) => [x - reach, y - reach, x + reach, y + reach];
  const filled = [...marks.map((mark) => around(mark.at, arm)), around(beam, 14 * size)];
  const rims = outlines.filter((points) => points.length).map((points) => [Math.min(...points.map(([x]) => x)), Math.min(...points.map(([, y]) => y)), Math.max(...points.map(([x]) => x)), Math.max(...points.map(([, y]) => y))]);
  const area = ([a, b, c, d]) => (c - a) * (d - b);
  const covered = ([a, b, c, d], [e, f, g, h]) => Math.max(0, Math.min(c, g) - Math.max(a, e)) * Math.max(0, Math.min(d, h) - Math.max(b, f));
  const inside = ([x, y], [a, b, c, d]) => x > a && x < c && y > b && y < d;
  // Outlines of circles are covered by no name; that of the structure may have names within it.
  const small = rims.filter((rim) => marks.some(({ at, kind }) => kind === "circle" && inside(at, rim)) && area(rim) < width * height / 16);
  const away = ([x, y], [a, b, c, d]) => Math.hypot(Math.max(a - x, 0, x - c), Math.max(b - y, 0, y - d));
  const placed = [];
  for (const mark of marks) {
    const wide = context.measureText(mark.text).width;
    const own = mark.kind === "circle" ? small.find((rim) => inside(mark.at, rim)) : undefined;
    const [a, b, c, d] = own ?? around(mark.at, arm);
    let best = null;
    for (const gap of [0, 1, 2, 3].map((times) => 3 * size + times * tall)) {
      const middle = [(a + c - wide) / 2, (b + d - tall) / 2];
      for (const [left, top] of [[c + gap, b - tall], [c + gap, middle[1]], [middle[0], d + gap], [middle[0], b - gap - tall], [a - gap - wide, middle[1]], [a - gap - wide, b - tall], [c + gap, d], [a - gap - wide, d]]) {
        const box = [left, top, left + wide, top + tall];
        const out = area(box) - covered(box, [0, 0, width, height]);
        const over = (boxes) => boxes.reduce((sum, other) => sum + covered(box, other), 0);
        // Of two names over one another none can be read; marks and outlines can be seen through one.
        const cost = over([...filled, ...small]) + 10 * over(placed.map((name) => name.box)) + 2 * out;
        // A name that lies nearer to another mark would name that one.
        const misled = marks.some((other) => other !== mark && away(other.at, box) <= away(mark.at, box)) ? area(box) / 2 : 0;
        if (!best || cost + misled < best.cost) best = { cost: cost + misled, box };
      }
    }
    placed.push({ ...mark, box: best.box });
  }
  return placed;
}

function showCamera(header, [grey]) {
  const canvas = $("camera");
  $("camera-box").hidden = !grey;  // an instrument that is left or lost shows nothing
  if (!grey) return;
  canvas.width = header.columns;
  canvas.height = header.rows;
  const context = canvas.getContext("2d"), image = context.createImageData(header.columns, header.rows);
  const pixels = new Uint32Array(image.data.buffer);
  for (let i = 0; i < grey.length; i++) {
    const g = grey[i];
    pixels[i] = g === 255 ? 0xff2020ff : (255 << 24) | (g << 16) | (g << 8) | g;  // the spot is red
  }
  context.putImageData(image, 0, 0);
}
