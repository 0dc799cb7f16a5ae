// The scene of a rendezvous: tumbling target, chaser with its camera, flight, plan and tube, in W or in the target's axes.
const { position, body, attitude, reference, tube, target, chaser, colours, bands } = episode;
const BEFORE = "#B8C4D0", TARGET_INK = [184, 191, 204], CHASER_INK = [250, 219, 153];
let inTarget = false;

const minus = (a, b) => a.map((x, i) => x - b[i]);
/** Return the rows of the rotation matrix of a unit quaternion [x, y, z, w]. */
function matrix([x, y, z, w]) {
  return [
    [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
    [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
    [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
  ];
}
const times = (rows, v) => rows.map((row) => dot3(row, v));
const back = (rows, v) => [0, 1, 2].map((i) => rows[0][i] * v[0] + rows[1][i] * v[1] + rows[2][i] * v[2]);
const turnedBy = (view, rows) => Object.fromEntries(Object.entries(view).map(([name, v]) => [name, back(rows, v)]));
const IDENTITY = [[1, 0, 0], [0, 1, 0], [0, 0, 1]];
const attitudes = attitude.map(matrix);
const positionInTarget = position.map((p, i) => back(attitudes[i], p));
const referenceInTarget = reference.map((p, i) => (p[0] === null ? p : back(attitudes[i], p)));

/** Return the linear interpolation between two quaternions. */
function between(p, q, u) {
  const sign = p.reduce((sum, x, i) => sum + x * q[i], 0) < 0 ? -1 : 1;
  const r = mixed(p, scaled(q, sign), u), norm = Math.hypot(...r);
  return scaled(r, 1 / norm);
}

function stateAt(t) {
  const row = rowAt(t), next = Math.min(row + 1, last);
  const u = next > row ? (t - time[row]) / (time[next] - time[row]) : 0;
  return {
    row,
    place: mixed(position[row], position[next], u),
    body: matrix(between(body[row], body[next], u)),
    target: matrix(between(attitude[row], attitude[next], u)),
    band: bands.filter(({ start }) => start <= t + 1e-9).pop() || bands[0],
  };
}

/** Return a function that says whether a solid hides a point from a distant viewer in the direction `sight`. */
function hiding(solid, sight) {
  const tiny = 1e-3 * Math.max(...solid.triangles.flat(2).map(Math.abs)), rows = [];
  for (const [corner, b, c] of solid.triangles) {
    const first = minus(b, corner), second = minus(c, corner), normal = cross3(first, second);
    const toward = dot3(normal, sight);
    if (toward > 1e-9 * Math.hypot(...normal)) {
      const over = (v) => v.map((x) => x / toward);
      rows.push([corner, over(cross3(second, sight)), over(cross3(sight, first)), over(normal)]);
    }
  }
  return (point) => rows.some(([corner, u, v, t]) => {
    const from = minus(point, corner), a = dot3(u, from), b = dot3(v, from);
    return a > 0 && b > 0 && a + b < 1 && -dot3(t, from) > tiny;
  });
}

/** Draw a solid; `view` has the camera's directions in their frame, `flat` maps points of this frame to pixels. */
function drawSolid(pen, solid, view, flat, ink) {
  const light = [0, 1, 2].map((i) => view.sight[i] + 0.55 * view.up[i] - 0.35 * view.right[i]);
  const norm = Math.hypot(...light), seen = [];
  solid.patches.forEach((patch, i) => {
    if (dot3(solid.normals[i], view.sight) > 1e-9) {
      seen.push([dot3(patch[0], view.sight) + dot3(patch[2], view.sight), patch, solid.normals[i]]);
    }
  });
  seen.sort((a, b) => a[0] - b[0]);
  for (const [, patch, normal] of seen) {
    const bright = 0.58 + 0.42 * Math.max(dot3(normal, light) / norm, 0);
    const colour = `rgb(${ink.map((x) => Math.round(x * bright)).join(",")})`;
    pen.beginPath();
    patch.forEach((corner, i) => (i ? pen.lineTo(...flat(corner)) : pen.moveTo(...flat(corner))));
    pen.closePath();
    pen.fillStyle = pen.strokeStyle = colour;
    pen.lineWidth = 0.7;
    pen.fill();
    pen.stroke();
  }
  const hides = hiding(solid, view.sight);
  for (const [a, b] of solid.edges) {
    if (!hides(mixed(a, b, 0.5))) polyline(pen, [flat(a), flat(b)], GREY, 0.9);
  }
}

/** Fill each uninterrupted part of the tube up to a row, with the width of its box in the picture. */
function drawTube(pen, centres, row, view, flat, metre) {
  let kept = [];
  const fill = () => {
    const sides = [[], []];
    kept.forEach(({ k, at }, i) => {
      const from = kept[Math.max(i - 1, 0)].at, to = kept[Math.min(i + 1, kept.length - 1)].at;
      const long = Math.hypot(to[0] - from[0], to[1] - from[1]) || 1;
      const across = [(from[1] - to[1]) / long, (to[0] - from[0]) / long];
      const direction = [0, 1, 2].map((j) => across[0] * view.right[j] - across[1] * view.up[j]);
      const inW = inTarget ? times(attitudes[k], direction) : direction;
      const wide = metre * tube[k] * inW.reduce((sum, x) => sum + Math.abs(x), 0);
      [1, -1].forEach((side, j) => sides[j].push([at[0] + side * wide * across[0], at[1] + side * wide * across[1]]));
    });
    pen.beginPath();
    [...sides[0], ...sides[1].reverse()].forEach((place, i) => (i ? pen.lineTo(...place) : pen.moveTo(...place)));
    if (kept.length > 1) pen.fill();
    kept = [];
  };
  pen.fillStyle = colours.tube;
  pen.globalAlpha = 0.45;
  for (let k = 0; k <= row; k++) {
    if (tube[k] === null) { fill(); continue; }
    const at = flat(centres[k]), before = kept.length ? kept[kept.length - 1].at : null;
    if (!before || Math.hypot(at[0] - before[0], at[1] - before[1]) >= 6) kept.push({ k, at });
  }
  fill();
  pen.globalAlpha = 1;
}

function drawScene(t) {
  const state = stateAt(t), { pen, width, height } = prepared(space), view = axes();
  const metre = camera.zoom * Math.min(width, 1.25 * height) / 2.2 / episode.reach;
  const flat = (p) => [0.5 * width + dot3(p, view.right) * metre, 0.5 * height - dot3(p, view.up) * metre];
  const rotation = inTarget ? IDENTITY : state.target, own = turnedBy(view, rotation);
  const place = inTarget ? back(state.target, state.place) : state.place;
  const path = inTarget ? positionInTarget : position;
  const approach = bands.find(({ name }) => name === "TRACK"), first = approach ? rowAt(approach.start) : 0;
  const nearest = target.radius ** 2, hides = hiding(target, own.sight);
  // Most points are outside the region that the target sweeps, so that they need no further test.
  const hidden = (p) => dot3(p, p) - dot3(p, view.sight) ** 2 < nearest
    && hides(back(rotation, p));
  const line = (points, colour, wide, dashes = []) => {
    const behind = points.map(hidden), places = points.map(flat);
    for (const which of [true, false]) {  // hidden parts are thin and dotted
      let piece = [];
      const stroke = () => {
        if (piece.length > 1) polyline(pen, piece, colour, which ? 0.4 * wide : wide, which ? [1, 4] : dashes);
        piece = [];
      };
      places.forEach((place, i) => { piece.push(place); if (behind[i] !== which) { stroke(); piece = [place]; } });
      stroke();
    }
  };
  const drawChaser = () => {
    const toFrame = inTarget ? [0, 1, 2].map((i) => back(state.target, state.body.map((row) => row[i]))) : null;
    const bodyRows = toFrame ? IDENTITY.map((_, i) => toFrame.map((column) => column[i])) : state.body;
    const at = (p) => flat(times(bodyRows, p).map((x, i) => x + place[i]));
    const cone = chaser.cone.map(at);
    for (const corner of cone.slice(1)) polyline(pen, [cone[0], corner], colours.camera, 1.2);
    polyline(pen, [...cone.slice(1), cone[1]], colours.camera, 1.2);
    drawSolid(pen, chaser, turnedBy(view, bodyRows), at, CHASER_INK);
    disc(pen, ...flat(place), chaser.radius * metre, null, GREY, 1);
  };
  const behind = hidden(place);
  if (behind) drawChaser();
  drawSolid(pen, target, own, (p) => flat(times(rotation, p)), TARGET_INK);
  drawTube(pen, inTarget ? referenceInTarget : reference, state.row, view, flat, metre);
  const gone = [...path.slice(first, state.row + 1), place];
  line(path.slice(0, Math.min(first, state.row) + 1), BEFORE, 1);
  if (state.row >= first) line(gone, colours.flight, 2.2);
  const plan = episode.plans.filter(({ start }) => start <= t + 1e-9).pop() || episode.plans[0];
  if (plan) line(inTarget ? plan.position_target : plan.position, colours.plan, 1.2, [6, 4]);
  if (element("future").checked) line(path.slice(state.row), BEFORE, 1.2);
  if (!behind) drawChaser();
  disc(pen, ...flat(times(rotation, episode.mating_point)), 4.5, colours.mating, PAPER, 1.5);
  drawCorner(pen, view, width, height);
}

/** Draw the axes of the frame in a corner. */
function drawCorner(pen, view, width, height) {
  const corner = [width < 500 ? width - 60 : 60, height - (width < 500 ? 50 : 80)];  // next to the legend on a small screen
  pen.fillStyle = GREY;
  pen.textAlign = "center";
  pen.textBaseline = "middle";
  IDENTITY.forEach((direction, i) => {
    const tip = (size) => [corner[0] + size * dot3(direction, view.right), corner[1] - size * dot3(direction, view.up)];
    polyline(pen, [corner, tip(28)], GREY, 1);
    pen.fillText(inTarget ? "123"[i] : "xyz"[i], ...tip(38));
  });
}

function countersAt(t) {
  const state = stateAt(t);
  const texts = [`${t.toFixed(1)} s`, state.band.name, `${episode.distance[state.row].toFixed(2)} m to the mating point`];
  return t >= END ? [...texts.slice(0, 2), episode.ending] : texts;
}

function showFrame() {
  element("near").textContent = inTarget ? "in the target's axes" : "in W";
  element("near").title = "change the frame of the scene";
}

[["flight", colours.flight], ["before the approach", BEFORE], ["plan", colours.plan], ["tube", colours.tube],
  ["camera", colours.camera]].forEach(([name, colour]) => keyEntry(name, colour));
keyEntry("mating point", colours.mating, colours.mating);
new Map(bands.map(({ name, colour }) => [name, colour])).forEach((colour, name) => keyEntry(name, colour, colour));
element("near").addEventListener("click", () => { inTarget = !inTarget; showFrame(); show(now); });
showFrame();
begin();
