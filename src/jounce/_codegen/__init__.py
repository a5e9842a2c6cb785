"""Code for other languages: the recursion traced once for one robot, its program printed.

`options` checks the arguments; `parametric` replaces data of the robot by run-time parameters; `function` is a traced
program with its input and output arrays; `schedule` turns it into statements, split into parts if it is long; `printer`
writes them in a `language`; `header` is the header comment; `test_vectors` are states with their correct results;
`render` fills in the templates. Each language has its own folder: a configuration, and templates of its files and
tests. A new language takes such a folder, its name in `language`, and a line in the tests.
"""

from jounce._codegen.generate import Generated, codegen

__all__ = ["Generated", "codegen"]
