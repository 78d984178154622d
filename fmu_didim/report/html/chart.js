/* Draws every .chart from the JSON of its figure as SVG, with the colours of the style sheet: lines over one axis,
   zoomed by dragging, by the buttons or by keys, values read by pointer, finger or arrow keys. */
(() => {
"use strict";
const bytes = text => Uint8Array.from(atob(text), c => c.charCodeAt(0)).buffer;
const escape = text => String(text).replace(/[&<>"]/g, c => `&#${c.charCodeAt(0)};`);
const values = coded => {
  if (coded.count) return Float64Array.from({length: coded.count}, (_, i) => coded.first + i * coded.step);
  if (coded.floats !== undefined) return Float64Array.from(new Float32Array(bytes(coded.floats)));
  return Float64Array.from(new Uint16Array(bytes(coded.steps)), n => n > 65534 ? NaN : coded.low + n * coded.scale);
};
const read = text => {
  const figure = JSON.parse(text), axes = figure.axes.map(values);
  for (const panel of figure.panels) for (const s of panel.series) {
    s.x = axes[s.x]; s.y = values(s.y);
    for (const part of ["error", "band"]) s[part] = s[part] ? values(s[part]) : null;
    s.rises = s.x.every((x, i) => i === 0 || !(x < s.x[i - 1]));
  }
  return figure;
};
const after = (x, value) => {
  let low = 0, high = x.length;
  while (low < high) { const middle = (low + high) >> 1; if (x[middle] < value) low = middle + 1; else high = middle; }
  return low;
};
const ticks = (low, high, count, log) => {
  if (log) {
    const from = Math.floor(Math.log10(low)), to = Math.ceil(Math.log10(high)), every = Math.max(1, Math.ceil((to - from) / count));
    for (const parts of [[1], [1, 2, 5]]) {
      const found = [];
      for (let d = from; d <= to; d += every) for (const m of parts) {
        const v = m * 10 ** d;
        if (v >= low * 0.999 && v <= high * 1.001) found.push([v, d >= -2 && d <= 4 ? String(+v.toPrecision(1)) : `${m}e${d}`]);
      }
      if (found.length > 1) return found;
    }
  }
  const rough = (high - low) / Math.max(count, 1) || 1, power = 10 ** Math.floor(Math.log10(rough));
  const step = power * [1, 2, 5, 10].find(f => f * power >= rough * 0.7);
  const digits = Math.max(0, -Math.floor(Math.log10(step) + 1e-9)), found = [];
  for (let v = Math.ceil(low / step - 1e-9) * step; v <= high + 1e-9 * step && found.length < 50; v += step) {
    const far = v !== 0 && (Math.abs(high) >= 1e6 || Math.abs(low) >= 1e6 || digits > 3);
    found.push([v, far ? (Math.abs(v) < step / 2 ? "0" : v.toExponential(Math.max(0, Math.floor(Math.log10(Math.abs(v))) + digits))) : (Math.abs(v) < step / 2 ? 0 : v).toFixed(digits)]);
  }
  return found;
};
const short = v => !Number.isFinite(v) ? "–" : v !== 0 && (Math.abs(v) < 1e-3 || Math.abs(v) >= 1e6) ? v.toExponential(2) : String(+v.toPrecision(4));
const scale = (low, high, from, to, log) => {
  const f = log ? v => Math.log10(Math.max(v, 1e-300)) : v => v, a = f(low), b = f(high);
  const place = v => from + (f(v) - a) / (b - a || 1) * (to - from);
  place.inverse = p => { const u = a + (p - from) / (to - from) * (b - a); return log ? 10 ** u : u; };
  return place;
};
const extent = (panel, hidden, from, to) => {
  let low = Infinity, high = -Infinity;
  const take = v => { if (Number.isFinite(v) && (!panel.log || v > 0)) { if (v < low) low = v; if (v > high) high = v; } };
  for (const s of panel.series) {
    if (hidden.has(s.name)) continue;
    const spread = s.error || s.band;
    for (let i = 0; i < s.y.length; i++) {
      if (s.x[i] < from || s.x[i] > to) continue;
      take(s.y[i]);
      if (spread) { take(s.y[i] - spread[i]); take(s.y[i] + spread[i]); }
    }
    if (s.kind === "stems") take(0);
  }
  if (panel.range) { take(panel.range[0]); take(panel.range[1]); }
  panel.levels.forEach(take);
  if (!(low <= high)) return panel.log ? [0.1, 10] : [-1, 1];
  if (panel.log) return [low / 1.3, high * 1.3];
  const room = (high - low) * 0.06 || Math.abs(high) * 0.1 || 1;
  return [low - room, high + room];
};
/* The visible points of a line: of each column of pixels the first, lowest, highest and last. */
const linePath = (s, px, py, from, to) => {
  const begin = s.rises ? Math.max(after(s.x, from) - 1, 0) : 0, end = s.rises ? Math.min(after(s.x, to) + 1, s.x.length) : s.x.length;
  let path = "", pen = false, column = NaN, first = 0, low = 0, high = 0, last = 0;
  const flush = () => {
    if (Number.isNaN(column)) return;
    const marks = low === high ? [first] : [first, low, high, last];
    for (const y of marks) { path += `${pen ? "L" : "M"}${column} ${y.toFixed(1)}`; pen = true; }
    column = NaN;
  };
  const sparse = end - begin < 4 * Math.abs(px(to) - px(from));
  for (let i = begin; i < end; i++) {
    if (!Number.isFinite(s.y[i])) { flush(); pen = false; continue; }
    const x = sparse ? +px(s.x[i]).toFixed(1) : Math.round(px(s.x[i])), y = py(s.y[i]);
    if (x !== column) { flush(); column = x; first = low = high = y; }
    low = Math.min(low, y); high = Math.max(high, y); last = y;
  }
  flush();
  return path;
};
const drawSeries = (s, px, py, from, to) => {
  const at = i => [px(s.x[i]).toFixed(1), py(s.y[i]).toFixed(1)];
  const seen = [...s.x.keys()].filter(i => s.x[i] >= from && s.x[i] <= to && Number.isFinite(s.y[i]));
  let drawn = "";
  if (s.band) {
    const upper = seen.map(i => `${px(s.x[i]).toFixed(1)} ${py(s.y[i] + s.band[i]).toFixed(1)}`);
    const lower = seen.map(i => `${px(s.x[i]).toFixed(1)} ${py(s.y[i] - s.band[i]).toFixed(1)}`).reverse();
    if (upper.length) drawn += `<path class="area ${s.style}" d="M${[...upper, ...lower].join("L")}Z"/>`;
  }
  if (s.error) drawn += `<path class="whisker ${s.style}" d="${seen.map(i => `M${at(i)[0]} ${py(s.y[i] - s.error[i]).toFixed(1)}V${py(s.y[i] + s.error[i]).toFixed(1)}`).join("")}"/>`;
  if (s.kind === "line") drawn += `<path class="line ${s.style}" d="${linePath(s, px, py, from, to)}"/>`;
  if (s.kind === "stems") drawn += `<path class="stem ${s.style}" d="${seen.map(i => `M${at(i)[0]} ${py(0).toFixed(1)}V${at(i)[1]}`).join("")}"/>`;
  if (s.kind === "points" || (s.kind === "line" && seen.length < 40)) drawn += `<path class="dots ${s.style}${seen.length > Math.abs(px(to) - px(from)) / 3 ? " dense" : ""}" d="${seen.map(i => `M${at(i).join(" ")}h0`).join("")}"/>`;
  return drawn;
};
const swatch = s => `<svg width="22" height="12" aria-hidden="true">${s.band || s.kind === "stems" ? `<rect class="area ${s.style}" width="22" height="12"/>` : ""}<path class="${s.kind === "points" ? "dots" : "line"} ${s.style}" d="${s.kind === "points" ? "M4 6h0M11 6h0M18 6h0" : "M0 6H22"}"/></svg>`;

class Chart {
  constructor(place) {
    this.place = place;
    this.figure = read(document.getElementById(place.dataset.figure).textContent);
    this.hidden = new Set(); this.cursor = null;
    let low = Infinity, high = -Infinity;
    for (const p of this.figure.panels) for (const s of p.series) for (const x of s.x) if (Number.isFinite(x) && (!this.figure.log || x > 0)) { if (x < low) low = x; if (x > high) high = x; }
    if (!(low <= high)) { low = 0; high = 1; }
    const room = this.figure.ticks.length || this.figure.panels.some(p => p.series.some(s => s.kind === "stems")) ? 0.5 : this.figure.panels.some(p => p.series.some(s => !s.rises)) ? (high - low) * 0.03 : 0;
    this.whole = this.range = low === high ? [low - 1, high + 1] : [low - room, high + room];
    this.build(); this.draw();
  }
  build() {
    const names = new Map();
    for (const p of this.figure.panels) for (const s of p.series) if (s.legend && !names.has(s.name)) names.set(s.name, s);
    const entries = names.size > 1 ? [...names.values()].map(s => `<button type="button" class="entry" aria-pressed="true" data-name="${escape(s.name)}">${swatch(s)}${escape(s.name)}</button>`).join("") : "";
    this.place.innerHTML = `<div class="legend">${entries}<span class="tools"><button type="button" data-zoom="0.5" aria-label="zoom in">+</button><button type="button" data-zoom="2" aria-label="zoom out">−</button><button type="button" data-zoom="0" aria-label="show all">all</button></span></div><div class="canvas" tabindex="0" role="group" aria-label="${escape(this.figure.title)}. Arrow keys read values, plus and minus zoom, 0 shows all."></div><div class="reading" hidden></div><p class="spoken" aria-live="polite"></p>`;
    this.canvas = this.place.querySelector(".canvas"); this.reading = this.place.querySelector(".reading"); this.spoken = this.place.querySelector(".spoken");
    this.place.querySelector(".legend").addEventListener("click", event => {
      const button = event.target.closest("button");
      if (!button) return;
      if (button.dataset.zoom) return this.zoom(+button.dataset.zoom);
      const name = button.dataset.name, shown = this.hidden.delete(name);
      if (!shown) this.hidden.add(name);
      button.setAttribute("aria-pressed", String(shown)); this.draw();
    });
    const inside = event => event.clientX - this.canvas.getBoundingClientRect().left;
    const value = event => { const f = this.canvas.clientWidth / this.width; return this.px.inverse(inside(event) / f); };
    this.canvas.addEventListener("pointermove", event => {
      const panel = event.target.closest("[data-panel]");
      if (this.begin !== undefined && event.pointerType === "mouse") this.mark(this.begin, value(event));
      this.point(value(event), panel ? +panel.dataset.panel : this.panel);
    });
    this.canvas.addEventListener("pointerdown", event => { if (event.pointerType === "mouse" && event.button === 0) { this.begin = value(event); this.canvas.setPointerCapture(event.pointerId); } });
    this.canvas.addEventListener("pointerup", event => {
      const begin = this.begin, end = value(event); this.begin = undefined; this.mark();
      if (begin !== undefined && Math.abs(this.px(end) - this.px(begin)) > 8) this.show([Math.min(begin, end), Math.max(begin, end)]);
    });
    this.canvas.addEventListener("pointercancel", () => { this.begin = undefined; this.mark(); });
    this.canvas.addEventListener("pointerleave", () => this.point(null));
    this.canvas.addEventListener("blur", () => this.point(null));
    this.canvas.addEventListener("dblclick", () => this.show(this.whole));
    this.canvas.addEventListener("keydown", event => this.key(event));
  }
  key(event) {
    const [low, high] = this.range.map(v => this.px(v)), now = this.cursor === null ? (low + high) / 2 : this.px(this.cursor);
    const move = {ArrowLeft: -1, ArrowRight: 1}[event.key], panel = {ArrowUp: -1, ArrowDown: 1}[event.key];
    if (move) this.point(this.px.inverse(Math.min(Math.max(now + move * (high - low) / (event.shiftKey ? 10 : 100), low), high)), this.panel, true);
    else if (panel) this.point(this.px.inverse(now), Math.min(Math.max((this.panel || 0) + panel, 0), this.figure.panels.length - 1), true);
    else if (event.key === "+" || event.key === "=") this.zoom(0.5);
    else if (event.key === "-") this.zoom(2);
    else if (event.key === "0" || event.key === "Escape") this.show(this.whole);
    else return;
    event.preventDefault();
  }
  zoom(factor) {
    if (!factor) return this.show(this.whole);
    const [low, high] = this.range.map(v => this.px(v)), middle = this.cursor === null ? (low + high) / 2 : this.px(this.cursor);
    this.show([low, high].map(p => this.px.inverse(middle + (p - middle) * factor)));
  }
  show(range) {
    const low = Math.max(range[0], this.whole[0]), high = Math.min(range[1], this.whole[1]);
    if (high > low) { this.range = [low, high]; this.draw(); }
  }
  draw(width) {
    const figure = this.figure, narrow = (width || this.canvas.clientWidth) < 520;
    this.width = Math.max(width || this.canvas.clientWidth, 240);
    const left = narrow ? 52 : 66, right = 10, [from, to] = this.range;
    this.px = scale(from, to, left, this.width - right, figure.log); this.frames = [];
    const begins = [];
    let top = 4, drawn = "";
    figure.panels.forEach((panel, k) => {
      const height = Math.round(Math.max(panel.height * (narrow ? 0.8 : 1), Math.min(panel.height, 92))), across = this.width - left - right;
      if (panel.head || !begins.length) begins.push(begins.length ? top - 6 : 0);
      if (panel.head) { top += 24; drawn += `<text class="head" x="${left}" y="${top - 8}">${escape(panel.head)}</text>`; }
      const [low, high] = extent(panel, this.hidden, from, to), py = scale(low, high, top + height, top, panel.log);
      drawn += `<g data-panel="${k}"><rect class="frame" x="${left}" y="${top}" width="${across}" height="${height}"/>`;
      for (const [v, text] of ticks(low, high, Math.max(3, Math.round(height / 42)), panel.log)) drawn += `<path class="grid${v === 0 ? " zero" : ""}" d="M${left} ${py(v).toFixed(1)}H${this.width - right}"/><text class="tick" text-anchor="end" x="${left - 6}" y="${(py(v) + 4).toFixed(1)}">${text}</text>`;
      const marks = figure.ticks.length ? figure.ticks : ticks(from, to, Math.round(this.width / 90), figure.log);
      for (const [v] of marks) if (v >= from && v <= to) drawn += `<path class="grid" d="M${this.px(v).toFixed(1)} ${top}v${height}"/>`;
      drawn += `<svg x="${left}" y="${top}" width="${across}" height="${height}" viewBox="${left} ${top} ${across} ${height}">`;
      if (panel.range) drawn += `<rect class="noise" x="${left}" width="${across}" y="${py(panel.range[1]).toFixed(1)}" height="${Math.max(py(panel.range[0]) - py(panel.range[1]), 0).toFixed(1)}"/>`;
      for (const level of panel.levels) drawn += `<path class="level" d="M${left} ${py(level).toFixed(1)}H${this.width - right}"/>`;
      const seen = panel.series.filter(s => !this.hidden.has(s.name)), above = s => s.kind === "points" && s.style !== "faint" && s.x.length < across / 2;
      for (const s of [...seen.filter(s => !above(s)), ...seen.filter(above)]) drawn += drawSeries(s, this.px, py, from, to);
      drawn += `</svg><text class="label" transform="translate(${narrow ? 10 : 13} ${top + height / 2}) rotate(-90)" text-anchor="middle">${escape(panel.label)}</text></g>`;
      this.frames.push({top, height, py}); top += height + (k + 1 < figure.panels.length ? 12 : 0);
    });
    const marks = figure.ticks.length ? figure.ticks : ticks(from, to, Math.round(this.width / 90), figure.log), turned = figure.ticks.length && this.width / figure.ticks.length < 70;
    for (const [v, text] of marks) if (v >= from && v <= to) drawn += `<text class="tick" text-anchor="${turned ? "end" : "middle"}" ${turned ? `transform="translate(${this.px(v).toFixed(1)} ${top + 12}) rotate(-45)"` : `x="${this.px(v).toFixed(1)}" y="${top + 17}"`}>${escape(text)}</text>`;
    top += turned ? 62 : 22;
    drawn += `<text class="label" text-anchor="middle" x="${(left + this.width - right) / 2}" y="${top + 14}">${escape(figure.label)}</text>`;
    this.height = top + 20;
    const parts = width ? begins : [0];  /* on paper a column of panels may be split between pages */
    this.canvas.innerHTML = parts.map((from, k) => `<svg viewBox="0 ${from} ${this.width} ${(parts[k + 1] || this.height) - from}" role="img" aria-label="${escape(figure.title)}">${drawn}<g class="cursor"></g></svg>`).join("");
    if (this.cursor !== null) this.point(this.cursor, this.panel);
  }
  mark(from, to) {
    const place = this.canvas.querySelector(".cursor");
    if (from === undefined) { place.innerHTML = ""; return; }
    const a = this.px(from), b = this.px(to);
    place.innerHTML = `<rect class="picked" x="${Math.min(a, b).toFixed(1)}" width="${Math.abs(b - a).toFixed(1)}" y="0" height="${this.height - 40}"/>`;
  }
  point(x, panel = 0, aloud = false) {
    const inside = x !== null && x >= this.range[0] && x <= this.range[1];
    this.cursor = inside ? x : null; this.panel = panel || 0;
    if (this.begin === undefined) this.mark();
    this.reading.hidden = !inside;
    if (!inside) return;
    const shown = this.figure.panels[this.panel], lines = [];
    let nearest = x, best = Infinity, marks = "";
    for (const s of shown.series) {
      if (this.hidden.has(s.name) || !s.rises || !s.x.length) continue;
      let i = Math.min(after(s.x, x), s.x.length - 1);
      if (i > 0 && Math.abs(s.x[i - 1] - x) < Math.abs(s.x[i] - x)) i--;
      const spread = s.error || s.band;
      lines.push([s.name, short(s.y[i]) + (spread ? ` ± ${short(spread[i])}` : "")]);
      if (Math.abs(s.x[i] - x) < best) { best = Math.abs(s.x[i] - x); nearest = s.x[i]; }
      if (Number.isFinite(s.y[i])) marks += `<circle class="mark ${s.style}" r="4" cx="${this.px(s.x[i]).toFixed(1)}" cy="${this.frames[this.panel].py(s.y[i]).toFixed(1)}"/>`;
    }
    if (!lines.length) { this.reading.hidden = true; return; }
    if (this.begin === undefined) this.canvas.querySelector(".cursor").innerHTML = `<path class="hair" d="M${this.px(nearest).toFixed(1)} ${this.frames[0].top}V${this.height - 40}"/>${marks}`;
    const named = this.figure.ticks.find(([v]) => v === Math.round(nearest)), where = named ? named[1] : `${this.figure.label.replace(/ \(.*/, "")} ${short(nearest)}`;
    this.reading.innerHTML = `<b>${escape(where)}</b>${lines.map(([n, v]) => `<span>${escape(n)}</span><span>${v}</span>`).join("")}`;
    const f = this.canvas.clientWidth / this.width, place = this.px(nearest) * f, box = this.reading.offsetWidth;
    this.reading.style.left = `${place + box + 24 < this.canvas.clientWidth ? place + 14 : Math.max(place - box - 14, 0)}px`;
    this.reading.style.top = `${this.canvas.offsetTop + this.frames[this.panel].top * f + 8}px`;
    if (aloud) this.spoken.textContent = `${shown.head || shown.label}, ${where}: ${lines.map(l => l.join(" ")).join(", ")}`;
  }
}
class Skeleton {
  constructor(place) {
    this.motion = JSON.parse(document.getElementById(place.dataset.figure).textContent);
    const all = [...this.motion.points.flat(), ...this.motion.path], size = 440, room = 26;
    const low = [0, 1].map(k => Math.min(...all.map(p => p[k]))), high = [0, 1].map(k => Math.max(...all.map(p => p[k])));
    const unit = Math.max(high[0] - low[0], high[1] - low[1]) || 1, f = (size - 2 * room) / unit;
    this.height = Math.round((high[1] - low[1]) * f + 2 * room); this.width = size;
    this.to = p => [room + (p[0] - low[0] + (unit - high[0] + low[0]) / 2) * f, this.height - room - (p[1] - low[1]) * f].map(v => v.toFixed(1));
    const tone = k => `color-mix(in srgb, var(--residual) ${15 + 85 * k / Math.max(this.motion.levels - 1, 1)}%, var(--raised))`;
    const path = this.motion.path.map((p, k) => [this.motion.level[k], this.to(p)]).sort((a, b) => a[0] - b[0]).map(([k, p]) => `<circle r="${2 + 0.5 * k}" cx="${p[0]}" cy="${p[1]}" style="fill:${tone(k)}"/>`).join("");
    place.innerHTML = `<svg viewBox="0 0 ${size} ${this.height}" role="img" aria-label="${escape(this.motion.title)}"><g>${path}</g><g class="robot"></g></svg><div class="controls"><button type="button">play</button><input type="range" min="0" max="${this.motion.time.length - 1}" value="0" aria-label="instant of ${escape(this.motion.title)}"><output></output></div>`;
    this.robot = place.querySelector(".robot"); this.range = place.querySelector("input"); this.shown = place.querySelector("output"); this.button = place.querySelector("button");
    this.range.addEventListener("input", () => { this.stop(); this.draw(Number(this.range.value)); });
    this.button.addEventListener("click", () => this.timer ? this.stop() : this.play());
    this.draw(0);
  }
  draw(k) {
    const points = this.motion.points[k].map(this.to), line = from => points.slice(from, from < 0 ? undefined : -1).map(p => p.join(" ")).join("L"), tip = points[points.length - 1];
    this.robot.innerHTML = `<path class="link" d="M${line(0)}"/><path class="link last" d="M${line(-2)}"/>${points.slice(1, -1).map(p => `<circle class="pivot" r="5.5" cx="${p[0]}" cy="${p[1]}"/>`).join("")}<rect class="base" x="${points[0][0] - 9}" y="${points[0][1] - 4}" width="18" height="8"/><circle class="at" r="4" cx="${tip[0]}" cy="${tip[1]}"/>`;
    this.range.value = k; this.shown.textContent = `${short(this.motion.time[k])} s`;
  }
  play() { this.button.textContent = "pause"; this.timer = setInterval(() => this.draw((Number(this.range.value) + 1) % this.motion.time.length), 33); }
  stop() { clearInterval(this.timer); this.timer = undefined; this.button.textContent = "play"; }
}
document.querySelectorAll(".skeleton").forEach(place => new Skeleton(place));
const charts = [...document.querySelectorAll(".chart")].map(place => new Chart(place));
const hint = () => document.querySelectorAll(".scroll").forEach(e => e.classList.toggle("wide", e.scrollWidth > e.clientWidth + 1));
hint(); addEventListener("toggle", hint, true);
new ResizeObserver(() => { hint(); if (!matchMedia("print").matches) charts.forEach(c => { if (c.canvas.clientWidth && c.canvas.clientWidth !== c.width) c.draw(); }); }).observe(document.body);
const opened = [];
addEventListener("toggle", event => charts.forEach(c => { if (event.target.contains(c.place)) c.draw(); }), true);
addEventListener("beforeprint", () => {
  document.querySelectorAll("details:not([open]):not(.folded)").forEach(d => { opened.push(d); d.open = true; });
  charts.forEach(c => { c.point(null); c.draw(Number(c.place.dataset.print || 680)); });
});
addEventListener("afterprint", () => { opened.splice(0).forEach(d => { d.open = false; }); charts.forEach(c => c.draw()); });
})();
