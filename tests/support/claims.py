"""Claims of speed and accuracy that somebody typed into a page, where tables of benchmarks are made by scripts.

Problem: a figure in a sentence stays as it is when the code, the machine or another library changes. A cell of a table
that a script made is measured again.

Method: what scripts make, code and addresses of links are blanked, so that all lines keep their numbers. Of the rest,
paragraphs and rows of tables are searched one by one. A claim is a number with a unit of time, memory or throughput; a
factor or a share; a count of digits or operations; a power of ten below one; or a bare number in a table whose head, or
first cell of the row, names what is measured. Numbers are digits or words; lists and ranges of them are one claim.

Invariants: a claim is found wherever its lines break, in emphasis and in comments of code too. Quantities of a robot
(N m, rad, kg, m/s), dates, versions, labels of equations, counts of joints and states, and values of options are no
claims.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass

from facts import QUOTED

MADE = re.compile(r"<!-- made by python -m benchmarks\.\w+(?:(?!<!-- made by).)*?<!-- end -->", re.DOTALL)
FENCE = re.compile(r"^ *(`{3,})[^\n]*\n.*?^ *\1 *$", re.MULTILINE | re.DOTALL)
COMMENT = re.compile(r"(?:^|(?<=\s))# .*", re.MULTILINE)
ADDRESS = re.compile(r"(?<=\])\([^)]*\)|https?://[^\s)>]+")
MARKS = re.compile(r"[*`$]|&\w+;|</?\w[^>]*>")

DIGITS = r"(?<![\w.^])(?<!\w-)\d+(?:,\d{3})*(?:\.\d+)?(?:e[+-]?\d+|\^\d+)?"
NUMERALS = (
    "one|two|three|four|five|six|seven|eight|nine|ten|eleven|twelve|thirteen|fourteen|fifteen|sixteen|seventeen|eighteen|"
    "nineteen|twenty|thirty|forty|fifty|sixty|seventy|eighty|ninety|tens|dozens?|hundreds?|thousands?|millions?|billions?|"
    "half|thirds?|quarters?|fifths?|sixths?|eighths?|tenths?|hundredths?|thousandths?|fraction"
)
NUMBER = rf"(?:{DIGITS}|\b(?i:{NUMERALS})\b)"
BETWEEN = r"(?:\s*[-\u2013/]\s*|,?\s+(?:to|and|or|against|than)\s+|,\s+|\s+(?:of\s+)?(?:an?\s+)?)"
LIST = rf"{NUMBER}(?:{BETWEEN}{NUMBER})*"
VAGUE = r"\b(?i:few|several|some|couple\s+of)\b"
AMOUNT = rf"(?:(?:{VAGUE}\s+)?{LIST}|{VAGUE})"  # of a unit

BEFORE_VERBS = (
    r"(?=\s*(?:[.,;:)|]|$)|\s+(?:for|to|per|of|on|with|and|or|too|at|each|in|from|once|by|is|as|than|after)\b)"
)
ONE_SECOND = rf"second{BEFORE_VERBS}"  # no second derivative, no second robot
SINGULAR = r"(?:nano|micro|milli)second|minute|hour|day"
SHORT_TIME = r"(?:[nuµμm]s|(?<!\d{4})s|min|h)(?![\w^²/])"  # no 1980s, s^2, s/m
TIME = rf"(?:{SHORT_TIME}|(?:(?:{SINGULAR})s?|seconds)\b|{ONE_SECOND})"
MEMORY = r"(?:[kKMGT]i?B|bytes?)\b"
FREQUENCY = r"(?:[kMG]Hz|[kMGT]?FLOPS?(?:/s)?)\b"
COUNTED = r"(?:states|calls|operations|instructions|samples|evaluations|cycles|steps|iterations|solves|motions)"
OPERATIONS = r"(?:[a-z-]+\s+)?(?:operations|multiplications|additions|instructions|flops|FLOPs|cycles|ticks)\b"
FRACTION = (
    r"(?:(?<![\w./])\d/\d+|\b(?i:twice|thrice|double|triple|half|"
    r"(?:an?|two|one|three)[\s-](?:third|quarter|fifth|sixth|eighth|tenth|hundredth|thousandth)s?))"
)
COMPARED = (
    r"(?:as\s+(?:fast|long|slow|much|many|accurate|large)|(?:fewer|less|more|faster|slower|shorter|longer)|that|"
    r"(?:of\s+)?(?:(?:the|its|their|all)\s+)?(?:times?|cost|memory|operations|instructions|digits|speed|error|work))\b"
)

CLAIMS = tuple(
    re.compile(pattern)
    for pattern in (
        # Times, memory, throughput.
        rf"{AMOUNT}(?:\s*|-)(?:(?:of\s+)?an?\s+)?(?:{TIME}|{MEMORY}|{FREQUENCY})",
        rf"\b(?i:an?)\s+(?:(?:{SINGULAR})\b|{ONE_SECOND})",
        r"\b(?:in|within|takes?|took|for|than)\s+(?:(?:nano|micro|milli)seconds|minutes|hours)\b",
        r"\b(?:within|takes?|took)\s+seconds\b",
        r"\b(?i:sub)-?(?:nano|micro|milli)?seconds?\b",
        rf"{LIST}(?:\s+{COUNTED})?(?:\s*/\s*|\s+(?:per|an?|each|every)\s+)(?:[nuµm]?s|(?:milli|micro)?second|minute|hour)\b",
        # Factors and shares.
        rf"{LIST}[\s-]+times\b",
        rf"{AMOUNT}\s+times(?=\s+(?:as|the|more|less|fewer|faster|slower|longer|shorter)\b)",
        rf"{FRACTION}\s+{COMPARED}",
        rf"{LIST}x(?!\w|\s?\d)",  # no 28 x 28
        rf"{LIST}\s?\u00d7(?=[.,;:)|]|$|\s+(?:as|the|that|more|less|fewer|faster|slower|longer|shorter)\b)",
        rf"\b(?i:(?:{NUMERALS})|{DIGITS})[\s-]?fold\b",
        rf"\bfactors?\s+(?:of|between)\s+{LIST}",
        r"\borders?\s+of\s+magnitude\b",
        rf"{LIST}\s?(?:%|per\s?cent\b|ppm\b)",
        # Errors, digits, operations.
        r"(?<![\w.])\d+(?:\.\d+)?e[-\u2212]\d+",
        r"(?<![\w.])10\s?(?:\^\s?\{?[-\u2212]\d+|\u207b[\u2070\u00b9\u00b2\u00b3\u2074-\u2079]+)",
        rf"{LIST}(?:\s+significant)?\s+(?:digits|decimals|ulps?|ULPs?)\b",
        rf"{LIST}\s+{OPERATIONS}",
    )
)
# What the numbers of a table are, by its head or the first cell of a row; "s" and "h" behind a comma or in parentheses.
MEASURED = re.compile(
    rf"(?:[,(\[]\s*|\bin\s+)(?:s|h|min)\b|\b(?:[nuµμm]s|(?:{SINGULAR}|second)s?)\b|\b{MEMORY}|[kMG]Hz\b|FLOP|%|"
    r"\b(?i:times|faster|slower|speed|time|errors?|differences?|digits|operations|instructions|memory|share)\b"
)
BARE = re.compile(rf"[~<>≤≥]?\s*(?:{LIST}|-?\d\S*)")


@dataclass(frozen=True)
class Claim:
    """A figure on a line of a page; `context` is its paragraph or row, without marks, and has it at `start`."""

    line: int
    figure: str
    context: str
    start: int

    def is_within(self, phrase: str) -> bool:
        """Whether the figure is part of a phrase of its paragraph."""
        end = self.start + len(self.figure)
        found = re.finditer(re.escape(phrase), self.context)
        return any(place.start() <= self.start and end <= place.end() for place in found)


def claims(page: str) -> list[Claim]:
    """Return all claims of speed or accuracy that somebody typed into a page, in its order."""
    found = []
    for line, text, head in _parts(_typed(page)):
        for start, end in _spans(text, head):
            # Contexts have single spaces: a mark behind what precedes the figure says where the figure begins there.
            before = text[:start]
            place = len(" ".join(f"{before}|".split())) - 1
            figure, context = " ".join(text[start:end].split()), " ".join(text.split())
            found.append(Claim(line + before.count("\n"), figure, context, place))
    return found


def _typed(page: str) -> str:
    """Return the page with all else than typed text blanked, line by line."""
    text = MADE.sub(_blank, page)
    text = FENCE.sub(_comments, text)
    for pattern in (QUOTED, ADDRESS, MARKS):
        text = pattern.sub(_blank, text)
    return text


def _blank(found: re.Match[str]) -> str:
    """Return as many spaces, in as many lines."""
    return re.sub(r"[^\n]", " ", found[0])


def _comments(found: re.Match[str]) -> str:
    """Return a block of code with its comments alone."""
    code, kept = found[0], list(_blank(found))
    for comment in COMMENT.finditer(code):
        kept[comment.start() + 1 : comment.end()] = comment[0][1:]
    return "".join(kept)


def _parts(text: str) -> Iterator[tuple[int, str, str]]:
    """Iterate over paragraphs and rows of tables: the first line, the text, and of rows the head of the table."""
    head, paragraph = "", []
    for number, line in enumerate([*text.split("\n"), ""], 1):
        is_row = line.lstrip().startswith("|")
        if paragraph and (is_row or not line.strip()):
            yield number - len(paragraph), "\n".join(paragraph), ""
            paragraph = []
        # A table begins with its head; any other line ends it.
        head = (head or line) if is_row else ""
        if is_row:
            yield number, line, head
        elif line.strip():
            paragraph.append(line)


def _spans(text: str, head: str) -> list[tuple[int, int]]:
    """Return where the claims of a text stand; those that overlap are one."""
    spans = sorted(place.span() for pattern in CLAIMS for place in pattern.finditer(text))
    spans = sorted([*spans, *_bare_cells(text, head)])
    merged: list[tuple[int, int]] = []
    for start, end in spans:
        if merged and start < merged[-1][1]:
            merged[-1] = merged[-1][0], max(end, merged[-1][1])
        else:
            merged.append((start, end))
    return merged


def _bare_cells(row: str, head: str) -> Iterator[tuple[int, int]]:
    """Iterate over the cells of a row that are numbers alone, of what the head or the first cell says is measured."""
    cells = list(re.finditer(r"[^|]+", row))
    first = next((cell[0] for cell in cells if cell[0].strip()), "")
    if not (MEASURED.search(head) or MEASURED.search(first)):
        return
    for cell in cells:
        if BARE.fullmatch(cell[0].strip()):
            start = cell.start() + len(cell[0]) - len(cell[0].lstrip())
            yield start, start + len(cell[0].strip())
