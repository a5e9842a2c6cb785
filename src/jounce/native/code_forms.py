"""Choose the form of native code for a computation, and write it.

There are four forms. `straight`: all operations of a robot in a straight line, the fastest code. `loop`: for larger
robots and high orders, the steps of a joint, called in a loop over the bodies; and for accelerations the same with the
steps of articulated bodies. `columns`: partial derivatives of large robots, with steps on columns of matrices.
`memory_layout` decides which form a computation takes; here it is traced and written.

Compiling takes time that grows with the code. A caller with limited patience gets `LongCompilationError` instead,
before most of the work is done: by estimates from the sizes of the robot, or once a trace becomes too long.
"""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from math import inf, prod
from typing import TYPE_CHECKING

import numpy as np

from jounce.core.errors import JounceError
from jounce.dynamics.computation import SECOND_PRODUCTS, Computation, Port, Signature, change
from jounce.dynamics.loops import closure_of
from jounce.model.drive_trains import stated_terms
from jounce.model.mechanism import Mechanism, with_exact_integers
from jounce.native import calls, memory_layout
from jounce.native.ir import BlockCode
from jounce.native.jit import Target
from jounce.native.memory_layout import LongCompilationError
from jounce.native.straight import straight_block
from jounce.program.passes import factor, fuse
from jounce.program.program import Program, Tape, TapeFullError, interruptible, uncollected

if TYPE_CHECKING:
    from jounce.program.differentiate import Followers

# What compiling takes, in seconds, as measured on one core of a Zen 4:
SECONDS_PER_STEP = 55e-6  # of the trace of a straight line
SECONDS_PER_DERIVATIVE_STEP = 80e-6  # of the trace of a product of derivatives
MAX_SECOND_STEPS = 1_000_000  # of the trace of second derivatives, which then compile for minutes
SECONDS_PER_LOOP_BODY = 1.2e-3  # in the tables of the loop form
SECONDS_PER_JOINT_KIND = 6e-3  # in the loop form, times the square of the number of rates


@interruptible()
@uncollected()
def kernel_modules(mechanism: Mechanism, computation: Computation, target: Target, patience: float = inf) -> list[str]:
    """Return the LLVM IR of a computation.

    Raises `LongCompilationError` if compiling it is likely to take longer than `patience` seconds.
    """
    signature = computation.signature(mechanism)
    return calls.write_modules(_make_block(mechanism, computation, target, patience), signature, target)


@interruptible()
@uncollected()
def trace_program(mechanism: Mechanism, computation: Computation, tape: Tape | None = None) -> Program:
    """Return the operations of a computation, traced from the recursion.

    Products with shared factors are grouped. If the mechanism holds nodes of a tape, give that tape: its inputs come
    first among those of the program.
    """
    tape = Tape() if tape is None else tape
    # Products of derivatives are made of the program of the values, which is traced first.
    parameters, values = tape.inputs, replace(computation, product=None)
    inputs = values.signature(mechanism).inputs
    arrays = [tape.variables(*port.shape) for port in inputs]
    results = values.series("recursion", with_exact_integers(mechanism), arrays).upto(values.count - 1)
    traced = factor(tape.program([x for result in results for x in np.ravel(result)]))
    if computation.product is None:
        return traced
    from jounce.program import differentiate  # imported here to keep start-up fast

    # Inputs such as poses have more numbers than directions: derivatives are along displacements of them.
    displaced = [
        differentiate.DisplacedInputs(
            parameters + port.start, port.shape, prod(port.displacement), partial(change, mechanism, port)
        )
        for port in inputs
        if port.displacement != port.shape
    ]
    # Dependent coordinates of closed robots are no free inputs: they follow the independent ones.
    followers = _trace_followers(mechanism, inputs, arrays, tape) if mechanism.takes_dependent else None
    free = differentiate.FreeInputs(parameters, displaced, followers)
    return differentiate.PRODUCTS[computation.product](traced, free, tape.most)


def _trace_followers(
    mechanism: Mechanism, inputs: Sequence[Port], arrays: Sequence[np.ndarray], tape: Tape
) -> "Followers":
    """Return the dependent coordinates and their velocities.

    The dependent coordinates are the last inputs that are traced on a tape, the independent ones the first.
    """
    from jounce.program.differentiate import Followers

    parameters = tape.inputs - sum(port.size for port in inputs)
    state = [arrays[0], tape.variables(mechanism.n), arrays[-1]]
    rate = Computation("coordinates", 1).series("recursion", with_exact_integers(mechanism), state)[1]
    dependent = closure_of(mechanism).dependent
    return Followers(parameters + inputs[-1].start, parameters, factor(tape.program([*rate[..., list(dependent)]])))


def _make_block(mechanism: Mechanism, computation: Computation, target: Target, patience: float) -> BlockCode:
    """Return the code of a block, in the form of the computation."""
    signature = computation.signature(mechanism)
    # Columns: only the factors of M are a straight line, which grows with the robot.
    layout = memory_layout.column_layout(computation, mechanism)
    if layout is not None:
        if layout.forward and layout.factor_operations * SECONDS_PER_STEP > patience:
            raise LongCompilationError
        from jounce.native import columns  # imported here to keep start-up fast

        return columns.emit_columns(mechanism, layout, signature)
    # A loop, with or without articulated bodies: one step for each kind of joint, whose length grows as the square of
    # the number of rates.
    if not memory_layout.is_straight(computation, mechanism):
        from jounce.native import loop  # imported here to keep start-up fast
        from jounce.native.loop_steps import Sweeps, joint_kinds

        steps_of_joints = (len(set(joint_kinds(mechanism))) + computation.base) * (computation.order + 1) ** 2
        if len(mechanism.joints) * SECONDS_PER_LOOP_BODY + steps_of_joints * SECONDS_PER_JOINT_KIND > patience:
            raise LongCompilationError
        # Drive terms that act in this robot, count in this quantity, and have data.
        terms = {*mechanism.acting}.intersection(computation.quantity.drives.terms)
        acting = tuple(term for term in stated_terms(mechanism.drives) if term in terms)
        return loop.emit_loop(mechanism, Sweeps(computation, computation.order, acting), signature)
    # A straight line. Each result takes a step at least: too many results are refused without a trace.
    if signature.outputs[-1].end * SECONDS_PER_STEP > patience:
        raise LongCompilationError
    # The tape stops the trace as soon as it has more steps than can be compiled in time.
    seconds_per_step = SECONDS_PER_STEP if computation.product is None else SECONDS_PER_DERIVATIVE_STEP
    max_steps = patience / seconds_per_step
    is_second = computation.product in SECOND_PRODUCTS
    try:
        tape = Tape(min(max_steps, MAX_SECOND_STEPS) if is_second else max_steps)
        steps = fuse(trace_program(mechanism, computation, tape))
    except TapeFullError:
        # Whatever the patience, second derivatives have a limit, and another way.
        if max_steps > MAX_SECOND_STEPS:
            size = "x".join(map(str, signature.outputs[0].shape))
            raise JounceError(
                f"{computation.describe(mechanism.name)}, {size}, takes over {MAX_SECOND_STEPS:,} operations; expected"
                " fewer. hvp of a kernel computes its columns, one for each direction; or choose a lower order"
            ) from None
        raise LongCompilationError from None
    first = _order_from_tip(signature) if computation.product == "vjp" else None
    return straight_block(steps, signature, target, first)


def _order_from_tip(signature: Signature) -> list[int]:
    """Return the numbers of all gradients, from the tip inward.

    Those by rates of the last coordinates are first. All gradients by rates of one joint take the same values, of
    which fewer then wait: this saves a sixth of the time.
    """
    # Gradients by entry j of ports of different sizes are compared by j / size, the way along the robot.
    places = [(port, j) for port in signature.outputs for j in range(port.size)]
    return sorted(range(len(places)), key=lambda k: -places[k][1] / places[k][0].size)
