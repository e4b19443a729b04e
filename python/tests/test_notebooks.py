"""The notebooks of python/notebooks run, and are stored without outputs (python/check runs this)."""

import json
import pathlib

import nbformat
import pytest
from nbclient import NotebookClient

FOLDER = pathlib.Path(__file__).parent.parent / "notebooks"
NOTEBOOKS = sorted(FOLDER.glob("*.ipynb"))


def test_they_are_all_there():
    assert [n.stem for n in NOTEBOOKS] == ["material", "night", "pass", "planning", "renderer", "spin", "study"]


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda p: p.stem)
def test_a_notebook_runs(path, tmp_path):
    """Truth: what the notebook itself asserts in its last cells, beside a formula or the night's own light. Outputs have at least one picture."""
    if path.stem == "renderer":
        pytest.importorskip("mitsuba", reason="mitsuba is not installed: the notebook beside it is not run")
    text = path.read_text()
    stored = json.loads(text)
    assert all(not c.get("outputs") and c.get("execution_count") is None for c in stored["cells"])
    notebook = nbformat.reads(text, as_version=4)
    nbformat.validate(notebook)
    NotebookClient(notebook, timeout=300, kernel_name="python3", resources={"metadata": {"path": str(tmp_path)}}).execute()
    outputs = [o for c in notebook.cells for o in c.get("outputs", [])]
    assert not any(o.output_type == "error" for o in outputs)
    forms = {form for o in outputs for form in o.get("data", {})}
    assert "image/png" in forms or any("<svg" in str(o.get("data", {}).get("text/html", "")) for o in outputs)
