// The scene of an episode: deputies with their trajectories and burns, the chief and the sun, or the docking region.
const { position, sun, beta, sunlight, points, radius, rings, deputies, orientation, cone } = episode;
const BODY = [[[1, 0, 0], "#D55E00"], [[0, 1, 0], "#0072B2"], [[0, 0, 1], "#009E73"]];
const NIGHT = "#B4BAC4", DAY = "#FFF1C4", DARK = "#4B5563";

const unit = (a) => scaled(a, 1 / (Math.hypot(...a) || 1));

/** Return R(q) v for a unit quaternion with the scalar last. */
function turned(q, v) {
  const t = scaled(cross3(q, v), 2), s = cross3(q, t);
  return v.map((x, i) => x + q[3] * t[i] + s[i]);
}

/** Return the attitude between two recorded ones. */
function attitudeAt(rows, row, next, u) {
  const a = rows[row], b = rows[next], sign = a.reduce((sum, x, i) => sum + x * b[i], 0) < 0 ? -1 : 1;
  return unit(a.map((x, i) => (1 - u) * x + u * sign * b[i]));
}

/** Return the state at a time, interpolated linearly between two recorded states. */
function stateAt(t) {
  const row = rowAt(t), next = Math.min(row + 1, last);
  const u = next > row ? (t - time[row]) / (time[next] - time[row]) : 0;
  const angle = sun && sun[row] + u * (sun[next] - sun[row]), tilt = beta ? beta[row] : 0;
  return {
    row,
    places: position.map((way) => mixed(way[row], way[next], u)),
    light: sun && [Math.cos(tilt) * Math.cos(angle), -Math.cos(tilt) * Math.sin(angle), Math.sin(tilt)],
    eclipse: Boolean(sunlight) && sunlight[row] < 0.5,
    attitudes: orientation && orientation.map((rows) => attitudeAt(rows, row, next, u)),
    dots: episode.chief ? points.map((p) => turned(attitudeAt(episode.chief, row, next, u), p)) : points,
    count: episode.inspected_at.filter((when) => when !== null && when <= t).length,
  };
}

/** Draw the chief with its day side and the points on the viewer's side; r is in pixels. */
function drawChief(pen, x, y, r, view, { light, eclipse, dots }, t) {
  if (!points.length || !light) {
    if (episode.docking_radius) disc(pen, x, y, r, null, INK);
    for (const [dx, dy] of [[5, 0], [0, 5]]) polyline(pen, [[x - dx, y - dy], [x + dx, y + dy]], INK, 1);
    return;
  }
  disc(pen, x, y, r, NIGHT);
  const a = dot3(light, view.right), b = dot3(light, view.up), d = dot3(light, view.sight);
  pen.save();
  pen.translate(x, y);
  pen.rotate(Math.atan2(-b, a));
  pen.beginPath();
  pen.arc(0, 0, r, -Math.PI / 2, Math.PI / 2);
  pen.ellipse(0, 0, Math.abs(d) * r, r, 0, Math.PI / 2, -Math.PI / 2, d < 0);
  pen.fillStyle = eclipse ? NIGHT : DAY;
  pen.fill();
  pen.restore();
  disc(pen, x, y, r, null, GREY);
  if (r < 12) return;  // too small for its points
  const size = Math.max(1.2, Math.min(6, r / 20));
  dots.forEach((point, i) => {
    if (dot3(point, view.sight) <= 0) return;
    const px = x + dot3(point, view.right) / radius * r, py = y - dot3(point, view.up) / radius * r;
    const when = episode.inspected_at[i];
    if (when !== null && when <= t) disc(pen, px, py, size, deputies[episode.inspector[i]].colour);
    else if (!eclipse && dot3(point, light) > 0) disc(pen, px, py, size, "#fff", "#222", Math.max(0.6, size / 4));
    else disc(pen, px, py, 0.7 * size, DARK);
  });
}

function drawScene(t) {
  const state = stateAt(t);
  const { pen, width, height } = prepared(space);
  const view = axes(), reach = episode.reach;
  const metre = camera.zoom * Math.min(width, 1.25 * height) / 2.2 / reach;
  const x0 = 0.5 * width, y0 = 0.5 * height, r = radius * metre;
  const flat = (p) => [x0 + dot3(p, view.right) * metre, y0 - dot3(p, view.up) * metre];
  const hidden = (p) => points.length > 0 && dot3(p, view.sight) < 0
    && dot3(p, view.right) ** 2 + dot3(p, view.up) ** 2 < radius * radius;
  const circle = (ring) => Array.from({ length: 121 }, (_, i) => {
    const angle = i / 60 * Math.PI;
    return [ring * Math.cos(angle), ring * Math.sin(angle), 0];
  });
  const outer = rings[rings.length - 1];
  pen.textAlign = "center";
  pen.textBaseline = "middle";
  const left = (camera.azimuth - 90) * Math.PI / 180;
  let free = null;  // inner end of the label of the next larger ring
  for (const ring of [...rings].reverse()) {
    polyline(pen, circle(ring).map(flat), PALE, 1);
    const [x, y] = flat([ring * Math.cos(left), ring * Math.sin(left), 0]), label = `${ring} m`;
    const half = pen.measureText(label).width / 2 + 3;
    if (free !== null && Math.abs(x - free.x) < half + free.half && Math.abs(y - free.y) < 14) continue;
    pen.fillStyle = GREY;
    pen.fillText(label, Math.max(x, half), y - 8);
    free = { x, y, half };
  }
  [["x radial", [0.6, 0, 0]], ["y along track", [0, 0.6, 0]], ["z", [0, 0, 0.6]]].forEach(([name, direction]) => {
    const tip = scaled(direction, outer);
    polyline(pen, [flat([0, 0, 0]), flat(tip)], AXIS, 1);
    const [x, y] = flat(scaled(tip, 1.1));
    pen.fillStyle = GREY;
    pen.fillText(name, x, y);
  });
  if (state.light && !state.eclipse) drawSun(pen, flat, state.light, outer);

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
    if (p.hidden === behind) disc(pen, ...p.at, 6, deputies[index].colour, PAPER, 1.5);
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
  drawChief(pen, x0, y0, r, view, state, now);
  drawWays(false);
  drawBurns(pen, flat, hidden, state.row, outer);
  if (orientation) drawAttitudes(pen, flat, view, state, outer);
  drawDeputies(false);
  const inset = Math.min(0.13 * width, 0.17 * height);
  if (points.length && r < 0.6 * inset) {
    const x = width - inset - 18, y = inset + 18;
    disc(pen, x, y, inset + 8, PAPER);
    drawChief(pen, x, y, inset, view, state, now);
    pen.fillStyle = GREY;
    const words = "the chief from here";
    pen.fillText(words, Math.min(x, width - 4 - pen.measureText(words).width / 2), y + inset + 13);
  }
}

function drawSun(pen, flat, light, outer) {
  const tail = flat(scaled(light, 0.7 * outer)), tip = flat(scaled(light, outer));
  const aside = [-light[1], light[0], 0];
  const barbs = [1, -1].map((side) => flat([0, 1, 2].map((i) => outer * (0.92 * light[i] + side * 0.045 * aside[i]))));
  polyline(pen, [tail, tip, barbs[0], tip, barbs[1]], ORANGE, 2.5);
  pen.fillStyle = "#B87A00";
  pen.fillText("sun", ...flat(scaled(light, 1.1 * outer)));
}

/** Draw the axes of each deputy's body and the cone of its camera. */
function drawAttitudes(pen, flat, view, { places, attitudes }, outer) {
  places.forEach((p, index) => {
    const along = (direction, length) => p.map((x, i) => x + length * outer * direction[i]);
    BODY.forEach(([axis, colour]) => {
      polyline(pen, [flat(p), flat(along(turned(attitudes[index], axis), 0.09))], colour, 2);
    });
    if (!cone) return;
    const look = turned(attitudes[index], cone.axis), half = Math.min(cone.half, 0.5 * Math.PI);
    let across = cross3(look, view.sight);
    across = Math.hypot(...across) > 1e-6 ? unit(across) : view.right;
    const other = cross3(look, across);
    const rim = Array.from({ length: 37 }, (_, i) => {
      const [c, s] = [Math.cos(i * Math.PI / 18), Math.sin(i * Math.PI / 18)];
      const edge = look.map((x, k) => Math.cos(half) * x + Math.sin(half) * (c * across[k] + s * other[k]));
      return flat(along(edge, 0.25));
    });
    const colour = deputies[index].colour;
    pen.globalAlpha = 0.12;
    pen.fillStyle = colour;
    for (const places of [rim, [flat(p), rim[0], rim[18]]]) {
      pen.beginPath();
      places.forEach(([x, y], i) => (i ? pen.lineTo(x, y) : pen.moveTo(x, y)));
      pen.fill();
    }
    pen.globalAlpha = 0.7;
    for (const line of [rim, [rim[0], flat(p), rim[18]]]) polyline(pen, line, colour, 1);
    pen.globalAlpha = 1;
  });
}

/** Draw a stroke in the direction of the thrust at each burn so far. */
function drawBurns(pen, flat, hidden, row, outer) {
  episode.burns.forEach((burns, index) => burns.forEach(({ step, thrust }) => {
    const foot = position[index][step];
    if (step > row || hidden(foot)) return;
    const tip = foot.map((x, i) => x + outer * thrust[i]);
    polyline(pen, [flat(foot), flat(tip)], INK, 1.2);
    disc(pen, ...flat(foot), 1.8, INK);
  }));
}

function countersAt(t) {
  const state = stateAt(t);
  const spent = episode.delta_v.reduce((sum, values) => sum + values[state.row], 0);
  const nearest = Math.min(...state.places.map((p) => Math.sqrt(dot3(p, p))));
  const what = points.length ? `${state.count} of ${points.length} points inspected` : `range ${nearest.toFixed(1)} m`;
  const lines = [`${(t / episode.unit_seconds).toFixed(1)} ${episode.unit}`, what, `delta-v ${spent.toFixed(3)} m/s${deputies.length > 1 ? " in all" : ""}`];
  if (t >= END && episode.ending) lines.push(episode.ending);
  return lines;
}

deputies.forEach(({ name, colour, dashes }) => keyEntry(name, colour, null, dashes));
if (points.length) {
  keyEntry(deputies.length > 1 ? "inspected: who saw it first" : "inspected", deputies[0].colour, deputies[0].colour);
  keyEntry("lit, not inspected", GREY, "#fff");
  keyEntry("in the dark", DARK, DARK);
}
if (episode.docking_radius) keyEntry("docking region", INK, PAPER);
keyEntry("burn", INK);
if (orientation) ["x", "y", "z"].forEach((name, i) => keyEntry(`${name} axis of the body`, BODY[i][1]));
if (cone) keyEntry("camera's cone", deputies[0].colour);

element("near").addEventListener("click", () => { camera.zoom = 0.45 * episode.reach / radius; show(now); });
begin();
