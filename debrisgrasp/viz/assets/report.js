"use strict";
// Fills the page from its data and connects the table with the viewer. Text from the data
// is only ever set as text, so that a name can't be read as markup.

const data = JSON.parse(document.getElementById("data").textContent);
const find = (id) => document.getElementById(id);

function make(tag, text = "", className = "") {
  const element = document.createElement(tag);
  element.textContent = text;
  if (className) element.className = className;
  return element;
}

const mm = (metres) => `${(1000 * metres).toFixed(0)} mm`;
const rgb = (hex) => [1, 3, 5].map((i) => parseInt(hex.slice(i, i + 2), 16) / 255);
const SELECTED = rgb("#1a62c6"), OTHERS = rgb("#7f8ea3"), ARROW = rgb("#0f3f80");
const REACH = rgb("#1a86b8"), REGION = rgb("#5b6c86"), GRID = rgb("#a9b2bf");

// Rows of a 4x4 pose to the columns that WebGL takes.
const columns = (pose) => [0, 1, 2, 3].flatMap((c) => pose.map((row) => row[c]));

function fillPage() {
  find("title").textContent = data.title;
  find("summary").textContent = data.summary;
  find("doubt").textContent = data.doubt;
  find("headline").textContent = data.headline;
  find("headline").classList.toggle("empty", !data.grasps.length);
  for (const line of [data.reason, ...data.passedOver]) if (line) find("reasons").append(make("p", line));
  for (const line of data.advice) find("advice").append(make("li", line));
  find("help").hidden = !data.advice.length;

  const body = find("grasps").tBodies[0];
  for (const grasp of data.grasps) {
    const row = body.insertRow();
    row.tabIndex = 0;
    row.append(make("td", grasp.rank, "number"), make("td", grasp.prototype),
      make("td", `${grasp.arm ?? ""} ${grasp.gripper} ${grasp.preshape}`));
    for (const key of ["S", "C", "R", "Q", "score"]) row.append(make("td", grasp[key].toFixed(2), "number"));
    row.addEventListener("click", () => choose(grasp.rank));
    row.addEventListener("keydown", (event) => { if (event.key === "Enter") choose(grasp.rank); });
  }
  find("table-box").hidden = find("next").hidden = !data.grasps.length;

  const image = data.image;
  find("image").src = `data:image/jpeg;base64,${image.jpeg}`;
  const rank = ([label, place]) => (label === data.chosen ? 0 : place || 1e9);
  for (const [label, place, u, v] of image.labels.sort((a, b) => rank(a) - rank(b))) {
    const mark = make("span", place ? `${place}: #${label}` : `#${label}`, label === data.chosen ? "chosen" : "");
    Object.assign(mark.style, { left: `clamp(32px, ${100 * u}%, 100% - 32px)`, top: `clamp(9px, ${100 * v}%, 100% - 9px)` });
    find("picture").append(mark);
  }
  new ResizeObserver(thinLabels).observe(find("picture"));
  find("picture-note").textContent =
    (image.fromCamera ? "The camera's picture. " : "Rendered from the viewpoint of the cloud. ") +
    "Place in the order: #label; the chosen object is outlined in orange.";

  data.order.forEach(([label, reason], i) => {
    const row = find("order").tBodies[0].insertRow();
    row.className = label === data.chosen ? "chosen" : "";
    row.append(make("td", `${i + 1}`), make("td", `#${label}`), make("td", reason));
  });
  const total = data.rejections.reduce((sum, [, n]) => sum + n, 0);
  for (const [reason, n] of data.rejections) {
    const row = find("rejections").tBodies[0].insertRow(), cell = make("td", reason);
    const bar = make("div", "", "bar");
    bar.style.width = `${100 * n / total}%`;
    cell.append(bar);
    row.append(cell, make("td", n.toLocaleString("en"), "number"));
  }
  if (!total) find("rejections").tBodies[0].insertRow().append(make("td", "none"));
}

// Of labels that would cover one another, the one earlier in the order stays.
function thinLabels() {
  const kept = [];
  for (const mark of find("picture").querySelectorAll("span")) {
    const box = mark.getBoundingClientRect();
    const isFree = kept.every((other) => box.left > other.right || box.right < other.left ||
      box.top > other.bottom || box.bottom < other.top);
    mark.style.visibility = isFree ? "" : "hidden";
    if (isFree) kept.push(box);
  }
}

function fillDetails(grasp) {
  const box = find("details"), list = make("dl"), pose = grasp.pose;
  box.replaceChildren(list);
  const place = [0, 1, 2].map((i) => pose[i][3].toFixed(3)).join(", ");
  const down = Math.acos(Math.max(-1, Math.min(1, -pose[2][2]))) * 180 / Math.PI;
  const rows = [
    ["Score", grasp.score.toFixed(3)], ["Q = S C R", `${grasp.Q.toFixed(3)} = ${["S", "C", "R"].map((k) => grasp[k].toFixed(2)).join(" · ")}`],
    ["Opening", mm(grasp.opening)], ["Closed", mm(grasp.width)],
    ["Approach", `${mm(grasp.approach)}, ${down.toFixed(0)}° from down`], ["Arm", grasp.arm ?? "floating hand"],
    ["Palm", `${place} m`], ...grasp.load,
  ];
  for (const [name, value] of rows) list.append(make("dt", name), make("dd", value));
  if (!grasp.joints.length) return;
  const more = make("details"), table = make("table");
  more.append(make("summary", "Joint values"), table);
  for (const [name, value] of grasp.joints) {
    const row = table.insertRow();
    row.append(make("td", name), make("td", `${value.toFixed(4)}`, "number"),
      make("td", `${(value * 180 / Math.PI).toFixed(1)}°`, "number"));
  }
  box.append(more);
}

let viewer = null, selected = 0, robotParts = null;
const shown = { segments: true, ground: true, picture: false, region: true, others: false, robot: true, approach: true, reach: true };

function startViewer() {
  try { viewer = new Viewer(find("canvas")); } catch (error) { find("failure").hidden = false; return; }
  const dark = window.matchMedia("(prefers-color-scheme: dark)");
  const paint = () => { viewer.background = dark.matches ? [0.11, 0.13, 0.17] : [0.957, 0.965, 0.976]; viewer.redraw(); };
  dark.addEventListener("change", paint);
  paint();
  putCloud();
  viewer.lines("grid", positionsOf(data.lines.grid), GRID, { alpha: 0.5 });
  viewer.lines("region", positionsOf(data.lines.region), REGION);
  if (data.robot) {
    robotParts = {
      positions: positionsOf(data.robot), faces: facesOf(data.robot),
      owners: new Uint16Array(bytesOf(data.robot.owners).buffer),
      postures: new Float32Array(bytesOf(data.robot.postures).buffer),
    };
    putRobot(0);
  }
  for (const grasp of data.grasps) {
    const hand = data.hands[grasp.hand];
    if (hand) viewer.mesh(`hand ${grasp.rank}`, positionsOf(hand), facesOf(hand), OTHERS, { model: columns(grasp.pose) });
  }
  makeButtons();
  lookFromSide(data.robot ? 50 : 20);
}

function putCloud() {
  const cloud = data.cloud;
  viewer.points("cloud", {
    positions: positionsOf(cloud), colors: bytesOf(shown.picture ? cloud.seen : cloud.colors),
    kinds: bytesOf(cloud.kinds), sizes: bytesOf(cloud.sizes), sizeStep: cloud.sizeStep,
  });
}

function putRobot(posture) {
  const { positions, faces, owners, postures } = robotParts, out = new Float32Array(positions.length);
  for (let i = 0; i < owners.length; i++) {
    const m = 12 * (posture * data.robot.nLinks + owners[i]);
    for (let r = 0; r < 3; r++)
      out[3 * i + r] = postures[m + 4 * r] * positions[3 * i] + postures[m + 4 * r + 1] * positions[3 * i + 1] +
        postures[m + 4 * r + 2] * positions[3 * i + 2] + postures[m + 4 * r + 3];
  }
  viewer.mesh("robot", out, faces, rgb(data.robot.color), { shown: shown.robot });
}

function applyShown() {
  viewer.kinds = [shown.ground, shown.segments, true].map(Number);
  viewer.set("region", { shown: shown.region });
  viewer.set("grid", { shown: shown.ground });
  viewer.set("robot", { shown: shown.robot });
  viewer.set("arrow", { shown: shown.approach });
  viewer.set("reach", { shown: shown.reach });
  for (const { rank } of data.grasps) {
    const isSelected = rank === selected;
    viewer.set(`hand ${rank}`, { shown: isSelected || shown.others, alpha: isSelected ? 1 : 0.22, color: isSelected ? SELECTED : OTHERS });
  }
}

function makeButtons() {
  const names = { segments: "other segments", ground: "ground, obstacles", picture: "camera colours", region: "region V" };
  if (data.grasps.length) Object.assign(names, { others: "all hands", approach: "approach" });
  if (data.robot) names.robot = "robot";
  if (data.robot && data.grasps.length) names.reach = "reach";
  for (const [key, title] of Object.entries(names)) {
    const button = make("button", title);
    button.setAttribute("aria-pressed", shown[key]);
    button.addEventListener("click", () => {
      shown[key] = !shown[key];
      button.setAttribute("aria-pressed", shown[key]);
      if (key === "picture") putCloud();
      applyShown();
    });
    find("toggles").append(button);
  }
  const views = { camera: lookFromCamera, side: () => lookFromSide(), above: lookFromAbove, hand: lookAtHand };
  if (data.robot) views.robot = lookAtRobot;
  if (!data.grasps.length) delete views.hand;
  for (const [title, look] of Object.entries(views)) {
    const button = make("button", title);
    button.addEventListener("click", look);
    find("views").append(button);
  }
}

// Middle and size of the chosen object, or of all points.
function focus() {
  const kinds = bytesOf(data.cloud.kinds), all = positionsOf(data.cloud);
  const wanted = kinds.includes(2) ? 2 : kinds.includes(1) ? 1 : 0;
  const low = [Infinity, Infinity, Infinity], high = [-Infinity, -Infinity, -Infinity];
  kinds.forEach((kind, i) => {
    if (kind === wanted) for (let k = 0; k < 3; k++) {
      low[k] = Math.min(low[k], all[3 * i + k]);
      high[k] = Math.max(high[k], all[3 * i + k]);
    }
  });
  if (!Number.isFinite(low[0])) return { center: [0, 0, 0], size: 1 };
  return { center: low.map((x, k) => (x + high[k]) / 2), size: Math.hypot(...subtract(high, low)) };
}

function lookTowards(target, direction, distance, cut) {
  viewer.lookFrom(unit(direction).map((x, k) => target[k] + distance * x), target, cut);
}

function sight() {
  const { center, size } = focus(), back = unit(subtract(data.viewpoint, center));
  return { center, distance: Math.max(1.9 * size, 0.5), back: [back[0], back[1], Math.max(back[2], 0.35)] };
}

// The robot stands where the camera looks from; the cut takes its head out of the way.
function lookFromCamera() { const s = sight(); lookTowards(s.center, s.back, s.distance, data.robot ? 0.68 : 0.02); }

// From the side on which the arm works.
function lookFromSide(angle = 60) {
  const s = sight(), turn = (data.grasps[0]?.arm?.includes("left") ? -1 : 1) * angle * Math.PI / 180;
  const [x, y] = s.back, cos = Math.cos(turn), sin = Math.sin(turn);
  lookTowards(s.center, [cos * x - sin * y, sin * x + cos * y, Math.min(s.back[2], 0.55)], s.distance);
}

function lookFromAbove() {
  const s = sight();
  viewer.lookFrom([s.center[0] - 1e-3, s.center[1], s.center[2] + 1.3 * s.distance], s.center);
}

function lookAtHand() {
  const pose = data.grasps[selected - 1].pose, s = sight();
  const palm = pose.slice(0, 3).map((row) => row[3] + 0.06 * row[2]);
  let across = pose.slice(0, 3).map((row) => row[1]);
  if (dot(across, s.back) < 0) across = across.map((x) => -x);
  const back = across.map((x, k) => x + 0.5 * s.back[k]);
  lookTowards(palm, [back[0], back[1], Math.max(back[2], 0.3)], 0.75);
}

function lookAtRobot() {
  const { center } = focus(), target = center.map((x) => x / 2);
  lookTowards([target[0], target[1], 0.5], [0.35, center[1] > 0 ? 1 : -1, 0.45], 3.4);
}

function choose(rank) { location.replace(`#grasp=${rank}`); select(rank); }

function select(rank) {
  const grasp = data.grasps[rank - 1];
  if (!grasp || rank === selected) return;
  selected = rank;
  [...find("grasps").tBodies[0].rows].forEach((row, i) => row.setAttribute("aria-selected", i + 1 === rank));
  find("grasps").tBodies[0].rows[rank - 1].scrollIntoView({ block: "nearest" });
  fillDetails(grasp);
  if (!viewer) return;
  viewer.mesh("arrow", positionsOf(grasp.arrow), facesOf(grasp.arrow), ARROW);
  if (robotParts) putRobot(rank);
  const reach = data.lines.reach[grasp.arm];
  viewer.lines("reach", reach ? positionsOf(reach) : new Float32Array(), REACH);
  applyShown();
}

function selectFromAddress() {
  const match = /^#grasp=(\d+)$/.exec(location.hash);
  select(match && data.grasps[match[1] - 1] ? Number(match[1]) : 1);
}

document.addEventListener("keydown", (event) => {
  const step = { ArrowDown: 1, ArrowUp: -1 }[event.key];
  if (!step || !data.grasps[selected - 1 + step]) return;
  event.preventDefault();
  choose(selected + step);
});
window.addEventListener("hashchange", selectFromAddress);
fillPage();
startViewer();
selectFromAddress();
