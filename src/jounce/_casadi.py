"""CasADi functions of a robot's quantities, to be differentiated and put into optimal control problems."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from jounce._scalars import Array, asarray, is_numeric
from jounce.arguments import requests
from jounce.dynamics.quantities import FORCES
from jounce.errors import JounceError
from jounce.model.mechanism import DATA
from jounce.model.parameters import parametrised
from jounce.robot import Robot

if TYPE_CHECKING:
    import casadi


def casadi_function(
    robot: Robot,
    order: int = 2,
    wrench: bool = False,
    quantity: str = FORCES.name,
    parameters: Sequence[str] = (),
) -> "casadi.Function":
    """A quantity and its rates up to an order as a `casadi.Function`, built on SX; MX may call it.

    Parameters
    ----------
    robot : Robot
        A robot of numbers.
    order : int
        The highest rate of the quantity: 2 gives Q, Qd, Q2d.
    wrench : bool
        Whether wrenches W, Wd, ... (nb, 6) on the bodies are inputs too.
    quantity : str
        "inverse_dynamics", "gravity_forces", "mass_matrix", "coriolis_matrix of form 'paper'" or "... 'skew'".
    parameters : list of str
        Data of the robot that become inputs:

        * "gravity": gravity (3);
        * "masses": masses (nb), bodies keep their COM, and inertia grows with the mass;
        * "lengths": lengths (nb, 3), the positions of the body frames in their parents';
        * "payload", or "payload:X" for a body or merged link X: payload_mass, payload_com (3) and payload_inertia (6)
          about the COM, xx xy xz yy yz zz, in the axes of X, the last body if none is named; those of a second
          payload are payload2_mass, ...

    Returns
    -------
    casadi.Function : inputs q, qd, q2d, ... (n), then W, Wd, ... and the parameters; outputs Q, Qd, Q2d, ... (n), or
        M, C, Cbar (n, n), Qgrav (n) with their rates.

    Raises
    ------
    JounceError : where a name is unknown, the robot holds symbols, or CasADi is missing.

    Examples
    --------
    >>> import casadi, jounce
    >>> F = jounce.casadi_function(jounce.load("iiwa14"), order=1, parameters=["payload"])
    >>> F.name_in()
    ['q', 'qd', 'q2d', 'q3d', 'payload_mass', 'payload_com', 'payload_inertia']
    >>> q, m = casadi.MX.sym("q", 7), casadi.MX.sym("m")
    >>> at_rest = F(q=q, payload_mass=m, payload_com=[0, 0, 0.1])  # what is not named is zero
    >>> casadi.jacobian(at_rest["Q"], q).shape, casadi.jacobian(at_rest["Q"], m).shape
    ((7, 7), (7, 1))
    """
    try:
        import casadi
    except ModuleNotFoundError:
        raise JounceError("functions of CasADi need it; install it by: pip install 'jounce[casadi]'") from None
    _check(robot)
    asked = requests.computation(robot.mechanism, quantity, order, wrench)

    def symbols(name: str, shape: tuple[int, ...]) -> Array:
        inputs[name] = casadi.SX.sym(name, *shape)
        return asarray(inputs[name]).reshape(shape)

    inputs: dict[str, Any] = {}
    signature = asked.signature(robot.mechanism.n, robot.mechanism.nb)
    arrays = [symbols(port.name, port.shape) for port in signature.inputs]
    mechanism, _ = parametrised(robot.mechanism, parameters, symbols)
    results = asked.series("recursion", mechanism, arrays).upto(order)
    names = [port.name for port in signature.outputs]
    return casadi.Function(quantity, list(inputs.values()), [_matrix(x) for x in results], list(inputs), names)


def _matrix(array: np.ndarray) -> "casadi.SX":
    """A CasADi matrix of an object array, a column of a vector."""
    import casadi

    rows = array if array.ndim == 2 else array[:, None]
    return casadi.SX(casadi.vertcat(*(casadi.horzcat(*row) for row in rows)))


def _check(robot: Robot) -> None:
    if not isinstance(robot, Robot):
        raise JounceError(f"a function is made of a Robot, not of a {type(robot).__name__}; try jounce.load")
    if not all(is_numeric(getattr(robot.mechanism, data)) for data in DATA):
        raise JounceError("the robot holds symbols; expected numbers: parameters= makes inputs of masses, say")
