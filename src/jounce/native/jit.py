"""LLVM IR made into native code by llvmlite, kept in memory as long as someone holds it."""

import ctypes
from typing import Any

from jounce.native.target import Target

Loop = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_void_p)


def _machine(target: Target) -> Any:
    """LLVM's code generator for a target; a new one each time, as whoever runs code takes it over."""
    import llvmlite.binding as llvm

    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    triple = llvm.Target.from_default_triple()
    return triple.create_target_machine(cpu=target.cpu, features=target.features, opt=2, jit=True)


def assemble(text: str, target: Target) -> bytes:
    """The object code of a module."""
    import llvmlite.binding as llvm

    code = _machine(target)
    module = llvm.parse_assembly(text)
    module.triple, module.data_layout = code.triple, str(code.target_data)
    return code.emit_object(module)


def load_object(code: bytes, target: Target) -> tuple[int, Any]:
    """The address of ``@states`` in object code, and what must live as long as it is called."""
    import llvmlite.binding as llvm

    machine = _machine(target)
    engine = llvm.create_mcjit_compiler(llvm.parse_assembly(""), machine)
    engine.add_object_file(llvm.ObjectFileRef.from_data(code))
    engine.finalize_object()
    return engine.get_function_address("states"), engine
