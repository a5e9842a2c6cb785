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
    (
        "limits/limited_motion.py",
        "return any(curve.deviations(motion.times[:1], 0) is not None for curve in curves)",
        "return any(curve.deviations(motion.times[:(2)], 0) is not None for curve in curves)",
    ): "whether a curve is measured is the same at all times",
    (
        "limits/limited_motion.py",
        "parts = b.rates(t, 1)[1] * spread[0], Q[0] * off, spread[0] * off # the last where both are off",
        "parts = b.rates(t, (2))[1] * spread[0], Q[0] * off, spread[0] * off # the last where both are off",
    ): "the first rate is the same when the second one is computed too, which is known where Q is",
    (
        "limits/worst_values.py",
        "_UNCERTAIN_TIMES_AT_ONCE = 20_000 # times judged together, which bounds working memory",
        "_UNCERTAIN_TIMES_AT_ONCE = (40000) # times judged together, which bounds working memory",
    ): "parts of any length share their ends, so that spans across them are the same once they are joined",
    (
        "limits/worst_values.py",
        "_VALUES_AT_ONCE = 2000 # times evaluated together",
        "_VALUES_AT_ONCE = (4000) # times evaluated together",
    ): "the value at a time does not depend on the times that are evaluated with it",
    (
        "limits/worst_values.py",
        "for kind in pieces.kinds if pieces.width.all() else ():",
        "for kind in pieces.kinds if pieces.width.any() else ():",
    ): "pieces are between times that differ, and all last; the only piece of a motion of one state does not",
}
