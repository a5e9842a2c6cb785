"""Native code for one robot: the recursion traced once, its program compiled for this processor.

A law is run on scalars that trace it, `jounce.program` is what that leaves, a list of operations, and has passes over
it; `code_forms` chooses the form: `straight` writes it as LLVM IR over vectors of states, with the functions of
`vector_functions`, `loop` and `columns` write the steps of a joint for large robots instead; `calls` writes what moves
states in and results out; `jit` compiles that for the host. `memory_layout` plans the form and the memory, `kernel` is
what users call.
"""
