"use strict";
// The time cursor of the page, and what follows it: the curves, the values, the robot.
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

const cells = all("#values table").flatMap(table => [...table.querySelectorAll("tbody tr")].flatMap((row, j) =>
  [...row.querySelectorAll("td")].map(cell => ({cell, j, k: +cell.dataset.value}))));
const digits = x => x && Math.abs(x) < 0.01 ? x.toExponential(2) : +x.toPrecision(5); // short, to fit a phone
document.addEventListener("cursor", ({detail: frame}) => cells.forEach(({cell, j, k}) => {
  const value = values[k][frame * n + j], [lower, upper] = frames.bounds[k].map(bound => bound[j]), t = times[frame];
  const [start, stop] = frames.windows[k] || [t, t];
  cell.textContent = Number.isNaN(value) ? "–" : digits(value);
  cell.classList.toggle("beyond", lower !== null && value < lower || upper !== null && value > upper);
  cell.classList.toggle("uncertain", t < start || t > stop);
}));

// The curves

const charts = panelData("curves"), joints = all("[data-joint]");
const [curves, line] = ["curves", "line"].map(id => document.getElementById(id));
const OPTIONS = {responsive: true, displayModeBar: false}, {height} = charts.layout;
const drawnJoints = () => joints.filter(box => box.checked).map(box => +box.dataset.joint);

function axisRanges() { // of each chart, with a margin
  return Object.entries(charts.ranges).flatMap(([axis, ranges]) => {
    const drawn = drawnJoints().filter(j => j in ranges).map(j => ranges[j]);
    const low = Math.min(...drawn.map(range => range[0])), high = Math.max(...drawn.map(range => range[1]));
    const margin = 0.06 * (high - low) || 0.1 * Math.abs(high) || 1;
    return drawn.length ? [[axis + ".range", [low - margin, high + margin]]] : [];
  });
}

if (matchMedia("(pointer: coarse)").matches) charts.layout.dragmode = false; // fingers scroll the page
for (const [key, range] of axisRanges()) charts.layout[key.split(".")[0]].range = range;
Plotly.newPlot(curves, charts.data, charts.layout, OPTIONS);
curves.on("plotly_click", event => { stop(); moveTo(frameAt(event.points[0].x)); });

// The line of the cursor lies over the charts: plotly would draw all of them again to move one of its own.
function placeLine() {
  const [left, right] = curves.layout.xaxis.range, share = (times[cursor] - left) / (right - left), {l, r, t, b} = charts.layout.margin;
  Object.assign(line.style, {left: `calc(${l}px + ${share} * (100% - ${l + r}px))`, top: `${t}px`, bottom: `${b}px`});
  line.hidden = share < 0 || share > 1;
}
document.addEventListener("cursor", placeLine);
curves.on("plotly_relayout", placeLine);

joints.forEach(box => box.addEventListener("change", () =>
  Plotly.update(curves, {visible: charts.data.map(trace => drawnJoints().includes(trace.meta))}, Object.fromEntries(axisRanges()))));

all("[data-span]").forEach(button => button.addEventListener("click", () => {
  const [first, last] = [times[0], times[times.length - 1]], width = (last - first) * button.dataset.span;
  const left = Math.max(first, Math.min(last - width, times[cursor] - width / 2));
  Plotly.relayout(curves, {"xaxis.range": [left, left + width]});
}));
addEventListener("beforeprint", () => Plotly.relayout(curves, {width: 680, height: Math.min(height, 960)}));
addEventListener("afterprint", () => Plotly.relayout(curves, {width: null, autosize: true, height}));

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
  const look = {autorange: false, gridcolor: "#d8d8d8", showbackground: false, showspikes: false};
  const [xaxis, yaxis, zaxis] = ["x", "y", "z"].map((name, side) => ({title: {text: name + " [m]"}, range: robot.space[side], ...look}));
  const spans = robot.space.map(([low, high]) => high - low), mean = Math.cbrt(spans[0] * spans[1] * spans[2]);
  const [rx, ry, rz] = spans.map(span => span / mean); // of the space, not of what lies in it
  const camera = {eye: {x: 1.35, y: -1.35, z: 0.6}, center: {x: 0, y: 0, z: -0.06}};
  return [[...surfaces, ...ends], {
    margin: {l: 0, r: 0, t: 0, b: 0}, paper_bgcolor: "rgba(0,0,0,0)", showlegend: false, font: {color: "#222222", size: 11},
    scene: {aspectmode: "manual", aspectratio: {x: rx, y: ry, z: rz}, xaxis, yaxis, zaxis, camera},
  }];
}
Plotly.newPlot(drawing, ...robotFigure(), OPTIONS);
document.addEventListener("cursor", ({detail: frame}) => drawRobot(stateAt(frame).q, baseAt(frame)));

all("[data-turn], [data-closer]").forEach(button => button.addEventListener("click", () => {
  const {x, y, z} = drawing.layout.scene.camera.eye, factor = +(button.dataset.closer || 1);
  const turn = (button.dataset.turn || 0) * Math.PI / 180, s = Math.sin(turn), c = Math.cos(turn);
  Plotly.relayout(drawing, {"scene.camera.eye": {x: factor * (c * x - s * y), y: factor * (s * x + c * y), z: factor * z}});
}));

moveTo(0);
