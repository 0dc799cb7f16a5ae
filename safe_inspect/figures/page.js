"use strict";
// Draws an episode: a scene that can be turned, and charts over time. All is plain canvas, so that the file stands alone.
const episode = JSON.parse(document.getElementById("episode").textContent);
const { time, position, sun, points, radius, rings, deputies } = episode;
const last = time.length - 1, END = time[last];
const ORANGE = "#E69F00", GREY = "#7A7A7A", PALE = "#D9D9D9", NIGHT = "#B4BAC4", DAY = "#FFF1C4", DARK = "#4B5563";
const FIRST = { azimuth: -52, elevation: 22 };
const element = (id) => document.getElementById(id);
const space = element("space");
const camera = { ...FIRST, zoom: 1 };
let now = 0, playing = false, before = 0;

const dot3 = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const scaled = (a, factor) => a.map((x) => x * factor);
const mixed = (a, b, u) => a.map((x, i) => x + u * (b[i] - x));

/** Index of the last recorded state that is not later than a time. */
function rowAt(t) {
  let low = 0, high = last;
  while (low < high) {
    const middle = (low + high + 1) >> 1;
    if (time[middle] <= t) low = middle; else high = middle - 1;
  }
  return low;
}

/** The state at a time, between two recorded ones by a straight line. */
function stateAt(t) {
  const row = rowAt(t), next = Math.min(row + 1, last);
  const u = next > row ? (t - time[row]) / (time[next] - time[row]) : 0;
  const angle = sun[row] + u * (sun[next] - sun[row]);
  return {
    row,
    places: position.map((way) => mixed(way[row], way[next], u)),
    light: [Math.cos(angle), -Math.sin(angle), 0],
    count: episode.inspected_at.filter((when) => when !== null && when <= t).length,
  };
}

/** Give a canvas as many pixels as the screen has, and return its context in CSS pixels. */
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

/** The camera's directions: to the reader, right and up. */
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

/** Draw the chief with its day side and the points on the reader's side; r in pixels. */
function drawChief(pen, x, y, r, view, light, t) {
  disc(pen, x, y, r, NIGHT);
  const a = dot3(light, view.right), b = dot3(light, view.up), d = dot3(light, view.sight);
  pen.save();
  pen.translate(x, y);
  pen.rotate(Math.atan2(-b, a));
  pen.beginPath();
  pen.arc(0, 0, r, -Math.PI / 2, Math.PI / 2);
  pen.ellipse(0, 0, Math.abs(d) * r, r, 0, Math.PI / 2, -Math.PI / 2, d < 0);
  pen.fillStyle = DAY;
  pen.fill();
  pen.restore();
  disc(pen, x, y, r, null, GREY);
  if (r < 12) return;  // too small for its points
  const size = Math.max(1.2, Math.min(6, r / 20));
  points.forEach((point, i) => {
    if (dot3(point, view.sight) <= 0) return;
    const px = x + dot3(point, view.right) / radius * r, py = y - dot3(point, view.up) / radius * r;
    const when = episode.inspected_at[i];
    if (when !== null && when <= t) disc(pen, px, py, size, deputies[episode.inspector[i]].colour);
    else if (dot3(point, light) > 0) disc(pen, px, py, size, "#fff", "#222", Math.max(0.6, size / 4));
    else disc(pen, px, py, 0.7 * size, DARK);
  });
}

function drawScene(state) {
  const { pen, width, height } = prepared(space);
  const view = axes(), reach = episode.reach;
  const metre = camera.zoom * Math.min(width, 1.25 * height) / 2.2 / reach;
  const x0 = 0.5 * width, y0 = 0.5 * height, r = radius * metre;
  const flat = (p) => [x0 + dot3(p, view.right) * metre, y0 - dot3(p, view.up) * metre];
  const hidden = (p) => dot3(p, view.sight) < 0
    && dot3(p, view.right) ** 2 + dot3(p, view.up) ** 2 < radius * radius;
  const circle = (ring) => Array.from({ length: 121 }, (_, i) => {
    const angle = i / 60 * Math.PI;
    return [ring * Math.cos(angle), ring * Math.sin(angle), 0];
  });
  const outer = rings[rings.length - 1];
  pen.textAlign = "center";
  pen.textBaseline = "middle";
  const left = (camera.azimuth - 90) * Math.PI / 180;
  for (const ring of rings) {
    polyline(pen, circle(ring).map(flat), PALE, 1);
    const [x, y] = flat([ring * Math.cos(left), ring * Math.sin(left), 0]);
    pen.fillStyle = GREY;
    pen.fillText(`${ring} m`, x, y - 8);
  }
  [["x radial", [0.6, 0, 0]], ["y along track", [0, 0.6, 0]], ["z", [0, 0, 0.6]]].forEach(([name, direction]) => {
    const tip = scaled(direction, outer);
    polyline(pen, [flat([0, 0, 0]), flat(tip)], "#BBB", 1);
    const [x, y] = flat(scaled(tip, 1.1));
    pen.fillStyle = GREY;
    pen.fillText(name, x, y);
  });
  const tail = flat(scaled(state.light, 0.7 * outer)), tip = flat(scaled(state.light, outer));
  const aside = [-state.light[1], state.light[0], 0];
  const barbs = [1, -1].map((side) => flat([0, 1, 2].map((i) =>
    outer * (0.92 * state.light[i] + side * 0.045 * aside[i]))));
  polyline(pen, [tail, tip, barbs[0], tip, barbs[1]], ORANGE, 2.5);
  const [sx, sy] = flat(scaled(state.light, 1.1 * outer));
  pen.fillStyle = "#B87A00";
  pen.fillText("sun", sx, sy);

  const ways = position.map((way, index) => {
    const gone = [...way.slice(0, state.row + 1), state.places[index]];
    return gone.map((p) => ({ at: flat(p), hidden: hidden(p) }));
  });
  const drawWays = (behind) => ways.forEach((way, index) => {
    let piece = [];
    const { colour, dashes } = deputies[index];
    way.forEach((p) => {
      if (p.hidden === behind) { piece.push(p.at); return; }
      if (piece.length > 1) polyline(pen, piece, colour, 2, dashes);
      piece = [p.at];
    });
    if (piece.length > 1) polyline(pen, piece, colour, 2, dashes);
  });
  const drawDeputies = (behind) => ways.forEach((way, index) => {
    const p = way[way.length - 1];
    if (p.hidden === behind) disc(pen, ...p.at, 6, deputies[index].colour, "#fff", 1.5);
  });
  if (element("future").checked) {
    position.forEach((way, index) => {
      pen.globalAlpha = 0.3;
      polyline(pen, way.slice(state.row).map(flat), deputies[index].colour, 1.2);
      pen.globalAlpha = 1;
    });
  }
  drawWays(true);
  drawDeputies(true);
  drawChief(pen, x0, y0, r, view, state.light, now);
  drawWays(false);
  drawBurns(pen, flat, hidden, state.row, outer);
  drawDeputies(false);
  const inset = Math.min(0.13 * width, 0.17 * height);
  if (r < 0.6 * inset) {
    const x = width - inset - 18, y = inset + 18;
    disc(pen, x, y, inset + 8, "#fff");
    drawChief(pen, x, y, inset, view, state.light, now);
    pen.fillStyle = GREY;
    pen.fillText("the chief from here", x, y + inset + 13);
  }
}

/** A stroke in the direction of the thrust at each burn so far. */
function drawBurns(pen, flat, hidden, row, outer) {
  episode.burns.forEach((burns, index) => burns.forEach(({ step, thrust }) => {
    const foot = position[index][step];
    if (step > row || hidden(foot)) return;
    const tip = foot.map((x, i) => x + outer * thrust[i]);
    polyline(pen, [flat(foot), flat(tip)], "#222", 1.2);
    disc(pen, ...flat(foot), 1.8, "#222");
  }));
}

function drawChart(chart) {
  const { pen, width, height } = prepared(chart.canvas);
  const box = { left: 62, right: width - 8, top: 16, bottom: height - (chart.bottom ? 34 : 8) };
  const [low, high] = chart.range;
  const x = (t) => box.left + t / END * (box.right - box.left);
  const y = (value) => box.bottom - (value - low) / (high - low || 1) * (box.bottom - box.top);
  pen.textBaseline = "middle";
  pen.fillStyle = "#222";
  pen.textAlign = "left";
  pen.fillText(chart.label, box.left, 7);
  pen.textAlign = "right";
  for (const tick of ticks(low, high, 3)) {
    polyline(pen, [[box.left, y(tick)], [box.right, y(tick)]], "#E6E6E6", 1);
    pen.fillText(String(tick), box.left - 6, y(tick));
  }
  pen.textAlign = "center";
  for (const tick of ticks(0, END / episode.unit_seconds, 6)) {
    const at = x(tick * episode.unit_seconds);
    polyline(pen, [[at, box.top], [at, box.bottom]], "#E6E6E6", 1);
    if (chart.bottom) pen.fillText(String(tick), at, box.bottom + 9);
  }
  if (chart.bottom) pen.fillText(`time [${episode.unit}]`, (box.left + box.right) / 2, height - 8);
  pen.save();
  pen.beginPath();
  pen.rect(box.left - 1, box.top - 2, box.right - box.left + 2, box.bottom - box.top + 4);
  pen.clip();
  for (const line of chart.lines) {
    const places = [];
    line.values.forEach((value, i) => {
      if (line.step && i) places.push([x(time[i]), places[places.length - 1][1]]);
      places.push([x(time[i]), y(value)]);
    });
    polyline(pen, places, line.colour, line.width || 1.6, line.dashes || []);
  }
  pen.restore();
  polyline(pen, [[x(now), box.top], [x(now), box.bottom]], ORANGE, 1.5);
  chart.timeAt = (px) => Math.min(Math.max((px - box.left) / (box.right - box.left), 0), 1) * END;
}

/** Round values between two bounds. */
function ticks(low, high, wanted) {
  const raw = (high - low) / wanted || 1, power = 10 ** Math.floor(Math.log10(raw));
  const step = [1, 2, 2.5, 5, 10].map((factor) => factor * power).find((size) => size >= raw * 0.999);
  const found = [];
  for (let k = Math.ceil(low / step - 1e-9); k * step <= high + 1e-9 * step; k++) {
    found.push(Number((k * step).toPrecision(8)));
  }
  return found;
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
  const state = stateAt(now);
  const spent = episode.delta_v.reduce((sum, values) => sum + values[state.row], 0);
  const told = [`${(now / episode.unit_seconds).toFixed(1)} ${episode.unit}`,
    `${state.count} of ${points.length} points inspected`, `delta-v ${spent.toFixed(3)} m/s`];
  if (now >= END && episode.ending) told.push(episode.ending);
  element("counters").replaceChildren(...told.map((text) => {
    const span = document.createElement("span");
    span.textContent = text;
    return span;
  }));
  drawScene(state);
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

function keyEntry(text, colour, dot) {
  const row = document.createElement("div"), mark = document.createElement("i"), label = document.createElement("span");
  mark.style.borderColor = colour;
  if (dot) { mark.className = "dot"; mark.style.background = dot; }
  label.textContent = text;
  row.append(mark, label);
  element("key").append(row);
}

deputies.forEach(({ name, colour }) => keyEntry(name, colour));
keyEntry(deputies.length > 1 ? "inspected: who saw it first" : "inspected", deputies[0].colour, deputies[0].colour);
keyEntry("lit, not inspected", "#222", "#fff");
keyEntry("in the dark", DARK, DARK);
keyEntry("burn", "#222");

space.addEventListener("pointerdown", (event) => space.setPointerCapture(event.pointerId));
space.addEventListener("pointermove", (event) => {
  if (!event.buttons) return;
  camera.azimuth -= 0.35 * event.movementX;
  camera.elevation = Math.min(Math.max(camera.elevation + 0.35 * event.movementY, -90), 90);
  show(now);
});
space.addEventListener("wheel", (event) => {
  event.preventDefault();
  camera.zoom = Math.min(Math.max(camera.zoom * Math.exp(-0.0015 * event.deltaY), 0.3), 2 * episode.reach / radius);
  show(now);
}, { passive: false });
element("time").addEventListener("input", () => show(Number(element("time").value) / 1000 * END));
element("play").addEventListener("click", () => play(!playing));
element("near").addEventListener("click", () => { camera.zoom = 0.45 * episode.reach / radius; show(now); });
element("far").addEventListener("click", () => { Object.assign(camera, FIRST, { zoom: 1 }); show(now); });
element("future").addEventListener("change", () => show(now));
window.addEventListener("resize", () => show(now));
window.addEventListener("keydown", (event) => {
  if (event.target.tagName === "SELECT") return;
  if (event.key === " ") { event.preventDefault(); play(!playing); }
  const step = { ArrowLeft: -1, ArrowRight: 1 }[event.key];
  if (step) { event.preventDefault(); play(false); show(time[Math.min(Math.max(rowAt(now) + step, 0), last)]); }
});
// A place in the episode can be named, such as page.html#0.5 for its middle.
show((Number(location.hash.slice(1)) || 0) * END);
