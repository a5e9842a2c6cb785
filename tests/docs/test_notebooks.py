"""Notebooks: they keep the outputs of their code, name what there is, and become pages of the site."""

import ast
import re
from pathlib import Path

import nbformat
import notebooks
import pytest

import jounce

NUMBER = re.compile(r"-?\d+(?:\.\d*)?(?:e[-+]\d+)?")
LARGEST = 600_000  # bytes: pictures of curves, no films
NOTEBOOKS = sorted(notebooks.FOLDER.glob("*.ipynb"))


@pytest.mark.outside
@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_kept_outputs_are_those_of_the_code(path: Path) -> None:
    kept, found = (notebooks.printed(book) for book in (nbformat.read(path, as_version=4), notebooks.run(path)))
    assert len(kept) == len(found) > 0
    for one, other in zip(kept, found, strict=True):
        # Numbers differ in their last digits from processor to processor.
        assert NUMBER.sub("0", one) == NUMBER.sub("0", other)


def test_notebooks_keep_no_times_of_a_run() -> None:
    for path in NOTEBOOKS:
        cells = nbformat.read(path, as_version=4).cells
        assert [cell for cell in cells if "execution" in cell.metadata] == []
        assert path.stat().st_size < LARGEST


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_names_that_notebooks_use_exist(path: Path) -> None:
    """The site runs them, which takes as long as to build it; here what they name is looked up."""
    named = 0
    for cell in nbformat.read(path, as_version=4).cells:
        for node in ast.walk(ast.parse(cell.source)) if cell.cell_type == "code" else ():
            if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id == "jounce":
                assert hasattr(jounce, node.attr), node.attr
                named += 1
    assert named


def test_a_notebook_that_warns_makes_no_page(tmp_path: Path) -> None:
    warn = nbformat.v4.new_code_cell("import warnings\nwarnings.warn('beware')")
    nbformat.write(nbformat.v4.new_notebook(cells=[warn]), tmp_path / "loud.ipynb")
    with pytest.raises(ValueError, match=r"^loud\.ipynb: .*beware"):
        notebooks.keep_outputs(tmp_path / "loud.ipynb")


def test_a_formula_of_an_output_becomes_one_of_the_page(tmp_path: Path) -> None:
    book = nbformat.v4.new_notebook(cells=[
        nbformat.v4.new_markdown_cell("# Title\nwords"),
        nbformat.v4.new_code_cell("import sympy\nsympy.Matrix([sympy.Symbol('x')])"),
    ])  # fmt: skip
    nbformat.write(book, tmp_path / "small.ipynb")
    notebooks.keep_outputs(tmp_path / "small.ipynb")
    page, pictures = notebooks.page_of(tmp_path / "small.ipynb")
    assert page.startswith("# Title\n\n[Download this notebook](small.ipynb)")
    assert r"$$\left[\begin{matrix}x\end{matrix}\right]$$" in page
    assert not pictures
