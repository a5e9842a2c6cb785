"""Read currents of motors as torques of joints: torque = torque constant * gear ratio * current.

Logs of many controllers hold currents in A, in columns such as ``current_joint1`` or under the name of torques. Torque
constants make torques of them: N m/A at the motor with a gear ratio, or at the joint without one. They are a number for
all joints, numbers in the order of the joints, or numbers by joint. Columns that state amperes, by their unit or by
their name, are never read as torques without them.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from jounce.arguments.names import values_by_name
from jounce.core.cures import Remedy, option_name
from jounce.core.errors import JounceError, join_names, quote_value, unknown_name_error
from jounce.core.scalars import asarray, is_finite

CURRENT_PATTERNS = ("current_{0}", "{0}.current", "{0}_current")
CURRENT_UNITS = {"A": 1.0, "mA": 1e-3}  # A
CURRENT_WORD = re.compile(r"(?<![a-z])(currents?|amps?|amperes?)(?![a-z])", re.IGNORECASE)
TORQUE_WORD = re.compile(r"torque|tau|effort|force", re.IGNORECASE)  # "current_torque" is the torque of now
CONSTANTS_CURE = Remedy("torque_constants= of jounce.load_motion, N m/A", "--torque-constants, N m/A")


@dataclass(frozen=True)
class Currents:
    """The torque constants and gear ratios of motors whose currents are read.

    Each is a number, a tuple of numbers by place, or a tuple of pairs of a joint and its number; None if torques are
    read.
    """

    constants: Any = None
    ratios: Any = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "constants", _check_numbers("torque_constants", self.constants))
        object.__setattr__(self, "ratios", _check_numbers("gear_ratios", self.ratios))
        if self.ratios is not None and not self.are_read:
            cure = f"give {option_name('torque_constants')} too, which are 1 for torques of motors before the gears"
            raise JounceError(f"{option_name('gear_ratios')} is of motors whose currents are read; {cure}")

    @property
    def are_read(self) -> bool:
        """Whether columns of torques hold currents."""
        return self.constants is not None

    @property
    def patterns(self) -> tuple[str, ...]:
        """The usual names of columns of currents, if these are read."""
        return CURRENT_PATTERNS if self.are_read else ()

    def check_units(self, columns: Mapping[str, str], units: Mapping[str, str | None]) -> None:
        """Raise `JounceError` where columns state the other of torques and currents.

        Columns are by joint, units by column.
        """
        for joint, column in columns.items():
            unit, bare_name = units[column], column.replace(joint, "")
            if self.are_read:
                if unit is not None and unit not in CURRENT_UNITS:
                    came = f"column {quote_value(column)} states {quote_value(unit)}; expected A or mA"
                    raise JounceError(f"{came}, or no {option_name('torque_constants')} if it holds torques")
                continue
            is_named = CURRENT_WORD.search(bare_name) is not None and TORQUE_WORD.search(bare_name) is None
            if unit in CURRENT_UNITS or is_named:
                came = f"column {quote_value(column)} holds a current, and torques are expected"
                raise JounceError(f"{came}; give {CONSTANTS_CURE}: torque = constant * gear ratio * current")

    def factors(
        self, joints: Sequence[str], columns: Mapping[str, str], units: Mapping[str, str | None]
    ) -> dict[str, float]:
        """Return the factors that make torques of currents.

        They are constant * gear ratio, by joint with a column, in its unit; {} where torques are read.
        """
        if not self.are_read:
            return {}
        if len(columns) == 0:
            cure = f"expected current_JOINT, JOINT.current, ..., or named by {option_name('torques')}"
            raise JounceError(f"{option_name('torque_constants')}: no columns of currents; {cure}")
        constants = _numbers_by_joint("torque_constants", self.constants, joints, columns)
        ratios = dict.fromkeys(joints, 1.0)
        if self.ratios is not None:
            ratios = _numbers_by_joint("gear_ratios", self.ratios, joints, columns)
        amperes = {joint: CURRENT_UNITS[units[column] or "A"] for joint, column in columns.items()}
        return {joint: constants[joint] * ratios[joint] * amperes[joint] for joint in columns}

    @staticmethod
    def describe(factors: Mapping[str, float], columns: Mapping[str, str]) -> str:
        """Describe how currents became torques."""
        values = join_names(f"{joint} {factors[joint]:.4g}" for joint in columns)
        first = quote_value(next(iter(columns.values())))
        return f"torques are currents, as {first}, times torque constants and gear ratios, N m/A: {values}"


def _check_numbers(keyword: str, given: object) -> Any:
    """Return a caller's constants or ratios, which are finite and not 0."""
    if given is None:
        return None
    expected = "expected a number, numbers in the order of the joints, or a mapping from joints to numbers, none 0"
    values = values_by_name(given)
    are_pairs = isinstance(values, tuple) and len(values) > 0 and all(isinstance(x, tuple) for x in values)
    if isinstance(values, Mapping) or are_pairs:
        pairs = [*values.items()] if isinstance(values, Mapping) else [*values]
        for joint, value in pairs:
            if not isinstance(joint, str) or not is_finite(value) or value == 0:
                came = f"{option_name(keyword)} of {quote_value(joint)} is {quote_value(value)}"
                raise JounceError(f"{came}; expected a number that is not 0")
        if len(pairs) == 0:
            raise JounceError(f"{option_name(keyword)} is empty; {expected}")
        return tuple((joint, float(value)) for joint, value in pairs)
    array = np.asarray(asarray(values, keyword))
    if array.dtype.kind != "f" or array.ndim > 1 or array.size == 0 or not (np.isfinite(array) & (array != 0)).all():
        raise JounceError(f"{option_name(keyword)} is {quote_value(given)}; {expected}")
    return float(array) if array.ndim == 0 else tuple(array.tolist())


def _numbers_by_joint(
    keyword: str, numbers: Any, joints: Sequence[str], columns: Mapping[str, str]
) -> dict[str, float]:
    """Return the number of each joint that has a column."""
    if isinstance(numbers, float):
        return dict.fromkeys(columns, numbers)
    if not isinstance(numbers[0], tuple):
        if len(numbers) != len(joints):
            came = f"{option_name(keyword)} has {len(numbers)} numbers"
            expected = f"{len(joints)} in the order of the joints, {join_names(joints)}, or one for all"
            raise JounceError(f"{came}; expected {expected}")
        return dict(zip(joints, numbers, strict=True))
    by_joint: dict[str, float] = dict(numbers)
    for joint in by_joint:
        if joint not in joints:
            raise JounceError(f"{option_name(keyword)}: {unknown_name_error('joint', joint, joints)}")
    missing = [joint for joint in columns if joint not in by_joint]
    if len(missing) > 0:
        came = f"no number for {join_names(missing)}, with currents in {quote_value(columns[missing[0]])}"
        raise JounceError(f"{option_name(keyword)}: {came}; expected one for each joint with a column")
    return by_joint
