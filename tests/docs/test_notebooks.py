"""Notebooks: they are kept without outputs, run from a clean kernel, and become pages."""

from pathlib import Path

import nbformat
import notebooks
import pytest

NOTEBOOKS = sorted(notebooks.FOLDER.glob("*.ipynb"))


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_notebooks_are_kept_without_outputs(path: Path) -> None:
    for cell in nbformat.read(path, as_version=4).cells:
        assert not cell.get("outputs")
        assert cell.get("execution_count") is None


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_notebooks_run_from_a_clean_kernel_without_a_warning(path: Path) -> None:
    for cell in notebooks.run(path).cells:
        said = [
            output.text
            for output in cell.get("outputs", ())
            if output.output_type == "stream" and output.name == "stderr"
        ]
        assert not said


def test_a_formula_of_an_output_becomes_one_of_the_page(tmp_path: Path) -> None:
    book = nbformat.v4.new_notebook(cells=[
        nbformat.v4.new_markdown_cell("# Title\nwords"),
        nbformat.v4.new_code_cell("import sympy\nsympy.Matrix([sympy.Symbol('x')])"),
    ])  # fmt: skip
    nbformat.write(book, tmp_path / "small.ipynb")
    page, pictures = notebooks.page_of(tmp_path / "small.ipynb")
    assert page.startswith("# Title\n\n[Download this notebook](small.ipynb)")
    assert r"$$\left[\begin{matrix}x\end{matrix}\right]$$" in page
    assert not pictures
