// The page as a whole: the line to the console, who steers, and the tabs.

import { Aim } from "./aim.js";
import { Link } from "./link.js";
import { Scan } from "./scan.js";

const $ = (id) => document.getElementById(id);
const page = { role: "watcher", known: {}, wish, say };
const watchOnly = new URLSearchParams(location.hash.slice(1)).has("watch");
const aim = new Aim(page), scan = new Scan(page);

/** Wish something of the console; what it refused before is overtaken. */
function wish(what, more) {
  if (page.refused) say("");
  link.wish(what, more);
}

/** Show a sentence; a problem is set apart. */
function say(text, problem = false) {
  $("said").textContent = text;
  $("said").className = problem ? "problem" : "";
  page.refused = false;
}

function showRole(role) {
  const changed = role !== page.role;
  page.role = role;
  showWho();
  if (changed) update();
}

function showWho() {
  const who = page.known.who ?? { steered: false, browsers: 1 };
  const others = who.browsers > 1 ? `; ${who.browsers} browsers are here` : "";
  const steering = page.role === "controller";
  const told = steering ? "You are steering" : who.steered ? "You are watching; somebody else is steering" : "You are watching; nobody is steering";
  if (page.connected) $("who").textContent = told + others;
  $("take").hidden = steering || who.steered || !page.connected;
  $("leave").hidden = !steering;
}

/** Enable what can be done now. */
function update() {
  const steering = page.role === "controller" && page.connected;
  for (const control of document.querySelectorAll(".steers")) control.disabled = !steering;
  for (const control of document.querySelectorAll("#name, #replace, #answer, #anew")) control.disabled = !steering;
  aim.update(steering);
  scan.update(steering);
}

function choose(tab) {
  if ($(tab).hidden) scrollTo(0, 0);  // where the last tab stood is nothing to this one
  for (const each of document.querySelectorAll("[role=tab]")) {
    const chosen = each.id === `tab-${tab}`;
    each.setAttribute("aria-selected", String(chosen));
    each.tabIndex = chosen ? 0 : -1;
    $(each.getAttribute("aria-controls")).hidden = !chosen;
  }
}
page.choose = choose;

const tabs = [...document.querySelectorAll("[role=tab]")];
for (const [i, tab] of tabs.entries()) {
  tab.addEventListener("click", () => choose(tab.id.slice(4)));
  tab.addEventListener("keydown", (event) => {
    const by = { ArrowRight: 1, ArrowLeft: -1 }[event.key];
    if (!by) return;
    event.preventDefault();
    event.stopPropagation();
    const next = tabs[(i + by + tabs.length) % tabs.length];
    choose(next.id.slice(4));
    next.focus();
  });
}

/** Show advice on stands, and its figure if there is one: each has an address of its own. */
function showPlan({ told, figure }) {
  $("planned").replaceChildren(...told.map((text) => Object.assign(document.createElement("p"), { textContent: text })));
  $("plan-link").hidden = true;  // the last one's figure does not stand under what is told now
  if (!figure) return;
  $("plan-narrow").srcset = `narrow_plan.png?${figure}`;
  $("plan-figure").src = $("plan-link").href = `plan.png?${figure}`;
}

$("plan-figure").addEventListener("load", () => { $("plan-link").hidden = false; });

const topics = {
  who: showWho,
  said: (word) => say(word.text, word.problem),
  phase({ tab, count }) { if (count !== page.phase) choose(tab); page.phase = count; },
  planned: showPlan,
  result: (word) => scan.result(word),
};

const link = new Link({
  open() {
    page.connected = true;
    if (!watchOnly) link.wish("take");
    showWho();
  },
  lost() {
    page.connected = false;
    page.role = "watcher";
    const resume = page.known.scan?.running ? `: ${page.known.scan.resume}` : "";
    $("who").textContent = `The connection is lost; trying again … A console that still runs sends the mirrors home. Where it has ended, see to them, start it anew and open the address that it prints${resume}`;
    $("take").hidden = $("leave").hidden = true;
    update();
  },
  role: showRole,
  refused: (why) => { say(why, true); page.refused = true; },
  topic(name, word) {
    page.known[name] = word;
    (topics[name] ?? aim.topics[name] ?? scan.topics[name] ?? (() => {}))(word);
    update();
  },
  picture(header, arrays) { (aim.pictures[header.picture] ?? scan.pictures[header.picture] ?? (() => {}))(header, arrays); },
});

$("examine").addEventListener("click", () => link.wish("plan"));
$("take").addEventListener("click", () => link.wish("take"));
$("leave").addEventListener("click", () => link.wish("leave"));
update();
