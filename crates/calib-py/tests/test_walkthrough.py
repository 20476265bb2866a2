"""The notebook runs completely."""

from pathlib import Path

import pytest


@pytest.mark.filterwarnings("ignore")
def test_the_notebook_runs() -> None:
    nbclient, nbformat = pytest.importorskip("nbclient"), pytest.importorskip("nbformat")
    pytest.importorskip("ipykernel")
    notebook = nbformat.read(Path(__file__).parents[1] / "examples/walkthrough.ipynb", as_version=4)
    nbclient.NotebookClient(notebook, timeout=120).execute()
    images = [output for cell in notebook.cells if cell.cell_type == "code" for output in cell.outputs if "image/png" in output.get("data", {})]
    assert len(images) == 2
