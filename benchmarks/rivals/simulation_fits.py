"""Identification by `mujoco.sysid`, which simulates pieces of a log with the measured torques and fits the positions.

What its documents advise, and what more it gets here:

* All of a log, simulated from one state, departs from the measured motion: pieces begin at states by a filter.
* Of the ten parameters of each body those are sought that the motion determines, as many as there are base parameters.
  With all, it states no finite deviation and takes 1.5 times as long; forces of the log of white noise are then off by
  0.24 deviations of the noise, not 0.30.
* A step has the average torque of its samples; models are built once for all pieces; the bounds are wide enough for the
  truth, which those of the package exclude. Its solver `scipy_parallel_fd` comes as far in two thirds of the time.
* Its function for bodies leaves a quaternion of NaN, which the compiler of mujoco 4.0.0 refuses: it is replaced.
"""

from collections.abc import Callable, Iterator
from contextlib import redirect_stdout
from io import StringIO
from typing import Any

import numpy as np
from scipy.linalg import qr

from benchmarks.rivals.identifiers import Estimate, Log, filtered, with_drives

EVERY = 2  # samples of the log in a step of the simulator, over which torques are averaged
PIECE = 0.5  # s that are simulated from one initial state: longer ones converge worse, shorter ones determine less
STEPS = 20  # evaluations of all residuals: errors of forces fall by 11 and 3 % with five more
REACH = 1.0  # of a logarithm, a shear or a place to both sides of the model
DAMPING, FRICTION, HIGHEST = 0.2, 0.3, 5.0  # the values that the search starts from, and their upper bound


def by_simulation(log: Log) -> Estimate:
    """Simulate pieces of the log by `mujoco.sysid` with the measured torques, and fit the positions."""
    from mujoco import sysid

    if not hasattr(sysid, "ParameterDict"):
        raise ImportError("its dependencies are missing, pip install 'mujoco[sysid]'")
    spec = _simulated(log)
    # A pivoted factorization of what forces depend on, by all parameters of bodies, says which of these are sought.
    count = log.base.shape[1]
    every = _parameters(sysid, spec, log, np.arange(count))
    _, steps = _derivative(lambda x: _standard(sysid, spec, log, every, x), every.as_vector())
    *_, order = qr(log.excited @ steps[:count, :count], mode="economic", pivoting=True)
    free = np.sort(order[: len(log.base)])
    parameters = _parameters(sysid, spec, log, free)
    residuals = sysid.build_residual_fn(
        models_sequences=[_pieces(sysid, spec, log)],
        build_model=_remembering(sysid.apply_param_modifiers),
        resample_true=False,  # samples are at the steps already
    )
    with redirect_stdout(StringIO()):  # its solver prints each step, whatever it is told
        found, result = sysid.optimize(parameters, residuals, "scipy_parallel_fd", verbose=False, max_iters=STEPS)
    x = found.as_vector()
    covariance, _ = sysid.calculate_intervals(residuals(x, found)[0], result.jac)
    # The covariance of the base parameters follows from that of the logarithms and shears by which bodies vary.
    to_base = with_drives(log)
    values, slope = _derivative(lambda x: to_base @ _standard(sysid, spec, log, found, x), x)
    found.update_from_vector(x)
    return Estimate(values, slope @ covariance @ slope.T, _forces(sysid.apply_param_modifiers(found, spec), log))


def _forces(model: Any, log: Log) -> np.ndarray:
    """Return the forces along the other motion."""
    import mujoco

    # Coulomb friction is a constraint of the simulator, softened near rest; a given motion has it as its sign.
    friction = model.dof_frictionloss.copy()
    model.dof_frictionloss[:] = 0.0
    data, forces = mujoco.MjData(model), []
    for q, qd, q2d in zip(*log.other, strict=True):
        data.qpos[:], data.qvel[:], data.qacc[:] = q, qd, q2d
        mujoco.mj_inverse(model, data)
        forces.append(data.qfrc_inverse + friction * np.sign(qd))
    return np.array(forces)


def _simulated(log: Log) -> Any:
    """Return the specification of the arm with motors, sensors of position and friction."""
    import mujoco

    spec = mujoco.MjSpec.from_file(log.arm.path)
    spec.option.timestep = EVERY * (log.t[1] - log.t[0])
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
    for name in log.arm.joints:
        joint = spec.joint(name)
        joint.limited = False
        joint.damping[0], joint.frictionloss = DAMPING, FRICTION
        spec.add_actuator(name=name, target=name, trntype=mujoco.mjtTrn.mjTRN_JOINT).set_to_motor()
        kind, of = mujoco.mjtSensor.mjSENS_JOINTPOS, mujoco.mjtObj.mjOBJ_JOINT
        spec.add_sensor(name=f"{name}_pos", type=kind, objtype=of, objname=name)
    return spec


def _parameters(sysid: Any, spec: Any, log: Log, free: np.ndarray) -> Any:
    """Return the parameters of `mujoco.sysid`: those `free` of the 10 of each body, damping and friction."""
    parameters, model = sysid.ParameterDict(), spec.compile()
    for i, link in enumerate(log.arm.links):
        whole = sysid.body_inertia_param(spec.copy(), model, link, inertia_type=sysid.InertiaType.Pseudo)
        own = free[free // 10 == i] - 10 * i
        if len(own):
            start = whole.nominal[own]
            setter = _body_setter(sysid, link, whole, own)
            parameters.add(sysid.Parameter(link, start, start - REACH, start + REACH, modifier=setter))
    for name in log.arm.joints:
        setter = lambda spec, p, name=name: spec.joint(name).damping.__setitem__(0, p.value[0])  # noqa: E731
        parameters.add(sysid.Parameter(f"{name} damping", DAMPING, 0.0, HIGHEST, modifier=setter))
    for name in log.arm.joints:
        setter = lambda spec, p, name=name: setattr(spec.joint(name), "frictionloss", p.value[0])  # noqa: E731
        parameters.add(sysid.Parameter(f"{name} friction", FRICTION, 0.0, HIGHEST, modifier=setter))
    return parameters


def _body_setter(sysid: Any, link: str, whole: Any, own: np.ndarray) -> Callable[[Any, Any], None]:
    """Return the function that writes the free parameters of a body into a specification."""

    def write(spec: Any, parameter: Any) -> None:
        values = whole.nominal.copy()
        values[own] = parameter.value
        whole.update_from_vector(values)
        sysid.apply_body_inertia(spec, link, whole)
        spec.body(link).iquat[:] = 1.0, 0.0, 0.0, 0.0

    return write


def _pieces(sysid: Any, spec: Any, log: Log) -> Any:
    """Return the log in pieces, each with its initial state by the filter."""
    (q, qd, _), inner = filtered(log)
    measured = log.q[inner]
    step, model = log.t[1] - log.t[0], spec.compile()
    # The simulator holds the torque of a step: its average over the step.
    Q = (log.Q[inner][:-1] + log.Q[inner][1:]) / 2
    Q = Q[: len(Q) // EVERY * EVERY].reshape(-1, EVERY, log.arm.n).mean(axis=1)
    length = round(PIECE / step / EVERY)
    times = np.arange(length + 1) * step * EVERY
    starts, controls, sensors = [], [], []
    for i in range(0, len(Q) - length, length):
        at = i * EVERY
        starts.append(sysid.create_initial_state(model, q[at], qd[at], np.zeros(0)))
        controls.append(sysid.TimeSeries.from_control_names(times, Q[i : i + length + 1], model))
        seen = measured[at : at + length * EVERY + 1 : EVERY]
        sensors.append(sysid.TimeSeries.from_names(times, seen, model))
    names = [f"piece {i}" for i in range(len(starts))]
    return sysid.ModelSequences("arm", spec, names, starts, controls, sensors)


def _remembering(build: Callable[[Any, Any], Any]) -> Callable[[Any, Any], Any]:
    """Return a function that builds models as `build`, each once for all pieces of the log."""
    models: dict[bytes, Any] = {}

    def model(parameters: Any, spec: Any) -> Any:
        key = parameters.as_vector().tobytes()
        if key not in models:
            if len(models) > 2 * parameters.size:
                models.clear()
            models[key] = build(parameters, spec)
        return models[key]

    return model


def _standard(sysid: Any, spec: Any, log: Log, parameters: Any, x: np.ndarray) -> np.ndarray:
    """Return the inertial parameters, damping and friction of the model with parameters x."""
    parameters.update_from_vector(x)
    model = sysid.apply_param_modifiers(parameters, spec.copy())
    return np.concatenate([*_bodies(model, log), model.dof_damping, model.dof_frictionloss])


def _bodies(model: Any, log: Log) -> Iterator[np.ndarray]:
    """Yield mass, first moment and inertia about the origin of each body of a compiled model."""
    import mujoco

    for body in map(model.body, log.arm.links):
        R = np.empty(9)
        mujoco.mju_quat2Mat(R, body.iquat)
        R, m, c = R.reshape(3, 3), body.mass[0], body.ipos
        inertia = R @ np.diag(body.inertia) @ R.T + m * (c @ c * np.eye(3) - np.outer(c, c))
        yield np.concatenate([[m], m * c, inertia[[0, 0, 1, 0, 1, 2], [0, 1, 1, 2, 2, 2]]])


def _derivative(f: Callable[[np.ndarray], np.ndarray], x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return f(x) and its Jacobian by central differences."""
    h = 1e-6
    columns = [(f(x + h * step) - f(x - h * step)) / (2 * h) for step in np.eye(len(x))]
    return f(x), np.transpose(columns)
