"""Methods of robots in API pages: those that are made from rows are read as they are made, not from their sources."""

from typing import Any

import griffe

import jounce.robot.methods  # noqa: F401 - griffe finds it then

MODULE, CLASS = "robot.methods", "Methods"


class MadeMethods(griffe.Extension):
    """Puts the methods that Python knows in place of what the sources show."""

    def on_package(self, *, pkg: griffe.Module, **_: Any) -> None:
        """Replace the methods of the class."""
        found = pkg[MODULE][CLASS]
        made = griffe.inspect(f"{pkg.name}.{MODULE}", filepath=found.filepath)[CLASS]
        for name, member in made.members.items():
            if member.is_function:
                found.set_member(name, member)
