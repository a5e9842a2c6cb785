"""Mutants that no test can notice, and why: `benchmarks.mutants` writes the reasons on its page."""

EQUIVALENT: dict[tuple[str, str, str], str] = {  # by module and its lines before and after, as one line each
    (
        "limits/slowdown.py",
        "if states.largest <= states.factor or not beyond.size:",
        "if (states.largest < states.factor) or not beyond.size:",
    ): "where both factors are equal, the first one has been refined until nothing was beyond a limit at it",
    (
        "limits/slowdown.py",
        "if states.largest <= states.factor or not beyond.size:",
        "if ((states.largest <= states.factor) and (not beyond.size)):",
    ): "what is added then changes nothing: no state, or some that only lower a factor that is not returned",
}
