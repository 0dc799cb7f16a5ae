"use strict";
// Common part of all pages: a scene that can be turned, and charts over time. Everything is drawn on plain canvases, so
// that the file is self-contained. The script of a page follows this one; it defines drawScene(t) and countersAt(t),
// and calls begin() at its end.
const episode = JSON.parse(document.getElementById("episode").textContent);
const { time } = episode;
const last = time.length - 1, END = time[last];
const tint = (name) => getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();
const ORANGE = "#E69F00", INK = tint("ink"), PAPER = tint("paper"), GREY = tint("grey"), PALE = tint("pale");
const GRID = tint("grid"), AXIS = tint("axis");
const FIRST = episode.view;
const element = (id) => document.getElementById(id);
const space = element("space");
const camera = { ...FIRST, zoom: 1 };
let now = 0, playing = false, before = 0;

const dot3 = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross3 = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const scaled = (a, factor) => a.map((x) => x * factor);
const mixed = (a, b, u) => a.map((x, i) => x + u * (b[i] - x));

/** Return the index of the last recorded state that is not later than a time. */
function rowAt(t) {
  let low = 0, high = last;
  while (low < high) {
    const middle = (low + high + 1) >> 1;
    if (time[middle] <= t) low = middle; else high = middle - 1;
  }
  return low;
}

/** Set the size of a canvas to the screen's resolution, and return its context in CSS pixels. */
function prepared(canvas) {
  const ratio = window.devicePixelRatio || 1, width = canvas.clientWidth, height = canvas.clientHeight;
  if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio)) {
    canvas.width = Math.round(width * ratio);
    canvas.height = Math.round(height * ratio);
  }
  const pen = canvas.getContext("2d");
  pen.setTransform(ratio, 0, 0, ratio, 0, 0);
  pen.clearRect(0, 0, width, height);
  pen.font = "12px " + getComputedStyle(document.body).fontFamily;
  return { pen, width, height };
}

/** Return the camera's directions: towards the viewer, right and up. */
function axes() {
  const a = camera.azimuth * Math.PI / 180, e = camera.elevation * Math.PI / 180;
  return {
    sight: [Math.cos(e) * Math.cos(a), Math.cos(e) * Math.sin(a), Math.sin(e)],
    right: [-Math.sin(a), Math.cos(a), 0],
    up: [-Math.sin(e) * Math.cos(a), -Math.sin(e) * Math.sin(a), Math.cos(e)],
  };
}

function polyline(pen, places, colour, width, dashes = []) {
  pen.beginPath();
  places.forEach(([x, y], i) => (i ? pen.lineTo(x, y) : pen.moveTo(x, y)));
  pen.setLineDash(dashes);
  pen.strokeStyle = colour;
  pen.lineWidth = width;
  pen.stroke();
  pen.setLineDash([]);
}

function disc(pen, x, y, r, fill, stroke = null, width = 1) {
  pen.beginPath();
  pen.arc(x, y, r, 0, 2 * Math.PI);
  if (fill) { pen.fillStyle = fill; pen.fill(); }
  if (stroke) { pen.strokeStyle = stroke; pen.lineWidth = width; pen.stroke(); }
}

function drawChart(chart) {
  const { pen, width, height } = prepared(chart.canvas);
  const box = { left: 62, right: width - 8, top: 16, bottom: height - (chart.bottom ? 34 : 8) };
  const [low, high] = chart.range;
  const x = (t) => box.left + t / END * (box.right - box.left);
  const y = (value) => box.bottom - (value - low) / (high - low || 1) * (box.bottom - box.top);
  pen.globalAlpha = 0.13;
  for (const { start, end, colour } of episode.bands || []) {
    pen.fillStyle = colour;
    pen.fillRect(x(start), box.top, x(end) - x(start), box.bottom - box.top);
  }
  pen.globalAlpha = 1;
  pen.textBaseline = "middle";
  pen.fillStyle = INK;
  pen.textAlign = "left";
  const label = Math.min(box.left, Math.max(0, width - 2 - pen.measureText(chart.label).width));
  pen.fillText(chart.label, label, 7, width - 2);
  pen.textAlign = "right";
  for (const tick of ticks(low, high, 3)) {
    polyline(pen, [[box.left, y(tick)], [box.right, y(tick)]], GRID, 1);
    pen.fillText(String(tick), box.left - 6, y(tick));
  }
  pen.textAlign = "center";
  for (const tick of ticks(0, END / episode.unit_seconds, 6)) {
    const at = x(tick * episode.unit_seconds);
    polyline(pen, [[at, box.top], [at, box.bottom]], GRID, 1);
    if (chart.bottom) pen.fillText(String(tick), at, box.bottom + 9);
  }
  if (chart.bottom) pen.fillText(`time [${episode.unit}]`, (box.left + box.right) / 2, height - 8);
  pen.save();
  pen.beginPath();
  pen.rect(box.left - 1, box.top - 2, box.right - box.left + 2, box.bottom - box.top + 4);
  pen.clip();
  for (const line of chart.lines) {
    let places = [];
    const stroke = () => polyline(pen, places, line.colour === "#222222" ? INK : line.colour, line.width || 1.6, line.dashes || []);
    line.values.forEach((value, i) => {
      if (value === null) {  // unknown: a gap
        stroke();
        places = [];
        return;
      }
      if (line.step && places.length) places.push([x(time[i]), places[places.length - 1][1]]);
      places.push([x(time[i]), y(value)]);
    });
    stroke();
  }
  pen.restore();
  polyline(pen, [[x(now), box.top], [x(now), box.bottom]], ORANGE, 1.5);
  chart.timeAt = (px) => Math.min(Math.max((px - box.left) / (box.right - box.left), 0), 1) * END;
}

/** Return round values between two bounds. */
function ticks(low, high, wanted) {
  const raw = (high - low) / wanted || 1, power = 10 ** Math.floor(Math.log10(raw));
  const step = [1, 2, 2.5, 5, 10].map((factor) => factor * power).find((size) => size >= raw * 0.999);
  const found = [];
  for (let k = Math.ceil(low / step - 1e-9); k * step <= high + 1e-9 * step; k++) {
    found.push(Number((k * step).toPrecision(8)));
  }
  return found.length < 3 && wanted < 12 ? ticks(low, high, 2 * wanted) : found;
}

const charts = episode.charts.map((chart, index) => {
  const canvas = document.createElement("canvas");
  element("series").append(canvas);
  const made = { ...chart, canvas, bottom: index === episode.charts.length - 1 };
  const jump = (event) => { if (event.buttons) show(made.timeAt(event.offsetX)); };
  canvas.addEventListener("pointerdown", jump);
  canvas.addEventListener("pointermove", jump);
  return made;
});

function show(t) {
  now = Math.min(Math.max(t, 0), END);
  element("time").value = 1000 * now / END;
  element("counters").replaceChildren(...countersAt(now).map((text) => {
    const span = document.createElement("span");
    span.textContent = text;
    return span;
  }));
  drawScene(now);
  charts.forEach(drawChart);
}

function play(on) {
  playing = on;
  element("play").textContent = on ? "pause" : "play";
  if (on) {
    if (now >= END) now = 0;
    before = performance.now();
    requestAnimationFrame(advance);
  }
}

function advance(clock) {
  if (!playing) return;
  const passed = Math.max(clock - before, 0) / 1000;
  before = clock;
  show(now + passed / Number(element("pace").value) * END);
  if (now >= END) play(false); else requestAnimationFrame(advance);
}

function keyEntry(text, colour, dot, dashes = []) {
  const row = document.createElement("div"), mark = document.createElement("i"), label = document.createElement("span");
  mark.style.borderColor = colour;
  if (dashes.length) mark.style.borderTopStyle = "dashed";
  if (dot) { mark.className = "dot"; mark.style.background = dot; }
  label.textContent = text;
  row.append(mark, label);
  element("key").append(row);
}

const fingers = new Map();
const apart = () => {
  const [a, b] = fingers.values();
  return Math.hypot(a[0] - b[0], a[1] - b[1]) || 1;
};
const zoomed = (factor) => { camera.zoom = Math.min(Math.max(camera.zoom * factor, 0.3), episode.most_zoom); };
space.addEventListener("pointerdown", (event) => {
  space.setPointerCapture(event.pointerId);
  fingers.set(event.pointerId, [event.offsetX, event.offsetY]);
});
for (const end of ["pointerup", "pointercancel"]) {
  space.addEventListener(end, (event) => fingers.delete(event.pointerId));
}
space.addEventListener("pointermove", (event) => {
  if (!event.buttons) return;
  if (fingers.size === 2) {
    const before = apart();
    fingers.set(event.pointerId, [event.offsetX, event.offsetY]);
    zoomed(apart() / before);
    show(now);
    return;
  }
  fingers.set(event.pointerId, [event.offsetX, event.offsetY]);
  camera.azimuth -= 0.35 * event.movementX;
  camera.elevation = Math.min(Math.max(camera.elevation + 0.35 * event.movementY, -90), 90);
  show(now);
});
space.addEventListener("wheel", (event) => {
  event.preventDefault();
  zoomed(Math.exp(-0.0015 * event.deltaY));
  show(now);
}, { passive: false });
element("time").addEventListener("input", () => show(Number(element("time").value) / 1000 * END));
element("play").addEventListener("click", () => play(!playing));
element("far").addEventListener("click", () => { Object.assign(camera, FIRST, { zoom: 1 }); show(now); });
element("future").addEventListener("change", () => show(now));
window.addEventListener("resize", () => show(now));
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => location.reload());
window.addEventListener("keydown", (event) => {
  if (event.target.tagName === "SELECT") return;
  if (event.key === " ") { event.preventDefault(); play(!playing); }
  const step = { ArrowLeft: -1, ArrowRight: 1 }[event.key];
  if (step) { event.preventDefault(); play(false); show(time[Math.min(Math.max(rowAt(now) + step, 0), last)]); }
});
/** Show the first picture, or the one at a share of the time given in the address: page.html#0.5 is the middle. */
function begin() {
  show((Number(location.hash.slice(1)) || 0) * END);
}
