"""Code for other languages: the recursion traced once for one robot, its program printed.

`generate` is the door; `options` checks the arguments; `function` is a traced program with its input and output arrays,
of a robot some of whose data are run-time parameters; `printer` writes its statements in a `language`, split into parts
if there are many; `header` is the header comment; `test_vectors` are states with their correct results. `languages` is
the table of languages; each has a folder with templates of its files and tests. A new language takes such a folder, a
row of the table, and a line in the tests.

`symbolic` are the equations as SymPy expressions, which `latex_document` prints; `casadi` are functions for CasADi.
"""

from jounce._codegen.generate import Generated, codegen

__all__ = ["Generated", "codegen"]
