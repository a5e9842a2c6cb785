"""Figures of speed and accuracy in pages for users are cells of tables that scripts made, or have a reason."""

import re
from pathlib import Path

import pytest

from jounce.native import cache, code_forms, memory_layout
from support.claims import claims

ROOT = Path(__file__).parents[2]
PATIENCE = f"longer than {memory_layout.MAX_COMPILE_SECONDS:g} s"
MIB = 2**20
LAYOUT = "a limit of the code, from whose constant this phrase is made: src/jounce/native/memory_layout.py"
SECOND = "a limit of the code, from whose constant this phrase is made: src/jounce/native/code_forms.py"
CACHE = "a setting, from whose default this phrase is made: src/jounce/native/cache.py"
EXCEPTIONS = {  # of pages, typed figures in phrases that stand there, without marks, and the reason
    "README.md": {
        "take a few minutes each": "how long pages take to read: docs/index.md",
        "paper's example: a minute": "set-up and demo in a new clone, on two cores: tests/demo",
        "the tests: ten minutes": "set-up and tests in a new clone, on two cores: tests/long_tests.txt",
        "an arm on springs over five seconds": "the length of a motion: docs/tutorials/elastic-panda.md",
    },
    "docs/comparison.md": {},
    "docs/howto/speed.md": {
        f"If it would be {PATIENCE}": LAYOUT,
        f"where that takes {PATIENCE}": LAYOUT,
        f"where it takes {PATIENCE} to compile": LAYOUT,
        f"beyond {code_forms.MAX_SECOND_STEPS:,} operations": SECOND,
        f"up to {memory_layout.MAX_STACK_BYTES // 2**10} KiB on the stack": LAYOUT,
        f"more than {memory_layout.MAX_SCRATCH_BYTES // MIB} MiB": LAYOUT,
        f"up to {cache.DEFAULT_CACHE_MIB} MiB": CACHE,
    },
}


@pytest.fixture(scope="module")
def claims_of_pages():
    """The claims of all pages."""
    return {page: claims((ROOT / page).read_text(encoding="utf-8")) for page in EXCEPTIONS}


@pytest.mark.parametrize("page", EXCEPTIONS)
def test_a_script_made_every_figure(page, claims_of_pages):
    typed = [
        claim for claim in claims_of_pages[page] if not any(claim.is_within(phrase) for phrase in EXCEPTIONS[page])
    ]
    assert [f"{page}:{claim.line}: {claim.figure}" for claim in typed] == []


@pytest.mark.parametrize("page", EXCEPTIONS)
def test_every_exception_occurs(page, claims_of_pages):
    unused = [
        phrase for phrase in EXCEPTIONS[page] if not any(claim.is_within(phrase) for claim in claims_of_pages[page])
    ]
    assert unused == []


@pytest.mark.parametrize("page", EXCEPTIONS)
def test_reasons_name_files_that_are_there(page):
    for phrase, reason in EXCEPTIONS[page].items():
        paths = re.findall(r"\b(?:src|tests|docs)/[\w./-]+\w", reason)
        assert paths, phrase
        assert [path for path in paths if not (ROOT / path).exists()] == []


@pytest.mark.parametrize(
    ("sentence", "figures"),
    [
        ("Q takes 52 ns per state.", ["52 ns"]),
        ("One state takes 2 us, and 0.4 µs by a bound kernel.", ["2 us", "0.4 µs"]),
        ("J takes 0.45, 0.46 and 0.55 us.", ["0.45, 0.46 and 0.55 us"]),
        ("compiled in 0.1ms", ["0.1ms"]),
        ("against 158 to 176 ms, then 24\u201347 ms", ["158 to 176 ms", "24\u201347 ms"]),
        ("after 22 s of compiling", ["22 s"]),
        ("a pause of\nthree\nseconds", ["three seconds"]),
        ("in half a microsecond for an arm", ["half a microsecond"]),
        ("some tenths of a second", ["some tenths of a second"]),
        ("in a fraction of a second", ["fraction of a second"]),
        ("It compiles in about a second too.", ["a second"]),
        ("Converting takes some ten microseconds, or a few ms.", ["some ten microseconds", "few ms"]),
        ("Hessians in microseconds", ["in microseconds"]),
        ("more than an hour per path", ["an hour"]),
        ("a five-minute run", ["five-minute"]),
        ("It is 1.8 times as fast.", ["1.8 times"]),
        ("5 to 35 times as fast, or fourteen times", ["5 to 35 times", "fourteen times"]),
        ("It is several times faster.", ["several times"]),
        ("1.42 times as many\noperations", ["1.42 times"]),
        ("a 2.5x gain, or 3\u00d7 faster", ["2.5x", "3\u00d7"]),
        ("tenfold, or 20-fold", ["tenfold", "20-fold"]),
        ("by a factor of 12", ["factor of 12"]),
        ("two orders of magnitude", ["orders of magnitude"]),
        ("It takes twice as long, in half the time of two thirds of the operations.",
         ["twice as long", "half the time", "two thirds of the operations"]),
        ("a third fewer", ["a third fewer"]),
        ("0.15 to 0.45 % shorter, 20% of the time", ["0.15 to 0.45 %", "20%"]),
        ("wrong by ten per cent", ["ten per cent"]),
        ("agrees to 1e-14, or 10^-12, or $10^{-9}$, or 10⁻⁷", ["1e-14", "10^-12", "10^{-9", "10⁻⁷"]),
        ("seven or eight digits fewer", ["seven or eight digits"]),
        ("Differences lose half of the digits.", ["half of the digits"]),
        ("within 2 ulp", ["2 ulp"]),
        ("sub-millisecond calls at double the speed, in 1/3 of the time",
         ["sub-millisecond", "double the speed", "1/3 of the time"]),
        ("2,213 operations at order 2", ["2,213 operations"]),
        ("twenty scalar multiplications", ["twenty scalar multiplications"]),
        ("a million operations", ["million operations"]),
        ("20,000 per second", ["20,000 per second"]),
        ("1e8 states/s, or 3 million states a second", ["1e8 states/s", "3 million states a second"]),
        ("Copying: 14.4 GB/s; 117 GFLOP/s", ["14.4 GB", "117 GFLOP/s"]),
        ("It takes 256 MiB, then 12 bytes.", ["256 MiB", "12 bytes"]),
        ("The loop runs at 20 kHz.", ["20 kHz"]),
        ("It takes **2.5** times the time, `0.4` us.", ["2.5 times", "0.4 us"]),
        ("[1.42 times](benchmarks/LITERATURE.md) as many", ["1.42 times"]),
        ("5&nbsp;ms", ["5 ms"]),
        ("| one state, µs | method |\n|---|---|\n| Q | 2.4 |", ["2.4"]),
        ("| | M |\n|---|---|\n| relative error | ~3 |", ["~3"]),
        ("| | Q |\n|---|---|\n| Pinocchio | **1.2** us |", ["1.2 us"]),
        ("```python\n>>> robot.audit()  # takes 2 ms\n```", ["2 ms"]),
    ],
)  # fmt: skip
def test_claims_are_found(sentence, figures):
    assert [claim.figure for claim in claims(sentence)] == figures


@pytest.mark.parametrize(
    "sentence",
    [
        "The hand pushes with 5 N along z, 0.5 m from the base, and 1 kg hangs from it.",
        "A Franka arm stops above 1,000 N m/s; joint 2 turns at 2.5 rad/s, or 9.81 m/s^2.",
        "an encoder of 17 bits, an inertia of 0.02 kg m^2, a stiffness of 10000 N m/rad",
        "Multibody System Dynamics 53(3), 257-273, 2021; read on 30 November 2026, in the 1980s",
        "Python 3.11 or later, MuJoCo 4.0, jax 0.4.30, AVX-512 and sm_90",
        "equations (25), (39) and (M21) of Section 3; all 58 equations",
        "`--step 0.02`, `SECONDS=600`, `order=2` and `JOUNCE_LANES=4`",
        "a batch of 1,000 states of seven joints on two cores, eight states per vector, up to order 12",
        "the second derivatives, a second robot, one second derivative, the first and the second",
        "a Hessian of 28 x 28, differentiated twice, half the length of the sole",
        "much faster, slower by far, to machine precision, within rounding",
        "[arXiv 2605.15845](https://arxiv.org/abs/2605.15845) and https://example.org/5-ms/2-times",
        "| joint | 2 |\n|---|---|\n| 3 | 4 |",
        "t (in s), forces in N, and one operation of many",
    ],
)
def test_what_claims_no_speed_is_left(sentence):
    assert claims(sentence) == []


def test_what_scripts_make_is_left():
    page = (
        "# Speed\n\n@results 7 joints, 2 ms in RIVALS\n\n```python\n>>> x = 2  # of both\n'5 ms'\n```\n\n"
        "<!-- made by python -m benchmarks.rivals: speed -->\n| us |\n|---|\n| 2.5 |\n<!-- end -->\n\nIt takes\n4 ms.\n"
    )
    assert [(claim.line, claim.figure) for claim in claims(page)] == [(17, "4 ms")]


@pytest.mark.parametrize("mark", ["<!-- made by hand -->", "<!-- made by python -m benchmarks.rivals: speed -->"])
def test_a_block_that_no_script_makes_or_that_does_not_end_is_read(mark):
    page = f"{mark}\n\nIt takes 4 ms.\n\n<!-- made by python -m benchmarks.x: y -->\n\n5 ms\n\n<!-- end -->\n"
    assert [claim.figure for claim in claims(page)] == ["4 ms"]


def test_a_phrase_excepts_its_own_figure_alone():
    first, second = claims("It waits for\n3 s. Kernels take 3 s.")
    assert (first.line, second.line) == (2, 2)
    assert first.is_within("waits for 3 s")
    assert not second.is_within("waits for 3 s")
