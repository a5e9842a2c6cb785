"""CasADi functions of a robot's quantities, to be differentiated and put into optimal control problems."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from jounce._codegen.casadi.external import function_name, matrix_shape
from jounce.arguments import requests
from jounce.core import errors, scalars
from jounce.core.errors import JounceError, join_names, quote_value, warn
from jounce.core.typing import Frame
from jounce.dynamics.computation import Computation
from jounce.dynamics.quantities.names import QuantityName
from jounce.engine.engine import Engine
from jounce.model import body_parameters
from jounce.model.mechanism import Mechanism

if TYPE_CHECKING:
    import casadi

MAX_POINTS = 1_000_000  # of a call: the Jacobian of an arm's forces has 0.2 billion entries then


def casadi_function(
    robot: Engine,
    quantity: QuantityName,
    order: int,
    wrench: bool,
    body: str | None,
    frame: Frame,
    parameters: Sequence[str],
    moving_base: bool,
    native: bool,
    points: int,
) -> "casadi.Function":
    """A quantity and its rates as a `casadi.Function`, see `Robot.casadi_function`."""
    with errors.optional_import("casadi_function() needs CasADi", "casadi"):
        import casadi
    if not robot.mechanism.is_numeric:
        raise JounceError(
            "the robot contains symbols; expected numbers (parameters=['masses'] makes its masses inputs)"
        )
    request = requests.ComputationRequest(quantity, order, wrench, body, frame, moving_base=moving_base)
    computation = requests.build_computation(robot.mechanism, request)
    _check_axes(computation, robot.mechanism)
    if isinstance(points, bool) or not isinstance(points, int | np.integer) or not 0 < points <= MAX_POINTS:
        raise JounceError(
            f"points is {quote_value(points)}; expected how many states a call takes, from 1 to {MAX_POINTS}"
        )
    if errors.check_bool("native", native, "whether native code computes the function"):
        if parameters:
            raise JounceError("native=True takes no parameters, which native code holds as numbers; native=False does")
        from jounce._codegen.casadi.native import native_function

        return native_function(robot.mechanism, computation, int(points))
    shapes = {name: value.shape for name, value in body_parameters.own_values(robot.mechanism, parameters).items()}
    signature = computation.signature(robot.mechanism, shapes)
    ports = sorted(signature.inputs, key=lambda port: port.role == "parameter")  # the state first, as in other calls
    inputs = {port.name: casadi.SX.sym(port.name, *port.shape) for port in ports}
    arrays = {port.name: scalars.asarray(inputs[port.name]).reshape(port.shape) for port in ports}
    mechanism, _ = body_parameters.parametrise(robot.mechanism, parameters, lambda name, shape: arrays[name])
    state = [arrays[port.name] for port in ports if port.role != "parameter"]
    method = next(iter(computation.quantity.laws))
    results = [_matrix(x) for x in computation.series(method, mechanism, state).upto(computation.count - 1)]
    names = [port.name for port in signature.outputs]
    all_results = casadi.veccat(*results)
    idle = [name for name in shapes if not casadi.depends_on(all_results, inputs[name])]
    if idle:
        warn(f"parameters without effect on {quantity}: {join_names(idle)}")
    function = casadi.Function(function_name(computation), list(inputs.values()), results, list(inputs), names)
    return function if points == 1 else function.map(int(points))


def _matrix(array: np.ndarray) -> "casadi.SX":
    """The CasADi matrix of an object array: a column of a vector, 1 x 1 of a scalar, several matrices in one column."""
    import casadi

    rows = array.reshape(matrix_shape(array.shape))
    return casadi.SX(casadi.vertcat(*(casadi.horzcat(*row) for row in rows)))


def _check_axes(computation: Computation, mechanism: Mechanism) -> None:
    """Raise `JounceError` if the result has more axes than a matrix of CasADi, since it is of all bodies."""
    shape = computation.shape(mechanism)
    if computation.quantity.of_bodies and len(shape) > 2:
        raise JounceError(
            f"{computation.name} of all bodies: a CasADi matrix has 2 axes, not {len(shape)};"
            f" body= selects one of: {join_names(mechanism.bodies)}"
        )
