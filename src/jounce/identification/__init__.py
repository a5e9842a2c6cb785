"""Identification: inertial parameters and drive terms of a robot from a motion and the forces measured along it."""

from jounce.identification.estimation import identify
from jounce.identification.excitation import Excitation, excite
from jounce.identification.payload import Payload, PayloadParameter
from jounce.identification.result import ForceResidual, Identification, IdentifiedLog, IdentifiedParameter

__all__ = [
    "Excitation", "ForceResidual", "Identification", "IdentifiedLog", "IdentifiedParameter", "Payload",
    "PayloadParameter", "excite", "identify",
]  # fmt: skip
