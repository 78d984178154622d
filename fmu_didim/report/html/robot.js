"use strict";
(() => {
/* Draws a robot whose frame j follows from frame j-1 by Tx(a) Rx(alpha) Ry(beta) Rz(theta) Tz(d), seen from far away. */
const robot = JSON.parse(document.getElementById("robot-data").textContent), place = document.getElementById("robot");
const canvas = place.querySelector("canvas"), pen = canvas.getContext("2d");
const shown = { frames: true, axes: true, ellipsoids: true, labels: true };
const q = robot.joints.map(j => Math.min(Math.max(0, j.low), j.high));
let azimuth = 0.6, elevation = 0.35, zoom = 1;
const times = (m, v) => m.map(row => row.reduce((sum, x, k) => sum + x * v[k], 0));
const product = (a, b) => a.map(row => b[0].map((_, k) => row.reduce((sum, x, i) => sum + x * b[i][k], 0)));
const add = (a, b, f = 1) => a.map((x, k) => x + f * b[k]);
const dot = (a, b) => a.reduce((sum, x, k) => sum + x * b[k], 0);
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const unit = v => { const size = Math.hypot(...v); return size > 0 ? v.map(x => x / size) : null; };
function frames(position) {
  let turn = [[1, 0, 0], [0, 1, 0], [0, 0, 1]], origin = [0, 0, 0];
  const found = [{ turn, origin }];
  robot.joints.forEach((j, k) => {
    const turns = j.type === "revolute", theta = j.theta + (turns ? position[k] : 0), d = j.d + (turns ? 0 : position[k]);
    const ca = Math.cos(j.alpha), sa = Math.sin(j.alpha), cb = Math.cos(j.beta), sb = Math.sin(j.beta), ct = Math.cos(theta), st = Math.sin(theta);
    origin = add(origin, times(turn, [j.a + d * sb, -d * sa * cb, d * ca * cb]));
    turn = product(turn, product([[cb, 0, sb], [sa * sb, ca, -sa * cb], [-ca * sb, sa, ca * cb]], [[ct, -st, 0], [st, ct, 0], [0, 0, 1]]));
    found.push({ turn, origin });
  });
  return found;
}
function extent() { /* middle and half of what is drawn at first */
  const low = [Infinity, Infinity, Infinity], high = [-Infinity, -Infinity, -Infinity];
  frames(q).forEach((f, k) => {
    const e = k && robot.joints[k - 1].ellipsoid, far = e ? Math.max(...e.radii) : 0, centre = e ? add(f.origin, times(f.turn, e.centre)) : f.origin;
    [f.origin.map(x => [x, x]), centre.map(x => [x - far, x + far])].forEach(box => box.forEach(([a, b], i) => { low[i] = Math.min(low[i], a); high[i] = Math.max(high[i], b); }));
  });
  return { middle: add(low, high).map(x => x / 2), size: Math.hypot(...add(high, low, -1)) / 2 || 1 };
}
const { middle, size } = extent();
function view() { /* right, up and towards the eye, in the frame of the base */
  const up = unit(robot.gravity.map(g => -g)) || [0, 0, 1];
  const first = [[1, 0, 0], [0, 1, 0], [0, 0, 1]].sort((a, b) => Math.abs(dot(a, up)) - Math.abs(dot(b, up)))[0];
  const east = unit(cross(up, cross(first, up))), north = cross(up, east);
  const level = add(east.map(x => x * Math.cos(azimuth)), north, Math.sin(azimuth)), side = add(east.map(x => -x * Math.sin(azimuth)), north, Math.cos(azimuth));
  const eye = add(level.map(x => x * Math.cos(elevation)), up, Math.sin(elevation));
  return [side, cross(eye, side), eye];
}
function draw() {
  const ratio = devicePixelRatio || 1, width = canvas.clientWidth, height = canvas.clientHeight, style = getComputedStyle(document.documentElement);
  canvas.width = width * ratio; canvas.height = height * ratio; pen.setTransform(ratio, 0, 0, ratio, 0, 0);
  const colour = name => style.getPropertyValue(name).trim(), seen = view(), f = 0.42 * Math.min(width, height) / size * zoom;
  const to = p => { const [x, y] = times(seen, add(p, middle, -1)); return [width / 2 + f * x, height / 2 - f * y]; };
  const line = (points, stroke, thick, dash = []) => {
    pen.beginPath(); points.forEach((p, k) => pen[k ? "lineTo" : "moveTo"](...to(p)));
    pen.strokeStyle = stroke; pen.lineWidth = thick; pen.setLineDash(dash); pen.stroke(); pen.setLineDash([]);
  };
  pen.clearRect(0, 0, width, height); pen.lineCap = "round"; pen.font = "13px system-ui, sans-serif";
  const at = frames(q), down = unit(robot.gravity), short = 0.09 * size;
  if (down) { const from = [0, 0, 0], end = add(from, down, 0.3 * size); line([from, end], colour("--faint"), 1.5, [2, 5]); pen.fillStyle = colour("--faint"); pen.fillText("gravity", ...add(to(end), [5, 4])); }
  if (shown.ellipsoids) {
    const bodies = at.slice(1).map((frame, k) => ({ frame, k, e: robot.joints[k].ellipsoid })).filter(b => b.e);
    bodies.forEach(b => { b.centre = add(b.frame.origin, times(b.frame.turn, b.e.centre)); });
    bodies.sort((a, b) => dot(seen[2], a.centre) - dot(seen[2], b.centre)).forEach(b => {
      const m = product(product(seen.slice(0, 2), b.frame.turn), b.e.axes.map(row => row.map((x, k) => x * b.e.radii[k])));
      const xx = dot(m[0], m[0]), xy = dot(m[0], m[1]), yy = dot(m[1], m[1]), l = Math.sqrt(xx) || 1e-12, s = Math.sqrt(Math.max(yy - xy * xy / xx || 0, 0));
      const [cx, cy] = to(b.centre), tone = colour(`--series${b.k % 8}`);
      pen.beginPath();
      for (let k = 0; k <= 64; k++) { const c = Math.cos(k * Math.PI / 32), n = Math.sin(k * Math.PI / 32); pen[k ? "lineTo" : "moveTo"](cx + f * l * c, cy - f * (xy / l * c + s * n)); }
      pen.globalAlpha = 0.22; pen.fillStyle = tone; pen.fill(); pen.globalAlpha = 0.9; pen.strokeStyle = tone; pen.lineWidth = 1.2; pen.stroke(); pen.globalAlpha = 1;
      pen.beginPath(); pen.arc(cx, cy, 3, 0, 7); pen.fillStyle = tone; pen.fill();
    });
  }
  line(at.map(frame => frame.origin), colour("--measured"), 5);
  at.forEach((frame, k) => {
    const along = axis => [frame.turn[0][axis], frame.turn[1][axis], frame.turn[2][axis]];
    if (k && shown.axes) { const z = along(2); line([add(frame.origin, z, -2.2 * short), add(frame.origin, z, 2.2 * short)], colour("--axis"), 1.3, robot.joints[k - 1].type === "prismatic" ? [6, 5] : []); }
    if (shown.frames) ["#d03b2f", "#2f8f3a", "#2f62d0"].forEach((tone, axis) => line([frame.origin, add(frame.origin, along(axis), short)], tone, 2.2));
    const [x, y] = to(frame.origin);
    pen.beginPath(); pen.arc(x, y, k ? 4.5 : 6, 0, 7); pen.fillStyle = colour("--paper"); pen.fill(); pen.strokeStyle = colour("--ink"); pen.lineWidth = 1.6; pen.setLineDash([]); pen.stroke();
    if (shown.labels) {
      const same = at.slice(0, k).filter(other => Math.hypot(...add(to(other.origin), [x, y], -1)) < 6).length;
      pen.fillStyle = colour("--ink"); pen.fillText(k ? String(k) : "base", x + 9 + 14 * same + (same && Math.hypot(...add(to(at[0].origin), [x, y], -1)) < 6 && k ? 22 : 0), y - 8);
    }
  });
}
const reading = (j, value) => j.type === "revolute" ? `${(value * 180 / Math.PI).toFixed(1)}°` : `${value.toFixed(3)} m`;
const sliders = place.querySelector(".sliders");
robot.joints.forEach((j, k) => {
  const label = document.createElement("label"), name = document.createElement("span"), input = document.createElement("input"), output = document.createElement("output");
  name.textContent = `joint ${k + 1}${j.limits ? "" : ", no limits"}`; name.title = j.name;
  Object.assign(input, { type: "range", min: j.low, max: j.high, step: (j.high - j.low) / 720, value: q[k] });
  input.addEventListener("input", () => { q[k] = Number(input.value); output.textContent = reading(j, q[k]); draw(); });
  output.textContent = reading(j, q[k]); label.append(name, input, output); sliders.append(label);
});
Object.keys(shown).forEach(what => {
  const label = document.createElement("label"), box = document.createElement("input");
  box.type = "checkbox"; box.checked = true; box.addEventListener("change", () => { shown[what] = box.checked; draw(); });
  label.append(box, what === "axes" ? "axes of joints" : what); place.querySelector(".shows").append(label);
});
let held = null;
const turned = (x, y) => { azimuth -= x; elevation = Math.min(Math.max(elevation + y, -1.5), 1.5); draw(); };
const zoomed = by => { zoom = Math.min(Math.max(zoom * by, 0.2), 20); draw(); };
canvas.addEventListener("pointerdown", event => { held = [event.clientX, event.clientY]; canvas.setPointerCapture(event.pointerId); });
canvas.addEventListener("pointermove", event => { if (held) { turned((event.clientX - held[0]) / 120, (event.clientY - held[1]) / 120); held = [event.clientX, event.clientY]; } });
canvas.addEventListener("pointerup", () => { held = null; });
canvas.addEventListener("wheel", event => { event.preventDefault(); zoomed(Math.exp(-event.deltaY / 600)); }, { passive: false });
canvas.addEventListener("keydown", event => {
  const turn = { ArrowLeft: [-0.1, 0], ArrowRight: [0.1, 0], ArrowUp: [0, 0.1], ArrowDown: [0, -0.1] }[event.key];
  if (turn) { turned(...turn); event.preventDefault(); } else if ("+-".includes(event.key)) zoomed(event.key === "+" ? 1.15 : 1 / 1.15);
});
new ResizeObserver(draw).observe(canvas);
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", draw);
addEventListener("beforeprint", draw);
draw();
})();
