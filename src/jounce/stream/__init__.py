"""Tables larger than memory: a job computes parts of them, here or on a cluster, and a run makes one output of all.

`jobs` compute blocks of channels, with what is kept of their motions; `run` computes the parts that are not among the
`finished_parts` yet, here or by `cluster`, and makes the output.
"""
