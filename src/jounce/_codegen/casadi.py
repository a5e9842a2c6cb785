"""CasADi functions of a robot's quantities, to be differentiated and put into optimal control problems."""

import re
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from jounce.arguments import requests
from jounce.core.errors import JounceError, listed, warn
from jounce.core.scalars import asarray
from jounce.core.typing import Frame
from jounce.dynamics.computation import Computation
from jounce.dynamics.quantities.names import QuantityName
from jounce.engine.engine import Engine
from jounce.model.mechanism import Mechanism
from jounce.model.parameters import own_values, parametrise

if TYPE_CHECKING:
    import casadi


def casadi_function(
    robot: Engine,
    quantity: QuantityName = "inverse_dynamics",
    order: int = 2,
    wrench: bool = False,
    *,
    body: str | None = None,
    frame: Frame = "body",
    parameters: Sequence[str] = (),
    base: bool = False,
) -> "casadi.Function":
    """A quantity and its rates up to an order as a `casadi.Function`, built on SX and callable with MX.

    Parameters
    ----------
    robot : Robot
        A robot of numbers.
    quantity : str, optional
        The name of the quantity, that of the method of `Robot`.
    order : int, optional
        The highest rate of the quantity: 2 gives Q, Qd, Q2d.
    wrench : bool, optional
        Whether wrenches W, Wd, ... (nb, 6) on the bodies are inputs too.
    body, frame : str, optional
        Body or merged link, and frame, of poses, twists and Jacobians. Poses and Jacobians need a body, twists are
        those of all bodies by default.
    parameters : list of str, optional
        Data of the robot that become inputs:

        * "gravity": gravity (3);
        * "masses": masses (nb), that of a floating base first; bodies keep their COM, and inertia grows with the mass;
        * "lengths": lengths (nb, 3), the positions of the body frames in their parents';
        * "payload", or "payload:X" for a body or merged link X: payload_mass, payload_com (3) and payload_inertia (6)
          about the COM, xx xy xz yy yz zz, in the axes of X, the end of the robot if none is named; those of a second
          payload are payload2_mass, ...
    base : bool, optional
        Whether the motion of the base is an input too, so that the ground of a fixed robot moves; it always is if the
        robot floats: base_pose (4, 4), body to inertial frame, base_twist (6, angular; linear) in the axes of the base,
        and the rates of it.

    Returns
    -------
    casadi.Function
        Named after the quantity, body and frame. Inputs q, qd, q2d, ... (n), then W, Wd, ..., the motion of the base,
        q_dependent (N - n) if loops are closed, the positions of all other joints, and the parameters; outputs the
        quantity and its rates under the names of its symbol, Q, Qd, Q2d, ...: columns of vectors, 1 x 1 of scalars. The
        matrices of partial derivatives P stand one below the other, (3 nv, nv), those of Pd are (4 nv, nv).

    Raises
    ------
    JounceError
        If a name is unknown, the quantity needs a body, the robot holds symbols, or CasADi is missing.

    Examples
    --------
    >>> import casadi, jounce
    >>> robot = jounce.load("iiwa14")
    >>> F = jounce.casadi_function(robot, order=1, parameters=["payload"])
    >>> F.name_in()
    ['q', 'qd', 'q2d', 'q3d', 'payload_mass', 'payload_com', 'payload_inertia']
    >>> q, m = casadi.MX.sym("q", 7), casadi.MX.sym("m")
    >>> at_rest = F(q=q, payload_mass=m, payload_com=[0, 0, 0.1])  # what is not named is zero
    >>> casadi.jacobian(at_rest["Q"], q).shape, casadi.jacobian(at_rest["Q"], m).shape
    ((7, 7), (7, 1))
    >>> jounce.casadi_function(robot, "jacobian", order=1, body="link7", frame="world")
    Function(jacobian_link7_world:(q[7],qd[7])->(J[6x7],Jd[6x7]) SXFunction)
    """
    try:
        import casadi
    except ModuleNotFoundError:
        raise JounceError("casadi_function() needs CasADi; install it by: pip install 'jounce[casadi]'") from None
    _check(robot)
    computation = requests.computation(robot.mechanism, quantity, order, wrench, body, frame, base=base)
    _check_axes(computation, robot.mechanism)
    shapes = {name: value.shape for name, value in own_values(robot.mechanism, parameters).items()}
    signature = computation.signature(robot.mechanism, shapes)
    ports = sorted(signature.inputs, key=lambda port: port.role == "parameter")  # the state first, as in other calls
    inputs = {port.name: casadi.SX.sym(port.name, *port.shape) for port in ports}
    arrays = {port.name: asarray(inputs[port.name]).reshape(port.shape) for port in ports}
    mechanism, _ = parametrise(robot.mechanism, parameters, lambda name, shape: arrays[name])
    state = [arrays[port.name] for port in ports if port.role != "parameter"]
    method = next(iter(computation.quantity.methods))
    results = [_matrix(x) for x in computation.series(method, mechanism, state).upto(computation.count - 1)]
    names = [port.name for port in signature.outputs]
    all_results = casadi.veccat(*results)
    idle = [name for name in shapes if not casadi.depends_on(all_results, inputs[name])]
    if idle:
        warn(f"parameters without effect on {quantity}: {listed(idle)}")
    return casadi.Function(_name(computation), list(inputs.values()), results, list(inputs), names)


def _matrix(array: np.ndarray) -> "casadi.SX":
    """The CasADi matrix of an object array: a column of a vector, 1 x 1 of a scalar, several matrices in one column."""
    import casadi

    rows = array.reshape((-1, array.shape[-1]) if array.ndim > 2 else (*array.shape, 1, 1)[:2])
    return casadi.SX(casadi.vertcat(*(casadi.horzcat(*row) for row in rows)))


def _name(computation: Computation) -> str:
    """The quantity with its body and frame as CasADi takes a name: letters and digits, single underscores between."""
    place = [computation.body or "", computation.frame if computation.quantity.frames else ""]
    return "_".join(re.findall("[A-Za-z0-9]+", "_".join([computation.name, *place])))


def _check(robot: Engine) -> None:
    if not isinstance(robot, Engine):
        raise JounceError(f"casadi_function() expects a jounce.Robot, got {type(robot).__name__}; try jounce.load")
    if not robot.mechanism.is_numeric:
        raise JounceError(
            "the robot contains symbols; expected numbers (parameters=['masses'] makes its masses inputs)"
        )


def _check_axes(computation: Computation, mechanism: Mechanism) -> None:
    """Raise `JounceError` if the result has more axes than a matrix of CasADi, since it is of all bodies."""
    shape = computation.shape(mechanism)
    if computation.quantity.of_bodies and len(shape) > 2:
        raise JounceError(
            f"{computation.name} of all bodies: a CasADi matrix has 2 axes, not {len(shape)};"
            f" body= selects one of: {listed(mechanism.body_names)}"
        )
