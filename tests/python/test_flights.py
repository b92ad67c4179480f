"""Replays, flight logs, evaluations and configurations, against the command line."""

import json
import pickle

import numpy as np
import pytest
from conftest import ROOM

import plumbline


def flat(figures, prefix=""):
    """Numbers of nested figures by their paths."""
    numbers = {}
    for name, value in figures.items():
        if isinstance(value, dict):
            numbers.update(flat(value, f"{prefix}{name}."))
        elif isinstance(value, (int, float)):
            numbers[prefix + name] = value
    return numbers


def test_a_replay_is_arrays_and_figures(room):
    frames = len(room.estimates)
    assert frames == room.report["frames"] >= 40
    for name, shape in {
        "stamp_ns": (frames,),
        "position": (frames, 3),
        "orientation": (frames, 4),
        "covariance": (frames, 9, 9),
        "health": (frames,),
        "state": (frames,),
    }.items():
        assert getattr(room.estimates, name).shape == shape, name
    known = room.estimates.has_pose
    assert np.isnan(room.estimates.position[~known]).all() and np.isfinite(room.estimates.position[known]).all()
    assert (room.estimates.state[known] == "tracking").all()
    assert room.report["completion"] == pytest.approx(known.mean())
    assert len(room.odometry) > 4 * frames and room.odometry.covariance.shape[1:] == (9, 9)
    assert len(room.truth) == known.sum() and room.report["hot_path_allocations"] == 0
    assert room.estimates.figures["points_tracked"].max() > 20
    error = np.linalg.norm(plumbline.evaluate(room, room.truth).align(room.estimates.poses().position) - room.truth.position, axis=1)
    assert np.sqrt(np.mean(error**2)) == pytest.approx(room.report["ate_rmse_m"], rel=1e-6)


def test_keys_of_the_configuration_are_changed_by_name(command, tmp_path):
    flight = plumbline.replay("sim:room", estimator__points__max_points=80, **ROOM)
    arguments = ["--start", "2", "--duration", "2", "--scale", "0.5", "--set", "estimator.points.max_points=80"]
    command("replay", "sim:room", *arguments, "--report", tmp_path / "report.json")
    report = json.loads((tmp_path / "report.json").read_text())
    assert flight.digest == report["estimate_digest"]
    assert flight.report["config_hash"] == report["config_hash"] == flight.config.hash
    same = plumbline.replay("sim:room", plumbline.Config.preset("sim"), **{"estimator.points.max_points": 80}, **ROOM)
    assert same.digest == flight.digest


def test_a_log_holds_what_the_replay_returned(room, tmp_path, command):
    path = tmp_path / "flight.mcap"
    flight = plumbline.replay("sim:room", record=path, odometry=True, **ROOM)
    assert flight.digest == room.digest
    command("verify", path)
    log = plumbline.read_log(path)
    assert (log.ending, log.damage, log.dropped, log.inputs_changed) == ("flight", None, 0, False)
    assert log.config == flight.config and log.config.hash == flight.report["config_hash"]
    for name in ("stamp_ns", "position", "orientation", "velocity", "covariance", "health", "frame"):
        assert np.array_equal(*(np.nan_to_num(getattr(rows, name)) for rows in (log.estimates, flight.estimates))), name
    assert np.array_equal(log.odometry.position, flight.odometry.position)
    assert len(log.frame) == len(flight.estimates) and len(log.imu) >= len(log.odometry)
    assert plumbline.replay(path).digest == flight.digest
    # The recording again, sample by sample.
    frames = list(plumbline.open_recording(path))
    assert [frame.stamp_ns for frame in frames] == log.frame_stamp_ns.tolist()

    broken = tmp_path / "broken.mcap"
    broken.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    half = plumbline.read_log(broken)
    assert half.ending == "truncated" and 0 < len(half.imu) < len(log.imu)
    with pytest.warns(plumbline.DataWarning, match="the log breaks off"):
        plumbline.replay(broken)


def test_the_errors_are_those_of_the_command(room, command, tmp_path):
    estimate, truth = tmp_path / "estimate.tum", tmp_path / "truth.tum"
    room.estimates.poses().save_tum(str(estimate))
    room.truth.save_tum(str(truth))
    said = json.loads(command("evaluate", estimate, truth, "--json").stdout)
    result = plumbline.evaluate(estimate, truth)
    assert flat(result.figures) == pytest.approx(flat(said), rel=1e-9, abs=1e-12)
    assert result.ate_m.rmse == pytest.approx(room.report["ate_rmse_m"], rel=1e-4)
    direct = plumbline.evaluate(room, (room.truth.stamp_ns, room.truth.position, room.truth.orientation), align="yaw")
    assert direct.rotation.shape == (3, 3) and direct.rotation[2, 2] == pytest.approx(1.0)
    back = plumbline.read_trajectory(estimate)
    assert np.array_equal(back.stamp_ns, room.estimates.poses().stamp_ns)
    shifted = (room.truth.stamp_ns + 10**10, room.truth.position, room.truth.orientation)
    with pytest.raises(plumbline.DataError, match="no stamps within"):
        plumbline.evaluate(room, shifted)
    with pytest.raises(plumbline.ArgumentError, match="length 1"):
        plumbline.evaluate(room, (room.truth.stamp_ns, room.truth.position, 2 * room.truth.orientation))
    with pytest.raises(plumbline.ArgumentError, match="align"):
        plumbline.evaluate(room, room.truth, align="best")
    with pytest.raises(plumbline.ArgumentTypeError, match="expected a path"):
        plumbline.evaluate(room, 7)


WRONG_TOML = {
    "unknown key": ("max_points = ", "max_point = "),
    "wrong value": ("max_points = ", "max_points = -"),
    "no TOML": ("[estimator.points]", "[estimator.points"),
}


@pytest.mark.parametrize("case", WRONG_TOML)
def test_a_configuration_is_refused_in_the_words_of_the_command(case, command, tmp_path):
    text = plumbline.Config.preset("sim").to_toml().replace(*WRONG_TOML[case], 1)
    path = tmp_path / "wrong.toml"
    path.write_text(text)
    said = command("config", path, status=2).stderr
    with pytest.raises(plumbline.ConfigError) as raised:
        plumbline.Config.load(path)
    words = "; ".join(line.strip() for line in str(raised.value).splitlines())
    assert said.strip() == f"plumbline: {words}"
    if case != "no TOML":
        violation = raised.value.violations[0]
        assert violation.key and violation.reason and violation.cure
    with pytest.raises(plumbline.ConfigError):
        plumbline.Config.from_toml(text)


def test_configurations_are_values(clip):
    sim = plumbline.Config.preset("sim")
    assert sim == plumbline.Config.from_toml(sim.to_toml()) and hash(sim) == hash(plumbline.Config.preset("sim"))
    assert pickle.loads(pickle.dumps(sim)) == sim
    other = sim.replace(estimator__points__max_points=99)
    assert other != sim and other.hash != sim.hash and "max_points = 99" in other.to_toml()
    assert "sim" in plumbline.Config.presets() and sim.image_sizes == [(752, 480), (752, 480)]
    assert plumbline.Config.from_euroc(clip).image_sizes == [(752, 480)] * 2
    with pytest.raises(plumbline.ConfigError, match="did you mean"):
        sim.replace(max_points=99)
    with pytest.raises(plumbline.ArgumentTypeError, match="max_points"):
        sim.replace(estimator__points__max_points=object())
    with pytest.raises(plumbline.ConfigError, match="nowhere.toml"):
        plumbline.Config.load("nowhere.toml")


def test_what_cannot_be_opened_is_a_data_error_in_the_words_of_the_command(command, tmp_path):
    said = command("replay", tmp_path / "nothing", status=2).stderr
    with pytest.raises(plumbline.DataError) as raised:
        plumbline.replay(tmp_path / "nothing")
    assert said.strip() == f"plumbline: {raised.value}"
    (tmp_path / "no.mcap").write_bytes(b"not a log")
    for call in (plumbline.read_log, plumbline.replay):
        with pytest.raises(plumbline.DataError, match="no.mcap"):
            call(tmp_path / "no.mcap")
    for wrong in ({"threads": 0}, {"conditions": ["fog:1"]}, {"imu_errors": ["x"]}, {"frames": (0, 5)}, {"topics": {"up": "/a"}}):
        with pytest.raises(plumbline.ArgumentError):
            plumbline.replay("sim:room", **wrong)
    with pytest.raises(plumbline.ArgumentError, match="sim:|choose"):
        plumbline.replay("sim:moon")
    with pytest.raises(plumbline.ArgumentError, match=".mcap"):
        plumbline.replay("sim:room", record=tmp_path / "log.bag")
