"""Type stubs, docstrings, and what is public."""

import importlib.util
import inspect
import os
import subprocess
import sys
from pathlib import Path

import pytest
from conftest import skip

import plumbline
from plumbline import _processor

PROGRAM = """
from pathlib import Path
import numpy as np
import plumbline

config = plumbline.Config.preset("sim").replace(estimator__points__max_points=100)
estimator = plumbline.Estimator(config)
estimator.add_imu(0, (0.0, 0.0, 0.0), np.zeros(3))
estimate = estimator.add_frame(0, np.zeros((480, 752), np.uint8), None)
norm: float = float(np.linalg.norm(estimate.position))
flight = plumbline.replay(Path("V1_01_easy"), config, odometry=True, estimator__points__max_points=100)
error: float = plumbline.evaluate(flight, "truth.tum", time_offset=0.5).ate_m.rmse
for record in plumbline.connect("/run/plumbline/local"):
    if isinstance(record, plumbline.Odometry):
        print(record.velocity @ record.velocity, record.stamp_ns + 1)
log = plumbline.read_log("flight.mcap")
print(log.odometry.position.mean(axis=0), [event.text for event in log.events], plumbline.Health(estimate.health))
"""


def checked(*arguments, folder):
    """Runs a module of mypy on the installed package."""
    if importlib.util.find_spec("mypy") is None or sys.version_info < (3, 10):
        skip("the check of types", "mypy is not installed, or this Python is older than it knows")
    package = Path(plumbline.__file__).parents[1]
    environment = {**os.environ, "PYTHONPATH": str(package)}
    # One that is installed is found by its py.typed, and must not be named.
    if package.name != "site-packages":
        environment["MYPYPATH"] = str(package)
    return subprocess.run([sys.executable, *arguments], cwd=folder, env=environment, capture_output=True, text=True)


def test_the_stubs_are_those_of_the_module(tmp_path):
    done = checked("-m", "mypy.stubtest", "plumbline._native", folder=tmp_path)
    assert done.returncode == 0, done.stdout + done.stderr


def test_a_program_is_checked_strictly(tmp_path):
    (tmp_path / "right.py").write_text(PROGRAM)
    (tmp_path / "wrong.py").write_text(PROGRAM.replace("add_imu(0,", 'add_imu("now",'))
    done = checked("-m", "mypy", "--strict", "right.py", "wrong.py", folder=tmp_path)
    complaints = [line for line in done.stdout.splitlines() if ": error: " in line]
    assert len(complaints) == 1 and complaints[0].startswith("wrong.py:8: "), done.stdout + done.stderr


def test_everything_public_is_documented():
    for name in plumbline.__all__:
        item = getattr(plumbline, name)
        if inspect.isclass(item) or callable(item):
            assert item.__doc__, name
        if not inspect.isclass(item):
            continue
        for member, value in vars(item).items():
            if not member.startswith("_") and (callable(value) or isinstance(value, property) or inspect.isgetsetdescriptor(value)):
                assert value.__doc__, f"{name}.{member}"


def test_units_are_in_the_docstrings():
    for name in ("position", "velocity", "gyro_bias", "accel_bias", "covariance", "bias_variances"):
        words = getattr(plumbline.Estimate, name).__doc__
        assert "shape (" in words and any(unit in words for unit in ("m,", "m/s", "rad/s", "rad^2/s^2")), name


def test_a_processor_that_lacks_instructions_is_an_import_error(tmp_path):
    cpuinfo = tmp_path / "cpuinfo"
    cpuinfo.write_text("processor\t: 0\nflags\t\t: fpu sse sse2 avx f16c\n")
    with pytest.raises(ImportError, match="avx2, bmi1"):
        _processor.check("x86_64", str(cpuinfo))
    cpuinfo.write_text("flags : " + " ".join(_processor.NEEDED))
    _processor.check("x86_64", str(cpuinfo))
    _processor.check("aarch64", str(tmp_path / "missing"))


def test_the_version_is_that_of_the_command(command):
    assert command("--version").stdout.split()[1] == plumbline.__version__


def test_messages_that_protoc_makes_of_the_schemas_lie_beside_the_package(tmp_path):
    made = tmp_path / "plumbline" / "v1" / "log_pb2.py"
    made.parent.mkdir(parents=True)
    made.write_text("STATE = 'tracking'\n")
    program = "import plumbline; from plumbline.v1 import log_pb2; print(plumbline.__version__, log_pb2.STATE)"
    ran = subprocess.run([sys.executable, "-c", program], env={**os.environ, "PYTHONPATH": os.pathsep.join([str(tmp_path), os.environ.get("PYTHONPATH", "")])}, capture_output=True, text=True)
    assert ran.stdout.split() == [plumbline.__version__, "tracking"], ran.stderr
