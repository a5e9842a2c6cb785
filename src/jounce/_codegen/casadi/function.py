"""Make CasADi functions of a robot's quantities for optimal control problems."""

from collections.abc import Sequence
from dataclasses import dataclass
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


@dataclass(frozen=True, kw_only=True)
class CasadiOptions:
    """The options of `Robot.casadi_function`.

    `native` and `points` are checked when it is made.
    """

    quantity: QuantityName
    order: int
    wrench: bool
    body: str | None
    frame: Frame
    parameters: Sequence[str]
    moving_base: bool
    native: bool
    points: int

    def __post_init__(self) -> None:
        points = self.points
        if isinstance(points, bool) or not isinstance(points, int | np.integer) or not 0 < points <= MAX_POINTS:
            raise JounceError(
                f"points is {quote_value(points)}; expected how many states a call takes, from 1 to {MAX_POINTS}"
            )
        errors.check_bool("native", self.native, "whether native code computes the function")
        if self.native and self.parameters:
            raise JounceError("native=True takes no parameters, which native code holds as numbers; native=False does")

    def computation(self, mechanism: Mechanism) -> Computation:
        """Return what the function computes for a robot."""
        request = requests.ComputationRequest(
            self.quantity, self.order, self.wrench, self.body, self.frame, moving_base=self.moving_base
        )
        return requests.build_computation(mechanism, request)


def casadi_function(robot: Engine, options: CasadiOptions) -> "casadi.Function":
    """Return a quantity and its rates as a `casadi.Function`, see `Robot.casadi_function`."""
    with errors.optional_import("casadi_function() needs CasADi", "casadi"):
        import casadi
    if not robot.mechanism.is_numeric:
        raise JounceError(
            "the robot contains symbols; expected numbers (parameters=['masses'] makes its masses inputs)"
        )
    computation, points = options.computation(robot.mechanism), int(options.points)
    _check_axes(computation, robot.mechanism)
    if options.native:
        # This module is imported without CasADi, on whose classes native functions are built.
        from jounce._codegen.casadi.native import native_function

        return native_function(robot.mechanism, computation, points)

    # Inputs are symbols: the state first, as in other calls, then the parameters.
    own_values = body_parameters.own_values(robot.mechanism, options.parameters)
    shapes = {name: value.shape for name, value in own_values.items()}
    signature = computation.signature(robot.mechanism, shapes)
    ports = sorted(signature.inputs, key=lambda port: port.role == "parameter")
    inputs = {port.name: casadi.SX.sym(port.name, *port.shape) for port in ports}
    arrays = {port.name: scalars.asarray(inputs[port.name]).reshape(port.shape) for port in ports}

    # The first method of a quantity is the recursion, or the only one; it runs on the symbols.
    mechanism, _ = body_parameters.parametrise(robot.mechanism, options.parameters, lambda name, shape: arrays[name])
    state = [arrays[port.name] for port in ports if port.role != "parameter"]
    method = next(iter(computation.quantity.laws))
    results = [_matrix(x) for x in computation.series(method, mechanism, state).upto(computation.count - 1)]

    # A parameter that enters no result is probably a mistake, as gravity in the mass matrix.
    all_results = casadi.veccat(*results)
    idle = [name for name in shapes if not casadi.depends_on(all_results, inputs[name])]
    if len(idle) > 0:
        warn(f"parameters without effect on {options.quantity}: {join_names(idle)}")

    names = [port.name for port in signature.outputs]
    function = casadi.Function(function_name(computation), list(inputs.values()), results, list(inputs), names)
    return function if points == 1 else function.map(points)


def _matrix(array: np.ndarray) -> "casadi.SX":
    """Return the CasADi matrix of an object array.

    A vector is a column, a scalar is 1 x 1, and several matrices stand in one column.
    """
    import casadi

    rows = array.reshape(matrix_shape(array.shape))
    return casadi.SX(casadi.vertcat(*(casadi.horzcat(*row) for row in rows)))


def _check_axes(computation: Computation, mechanism: Mechanism) -> None:
    """Raise `JounceError` if a result has too many axes.

    A matrix has two; results of all bodies may have three.
    """
    shape = computation.shape(mechanism)
    if computation.quantity.of_bodies and len(shape) > 2:
        raise JounceError(
            f"{computation.name} of all bodies: a CasADi matrix has 2 axes, not {len(shape)};"
            f" body= selects one of: {join_names(mechanism.bodies)}"
        )
