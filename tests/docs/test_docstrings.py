"""Docstrings of everything public say what a caller needs: parameters, results, and an example that runs.

What every call refuses, `jounce` and `Robot` say once. A section `Raises` is for what else a call refuses, if anything.
"""

import inspect
import re
from collections import ChainMap

import pytest

import jounce
from jounce.native.products import DerivativeProducts
from jounce.robot.applications import Applications
from jounce.robot.exports import Exports


def public_members():
    """All public callables by name: functions, classes, and what they can do."""
    for name in jounce.__all__:
        member = getattr(jounce, name)
        if callable(member):
            yield name, member
        if inspect.isclass(member):
            own = [vars(base) for base in member.__mro__ if base in (member, Applications, Exports, DerivativeProducts)]
            for key, static in ChainMap(*own).items():
                if (not key.startswith("_") or key == "__call__") and not isinstance(static, property):
                    method = getattr(member, key)
                    if callable(method):
                        yield f"{name}.{key}", method


MEMBERS = {
    name: member for name, member in public_members() if not (inspect.isclass(member) and issubclass(member, Exception))
}


def sections(member):
    return set(re.findall(r"^(\w+)\n-{3,}$", inspect.getdoc(member) or "", re.MULTILINE))


@pytest.mark.parametrize("name", MEMBERS)
def test_has_all_sections(name):
    member = MEMBERS[name]
    needed = {"Examples"}
    if not inspect.isclass(member):
        signature = inspect.signature(member)
        given = [key for key in signature.parameters if key not in ("self", "cls")]
        needed |= {"Parameters"} if given else set()
        needed |= {"Returns"} if signature.return_annotation not in (None, "None") else set()
    assert needed - sections(member) == set()


@pytest.mark.parametrize("name", [name for name, member in MEMBERS.items() if not inspect.isclass(member)])
def test_every_parameter_is_described(name):
    text = inspect.getdoc(MEMBERS[name])
    described = {
        key.strip(" *") for line in re.findall(r"^(\*?\*?\w[^:\n]*) : ", text, re.MULTILINE) for key in line.split(",")
    }
    kinds = inspect.signature(MEMBERS[name]).parameters.values()
    asked = {x.name for x in kinds if x.name not in ("self", "cls", "fixed")}
    assert asked - described == set()


GENERAL = re.compile(  # what every call refuses, in the words of sections
    r"(an? |the )?(\w+ )?(shapes?|arrays?|names?|rates?|kinds?|types?|numbers?|argument)( or \w+)? (is|has|are)"
    r" (a )?(wrong|unknown|skipped|not finite|out of range|invalid)( shape)?"
)


@pytest.mark.parametrize("name", [name for name, member in MEMBERS.items() if "Raises" in sections(member)])
def test_raises_states_what_not_every_call_refuses(name):
    text = re.search(r"^Raises\n-{3,}\n(.*?)(?=\n\n|\Z)", inspect.getdoc(MEMBERS[name]), re.MULTILINE | re.DOTALL)[1]
    conditions = re.split(r", or |, | or |; ", re.sub(r"\s+", " ", text).replace("JounceError If ", "").strip(" ."))
    assert [condition for condition in conditions if not GENERAL.fullmatch(condition)]


def test_quantities_name_the_paper():
    for row in ("inverse_dynamics", "mass_matrix", "coriolis_matrix", "gravity_forces", "jacobian", "poses", "twists"):
        assert "References" in sections(getattr(jounce.Robot, row)), row
