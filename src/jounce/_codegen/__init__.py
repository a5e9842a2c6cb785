"""Code for other languages: the recursion traced once for one robot, its program printed.

`options` checks what is asked for; `parametric` says which of the robot's data the code takes at run time; `function`
is what is traced: a program with the arrays that it takes and gives; `schedule` puts it into statements, cut into parts
where it is long; `printer` writes them in a `language`; `header` is what stands at the head of the code;
`test_vectors` are states with the results that are right for them; `render` fills in the templates. Each language is a
folder of its own: a configuration, and templates of its files, tests among them; to add one takes the folder, its name
in `language`, and a line in the tests.
"""

from jounce._codegen.generate import Generated, codegen

__all__ = ["Generated", "codegen"]
