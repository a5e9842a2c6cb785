"""Tables that lie, and tables that change while they are read: right numbers, or one line, and never the end."""

from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context

import numpy as np
import pytest
from hypothesis import strategies as st

from fuzz import tables as lies
from fuzz.contract import PATIENCE, kept, workshop
from jounce.io import tables

RANDOM = st.randoms(note_method_calls=False, use_true_random=False)
EXAMPLES = {".npz": 1500, ".mat": 500, ".parquet": 300}
pytestmark = pytest.mark.filterwarnings("ignore::jounce.JounceWarning")


@pytest.fixture(scope="module")
def reader():
    """A process that reads; if a file ends it, its test fails, and the file is kept."""
    with ProcessPoolExecutor(1, get_context("spawn"), lies.prepare) as pool:
        yield lambda call, *given: pool.submit(call, *given).result(PATIENCE)


@pytest.mark.parametrize("suffix", EXAMPLES)
def test_lies(budget, reader, suffix):
    with workshop(f"lies{suffix[1:]}") as folder:

        def check(rng):
            path = folder / f"table{suffix}"
            path.write_bytes(lies.LYING[suffix](rng))
            with kept(f"lies{suffix[1:]}", path):
                reader(lies.check_lying, path)

        budget.attack(check, EXAMPLES[suffix], rng=RANDOM)


@pytest.mark.parametrize("suffix", [".npz", ".csv", ".parquet"])
def test_changes(budget, reader, suffix):
    with workshop(f"changes{suffix[1:]}") as folder:

        def check(rng, share):
            path, other = folder / f"table{suffix}", folder / f"changed{suffix}"
            t = np.arange(rng.choice((1, 100, 20_000))) + 0.5
            tables.TABLE_WRITERS[suffix].write(path, np.array_split(t, 3) and [{"t": t, "a": -t}], None)
            content = path.read_bytes()
            cut = rng.randint(0, len(content))
            other.write_bytes(rng.choice((content[:cut], content + content[:cut], content + bytes(cut))))
            with kept(f"changes{suffix[1:]}", path, other):
                reader(lies.check_changing, path, other.read_bytes(), share)

        budget.attack(check, 100, rng=RANDOM, share=st.floats(0, 1))
