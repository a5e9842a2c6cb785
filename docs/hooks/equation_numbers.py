"""The numbers that the paper prints beside its equations, by the label that each has in the paper's source.

Equations without a label have their number as label, "25". The source is that of the preprint.

Run with the paper's TeX source, ``python docs/hooks/equation_numbers.py paper.tex``, it prints the table `NUMBERS`.
"""

import re
import sys
from itertools import count
from pathlib import Path

ENVIRONMENT = re.compile(r"\\begin\{(equation|eqnarray)\}(.*?)\\end\{\1\}", re.DOTALL)
INNER = re.compile(r"\\begin\{array\}.*?\\end\{array\}", re.DOTALL)  # its rows are none of the equation's
LABEL = re.compile(r"\\label\{(\w+)\}")
UNNUMBERED = re.compile(r"\\(notag|nonumber)\b")

NUMBERS = {
    "EOM1": 1,
    "Cij": 2,
    "Ci": 3,
    "Xi": 4,
    "5": 5,
    "6": 6,
    "SO3exp": 7,
    "Vsys": 8,
    "JbSys": 9,
    "Ab": 10,
    "AdCij": 11,
    "Jdot": 12,
    "a": 13,
    "adSE3": 14,
    "VbdotMat": 15,
    "A": 16,
    "D": 17,
    "18": 18,
    "Adot": 19,
    "MC": 20,
    "Msys": 21,
    "Csys": 22,
    "b": 23,
    "eqn_body_fixed_mass_inertia_matrix": 24,
    "25": 25,
    "eq_U": 26,
    "Qext": 27,
    "EOM1stOrder": 28,
    "Mdot": 29,
    "M1": 30,
    "Cdot": 31,
    "C1": 32,
    "CSysdot": 33,
    "C11": 34,
    "C12": 35,
    "Qgravdot": 36,
    "Qextdot": 37,
    "EOM2ndOrder": 38,
    "39": 39,
    "Mddot": 40,
    "41": 41,
    "42": 42,
    "M21": 43,
    "M22": 44,
    "45": 45,
    "C2temp": 46,
    "C1dot": 47,
    "CSys2dot": 48,
    "49": 49,
    "C21": 50,
    "C22": 51,
    "52": 52,
    "Qextddot": 53,
    "Cbar": 54,
    "55": 55,
    "56": 56,
    "57": 57,
    "58": 58,
}


def number(tex: str) -> dict[str, int]:
    """The number of each label's equation, counted as LaTeX counts, and of each equation without a label.

    A labelled row without a number continues the form above it, ``&&``, and has the number of that form. LaTeX's
    references to it print the next number instead: `references`.
    """
    found, numbers, last = {}, count(1), 0
    for kind, body in ENVIRONMENT.findall(re.sub(r"(?<!\\)%.*\n?", "", tex)):
        form = None  # the number of the form that the row belongs to
        waiting: list[str] = []  # labels of a form whose number is still to come
        for row in INNER.sub("", body).split(r"\\") if kind == "eqnarray" else [body]:
            if not row.strip().startswith("&&"):
                form = None
            waiting += LABEL.findall(row)
            if not UNNUMBERED.search(row):
                form = last = next(numbers)
            if form is not None:
                found |= dict.fromkeys(waiting, form)
                waiting = []
    unlabelled = {str(n): n for n in range(1, last + 1) if n not in found.values()}
    return dict(sorted((found | unlabelled).items(), key=lambda pair: pair[1]))


def references(tex: str) -> dict[str, int]:
    """What LaTeX prints for a reference to each label: the number of its row, or the next one if the row has none."""
    found, numbers = {}, 1
    for kind, body in ENVIRONMENT.findall(re.sub(r"(?<!\\)%.*\n?", "", tex)):
        for row in INNER.sub("", body).split(r"\\") if kind == "eqnarray" else [body]:
            found |= dict.fromkeys(LABEL.findall(row), numbers)
            numbers += not UNNUMBERED.search(row)
    return found


if __name__ == "__main__":
    for label, value in number(Path(sys.argv[1]).read_text(encoding="utf-8")).items():
        print(f'    "{label}": {value},')
