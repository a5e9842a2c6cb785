"""Native code for one robot: the recursion traced once, its program compiled for this processor.

A law is run on scalars that trace it. The trace is a list of operations, a `jounce.program`, which has passes over it.
`code_forms` chooses one of four forms: `straight` writes all operations as LLVM IR over vectors of states, with the
functions of `vector_functions`; for large robots, `loop` writes the steps of a joint, with or without those of
articulated bodies (`loop_steps`), and `columns` those of columns of matrices. `calls` writes what moves states in and
results out, and `jit` compiles that for the host. `memory_layout` plans the form and the memory; `kernel` is what users
call.
"""
