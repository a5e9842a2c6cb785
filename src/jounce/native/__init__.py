"""Native code for one robot: the recursion traced once, its program compiled for this processor.

A law is run on scalars that trace it, `jounce.program` is what that leaves, a list of operations, and has passes over
it; `emit` writes them as LLVM IR over vectors of states, with the functions of `functions`; `jit` compiles that for the
host.
"""
