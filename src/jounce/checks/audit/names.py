"""Names that spreadsheets interpret as formulas."""

from jounce.checks.audit.finding import Finding
from jounce.model.mechanism import Mechanism

FORMULA_STARTS = ("=", "+", "-", "@", "\t", "\r")  # of cells that spreadsheets take for formulas


def check_formulas(mechanism: Mechanism) -> list[Finding]:
    """Names of joints and links that a spreadsheet computes: they are heads of columns, and cells of tables."""
    joints = tuple(name for name in mechanism.joints if name.startswith(FORMULA_STARTS))
    links = tuple(name for name in mechanism.frame_names if name.startswith(FORMULA_STARTS))
    return [
        Finding(
            severity="warning",
            kind="name",
            bodies=() if of == "joints" else names,
            joints=names if of == "joints" else (),
            number=float(len(names)),
            unit=of,
            text=f"the name begins with {names[0][0]!r}: spreadsheets that open a CSV table execute it as a formula",
            advice="rename it in the file, or import tables as text",
        )
        for of, names in (("joints", joints), ("links", links))
        if names
    ]
