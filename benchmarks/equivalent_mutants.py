"""Mutants that no test can notice, and why: `benchmarks.mutants` writes the reasons on its page."""

EQUIVALENT: dict[tuple[str, str, str], str] = {}  # by module and its lines before and after, as one line each
