"use strict";
// The time cursor of the page, and what follows it: the curves, the values, the robot. Folded curves are drawn when opened.
// Whatever else shall follow listens to the event "cursor" of the document, whose detail is the number of the frame.

// The cursor

const frames = panelData("frames"), n = frames.n, times = array(frames.t), values = frames.values.map(array);
const [slider, clock, play, speed] = ["time", "clock", "play", "speed"].map(id => document.getElementById(id));
const reducedMotion = matchMedia("(prefers-reduced-motion: reduce)");
let cursor = 0, playing = 0;

// q of the drawing: joints of several screws turn about x, y and z, then shift, as joints of one screw each
const steps = panelData("robot").q, drawn = steps ? array(steps) : values[0];
const stateAt = frame => ({t: times[frame], q: drawn.slice(frame * n, frame * n + n)});

function moveTo(frame) {
  cursor = Math.max(0, Math.min(times.length - 1, frame));
  slider.value = cursor;
  clock.textContent = `t = ${times[cursor].toFixed(4)} s`;
  slider.setAttribute("aria-valuetext", clock.textContent);
  document.dispatchEvent(new CustomEvent("cursor", {detail: cursor}));
}

function frameAt(t) {
  let best = 0;
  times.forEach((x, k) => { if (Math.abs(x - t) < Math.abs(times[best] - t)) best = k; });
  return best;
}

function stop() {
  cancelAnimationFrame(playing);
  playing = 0;
  play.textContent = "Play";
}

function start() {
  const first = times[cursor === times.length - 1 ? 0 : cursor], began = performance.now();
  const tick = reducedMotion.matches ? 1 : 0; // s: a picture per second instead of a moving one
  const step = now => {
    const passed = Math.max(0, now - began) / 1000, t = first + speed.value * (tick ? Math.floor(passed / tick) * tick : passed);
    const frame = times.findIndex(x => x >= t);
    if (frame !== cursor) moveTo(frame < 0 ? times.length - 1 : frame);
    if (frame < 0) stop(); else playing = requestAnimationFrame(step);
  };
  play.textContent = "Pause";
  playing = requestAnimationFrame(step);
}

play.addEventListener("click", () => playing ? stop() : start());
speed.addEventListener("change", () => { if (playing) { stop(); start(); } });
slider.addEventListener("input", () => { stop(); moveTo(+slider.value); });
all("[data-frame]").forEach(button => button.addEventListener("click", () => { stop(); moveTo(+button.dataset.frame); }));

// The values under the cursor

const cells = all(".values table").flatMap(table => [...table.querySelectorAll("tbody tr")].flatMap((row, j) =>
  [...row.querySelectorAll("td")].map(cell => ({cell, j, k: +cell.dataset.value}))));
const NOISE = 1e-12; // of the largest value of a quantity: the rounding of what is 0
const noise = values.map(of => NOISE * of.reduce((most, x) => Math.max(most, Math.abs(x) || 0), 0));
const digits = x => x && Math.abs(x) < 0.01 ? x.toExponential(2) : +x.toPrecision(5); // short, to fit a phone
document.addEventListener("cursor", ({detail: frame}) => cells.forEach(({cell, j, k}) => {
  const value = values[k][frame * n + j], [lower, upper] = frames.bounds[k].map(bound => bound[j]), t = times[frame];
  const [start, stop] = frames.windows[k] || [t, t];
  cell.textContent = Number.isNaN(value) ? "–" : digits(Math.abs(value) > noise[k] ? value : 0);
  cell.classList.toggle("beyond", lower !== null && value < lower || upper !== null && value > upper);
  cell.classList.toggle("uncertain", t < start || t > stop);
}));

// The curves: a figure of the forces, and one of all else. A figure in a fold is drawn when the fold is opened.

const joints = all("[data-joint]"), OPTIONS = {responsive: true, displayModeBar: false};
const figures = all(".charts").map(box => ({...panelData(box.dataset.charts), curves: box.querySelector(".plot"), line: box.querySelector(".line")}));
const ALWAYS_DRAWN = -1; // of curves that are of no joint
const drawnJoints = () => [ALWAYS_DRAWN, ...joints.filter(box => box.checked).map(box => +box.dataset.joint)];
let span = figures[0].layout.xaxis.range.slice(); // of the time axes of all figures

function axisRanges({ranges}) { // of each chart, with a margin
  return Object.entries(ranges).flatMap(([axis, ranges]) => {
    const drawn = drawnJoints().filter(j => j in ranges).map(j => ranges[j]);
    const low = Math.min(...drawn.map(range => range[0])), high = Math.max(...drawn.map(range => range[1]));
    const margin = 0.06 * (high - low) || 0.1 * Math.abs(high) || 1;
    return drawn.length ? [[axis + ".range", [low - margin, high + margin]]] : [];
  });
}

const isDrawn = ({data}) => data.map(trace => drawnJoints().includes(trace.meta));

// The line of the cursor lies over the charts: plotly would draw all of them again to move one of its own.
function placeLine({line, layout}) {
  const [left, right] = span, share = (times[cursor] - left) / (right - left), {l, r, t, b} = layout.margin;
  Object.assign(line.style, {left: `calc(${l}px + ${share} * (100% - ${l + r}px))`, top: `${t}px`, bottom: `${b}px`});
  line.hidden = share < 0 || share > 1;
}

function show(range) { // all time axes show the same span
  if (range.every((t, side) => t === span[side])) return;
  span = range.slice();
  figures.filter(figure => figure.isPlotted).forEach(({curves}) => Plotly.relayout(curves, {"xaxis.range": span.slice()}));
  figures.forEach(placeLine);
}

function plot(figure) {
  if (figure.isPlotted) return;
  const {curves, data, layout} = figure;
  figure.isPlotted = true;
  if (matchMedia("(pointer: coarse)").matches) layout.dragmode = false; // fingers scroll the page
  layout.xaxis.range = span.slice();
  for (const [key, range] of axisRanges(figure)) layout[key.split(".")[0]].range = range;
  isDrawn(figure).forEach((visible, k) => { data[k].visible = visible; });
  Plotly.newPlot(curves, data, layout, OPTIONS);
  curves.on("plotly_click", event => { stop(); moveTo(frameAt(event.points[0].x)); });
  curves.on("plotly_relayout", () => show(curves.layout.xaxis.range));
}

figures.forEach(figure => {
  const fold = figure.curves.closest("details");
  if (fold) fold.addEventListener("toggle", () => { if (fold.open) plot(figure); }); else plot(figure);
});
document.addEventListener("cursor", () => figures.forEach(placeLine));

joints.forEach(box => box.addEventListener("change", () => figures.filter(figure => figure.isPlotted).forEach(figure =>
  Plotly.update(figure.curves, {visible: isDrawn(figure)}, Object.fromEntries(axisRanges(figure))))));

all("[data-span]").forEach(button => button.addEventListener("click", () => {
  const [first, last] = [times[0], times[times.length - 1]], width = (last - first) * button.dataset.span;
  const left = Math.max(first, Math.min(last - width, times[cursor] - width / 2));
  show([left, left + width]);
}));

// Paper shows all: folds are opened to be printed, and closed again.
const folds = all("details"), heights = figures.map(figure => figure.layout.height);
let openedToPrint = [];
addEventListener("beforeprint", () => {
  openedToPrint = folds.filter(fold => !fold.open);
  openedToPrint.forEach(fold => { fold.open = true; });
  figures.forEach(plot);
  figures.forEach(({curves}, k) => Plotly.relayout(curves, {width: 680, height: Math.min(heights[k], 960)}));
});
addEventListener("afterprint", () => {
  figures.forEach(({curves}, k) => Plotly.relayout(curves, {width: null, autosize: true, height: heights[k]}));
  openedToPrint.forEach(fold => { fold.open = false; });
});

// The robot: C_i = C_p B_i exp(X_i theta_i) with theta = G q + g; a pose is the three rows of (R r)

const robot = panelData("robot"), drawing = document.getElementById("robot");
const [B, X, G, g] = ["B", "X", "G", "g"].map(name => array(robot[name]));
const solids = robot.solids.map(solid => Object.fromEntries(["bodies", "vertices", "triangles"].map(name => [name, array(solid[name])])));
const IDENTITY = [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0];

function product(a, b) {
  return IDENTITY.map((_, k) => {
    const row = k - k % 4, column = k % 4;
    return a[row] * b[column] + a[row + 1] * b[4 + column] + a[row + 2] * b[8 + column] + (column === 3 ? a[row + 3] : 0);
  });
}

function exp([x, y, z, ...m], theta) {
  const s = Math.sin(theta), c = 1 - Math.cos(theta), square = x * x + y * y + z * z;
  const tilde = [[0, -z, y], [z, 0, -x], [-y, x, 0]], e = [x, y, z];
  const mixed = (i, j, a, b, d) => (i === j ? a - d * square : 0) + b * tilde[i][j] + d * e[i] * e[j];
  return [0, 1, 2].flatMap(i => [
    ...[0, 1, 2].map(j => mixed(i, j, 1, s, c)),
    [0, 1, 2].reduce((sum, j) => sum + mixed(i, j, theta, c, theta - s) * m[j], 0),
  ]);
}

const jointsOf = robot.parent.map((_, i) => [...robot.owners.keys()].filter(k => robot.owners[k] === i));

const bases = robot.base && array(robot.base);

function pose(q, base = IDENTITY) {
  const C = [];
  robot.parent.forEach((p, i) => {
    const Bi = B.subarray(12 * i, 12 * i + 12);
    C.push(jointsOf[i].reduce((T, k) => {
      const theta = q.reduce((sum, x, j) => sum + G[k * n + j] * x, g[k]);
      return product(T, exp([...X.slice(6 * k, 6 * k + 6)], theta));
    }, product(p < 0 ? base : C[p], Bi)));
  });
  return C;
}

function points(C, {bodies, vertices}, base) {
  const ground = robot.floats ? IDENTITY : base;
  const found = [0, 1, 2].map(() => new Float32Array(bodies.length));
  bodies.forEach((body, v) => {
    const T = body < 0 ? ground : C[body], x = vertices[3 * v], y = vertices[3 * v + 1], z = vertices[3 * v + 2];
    found.forEach((axis, k) => { axis[v] = T[4 * k] * x + T[4 * k + 1] * y + T[4 * k + 2] * z + T[4 * k + 3]; });
  });
  return found;
}

const baseAt = frame => bases ? bases.subarray(12 * frame, 12 * frame + 12) : IDENTITY;

function drawRobot(q, base = IDENTITY) {
  const C = pose(q, base), found = solids.map(solid => points(C, solid, base));
  const [x, y, z] = [0, 1, 2].map(side => found.map(axes => axes[side]));
  Plotly.restyle(drawing, {x, y, z}, found.map((_, trace) => trace));
}

// Browsers print what a canvas of WebGL keeps, and it keeps nothing unless asked to.
const getContext = HTMLCanvasElement.prototype.getContext;
HTMLCanvasElement.prototype.getContext = function (type, options) {
  return getContext.call(this, type, type.startsWith("webgl") ? {...options, preserveDrawingBuffer: true} : options);
};

// The camera: as near as the corners of the space fit, with their labels
function fittedCamera(sides, width, height) {
  const FIELD = Math.tan(Math.PI / 8), ROUNDS = 40, LEFT = 66, RIGHT = 36, HIGH = 28; // of plotly's camera; px around the corners, for labels
  const unit = v => v.map(x => x / Math.hypot(...v)), along = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
  const toEye = unit([1.35, -1.35, 0.6]), right = unit([-toEye[1], toEye[0], 0]);
  const up = [-toEye[2] * right[1], toEye[2] * right[0], toEye[0] * right[1] - toEye[1] * right[0]];
  const corners = [...Array(8).keys()].map(k => sides.map((side, axis) => side * ((k >> axis & 1) - 0.5)));
  const room = [(width - LEFT - RIGHT) / height, 1 - 2 * HIGH / height], middle = [(LEFT - RIGHT) / height, 0]; // of half the height
  let center = [0, 0, 0], distance = 3;
  for (let round = 0; round < ROUNDS; round++) {
    const seen = corners.map(corner => corner.map((x, k) => x - center[k])).map(corner => {
      const scale = 1 / (FIELD * (distance - along(corner, toEye)));
      return [scale * along(corner, right), scale * along(corner, up)];
    });
    const [across, high] = [0, 1].map(k => [Math.min(...seen.map(x => x[k])), Math.max(...seen.map(x => x[k]))]);
    const shift = [across, high].map(([low, top], k) => FIELD * distance * ((low + top) / 2 - middle[k]));
    center = center.map((x, k) => x + shift[0] * right[k] + shift[1] * up[k]);
    distance *= Math.max((across[1] - across[0]) / room[0], (high[1] - high[0]) / room[1]) / 2;
  }
  const [x, y, z] = center;
  return {eye: {x: x + distance * toEye[0], y: y + distance * toEye[1], z: z + distance * toEye[2]}, center: {x, y, z}};
}

function robotFigure() {
  const C = pose(stateAt(0).q, baseAt(0)), lighting = {ambient: 0.65, diffuse: 0.7, specular: 0.1, facenormalsepsilon: 0}; // small triangles have normals too
  const shading = {flatshading: true, lighting, hoverinfo: "skip"};
  const surfaces = solids.map((solid, s) => {
    const [x, y, z] = points(C, solid, baseAt(0)), {triangles} = solid, third = triangles.length / 3;
    const [i, j, k] = [0, 1, 2].map(side => triangles.slice(side * third, side * third + third));
    return {type: "mesh3d", x, y, z, i, j, k, color: robot.solids[s].colour, ...shading};
  });
  const ends = robot.ends.map(packed => {
    const end = array(packed), [x, y, z] = [0, 1, 2].map(side => end.filter((_, k) => k % 3 === side));
    return {type: "scatter3d", mode: "lines", x, y, z, line: {color: "#777777", width: 2}, hoverinfo: "skip"};
  });
  const look = {autorange: false, gridcolor: "#d8d8d8", showbackground: false, showspikes: false, nticks: drawing.clientWidth < 400 ? 3 : 5};
  const [xaxis, yaxis, zaxis] = ["x", "y", "z"].map((name, side) => ({title: {text: name + " [m]"}, range: robot.space[side], ...look}));
  const spans = robot.space.map(([low, high]) => high - low), mean = Math.cbrt(spans[0] * spans[1] * spans[2]);
  const [rx, ry, rz] = spans.map(span => span / mean); // of the space, not of what lies in it
  const camera = fittedCamera([rx, ry, rz], drawing.clientWidth, drawing.clientHeight);
  return [[...surfaces, ...ends], {
    margin: {l: 0, r: 0, t: 0, b: 0}, paper_bgcolor: "rgba(0,0,0,0)", showlegend: false, font: {color: "#222222", size: 11},
    scene: {aspectmode: "manual", aspectratio: {x: rx, y: ry, z: rz}, xaxis, yaxis, zaxis, camera},
  }];
}
Plotly.newPlot(drawing, ...robotFigure(), OPTIONS);
document.addEventListener("cursor", ({detail: frame}) => drawRobot(stateAt(frame).q, baseAt(frame)));

all("[data-turn], [data-closer]").forEach(button => button.addEventListener("click", () => {
  const turn = (button.dataset.turn || 0) * Math.PI / 180, s = Math.sin(turn), c = Math.cos(turn), factor = +(button.dataset.closer || 1);
  const turned = ({x, y, z}) => ({x: c * x - s * y, y: s * x + c * y, z});
  const {camera} = drawing.layout.scene, center = turned(camera.center), eye = turned(camera.eye);
  for (const side of "xyz") eye[side] = center[side] + factor * (eye[side] - center[side]);
  Plotly.relayout(drawing, {"scene.camera": {...camera, eye, center}});
}));

moveTo(frames.start);
