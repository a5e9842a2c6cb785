"""Notebooks as pages: the outputs that they keep stand in the page.

``python docs/hooks/notebooks.py`` (`make notebooks`) runs each from a clean kernel and keeps its outputs, so that they
are read in the repository too; a test runs them again and compares what they print.
"""

import re
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

DOCS = Path(__file__).parents[1]
FOLDER = DOCS / "notebooks"
LONGEST = 300  # seconds that a cell may take
FORMULA = re.compile(r"^\$\\displaystyle (.*)\$$", re.MULTILINE)  # as SymPy displays its expressions


def on_files(files: Any, config: Any, **_: Any) -> Any:
    """The files of the site with a page of each notebook and its pictures; the notebooks themselves are there too."""
    from mkdocs.structure.files import File

    for path in sorted(FOLDER.glob("*.ipynb")):
        page, pictures = page_of(path)
        files.append(File.generated(config, f"notebooks/{path.stem}.md", content=page))
        for name, content in pictures.items():
            files.append(File.generated(config, f"notebooks/{name}", content=content))
    return files


def page_of(path: Path) -> tuple[str, dict[str, bytes]]:
    """A notebook with its outputs as Markdown, and the pictures that it refers to, by name."""
    import nbformat
    from nbconvert import MarkdownExporter

    exporter, folder = MarkdownExporter(), f"{path.stem}_files"
    notebook = nbformat.read(path, as_version=4)
    page, resources = exporter.from_notebook_node(notebook, {"output_files_dir": folder, "unique_key": path.stem})
    title, _, rest = FORMULA.sub(r"$$\1$$", page.lstrip()).partition("\n")
    link = f"[Download this notebook]({path.name}){{ .md-button download='' }}"
    return f"{title}\n\n{link}\n{rest}", resources["outputs"]


def run(path: Path) -> Any:
    """A notebook with the outputs of its cells, run in an empty folder by a kernel of its own.

    Raises
    ------
    nbclient.exceptions.CellExecutionError : where a cell fails, with its traceback.
    ValueError : where a cell warns, with what it says.
    """
    import nbformat
    from nbclient import NotebookClient

    notebook = nbformat.read(path, as_version=4)
    with TemporaryDirectory() as folder:
        NotebookClient(notebook, timeout=LONGEST, resources={"metadata": {"path": folder}}).execute()
    for output in (output for cell in notebook.cells for output in cell.get("outputs", ())):
        if output.output_type == "stream" and output.name == "stderr":
            raise ValueError(f"{path.name}: {output.text}")
    return notebook


def keep_outputs(path: Path) -> None:
    """Run a notebook, and keep its outputs without the times of the run."""
    import nbformat

    notebook = run(path)
    for cell in notebook.cells:
        cell.metadata.pop("execution", None)
    nbformat.write(notebook, path)


def printed(notebook: Any) -> list[str]:
    """What each output of a notebook prints: its text, not its pictures."""
    outputs = [output for cell in notebook.cells for output in cell.get("outputs", ())]
    return [output.get("text", "") or output.get("data", {}).get("text/plain", "") for output in outputs]


if __name__ == "__main__":
    for source in sorted(FOLDER.glob("*.ipynb")):
        keep_outputs(source)
