"use strict";
// Turns clicks into observations. Points are shown with the camera's y axis downwards.

const data = JSON.parse(document.getElementById("data").textContent);
const find = (id) => document.getElementById(id);
const views = data.views.map((view) => ({ ...view, points: positionsOf(view.cloud), pick: null, from: "" }));
let current = 0, viewer = null;

const SHOWN = [0, 0, 1, -1, 0, 0, 0, -1, 0];  // rows: camera z, -x, -y
const shownOf = (p) => [0, 3, 6].map((r) => SHOWN[r] * p[0] + SHOWN[r + 1] * p[1] + SHOWN[r + 2] * p[2]);

// Depth farther from a click than this many pixels belongs to something else.
const FARTHEST = 6, FEWEST = 4;

function median(values) {
  const sorted = [...values].sort((a, b) => a - b), n = sorted.length;
  return n % 2 ? sorted[(n - 1) / 2] : (sorted[n / 2 - 1] + sorted[n / 2]) / 2;
}

// Depth of a pixel: median over a ring of the foremost surface there.
function pickInPicture(u, v) {
  const view = views[current], [fx, fy, cx, cy] = view.camera, p = view.points;
  const depths = [];
  for (let i = 0; i < p.length; i += 3) {
    const du = fx * p[i] / p[i + 2] + cx - u, dv = fy * p[i + 1] / p[i + 2] + cy - v;
    const away = du * du + dv * dv;
    if (away >= 4 && away <= FARTHEST * FARTHEST) depths.push(p[i + 2]);
  }
  if (depths.length < FEWEST) return tell(`no depth here: hardly any within ${FARTHEST} pixels`);
  depths.sort((a, b) => a - b);
  const near = depths[Math.floor(0.25 * depths.length)];
  const surface = depths.filter((z) => Math.abs(z - near) < 0.02 * near);
  const z = median(surface);
  take([(u - cx) / fx * z, (v - cy) / fy * z, z], `ring of ${surface.length}`);
}

function pickInSpace(x, y) {
  const p = views[current].points, { back, right, up } = viewer.axes(), eye = viewer.eye();
  const canvas = find("canvas"), f = 1 / Math.tan(0.35) * canvas.clientHeight / 2;
  const left = x - canvas.clientWidth / 2, top = canvas.clientHeight / 2 - y;
  let best = -1, least = Infinity;
  for (let i = 0; i < p.length; i += 3) {
    const d = subtract(shownOf([p[i], p[i + 1], p[i + 2]]), eye), depth = -dot(d, back);
    if (depth < 0.02) continue;
    const away = Math.hypot(f * dot(d, right) / depth - left, f * dot(d, up) / depth - top);
    // A few pixels beside the click count as much as a centimetre of depth.
    if (away < 9 && depth + 0.003 * away < least) { least = depth + 0.003 * away; best = i; }
  }
  if (best < 0) return tell("No point lies there.");
  const sum = [0, 0, 0], at = [p[best], p[best + 1], p[best + 2]];
  let n = 0;
  for (let i = 0; i < p.length; i += 3)
    if (Math.hypot(p[i] - at[0], p[i + 1] - at[1], p[i + 2] - at[2]) < 0.008) {
      for (let k = 0; k < 3; k++) sum[k] += p[i + k];
      n++;
    }
  take(sum.map((s) => s / n), `${n} points`);
}

function take(point, from) {
  const view = views[current], isNew = !view.pick;
  Object.assign(view, { pick: point, from });
  // A second pick in one view mends the first: stay there.
  const n = views.length, next = views.findIndex((_, k) => k > current && !views[k].pick);
  const open = next >= 0 ? next : views.findIndex((other) => !other.pick);
  if (isNew && open >= 0) show(open); else refresh();
  const place = point.map((x, k) => `${"xyz"[k]} ${x.toFixed(4)}`).join("   ") + " m";
  tell(n > 1 ? `${view.observation.name}:   ${place}` : place);
}

function tell(text) { find("picked").textContent = text; }

function fileText() {
  const observations = views.filter((v) => v.pick).map((v) =>
    ({ ...v.observation, point: v.pick.map((x) => Number(x.toFixed(5))) }));
  return JSON.stringify({ ...data.header, observations }, null, 1) + "\n";
}

function refresh() {
  const body = find("rows").tBodies[0];
  body.replaceChildren();
  views.forEach((view, i) => {
    const row = body.insertRow();
    row.setAttribute("aria-selected", i === current);
    const numbers = view.pick ? view.pick.map((x) => x.toFixed(4)) : ["", "", ""];
    for (const [k, text] of [view.observation.name, view.name, ...numbers, view.from].entries()) {
      const cell = row.insertCell();
      cell.textContent = text;
      if (k > 1 && k < 5) cell.className = "number";
    }
    row.addEventListener("click", () => show(i));
  });
  find("file").value = fileText();
  for (const mark of document.querySelectorAll("#frame .mark")) mark.remove();
  const { pick, camera } = views[current];
  if (pick && camera) {
    const mark = document.createElement("span"), [fx, fy, cx, cy, width, height] = camera;
    mark.className = "mark";
    mark.style.left = `${100 * (fx * pick[0] / pick[2] + cx + 0.5) / width}%`;
    mark.style.top = `${100 * (fy * pick[1] / pick[2] + cy + 0.5) / height}%`;
    find("frame").append(mark);
  }
  if (!viewer) return;
  const cross = [];
  if (pick) for (let k = 0; k < 3; k++) for (const side of [-0.03, 0.03])
    cross.push(...shownOf(pick.map((x, i) => x + (i === k ? side : 0))));
  viewer.lines("pick", new Float32Array(cross), [1, 0.3, 0]);
}

function show(index) {
  current = index;
  const view = views[index];
  find("frame").hidden = !view.picture;
  find("no-picture").hidden = Boolean(view.picture);
  if (view.picture) find("image").src = `data:image/jpeg;base64,${view.picture}`;
  if (viewer) {
    const positions = new Float32Array(view.points.length), middle = [0, 0, 0];
    for (let i = 0; i < positions.length; i += 3) {
      const p = shownOf([view.points[i], view.points[i + 1], view.points[i + 2]]);
      for (let k = 0; k < 3; k++) { positions[i + k] = p[k]; middle[k] += 3 * p[k] / positions.length; }
    }
    viewer.points("cloud", {
      positions, colors: bytesOf(view.cloud.colors), kinds: new Uint8Array(positions.length / 3),
      sizes: bytesOf(view.cloud.sizes), sizeStep: view.cloud.sizeStep,
    });
    viewer.lookFrom([-0.15, 0, 0.1], middle);
  }
  tell("");
  refresh();
}

find("frame").addEventListener("click", (event) => {
  const box = find("image").getBoundingClientRect(), [, , , , width, height] = views[current].camera;
  pickInPicture((event.clientX - box.left) / box.width * width - 0.5, (event.clientY - box.top) / box.height * height - 0.5);
});
find("copy").addEventListener("click", () => {
  find("file").select();
  navigator.clipboard?.writeText(fileText()).then(() => { find("said").textContent = "copied"; });
});
find("save").addEventListener("click", () => {
  const link = document.createElement("a");
  link.href = "data:application/json;charset=utf-8," + encodeURIComponent(fileText());
  link.download = "observations.json";
  link.click();
});
try {
  viewer = new Viewer(find("canvas"));
  let down = null;
  find("canvas").addEventListener("pointerdown", (event) => { down = [event.offsetX, event.offsetY]; });
  find("canvas").addEventListener("click", (event) => {
    if (down && Math.hypot(event.offsetX - down[0], event.offsetY - down[1]) < 4) pickInSpace(event.offsetX, event.offsetY);
  });
} catch (error) { find("failure").hidden = false; }
show(0);
