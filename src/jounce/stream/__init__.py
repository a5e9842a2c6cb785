"""Tables larger than memory: a job computes parts of them, here or on a cluster, and a run makes one output of all.

`job` says what is computed, `forces`, `motors` and `limit_checks` are the jobs; each gives blocks of channels, with
what is kept of their motions (`results`). `run` computes the parts that the `work_folder` has not finished yet, and
`publish` makes the output, which appears as a whole.
"""
