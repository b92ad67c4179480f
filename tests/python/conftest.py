"""What the tests of the package share: the command, data, and a short flight."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import plumbline

REPOSITORY = Path(__file__).resolve().parents[2]
SHARED = Path(os.environ.get("PLUMBLINE_SHARED", REPOSITORY.parent / "shared"))
#: A short simulated flight: 40 frames.
ROOM = {"start": 2.0, "duration": 2.0, "scale": 0.5}


def skip(what, why):
    """Skips a test in the words of the whole suite, where that is allowed."""
    with open(os.environ.get("PLUMBLINE_SKIPPED", os.devnull), "a", encoding="utf-8") as file:
        file.write(f"skipped: {what}, because {why}\n")
    if os.environ.get("CI"):
        pytest.fail(f"skipped: {what}, because {why}")
    pytest.skip(f"{what}, because {why}")


@pytest.fixture(scope="session")
def command():
    """Runs the command `plumbline`: the one of the wheel, or that of PLUMBLINE_COMMAND."""
    program = os.environ.get("PLUMBLINE_COMMAND") or shutil.which("plumbline", path=str(Path(sys.executable).parent))
    assert program, "no command plumbline beside this Python; name one in PLUMBLINE_COMMAND"

    def run(*arguments, status=0):
        done = subprocess.run([program, *map(str, arguments)], capture_output=True, text=True, timeout=300)
        assert done.returncode == status, done.stderr
        return done

    run.program = program
    return run


@pytest.fixture(scope="session")
def clip():
    """A recorded flight."""
    path = SHARED / "euroc/V1_01_easy_clip"
    if not path.is_dir():
        skip("a recorded flight", f"{path} is not there")
    return path


@pytest.fixture(scope="session")
def room():
    """A replayed flight in the simulated room, with its odometry."""
    return plumbline.replay("sim:room", odometry=True, **ROOM)


@pytest.fixture(scope="session")
def inputs():
    """The samples of that flight, kept."""
    recording = plumbline.open_recording("sim:room", **ROOM)
    return recording.config, list(recording), recording.imu_until()


def fly(recording, estimator):
    """The loop of the documentation; the estimates."""
    estimates = []
    for frame in recording:
        imu = recording.imu_until(estimator.imu_needed_until(frame.stamp_ns))
        estimator.add_imu_array(imu.stamp_ns, imu.gyro, imu.accel)
        estimates.append(estimator.add_frame(frame.stamp_ns, frame.left, frame.right, sequence=frame.sequence))
    return estimates


@pytest.fixture
def started(inputs):
    """An estimator that has been given five frames and the samples for them, and what comes next."""
    config, frames, imu = inputs
    estimator = plumbline.Estimator(config)
    until = frames[5].stamp_ns
    rows = imu.stamp_ns <= until
    estimator.add_imu_array(imu.stamp_ns[rows], imu.gyro[rows], imu.accel[rows])
    for frame in frames[:5]:
        estimator.add_frame(frame.stamp_ns, frame.left, frame.right)
    return estimator, frames[5], int(imu.stamp_ns[rows][-1])


def is_close(a, b):
    return np.allclose(a, b, rtol=0, atol=1e-12)
