"""Code for other languages: the recursion traced once for one robot, its program printed.

`parametric` says which of the robot's data the code takes at run time; `routine` is what is traced: a program with the
arrays that it takes and gives; `listing` puts it into statements, cut into parts where it is long; `printer` writes
them in a `language`; `vectors` are states with the forces that are right for them. Each language is a folder of its
own: a configuration, and templates of its files, tests among them; to add one takes the folder, its name in `language`,
and a line in the tests.
"""

from jounce._codegen.generation import Generated, codegen

__all__ = ["Generated", "codegen"]
