"""Tables larger than memory: a plan of parts of the input, a pure function of a part, and what runs the plan.

`input_parts.make_plan` divides the input into parts. `parts.compute` reads one part, and writes its rows and a record
of it into the work folder. A runner calls it for every part that has no valid record yet, in any order and process.
`publish` makes the output of the parts, which appears as a whole.
"""
