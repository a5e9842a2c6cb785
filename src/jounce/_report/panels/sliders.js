// The sliders: what holds the robot at rest at their q, with a force that pulls an end

// What the bodies exert, (moment; force) in its own frame: the opposite of the pull on one of its points
function wrench(C, {body, point}, pull) {
  const W = new Float64Array(6 * C.length), [a, b, c] = point;
  const [x, y, z] = [0, 1, 2].map(i => pull.reduce((sum, f, k) => sum + C[body][4 * k + i] * f, 0));
  W.set([b * z - c * y, c * x - a * z, a * y - b * x, x, y, z].map(w => -w), 6 * body);
  return W;
}

// At q of all joints, of which some are coordinates: forces also take the others, where there are any
function atRest(q, pull, at, own = [...q.keys()]) {
  const C = pose(q), rest = new Float64Array(own.length), still = wrench(C, at, [0, 0, 0]);
  const u = Float64Array.from(own, j => q[j]), others = own.length < n ? [q.filter((_, j) => !own.includes(j))] : [];
  const [Q] = forcesAtRest.inverse_dynamics(u, rest, rest, wrench(C, at, pull), ...others);
  const [alone] = forcesAtRest.inverse_dynamics(u, rest, rest, still, ...others), [gravity] = forcesAtRest.gravity_forces(u, ...others);
  return {Q, gravity, pulled: Q.map((x, j) => x - alone[j])};
}

{
const data = panelData("sliders"), {lower, upper, units, effort, inertial, ends, force, own, loops} = data;
const sliders = all("[data-slider]"), pulls = all("[data-pull]"), rows = all("#rest tbody tr").map(row => [...row.querySelectorAll(".number")]);
const [end, pulled, release, stuck] = ["end", "pull", "release", "stuck"].map(id => document.getElementById(id));
const reach = 0.4 * Math.max(...robot.space.map(([low, high]) => high - low)) / force;
const line = {type: "scatter3d", mode: "lines", x: [], y: [], z: [], line: {color: "#d55e00", width: 8}, hoverinfo: "skip"};
const arrow = drawing.data.length;
sliders.forEach((slider, j) => Object.assign(slider, {min: lower[j], max: upper[j]}));
Plotly.addTraces(drawing, line);

let shown = stateAt(0).q;

// All joints where the sliders are; where loops do not close there, as far on as they do
function closed() {
  const wanted = Float64Array.from(sliders, slider => +slider.value);
  if (!loops.length) return wanted;
  const {q, arrived} = closedOn(data, shown, wanted);
  stuck.hidden = arrived;
  if (!arrived) setSliders(q);
  return q;
}

const setSliders = q => own.forEach((j, k) => { sliders[k].value = q[j]; });

function compute(q) {
  const pull = pulls.map(slider => +slider.value), at = ends[end.value];
  const {Q, gravity, pulled: share} = atRest(q, pull, at, own);
  shown = q;
  rows.forEach((cells, j) => {
    [q[own[j]], gravity[j], share[j], Q[j]].forEach((x, k) => { cells[k].textContent = +(+x.toFixed(9)).toPrecision(5) + (k ? " " + units[j] : ""); });
    const bounded = inertial ? Q[j] - gravity[j] : Q[j], [least, most] = effort.map(bound => bound[j]);
    cells[3].classList.toggle("beyond", least !== null && bounded < least || most !== null && bounded > most);
  });
  pulled.textContent = `(${pull.map(x => +x.toPrecision(3)).join(", ")}) N`;
  return {q, pull, at};
}

function drawPull({q, pull, at}) {
  const T = pose(q)[at.body], start = [0, 1, 2].map(k => T[4 * k + 3] + at.point.reduce((sum, x, i) => sum + T[4 * k + i] * x, 0));
  const [x, y, z] = start.map((s, k) => [s, s + reach * pull[k]]);
  Plotly.restyle(drawing, {x: [x], y: [y], z: [z]}, [arrow]);
}

const moved = () => { stop(); const state = compute(closed()); drawRobot(state.q); drawPull(state); };
[...sliders, ...pulls, end].forEach(input => input.addEventListener("input", moved));
release.addEventListener("click", () => { pulls.forEach(slider => { slider.value = 0; }); moved(); });
document.addEventListener("cursor", ({detail: frame}) => {
  const {q} = stateAt(frame);
  setSliders(q);
  const state = compute(q);
  if (state.pull.some(x => x)) drawPull(state);
});
moveTo(cursor);
}
