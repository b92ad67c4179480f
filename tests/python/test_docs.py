"""The examples of the documentation, run as they stand, and the notebook."""

import importlib.util
import re

import numpy as np
import pytest
from conftest import REPOSITORY, SHARED, skip

import plumbline

PAGES = ["docs/python.md", "runtime/python/README.md"]


def blocks(page):
    text = (REPOSITORY / page).read_text(encoding="utf-8")
    return re.findall(r"^```python\n(.*?)^```$", text, flags=re.M | re.S)


@pytest.fixture
def dataset(clip, tmp_path):
    """The clip with the ground truth of its sequence, as the whole data set has it."""
    folder = tmp_path / "V1_01_easy" / "mav0"
    folder.mkdir(parents=True)
    for part in (clip / "mav0").iterdir():
        (folder / part.name).symlink_to(part)
    table = folder / "state_groundtruth_estimate0"
    table.mkdir()
    first = int((clip / "mav0/cam0/data.csv").read_text().splitlines()[1].split(",")[0])
    truth = plumbline.read_trajectory(SHARED / "euroc/trajectories/V1_01_easy.tum.gz")
    rows = np.abs(truth.stamp_ns - first) < 10**10
    with open(table / "data.csv", "w", encoding="ascii") as file:
        file.write("#timestamp" + "".join(f",{name}" for name in "p p p q q q q v v v w w w a a a".split()) + "\n")
        for stamp, position, (x, y, z, w) in zip(*(array[rows] for array in (truth.stamp_ns, truth.position, truth.orientation))):
            file.write(",".join(map(repr, [int(stamp), *map(float, [*position, w, x, y, z, *[0.0] * 9])])) + "\n")
    return tmp_path


@pytest.mark.parametrize("page", PAGES)
def test_examples_run_as_they_stand(page, dataset, monkeypatch):
    monkeypatch.chdir(dataset)
    monkeypatch.setenv("MPLBACKEND", "agg")
    names = {"__name__": page}
    found = blocks(page)
    assert found
    for block in found:
        if "matplotlib" in block and not has("matplotlib"):
            skip("an example that plots", "matplotlib is not installed")
        # A page is read from its beginning: later examples go on with the names of earlier ones.
        exec(compile(block, page, "exec"), names)


def has(module):
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
