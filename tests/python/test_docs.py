"""The examples of the documentation, run as they stand, and the notebook."""

import re

import pytest
from conftest import REPOSITORY, skip

PAGES = ["docs/python.md", "runtime/python/README.md"]


def blocks(page):
    text = (REPOSITORY / page).read_text(encoding="utf-8")
    return re.findall(r"^```python\n(.*?)^```$", text, flags=re.M | re.S)


@pytest.mark.parametrize("page", PAGES)
def test_examples_run_as_they_stand(page, clip, tmp_path, monkeypatch):
    (tmp_path / "V1_01_easy").symlink_to(clip)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MPLBACKEND", "agg")
    found = blocks(page)
    assert found
    for block in found:
        if "matplotlib" in block and not has("matplotlib"):
            skip("an example that plots", "matplotlib is not installed")
        # A page is read from its beginning: later examples go on with the names of earlier ones.
        exec(compile(block, page, "exec"), globals().setdefault("_" + page, {"__name__": page}))


def has(module):
    import importlib.util

    return importlib.util.find_spec(module) is not None


def test_the_notebook_runs_and_plots(tmp_path, monkeypatch):
    if not (has("nbclient") and has("ipykernel") and has("matplotlib")):
        skip("the notebook", "nbclient, ipykernel or matplotlib is not installed")
    import nbclient
    import nbformat

    notebook = nbformat.read(REPOSITORY / "examples/trajectory.ipynb", as_version=4)
    lines = sum(len(cell.source.splitlines()) for cell in notebook.cells if cell.cell_type == "code")
    assert lines <= 10
    monkeypatch.setenv("IPYTHONDIR", str(tmp_path / "ipython"))
    nbclient.NotebookClient(notebook, timeout=300, resources={"metadata": {"path": str(tmp_path)}}).execute()
    outputs = [output for cell in notebook.cells if cell.cell_type == "code" for output in cell.outputs]
    assert any("image/png" in output.get("data", {}) for output in outputs)
