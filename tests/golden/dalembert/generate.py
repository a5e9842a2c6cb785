"""Writes fivebar.json and gough_stewart.json: forces of parallel robots and their rates, to 40 digits (mpmath alone).

Nothing here solves a constraint: the kinematics are closed forms, circles that intersect (five-bar) and legs from the
pose of their platform (Gough-Stewart). They are evaluated once on series in the time t, cut after t^4, with a virtual
displacement e (e^2 = 0): the coefficients are all rates, and those of e the virtual displacements of all bodies.
d'Alembert's principle gives the forces, sum m (p'' - g) . dp + (d/dt R I R^T w) . dphi over the centres of mass p.

Shares with jounce: nothing but the files of the robots.
"""

import json
from pathlib import Path

from mpmath import atan2, binomial, cos, factorial, mp, mpc, mpf, nstr, sin
from ruamel.yaml import YAML

HERE = Path(__file__).parent
ROBOTS = HERE.parents[2] / "src" / "jounce" / "io" / "robots"
ORDER = 4  # in t: forces to the second rate
mp.dps = 70


class Jet:
    """sum c[i][k] t^i e^k, i <= ORDER, k <= 1."""

    def __init__(self, c):
        self.c = c

    def __add__(self, other):
        other = jet(other)
        return Jet([[x + y for x, y in zip(a, b, strict=True)] for a, b in zip(self.c, other.c, strict=True)])

    def __mul__(self, other):
        a, b = self.c, jet(other).c
        rows = range(ORDER + 1)
        low = [sum(a[j][0] * b[i - j][0] for j in range(i + 1)) for i in rows]
        high = [sum(a[j][0] * b[i - j][1] + a[j][1] * b[i - j][0] for j in range(i + 1)) for i in rows]
        return Jet([list(pair) for pair in zip(low, high, strict=True)])

    __radd__, __rmul__ = __add__, __mul__

    def __neg__(self):
        return self * -1

    def __sub__(self, other):
        return self + -jet(other)

    def __rsub__(self, other):
        return jet(other) - self

    def __truediv__(self, other):
        return self * jet(other).compose(lambda x, k: (-1) ** k / x ** (k + 1))

    def compose(self, taylor):
        """f of this, of which taylor(x, k) are the coefficients at x."""
        start = self.c[0][0]
        rest, power, result = self - start, jet(1), jet(0)
        for k in range(ORDER + 2):
            result, power = result + power * taylor(start, k), power * rest
        return result

    @property
    def dot(self):
        """The derivative with respect to t; the last coefficient is lost."""
        return Jet([[i * x for x in self.c[i]] for i in range(1, ORDER + 1)] + [[mpf(0), mpf(0)]])

    @property
    def virtual(self):
        return Jet([[row[1], mpf(0)] for row in self.c])

    def rates(self, highest=ORDER):
        return [factorial(k) * self.c[k][0] for k in range(highest + 1)]


def jet(x):
    return x if isinstance(x, Jet) else Jet([[x + mpf(0), mpf(0)], *([mpf(0), mpf(0)] for _ in range(ORDER))])


def sine(x):
    return x.compose(lambda x, k: sin(x + k * mp.pi / 2) / factorial(k))


def cosine(x):
    return x.compose(lambda x, k: cos(x + k * mp.pi / 2) / factorial(k))


def root(x):
    return x.compose(lambda x, k: binomial(mpf(1) / 2, k) * x ** (mpf(1) / 2 - k))


def angle(y, x):
    """atan2(y, x), by Im log."""
    y0, x0 = y.c[0][0], x.c[0][0]
    turned = (x + y * mpc(0, 1)) * (1 / mpc(x0, y0))
    log = turned.compose(lambda z, k: mpf(0) if k == 0 else mpf((-1) ** (k + 1)) / k)
    return Jet([[mpf(0) + z.imag for z in row] for row in log.c]) + atan2(y0, x0)


def dot(a, b):
    return sum((x * y for x, y in zip(a, b, strict=True)), jet(0))


def add(*vectors):
    return [sum(entries, jet(0)) for entries in zip(*vectors, strict=True)]


def scale(s, a):
    return [s * x for x in a]


def apply(R, v):
    return [dot(row, v) for row in R]


def transpose(R):
    return [list(column) for column in zip(*R, strict=True)]


def product(A, B):
    return transpose([apply(A, column) for column in transpose(B)])


def turn(axis, q):
    """The rotation by q about x, y or z."""
    c, s, i = cosine(q), sine(q), "xyz".index(axis)
    j, k = (i + 1) % 3, (i + 2) % 3
    R = [[jet(int(row == column)) for column in range(3)] for row in range(3)]
    R[j][j], R[j][k], R[k][j], R[k][k] = c, -s, s, c
    return R


def spin(dR, R):
    """The vector of the skew matrix dR R^T."""
    S = product(dR, transpose(R))
    return [S[2][1], S[0][2], S[1][0]]


def entries_of(R, part):
    return [[getattr(x, part) for x in row] for row in R]


def numbers(values):
    return [mpf(x) for x in values]


class Robot:
    """The bodies of a robot file: mass, centre, inertia about it; the places of bodies and frames in their carriers."""

    def __init__(self, name):
        data = YAML(typ="safe").load((ROBOTS / name / "robot.yaml").read_text())
        self.name, self.actuated, self.gravity = name, data["actuated"], numbers(data["gravity"])
        self.coordinates = [body["joint"]["name"] for body in data["bodies"]]
        self.place = {one["name"]: numbers(one.get("pose", {}).get("position", [0, 0, 0])) for one in data["bodies"]}
        self.place |= {one["name"]: numbers(one["pose"]["position"]) for one in data["frames"]}
        self.inertia = {}
        for body in data["bodies"]:
            if "inertia" in body:
                stated = body["inertia"]
                xx, xy, xz, yy, yz, zz = numbers(stated["inertia"])
                tensor = [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]
                self.inertia[body["name"]] = mpf(stated["mass"]), numbers(stated["com"]), tensor

    def virtual_work(self, poses):
        """The generalised force of inertia and gravity on the virtual displacement in the poses; T and U."""
        total = kinetic = potential = jet(0)
        for name, (m, com, tensor) in self.inertia.items():
            R, origin = poses[name]
            p = add(origin, apply(R, com))
            w, world = spin(entries_of(R, "dot"), R), product(product(R, tensor), transpose(R))
            momentum, v = apply(world, w), [x.dot for x in p]
            force = [m * (x.dot - g) for x, g in zip(v, self.gravity, strict=True)]
            total += dot(force, [x.virtual for x in p])
            total += dot([x.dot for x in momentum], spin(entries_of(R, "virtual"), R))
            kinetic += (m * dot(v, v) + dot(momentum, w)) * mpf(0.5)
            potential += -m * dot(p, self.gravity)
        return total, kinetic, potential


def steady(x):
    return Jet([[row[0], mpf(0)] for row in x.c])


def wave(t, mean, size, rate, phase):
    return mean + mpf(size) * sine(Jet([[mpf(rate) * x for x in row] for row in t.c]) + mpf(phase))


def moving(x, virtual):
    return Jet([[x.c[0][0], mpf(virtual)], *([row[0], mpf(0)] for row in x.c[1:])])


def fivebar(robot, shoulders):
    """Poses and coordinates of the five-bar: its tip is where two circles about the elbows meet, above their line."""
    (A, B), poses, q = (robot.place[side + "_upper"] for side in ("left", "right")), {}, {}
    upper = {side: robot.place[side + "_forearm"][0] for side in ("left", "right")}
    lower = {side: robot.place[side + "_tip"][0] for side in ("left", "right")}
    elbows = {}
    for side, base, shoulder in zip(("left", "right"), (A, B), shoulders, strict=True):
        elbows[side] = base[0] + upper[side] * cosine(shoulder), base[2] + upper[side] * sine(shoulder)
    (x1, z1), (x2, z2) = elbows["left"], elbows["right"]
    dx, dz = x2 - x1, z2 - z1
    square = dx * dx + dz * dz
    along = (square + (lower["left"] ** 2 - lower["right"] ** 2)) / (2 * square)
    up = root((lower["left"] ** 2 - along * along * square) / square)
    tip = x1 + along * dx - up * dz, z1 + along * dz + up * dx
    for side, base, shoulder in zip(("left", "right"), (A, B), shoulders, strict=True):
        x, z = elbows[side]
        forearm = angle(tip[1] - z, tip[0] - x)
        poses[side + "_upper"] = turn("y", -shoulder), [jet(c) for c in base]
        poses[side + "_forearm"] = turn("y", -forearm), [x, jet(0), z]
        q |= {side + "_shoulder": shoulder, side + "_elbow": forearm - shoulder}
    return poses, q


def fivebar_motion(t):
    return [wave(t, mpf(2.2), 0.35, 2.1, 0.4), wave(t, mpf(0.94), 0.4, 2.9, 1.3)]


def gough_stewart(robot, pose):
    """Poses and coordinates of the platform and its legs, from the position and the angles about z, y, x."""
    position, R = pose[:3], product(turn("z", pose[5]), product(turn("y", pose[4]), turn("x", pose[3])))
    poses, q = {"platform": (R, position)}, {}
    for i in range(1, 7):
        base = robot.place[f"cross{i}"]
        corner = scale(mpf(-1), robot.place["platform"]) if i == 1 else robot.place[f"corner{i}"]
        leg = add(position, apply(R, corner), scale(mpf(-1), [jet(x) for x in base]))
        q[f"length{i}"] = root(dot(leg, leg))
        q[f"leg{i}_x"] = angle(-leg[1], leg[2])
        q[f"leg{i}_y"] = angle(leg[0], root(leg[1] * leg[1] + leg[2] * leg[2]))
        turned = product(turn("x", q[f"leg{i}_x"]), turn("y", q[f"leg{i}_y"]))
        poses[f"cylinder{i}"] = turned, [jet(x) for x in base]
        poses[f"piston{i}"] = turned, add([jet(x) for x in base], leg)
        if i == 1:
            ball = product(transpose(turned), R)
            q["ball_x"] = angle(-ball[1][2], ball[2][2])
            q["ball_y"] = angle(ball[0][2], root(ball[0][0] * ball[0][0] + ball[0][1] * ball[0][1]))
            q["ball_z"] = angle(-ball[0][1], ball[0][0])
    return poses, q


def platform_motion(t):
    return [
        wave(t, mpf(0), 0.02, 2.3, 0.1),
        wave(t, mpf(0), 0.025, 1.7, 0.9),
        wave(t, mpf(0.16), 0.015, 3.1, 2.0),
        wave(t, mpf(0), 0.15, 2.7, 0.6),
        wave(t, mpf(0.05), 0.12, 1.9, 2.2),
        wave(t, mpf(0), 0.2, 2.2, 1.4),
    ]


def solved(A, b):
    """x of A x = b over series, by elimination with pivots."""
    n, rows = len(b), [[*row, x] for row, x in zip(A, b, strict=True)]
    for k in range(n):
        pivot = max(range(k, n), key=lambda i: abs(rows[i][k].c[0][0]))
        rows[k], rows[pivot] = rows[pivot], rows[k]
        for i in range(n):
            if i != k:
                factor = rows[i][k] / rows[k][k]
                rows[i] = [x - factor * y for x, y in zip(rows[i], rows[k], strict=True)]
    return [rows[k][n] / rows[k][k] for k in range(n)]


def case(robot, kinematics, motion, time):
    """One state: all coordinates with four rates, and the forces of the drives with two."""
    given = motion(Jet([[mpf(time), mpf(0)], [mpf(1), mpf(0)], *([mpf(0), mpf(0)] for _ in range(ORDER - 1))]))
    work, changes = [], []
    for k in range(len(given)):
        poses, q = kinematics(robot, [moving(x, int(j == k)) for j, x in enumerate(given)])
        found, kinetic, potential = robot.virtual_work(poses)
        work.append(found)
        changes.append([q[name].virtual for name in robot.actuated])
    Q = solved(changes, work)  # the work on each virtual displacement is that of the drives
    power = dot(Q, [steady(q[name]).dot for name in robot.actuated]).rates(1)
    balance = steady(kinetic + potential).dot.rates(1)
    assert all(abs(x - y) < mpf(10) ** -60 for x, y in zip(power, balance, strict=True)), (power, balance)
    forces = transpose([x.rates(2) for x in Q])
    coordinates = transpose([q[name].rates() for name in robot.coordinates])
    return {"time": time, "coordinates": texts(coordinates), "forces": texts(forces)}


def texts(rows):
    return [[nstr(x, 40) for x in row] for row in rows]


def write(name, kinematics, motion, times):
    robot = Robot(name)
    cases = [case(robot, kinematics, motion, time) for time in times]
    names = f'"coordinates": {json.dumps(robot.coordinates)},\n"actuated": {json.dumps(robot.actuated)}'
    listed = ",\n".join(map(json.dumps, cases))
    (HERE / f"{name}.json").write_text(f'{{{names},\n"cases": [\n{listed}\n]}}\n')


if __name__ == "__main__":
    write("fivebar", fivebar, fivebar_motion, (0.0, 0.7, 1.9))
    write("gough_stewart", gough_stewart, platform_motion, (0.0, 0.8, 2.3))
