"""The local socket of a flight that goes on."""

import subprocess
import threading
import time

import numpy as np
import pytest

import plumbline


@pytest.fixture
def flight(command, tmp_path):
    """A simulated flight in real time with a local socket, and the path of that."""
    socket = tmp_path / "local"
    config = plumbline.Config.preset("sim").replace(local__path=str(socket))
    (tmp_path / "drone.toml").write_text(config.to_toml())
    arguments = ["replay", "sim:room", "--config", "drone.toml", "--speed", "1", "--scale", "0.5", "--start", "2"]
    process = subprocess.Popen(
        [command.program, *arguments, "--duration", "60"], cwd=tmp_path, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )
    yield socket
    process.terminate()
    process.wait()


def test_odometry_and_estimates_come_until_the_flight_ends(flight):
    with plumbline.connect(flight, patience_s=60) as connection:
        assert connection.may_command
        kinds = {plumbline.Odometry: [], plumbline.Estimate: []}
        for record in connection:
            kinds[type(record)].append(record)
            if len(kinds[plumbline.Odometry]) >= 100 and len(kinds[plumbline.Estimate]) >= 8:
                break
        odometry, estimates = kinds.values()
        stamps = [o.stamp_ns for o in odometry]
        assert stamps == sorted(set(stamps)) and all(o.has_pose and o.covariance.shape == (9, 9) for o in odometry)
        assert all(np.isclose(np.linalg.norm(e.orientation), 1) for e in estimates)
        before = estimates[-1].reset_counter
        connection.reset("hard", timeout_s=10)
        deadline = time.monotonic() + 60
        while time.monotonic() < deadline:
            record = connection.next(timeout_s=60)
            if isinstance(record, plumbline.Estimate) and record.reset_counter > before:
                break
        else:
            pytest.fail("no reset came")
        with pytest.raises(plumbline.ArgumentError, match="soft"):
            connection.reset("cold")
    with pytest.raises(plumbline.ConnectionLost, match="closed"):
        connection.next(timeout_s=0.1)


def test_a_choice_of_records_and_a_wait_that_ends(flight):
    with plumbline.connect(flight, patience_s=60, odometry=False) as connection:
        records = [connection.next(timeout_s=60) for _ in range(3)]
        assert all(isinstance(record, plumbline.Estimate) for record in records)
    with plumbline.connect(flight, odometry=False, estimates=False) as connection:
        assert connection.next(timeout_s=0.05) is None
        refused = []

        def meddle():
            try:
                connection.close()
            except plumbline.BusyError as error:
                refused.append(error)

        thread = threading.Timer(0.2, meddle)
        thread.start()
        assert connection.next(timeout_s=1.0) is None
        thread.join()
        assert refused


def test_no_flight_is_said_with_the_path(tmp_path):
    with pytest.raises(plumbline.ConnectionLost, match="nowhere"):
        plumbline.connect(tmp_path / "nowhere")
    with pytest.raises(plumbline.ArgumentError, match="seconds"):
        plumbline.connect(tmp_path / "nowhere", patience_s=-1)
