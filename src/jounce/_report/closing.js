// Loops of a robot that the page moves: closed by Newton's method, in steps that stay on the branch

const MOST_STEP = 0.05, LEAST_SHARE = 1e-4, LOOPS_CLOSED = 1e-11, WEAKEST = 1e-12; // rad or lengths; shares of a way

const cross = ([a, b, c], [x, y, z]) => [b * z - c * y, c * x - a * z, a * y - b * x];
const dot = (a, b) => a.reduce((sum, x, k) => sum + x * b[k], 0);
const turned = (T, v) => [0, 1, 2].map(i => T[4 * i] * v[0] + T[4 * i + 1] * v[1] + T[4 * i + 2] * v[2]);
const turnedBack = (T, v) => [0, 1, 2].map(i => T[i] * v[0] + T[4 + i] * v[1] + T[8 + i] * v[2]);
const origin = T => [T[3], T[7], T[11]];
const minus = (a, b) => a.map((x, k) => x - b[k]);

// How far the loops are from closed, and the rows of their derivatives by all coordinates
function loopGaps(loops, q) {
  const C = pose(q), gaps = [], rows = [];
  for (const {frames: ends, turns, slides, axis} of loops) {
    const [Ta, Tb] = ends.map(({body, T}) => body < 0 ? T : product(C[body], T)), at = origin(Tb);
    const turnsBy = q.map(() => [0, 0, 0]), slidesBy = q.map(() => [0, 0, 0]);
    ends.forEach(({body}, side) => {
      for (let i = body; i >= 0; i = robot.parent[i]) for (const k of jointsOf[i]) {
        const w = turned(C[i], X.slice(6 * k, 6 * k + 3)), arm = cross(w, minus(at, origin(C[i])));
        const v = turned(C[i], X.slice(6 * k + 3, 6 * k + 6)).map((x, l) => x + arm[l]);
        q.forEach((_, j) => [[turnsBy, w], [slidesBy, v]].forEach(([by, own]) =>
          turnedBack(Ta, own).forEach((x, l) => { by[j][l] += (side ? 1 : -1) * G[k * q.length + j] * x; })));
      }
    });
    const columns = [0, 1, 2].map(k => turnedBack(Ta, [Tb[k], Tb[4 + k], Tb[8 + k]]));
    const ofAxis = [0, 1, 2].map(k => dot(axis, columns.map(column => column[k])));
    const turn = turns.length === 3 ? [1, 2, 0].map((k, i) => { const l = 3 - k - i; return (columns[k][l] - columns[l][k]) / 2; }) : cross(axis, ofAxis);
    turns.forEach(row => { gaps.push(dot(row, turn)); rows.push(turnsBy.map(by => dot(row, by))); });
    slides.forEach(row => { gaps.push(dot(row, turnedBack(Ta, minus(at, origin(Ta))))); rows.push(slidesBy.map(by => dot(row, by))); });
  }
  return {gaps, rows};
}

// The least x with A x nearest to b, of columns that are independent; null where they are not
function leastSquares(A, b) {
  const n = A[0].length, size = [...Array(n).keys()].map(j => Math.hypot(...A.map(row => row[j])));
  const N = size.map((s, i) => [...size.map((t, j) => dot(A.map(row => row[i] / s), A.map(row => row[j] / t))), dot(A.map(row => row[i] / s), b)]);
  for (let i = 0; i < n; i++) {
    if (!(N[i][i] > WEAKEST)) return null;
    for (let k = i + 1; k < n; k++) {
      const factor = N[k][i] / N[i][i];
      for (let j = i; j <= n; j++) N[k][j] -= factor * N[i][j];
    }
  }
  const x = Array(n);
  for (let i = n - 1; i >= 0; i--) x[i] = (N[i][n] - x.reduce((sum, y, j) => j > i ? sum + N[i][j] * y : sum, 0)) / N[i][i];
  return x.map((y, i) => y / size[i]);
}

// All coordinates, from some with closed loops on to others of the sliders, as far as the branch leads
function closedOn({own, loops, lengths}, before, target) {
  const others = lengths.map((_, j) => j).filter(j => !own.includes(j)), span = (a, b) => Math.max(...others.map(j => Math.abs(a[j] - b[j]) / lengths[j]));
  const stepped = (q, {gaps, rows}) => {
    const found = leastSquares(rows.map(row => others.map(j => row[j])), gaps), next = q.slice();
    if (found) others.forEach((j, k) => { next[j] -= found[k]; });
    return found && next;
  };
  const newton = start => {
    for (let k = 0, q = start; q && k < 12; k++) {
      const state = loopGaps(loops, q);
      if (Math.max(...state.gaps.map(Math.abs)) < LOOPS_CLOSED) return q;
      q = stepped(q, state);
    }
    return null;
  };
  const way = own.map((j, k) => target[k] - before[j]), long = Math.max(...way.map((x, k) => Math.abs(x) / lengths[own[k]]));
  let q = Array.from(before), left = 1, share = Math.min(1, MOST_STEP / long);
  while (left > 0 && share > LEAST_SHARE) {
    const part = Math.min(share, left), {rows} = loopGaps(loops, q);
    const predicted = stepped(q, {rows, gaps: rows.map(row => part * dot(own.map(j => row[j]), way))});
    if (predicted) own.forEach((j, k) => { predicted[j] = target[k] - (left - part) * way[k]; });
    const found = predicted && newton(predicted);
    if (found && span(found, predicted) <= Math.max(0.3 * span(predicted, q), 1e-6)) {
      left = part === left ? 0 : left - part;
      q = found;
      share = Math.min(2 * part, MOST_STEP / long);
    } else {
      share = part / 2;
    }
  }
  return {q: Float64Array.from(q), arrived: left === 0};
}
