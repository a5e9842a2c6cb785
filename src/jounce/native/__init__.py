"""Native code for one robot: the recursion traced once, its program compiled for this processor.

`trace` runs a law on tracing scalars and keeps each distinct operation once; `program` is what it leaves: a list of
operations; `factor` and `fuse` are passes over programs; `emit` writes them as LLVM IR over vectors of states, with
sine and cosine of `functions`; `jit` compiles that for the host.
"""
