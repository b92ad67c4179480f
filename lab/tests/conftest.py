"""The program under test, and a stand-in for it that is quick."""

import os
import sys
from types import SimpleNamespace

import pytest

# Stands in for `plumbline`: a report whose figures depend on the arguments alone, and a failure where `bad` is among them.
STAND_IN = """#!{python}
import hashlib, json, sys
if sys.argv[1] == "--version":
    print("plumbline 0.0.0")
    sys.exit()
with open({log!r}, "a") as log:
    log.write(sys.argv[2] + "\\n")
if "bad" in sys.argv[2]:
    print("plumbline: sim:bad: no such scene", file=sys.stderr)
    sys.exit(2)
digest = hashlib.sha256(" ".join(sys.argv[2:-3]).encode()).hexdigest()
ate_m = int(digest[:4], 16) * 1e-6
times = dict.fromkeys(("p50", "p95", "p99", "max"), ate_m)
report = {{"frame_cpu_ms": times, "frame_ms": times, "stage_ms": {{"window": times}}}}
report |= {{"estimate_digest": digest, "completion": 1.0, "resets": 0, "accuracy": {{"ate_rmse_m": ate_m, "ate_percent": ate_m}}}}
open(sys.argv[-1], "w").write(json.dumps(report))
"""


@pytest.fixture
def stand_in(tmp_path):
    """Path of the stand-in, and the file in which it lists the sources that it flew."""
    program, log = tmp_path / "stand-in", tmp_path / "flown"
    program.write_text(STAND_IN.format(python=sys.executable, log=str(log)))
    program.chmod(0o755)
    log.touch()
    return SimpleNamespace(program=str(program), flown=lambda: log.read_text().splitlines())


@pytest.fixture
def plumbline():
    """The program under test."""
    program = os.environ.get("PLUMBLINE")
    if not program:
        pytest.skip("$PLUMBLINE names no program")
    return program


@pytest.fixture
def how():
    """Arguments of a run on this machine."""
    none = {"scheduler": None, "slurm": None, "kubernetes": None}
    return lambda program, jobs=2, **more: SimpleNamespace(**none | {"jobs": jobs, "program": program, "quiet": True} | more)
