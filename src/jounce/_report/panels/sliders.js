// The sliders: what holds the robot at rest at their q, with a force that pulls an end

// What the bodies exert, (moment; force) in its own frame: the opposite of the pull on one of its points
function wrench(C, {body, point}, pull) {
  const W = new Float64Array(6 * C.length), [a, b, c] = point;
  const [x, y, z] = [0, 1, 2].map(i => pull.reduce((sum, f, k) => sum + C[body][4 * k + i] * f, 0));
  W.set([b * z - c * y, c * x - a * z, a * y - b * x, x, y, z].map(w => -w), 6 * body);
  return W;
}

function atRest(q, pull, at) {
  const C = pose(q), rest = new Float64Array(n), still = wrench(C, at, [0, 0, 0]);
  const [Q] = forcesAtRest.inverse_dynamics(q, rest, rest, wrench(C, at, pull));
  const [alone] = forcesAtRest.inverse_dynamics(q, rest, rest, still), [gravity] = forcesAtRest.gravity_forces(q);
  return {Q, gravity, pulled: Q.map((x, j) => x - alone[j])};
}

{
const {lower, upper, units, effort, inertial, ends, force} = panelData("sliders");
const sliders = all("[data-slider]"), pulls = all("[data-pull]"), rows = all("#rest tbody tr").map(row => [...row.querySelectorAll(".number")]);
const [end, pulled, release] = ["end", "pull", "release"].map(id => document.getElementById(id));
const reach = 0.4 * Math.max(...robot.space.map(([low, high]) => high - low)) / force;
const line = {type: "scatter3d", mode: "lines", x: [], y: [], z: [], line: {color: "#d55e00", width: 8}, hoverinfo: "skip"};
const arrow = drawing.data.length;
sliders.forEach((slider, j) => Object.assign(slider, {min: lower[j], max: upper[j]}));
Plotly.addTraces(drawing, line);

function compute() {
  const q = Float64Array.from(sliders, slider => +slider.value), pull = pulls.map(slider => +slider.value), at = ends[end.value];
  const {Q, gravity, pulled: share} = atRest(q, pull, at);
  rows.forEach((cells, j) => {
    [q[j], gravity[j], share[j], Q[j]].forEach((x, k) => { cells[k].textContent = +(+x.toFixed(9)).toPrecision(5) + (k ? " " + units[j] : ""); });
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

const moved = () => { stop(); const state = compute(); drawRobot(state.q); drawPull(state); };
[...sliders, ...pulls, end].forEach(input => input.addEventListener("input", moved));
release.addEventListener("click", () => { pulls.forEach(slider => { slider.value = 0; }); moved(); });
document.addEventListener("cursor", ({detail: frame}) => {
  stateAt(frame).q.forEach((x, j) => { sliders[j].value = x; });
  const state = compute();
  if (state.pull.some(x => x)) drawPull(state);
});
moveTo(cursor);
}
