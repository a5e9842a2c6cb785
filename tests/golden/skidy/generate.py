"""Writes forces.json: what skidy 0.0.1 itself makes of the files here, at one state each (`pip install skidy`).

Shares with jounce: nothing.
"""

import json
from pathlib import Path

HERE = Path(__file__).parent
WEE = {"Mx": 0.3, "My": -0.5, "Mz": 0.7, "Fx": 2.0, "Fy": -1.0, "Fz": 3.0}  # constant, where a file names them


def forces(path):
    """The state, as q and its rates, and skidy's Q, Qd, Q2d and poses of the bodies there."""
    import skidy
    from sympy import Matrix

    model = skidy.robot_from_yaml(str(path))
    numbers = WEE | model.assignment_dict

    def number(matrix):
        return Matrix(matrix).subs(numbers).evalf(25)

    def rows(matrix):
        return [[float(x) for x in row] for row in Matrix(matrix).tolist()]

    n = len(model.body_ref_config)
    state = [[round(0.3 + 0.4 * k - 0.27 * i + 0.11 * i * k, 6) for i in range(n)] for k in range(5)]
    model.gravity_vector = number(model.gravity_vector)
    for name in ("joint_screw_coord", "body_ref_config", "Mb"):  # numbers throughout: its algorithm in minutes less
        setattr(model, name, [number(x) for x in getattr(model, name)])
    W = [number(w) for w in (model.WEE if isinstance(model.WEE, list) else [model.WEE])]
    still = [0 * w for w in W]
    q = [number(rate) for rate in state]
    model.closed_form_inv_dyn_body_fixed(*q, W, still, still, simplify=False, parallel=False)
    Q = [[x for [x] in rows(rate)] for rate in (model.Q, model.Qd, model.Q2d)]
    return {"state": state, "Q": Q, "poses": [rows(C) for C in model._FK_C]}


if __name__ == "__main__":
    lines = [f'"{path.stem}": {json.dumps(forces(path))}' for path in sorted(HERE.glob("*.yaml"))]
    (HERE / "forces.json").write_text("{\n" + ",\n".join(lines) + "\n}\n")
