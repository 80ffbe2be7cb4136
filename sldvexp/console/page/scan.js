// The scan: how far it is, the velocity image as it grows, and what can be wished.

import { Cells, atFrequency, paintRamp } from "./cells.js";

const $ = (id) => document.getElementById(id);

/** Make pairs of a list of descriptions. */
function pairs(entries) {
  return entries.map(([name, value]) => {
    const pair = document.createElement("div"), dt = document.createElement("dt"), dd = document.createElement("dd");
    dt.textContent = name;
    dd.textContent = value;
    pair.append(dt, dd);
    return pair;
  });
}

export class Scan {
  constructor(page) {
    this.page = page;
    this.image = new Cells($("image"), () => { $("image").dataset.cells = this.image.count; });
    $("image").cells = this.image;
    paintRamp($("image-ramp"));
    this.topics = {
      scan: (word) => this.show(word),
      ask: (word) => this.ask(word),
      done: (word) => this.done(word),
      ahead: (word) => this.ahead(word),
    };
    this.pictures = { image: (header, arrays) => this.grow(header, arrays) };
    for (const id of ["pause", "again", "skip", "stop"]) $(id).addEventListener("click", () => this.page.wish(id));
    $("go-on").addEventListener("click", () => this.page.wish("go_on"));
    $("again-bad").addEventListener("click", () => this.page.wish("again_bad"));
    $("anew").addEventListener("change", () => this.showNext());
    const reply = () => { this.page.wish("answer", { text: $("answer").value }); $("answer").value = ""; };
    $("reply").addEventListener("click", reply);
    $("answer").addEventListener("keydown", (event) => { if (event.key === "Enter") reply(); });
  }

  update(steering) {
    const now = this.now ?? {}, free = now.running && !this.asked;  // who is asked answers first
    const can = { pause: free && !now.paused, "go-on": now.paused || now.resumable && !now.running, again: free, "again-bad": free, skip: free, stop: now.running };
    for (const [id, possible] of Object.entries(can)) $(id).disabled = !(steering && possible);
  }

  show(word) {
    this.now = word;
    $("progress").value = word.part ?? 0;
    $("progress-told").textContent = word.told;
    $("facts").replaceChildren(...pairs(Object.entries(word.facts ?? {})));
  }

  /** Say what the next scan takes and keeps, and what Go on makes of places that were aimed anew since. */
  ahead(word) {
    this.next = word;
    $("go-on-told").textContent = word.go_on;
    $("go-on-told").hidden = !word.go_on;
    $("anew-box").hidden = !word.keep.length;
    if (!word.keep.length) $("anew").checked = false;
    this.showNext();
  }

  showNext() { $("start").textContent = $("anew").checked ? "Scan all views anew" : this.next?.label ?? "Scan"; }

  ask(word) {
    this.asked = Boolean(word);
    $("ask").hidden = !word;
    if (!word) return;
    $("asked").textContent = word.text;
    $("answer-box").hidden = !word.answer;
    this.page.choose("scan");
  }

  /** Tell of the view that was done last, or of the one that was chosen since. */
  done(views) {
    if (views.length !== this.views?.length) this.told = views.at(-1)?.name;
    this.views = views;
    const choices = views.map(({ name }) => {
      const choice = Object.assign(document.createElement("button"), { type: "button", textContent: `View ${name}` });
      choice.dataset.name = name;
      choice.addEventListener("click", () => { this.told = name; this.showDone(); });
      return choice;
    });
    const lists = views.map(({ name, told }) => {
      const list = document.createElement("ul");
      list.dataset.name = name;
      list.append(...told.map((text) => Object.assign(document.createElement("li"), { textContent: text })));
      return list;
    });
    const within = $("views-done").contains(document.activeElement) && document.activeElement.dataset.name;
    $("views-told").replaceChildren(...choices);
    $("views-done").hidden = !views.length;
    $("views-lists").replaceChildren(...lists);
    this.showDone();
    if (within) choices.find((choice) => choice.dataset.name === within)?.focus();
  }

  showDone() {
    for (const choice of $("views-told").children) choice.setAttribute("aria-pressed", String(choice.dataset.name === this.told));
    for (const list of $("views-lists").children) list.hidden = list.dataset.name !== this.told;
  }

  grow(header, [dac, value, flag]) {
    if (header.begin) {
      this.image.forget();
      if (header.low) this.image.show(header.low, header.high);
      return;
    }
    this.image.add(dac, value, flag, header.tall, header.wide);
    $("image-range").textContent = `0 to ${this.image.top.toPrecision(3)} mm/s ${atFrequency(header)}; grey: not to be trusted, green: over the range`;
  }

  result(word) {
    $("result-told").textContent = word.told;
    $("result-lines").replaceChildren(...pairs(word.lines ?? []));
    $("report").hidden = !word.page;
  }
}
