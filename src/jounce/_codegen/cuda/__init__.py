"""CUDA: functions of one state for host and device, and kernels of many, one a thread."""

from jounce._codegen import cpp
from jounce._codegen.language import Language

LANGUAGE = Language(name="cuda", title="CUDA", reserved=cpp.LANGUAGE.reserved, taken="test")
