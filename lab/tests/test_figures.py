"""Figures: comparisons, naming of faults, trajectories, noise of an IMU, masks."""

import json
import subprocess
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import tomlkit
from evo.core.trajectory import PoseTrajectory3D
from PIL import Image
from scipy.spatial.transform import Rotation

from plumbline_lab import LabError, cli, compare, knock, recordings, shuttle, summaries, trajectories
from plumbline_lab.plot import Flight


def test_a_small_gain_is_distinguished_from_large_differences_between_flights():
    random = np.random.default_rng(1)
    base = 1 + 2 * random.random(12)
    result = compare.paired(base, base * (0.9 + 0.03 * random.standard_normal(12)))
    assert result.is_significant and 0.87 < result.ratio < 0.93
    assert result.ratio_95[0] < result.ratio < result.ratio_95[1]
    assert compare.paired([1], [2]) is None


def test_the_interval_of_eight_flights_holds_the_truth_in_95_of_100():
    random, held = np.random.default_rng(5), 0
    for _ in range(200):
        base = 1 + 2 * random.random(8)
        result = compare.paired(base, base * (1 + 0.03 * random.standard_normal(8)))
        held += result.difference_95[0] <= 0 <= result.difference_95[1]
    assert 0.91 <= held / 200 <= 0.985


def flown(variation, **figures):
    columns = {f"honesty.worst_sigmas.{name}": 1.0 for name in ("position", "velocity", "tilt")}
    labels = {"variation": variation, "path": "yaws", "scene": "room", "seed": 1, "resets": 0}
    return labels | columns | {"honesty.jumps": 0, "honesty.usable": 1.0} | figures


def test_a_bit_is_right_where_it_names_the_fault_within_a_second():
    since = "honesty.since_fault_s."
    table = pd.DataFrame([
        flown("fault=accel-dead:x@5", **{f"{since}accelerometer contradicted": 0.5, f"{since}gyroscope stuck": 2}),
        flown("fault=accel-dead:y@5&fault=stamp-jitter:1@5", **{"honesty.worst_sigmas.tilt": 5.1}),
        flown("", **{"honesty.first_s.stationary": 0.5}),
    ])  # fmt: skip
    assert list(summaries.honest(table)) == [True, False, True]
    text = summaries.honesty(table)
    assert "accelerometer contradicted 0.50" in text and "1 of 2 honest; 1 of 2 that a health bit can name" in text
    naming = " ".join(summaries.naming(table).split())
    assert "| gyroscope stuck | 1 | 0 | 0 % | accel-dead |" in naming
    assert "| accel-dead | 2 | 1 | 1 of 2 | 1 |" in naming and "| none | 1 | 1 | 0 of 0 | 0 |" in naming
    assert summaries.named_by("fault=imu-late:50@3") == ("IMU late",) and summaries.named_by("condition=night") == ()


def circle(seconds=20.0, step_s=0.05, frame=None, radius_m=3.0, noise_m=0.0):
    """A circle with turns about all axes, seen from another frame."""
    t = np.arange(0, seconds, step_s) + 100.0
    positions = radius_m * np.stack([np.cos(0.4 * t), np.sin(0.4 * t), 0.3 * np.sin(0.004 * t * t)], axis=1)
    positions += noise_m * np.random.default_rng(1).standard_normal(positions.shape)
    turns = Rotation.from_euler("ZYX", np.stack([0.4 * t, 0.3 * np.sin(t), 0.2 * np.cos(1.7 * t)], axis=1))
    rotation, translation = frame or (Rotation.identity(), np.zeros(3))
    quaternions = (rotation * turns).as_quat()
    return trajectories.poses(t, rotation.apply(positions) + translation, quaternions)


def write_tum(path: Path, trajectory: PoseTrajectory3D) -> Path:
    rows = np.column_stack([trajectory.timestamps, trajectory.positions_xyz, np.roll(trajectory.orientations_quat_wxyz, -1, axis=1)])
    np.savetxt(path, rows, fmt="%.9f")
    return path


@pytest.mark.parametrize("alignment", ["first", "se3", "sim3"])
def test_the_same_flight_in_another_frame_has_no_error(alignment):
    frame = (Rotation.from_rotvec([0, 0, 2.1]), np.array([5.0, -3.0, 2.0]))
    estimate = trajectories.Estimate("circle", circle())
    flight = Flight(estimate, circle(step_s=0.01, frame=frame), alignment, None)
    assert np.abs(flight.errors_m).max() < 1e-4 and np.abs(flight.attitude_deg).max() < 0.01 and flight.ate_m < 1e-4


def test_a_rotation_error_is_unknown_where_positions_move_too_little(tmp_path, capsys):
    estimate = write_tum(tmp_path / "a.tum", circle(radius_m=0.01, noise_m=0.01))
    truth = write_tum(tmp_path / "b.tum", circle(radius_m=0.01))
    judged = [Flight(trajectories.load(estimate), trajectories.load(truth).poses, way, None).attitude_deg for way in ("se3", "first")]
    assert judged[0] is None and judged[1] is not None
    assert cli.main(["plot", str(estimate), str(truth), "--truth", str(truth), "--align", "se3", "--out", str(tmp_path / "x.svg")]) == 0
    assert (tmp_path / "x.svg").read_text().startswith("<?xml") and "b: ATE 0.0000 m" in capsys.readouterr().out


def test_clocks_that_differ_are_found_and_flights_that_differ_are_refused(tmp_path):
    estimate, truth = circle(), circle(seconds=30, step_s=0.01)
    moved = PoseTrajectory3D(truth.positions_xyz, truth.orientations_quat_wxyz, truth.timestamps + 1234.5678)
    assert trajectories.time_offset(estimate, moved) == pytest.approx(1234.5678, abs=2e-3)
    random = np.random.default_rng(3)
    walk = np.cumsum(random.standard_normal((500, 3)), axis=0)
    other = trajectories.poses(np.arange(500) * 0.05, walk, Rotation.from_rotvec(0.1 * walk).as_quat())
    with pytest.raises(LabError, match="agree at no offset"):
        trajectories.time_offset(estimate, other)
    with pytest.raises(LabError, match="--time-offset auto"):
        trajectories.common(estimate, moved)
    (tmp_path / "no.tum").write_text("1 2 3\n")
    assert cli.main(["plot", str(tmp_path / "no.tum"), "--out", str(tmp_path / "x.png")]) == 1


def test_drift_is_that_of_the_scale():
    truth = circle()
    scaled = PoseTrajectory3D(1.01 * truth.positions_xyz, truth.orientations_quat_wxyz, truth.timestamps)
    percent, degrees = shuttle.drift(scaled, truth)
    assert 0.3 < percent < 1.0 and degrees < 1e-6


def imu_table(folder: Path, samples: np.ndarray, dt_s: float) -> Path:
    """Data set with these inertial samples."""
    (folder / "mav0" / "imu0").mkdir(parents=True)
    stamps = (np.arange(len(samples)) * dt_s * 1e9).astype(np.int64) + 1_400_000_000_000_000_000
    table = pd.DataFrame(samples)
    table.insert(0, "stamp", stamps)
    table.to_csv(folder / "mav0" / "imu0" / "data.csv", index=False)
    text = (folder / "mav0" / "imu0" / "data.csv").read_text()
    (folder / "mav0" / "imu0" / "data.csv").write_text("#" + text)
    return folder


def test_noise_of_a_simulated_imu_is_found_and_written(tmp_path, capsys):
    random, rate_hz, count = np.random.default_rng(2), 50, 180_000
    densities, walks = np.repeat([2e-4, 2e-3], 3), np.repeat([4e-5, 4e-4], 3)
    samples = densities * np.sqrt(rate_hz) * random.standard_normal((count, 6))
    samples += np.cumsum(walks / np.sqrt(rate_hz) * random.standard_normal((count, 6)), axis=0)
    samples[:, 5] += 9.81
    # Carried about before it was put down.
    samples[:1000, :3] += 0.5 * np.sin(0.06 * np.arange(1000))[:, None]
    folder = imu_table(tmp_path / "rest", samples, 1 / rate_hz)
    config = tmp_path / "own.toml"
    config.write_text("# mine\n[imu]\nrate_hz = 200.0 # Hz\ngyro_noise_density = 1.0\naccel_range_m_s2 = 78.0\n[rig]\nx = 1\n")
    out, picture = tmp_path / "new.toml", tmp_path / "allan.svg"
    assert cli.main(["allan", str(folder), "--config", str(config), "--out", str(out), "--inflate", "2", "--plot", str(picture)]) == 0
    found = tomlkit.parse(out.read_text())["imu"]
    assert found["rate_hz"] == 50 and found["accel_range_m_s2"] == 78 and "# mine" in out.read_text()
    assert found["gyro_noise_density"] == pytest.approx(4e-4, rel=0.01) and found["accel_noise_density"] == pytest.approx(4e-3, rel=0.01)
    assert found["gyro_bias_walk"] == pytest.approx(4e-5, rel=0.15) and found["accel_bias_walk"] == pytest.approx(4e-4, rel=0.15)
    assert "rest of 3579" in capsys.readouterr().out and picture.read_text().startswith("<?xml")
    moving = imu_table(tmp_path / "moving", samples[:1000], 1 / rate_hz)
    assert cli.main(["allan", str(moving)]) == 1 and "nowhere at rest" in capsys.readouterr().err
    short = imu_table(tmp_path / "short", samples[-1500:], 1 / rate_hz)
    assert cli.main(["allan", str(short)]) == 0 and "too short for the bias walk" in capsys.readouterr().out


def test_a_knocked_camera_sees_the_scene_turned_from_the_moment_on(tmp_path):
    camera = {"resolution": [41, 31], "intrinsics": [30.0, 30.0, 20.0, 15.0], "distortion_coefficients": [0.0] * 4}
    camera["T_BS"] = {"data": np.eye(4).ravel().tolist()}
    at = knock.looked_up(camera, Rotation.from_euler("z", 90, degrees=True))
    assert at[:, 15, 25] == pytest.approx([20, 20])
    folder = tmp_path / "mav0" / "cam0" / "data"
    folder.mkdir(parents=True)
    (folder.parent / "sensor.yaml").write_text(json.dumps(camera))
    image = Image.fromarray(np.random.default_rng(1).integers(0, 255, (31, 41), np.uint8))
    for stamp_ns in ("1000000000", "31000000000"):
        image.save(folder / f"{stamp_ns}.png")
    assert cli.main(["knock", str(tmp_path), "--out", str(tmp_path / "out")]) == 0
    written = tmp_path / "out" / "mav0" / "cam0" / "data"
    before, after = (np.asarray(Image.open(written / f"{stamp_ns}.png")) for stamp_ns in ("1000000000", "31000000000"))
    assert (before == np.asarray(image)).all() and (after != np.asarray(image)).mean() > 0.5
    assert cli.main(["knock", str(tmp_path), "--out", str(tmp_path / "out")]) == 1
    (folder / "31000000000.png").unlink()
    assert cli.main(["knock", str(tmp_path), "--out", str(tmp_path / "short")]) == 1
    assert not (tmp_path / "short").exists()


def test_what_stands_still_before_a_moving_scene_is_masked(tmp_path, capsys):
    random = np.random.default_rng(4)
    world = np.kron(random.integers(0, 255, (60, 80)), np.ones((8, 8)))
    folder = tmp_path / "mav0" / "cam0"
    (folder / "data").mkdir(parents=True)
    lines = ["#timestamp [ns],filename"]
    for k in range(40):
        image = np.roll(world, (13 * k, 29 * k), axis=(0, 1))[:120, :160].copy()
        # A striped leg.
        image[80:, 64:96] = np.where(np.arange(32) % 8 < 4, 30, 220)
        Image.fromarray(image.astype(np.uint8)).save(folder / "data" / f"{k}.png")
        lines.append(f"{1_000_000_000 + k * 250_000_000},{k}.png")
    (folder / "data.csv").write_text("\n".join(lines))
    assert cli.main(["mask", str(tmp_path), "--out", str(tmp_path / "masks"), "--margin-px", "0"]) == 0
    seen = np.asarray(Image.open(tmp_path / "masks" / "left-mask.png")) > 0
    assert (~seen[80:, 64:96]).mean() > 0.9 and seen[:64].mean() > 0.98 and seen.mean() > 0.85
    assert cli.main(["mask", str(tmp_path), "--out", str(tmp_path / "masks")]) == 1
    assert "exists; name another folder" in capsys.readouterr().err


def test_a_flight_log_holds_the_samples_and_images_of_its_flight(plumbline, tmp_path):
    folder, log = tmp_path / "flight", tmp_path / "log.mcap"
    quiet = {"check": True, "stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    subprocess.run([plumbline, "simulate", folder, "--duration", "1.2", "--scale", "0.3"], **quiet)
    subprocess.run([plumbline, "replay", "sim:room?duration=1.2&scale=0.3", "--record", log], **quiet)
    written, kept = recordings.imu(folder), recordings.imu(log)
    assert len(kept) > 150 and written.equals(kept)
    for camera in range(2):
        of_set, of_log = (list(recordings.images(path, camera)) for path in (folder, log))
        assert [stamp for stamp, _ in of_set] == [stamp for stamp, _ in of_log] and len(of_log) == 24
        assert all((recordings.levels(a) == recordings.levels(b)).all() for (_, a), (_, b) in zip(of_set, of_log))


def test_a_shuttle_tells_the_drift_of_a_simulated_flight(plumbline, capsys):
    assert cli.main(["shuttle", "sim:room?start=5&duration=6&scale=0.3", "--program", plumbline, "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["resets"] == [0, 0] and told["poses"] > 100 and 0.2 < told["found_over_true"] < 5


def test_a_flight_log_in_place_of_a_table_is_told_how_to_become_one(tmp_path):
    (tmp_path / "log.mcap").write_bytes(b"\x89MCAP0\r\n")
    with pytest.raises(LabError, match="replay LOG --states"):
        trajectories.load(tmp_path / "log.mcap")
