"use strict";
// Connects the list of prototypes with the viewer. Names are only ever set as text.

const data = JSON.parse(document.getElementById("data").textContent);
const find = (id) => document.getElementById(id);
const mm = (metres) => `${(1000 * metres).toFixed(0)} mm`;
const HAND = [0.10, 0.38, 0.78];
const shown = { points: true, open: true, closed: false };
let viewer = null, selected = -1;

function make(tag, text = "", className = "") {
  const element = document.createElement(tag);
  element.textContent = text;
  if (className) element.className = className;
  return element;
}

function fillPage() {
  find("title").textContent = data.title;
  const bad = data.prototypes.filter((p) => p.findings.length).length;
  find("headline").textContent = bad ? `${bad} with findings` : "";
  find("headline").classList.toggle("empty", bad > 0);
  data.prototypes.forEach((p, i) => {
    const row = find("grasps").tBodies[0].insertRow();
    row.tabIndex = 0;
    row.append(make("td", `${i + 1}`, "number"), make("td", p.name), make("td", p.hand),
      make("td", mm(p.opening), "number"), make("td", mm(p.width), "number"));
    row.addEventListener("click", () => choose(i));
    row.addEventListener("keydown", (event) => { if (event.key === "Enter") choose(i); });
  });
  for (const [key, title] of Object.entries({ points: "surface", open: "open hand", closed: "closed hand" })) {
    const button = make("button", title);
    button.setAttribute("aria-pressed", shown[key]);
    button.addEventListener("click", () => {
      shown[key] = !shown[key];
      button.setAttribute("aria-pressed", shown[key]);
      applyShown();
    });
    find("toggles").append(button);
  }
}

function applyShown() {
  if (!viewer) return;
  viewer.set("points", { shown: shown.points });
  viewer.set("open", { shown: shown.open, alpha: shown.closed ? 0.3 : 1 });
  viewer.set("closed", { shown: shown.closed });
}

function choose(i) { location.replace(`#prototype=${i + 1}`); select(i); }

function select(i) {
  const p = data.prototypes[i];
  if (!p || i === selected) return;
  selected = i;
  const rows = [...find("grasps").tBodies[0].rows];
  rows.forEach((row, k) => row.setAttribute("aria-selected", k === i));
  rows[i].scrollIntoView({ block: "nearest" });
  const list = make("dl");
  for (const [name, value] of [["Opening", `${mm(p.opening)} → ${mm(p.width)}`], ["Kind", p.kind],
    ["Points", `${p.count}`], ["Half turns", p.turns]])
    list.append(make("dt", name), make("dd", value));
  find("details").replaceChildren(list);
  find("reasons").replaceChildren(make("p", p.description));
  for (const finding of p.findings) find("reasons").append(make("p", finding, "warn"));
  if (!viewer) return;
  const positions = positionsOf(p.points);
  viewer.points("points", { positions, colors: bytesOf(p.colors), sizes: bytesOf(p.sizes),
    kinds: new Uint8Array(positions.length / 3).fill(1), sizeStep: p.sizeStep });
  for (const key of ["open", "closed"]) viewer.mesh(key, positionsOf(p[key]), facesOf(p[key]), HAND);
  applyShown();
}

try {
  viewer = new Viewer(find("canvas"));
  viewer.lookFrom([0.28, -0.62, 0.14], [0, 0, -0.05]);
} catch (error) { find("failure").hidden = false; }
document.addEventListener("keydown", (event) => {
  const step = { ArrowDown: 1, ArrowUp: -1 }[event.key];
  if (!step || !data.prototypes[selected + step]) return;
  event.preventDefault();
  choose(selected + step);
});
fillPage();
const match = /^#prototype=(\d+)$/.exec(location.hash);
select(match && data.prototypes[match[1] - 1] ? match[1] - 1 : 0);
