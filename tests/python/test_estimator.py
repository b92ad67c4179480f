"""The estimator in a program's own loop."""

import json
import threading

import numpy as np
import pytest
from conftest import ROOM, fly

import plumbline


def test_the_digest_of_a_recorded_flight_is_that_of_a_replay(clip, command, tmp_path):
    command("replay", clip, "--frames", "0..40", "--report", tmp_path / "report.json")
    recording = plumbline.open_recording(clip, frames=(0, 40))
    estimator = plumbline.Estimator(recording.config)
    fly(recording, estimator)
    expected = json.loads((tmp_path / "report.json").read_text())["estimate_digest"]
    assert estimator.digest() == expected
    assert plumbline.replay(clip, frames=(0, 40), threads=3).digest == expected


def test_the_digest_of_a_simulated_flight_is_that_of_a_replay(room):
    recording = plumbline.open_recording("sim:room", **ROOM)
    estimator = plumbline.Estimator(recording.config)
    estimates = fly(recording, estimator)
    assert estimator.digest() == room.digest
    last = estimates[-1]
    assert last.has_pose and last.state == "tracking"
    assert np.array_equal(last.position, room.estimates.position[-1])
    assert np.array_equal(last.covariance, room.estimates.covariance[-1])


def test_arrays_of_an_estimate_are_copies_that_outlive_it(room):
    recording = plumbline.open_recording("sim:room", **ROOM)
    estimate = fly(recording, plumbline.Estimator(recording.config))[-1]
    first = estimate.covariance
    shapes = {"position": (3,), "orientation": (4,), "velocity": (3,), "gyro_bias": (3,), "accel_bias": (3,)}
    shapes.update(covariance=(9, 9), bias_variances=(6,), camera_position=(3,), camera_orientation=(4,))
    for name, shape in shapes.items():
        array = getattr(estimate, name)
        assert array.shape == shape and array.dtype == np.float64, name
        array[...] = np.nan
        assert not np.isnan(getattr(estimate, name)).any(), name
    kept = first.copy()
    del estimate, array
    assert np.array_equal(first, kept) and np.array_equal(first, first.T)
    assert (np.linalg.eigvalsh(first) > 0).all()


def test_odometry_follows_the_inertial_samples(inputs, room):
    config, frames, imu = inputs
    estimator = plumbline.Estimator(config)
    row, told = 0, []
    for frame in frames:
        needed = estimator.imu_needed_until(frame.stamp_ns)
        while row < len(imu) and (row == 0 or imu.stamp_ns[row - 1] < needed):
            odometry = estimator.propagate(int(imu.stamp_ns[row]), imu.gyro[row], tuple(imu.accel[row]))
            if odometry is not None:
                told.append(odometry)
            row += 1
        estimator.add_frame(frame.stamp_ns, frame.left, frame.right, sequence=frame.sequence)
    assert estimator.digest() == room.digest
    assert len(told) > 200 and all(o.has_pose for o in told)
    newest = told[-1]
    near = np.argmin(np.abs(room.odometry.stamp_ns - newest.stamp_ns))
    assert np.linalg.norm(newest.position - room.odometry.position[near]) < 0.02
    assert newest.matrix().shape == (4, 4) and newest.angular_rate.shape == (3,)


def test_rows_with_padding_give_the_same_bits(inputs):
    config, frames, imu = inputs
    digests = set()
    for is_padded in (False, True):
        estimator = plumbline.Estimator(config)
        estimator.add_imu_array(imu.stamp_ns, imu.gyro, imu.accel)
        for frame in frames[:8]:
            images = frame.left, frame.right
            if is_padded:
                images = tuple(np.pad(image, ((3, 2), (7, 13)), constant_values=255)[3:-2, 7:-13] for image in images)
                assert not images[0].flags.c_contiguous
            estimator.add_frame(frame.stamp_ns, *images)
        digests.add(estimator.digest())
    assert len(digests) == 1


def test_a_missing_image_is_a_health_bit(started):
    estimator, frame, _ = started
    estimate = estimator.add_frame(frame.stamp_ns, frame.left)
    assert plumbline.Health.RIGHT_IMAGE_MISSING in plumbline.Health(estimate.health)
    assert "right image missing" in estimate.health_names


def test_a_hard_reset_begins_anew(inputs):
    config, frames, imu = inputs
    estimator = plumbline.Estimator(config)
    estimator.add_imu_array(imu.stamp_ns, imu.gyro, imu.accel)
    counters = []
    for number, frame in enumerate(frames):
        if number == 20:
            estimator.reset("hard")
        counters.append(estimator.add_frame(frame.stamp_ns, frame.left, frame.right).reset_counter)
    assert counters[19] == 0 and counters[20] == 1


NAN = float("nan")


def image(frame):
    return frame.left


#: What is misused: the call, its exception, and a part of its message.
MISUSE = {
    "stamp None": (lambda e, f, t: e.add_imu(None, (0, 0, 0), (0, 0, 9.8)), plumbline.ArgumentTypeError, "stamp_ns"),
    "stamp in seconds": (lambda e, f, t: e.add_imu(1.5, (0, 0, 0), (0, 0, 9.8)), plumbline.ArgumentTypeError, "integer number of nanoseconds"),
    "gyro None": (lambda e, f, t: e.add_imu(t + 1, None, (0, 0, 9.8)), plumbline.ArgumentTypeError, "gyro: expected three numbers"),
    "gyro too short": (lambda e, f, t: e.add_imu(t + 1, (0, 0), (0, 0, 9.8)), plumbline.ArgumentTypeError, "gyro: expected three numbers"),
    "gyro of strings": (lambda e, f, t: e.add_imu(t + 1, "abc", (0, 0, 9.8)), plumbline.ArgumentTypeError, "gyro"),
    "accel of the wrong shape": (lambda e, f, t: e.add_imu(t + 1, (0, 0, 0), np.zeros((3, 1))), plumbline.ArgumentTypeError, "accel"),
    "gyro NaN": (lambda e, f, t: e.add_imu(t + 10**6, (NAN, 0, 0), (0, 0, 9.8)), plumbline.SampleError, "NaN"),
    "gyro in degrees": (lambda e, f, t: e.add_imu(t + 10**6, (1e4, 0, 0), (0, 0, 9.8)), plumbline.SampleError, "range"),
    "sample out of order": (lambda e, f, t: e.add_imu(t - 10**6, (0, 0, 0), (0, 0, 9.8)), plumbline.OutOfOrderError, "not later"),
    "sample far ahead": (lambda e, f, t: e.add_imu(t + 10**15, (0, 0, 0), (0, 0, 9.8)), plumbline.SampleError, "far ahead"),
    "propagate out of order": (lambda e, f, t: e.propagate(t - 10**6, (0, 0, 0), (0, 0, 9.8)), plumbline.OutOfOrderError, "not later"),
    "stamps of floats": (lambda e, f, t: e.add_imu_array([t + 1.0], [[0, 0, 0]], [[0, 0, 9.8]]), plumbline.ArgumentTypeError, "integer"),
    "rows of different number": (lambda e, f, t: e.add_imu_array([t + 1, t + 2], [[0, 0, 0]], [[0, 0, 9.8]]), plumbline.ArgumentError, "as many"),
    "gyros of the wrong shape": (lambda e, f, t: e.add_imu_array([t + 1], [[0, 0]], [[0, 0, 9.8]]), plumbline.ArgumentError, r"\(N, 3\)"),
    "gyros of objects": (lambda e, f, t: e.add_imu_array([t + 1], [[None, 0, 0]], [[0, 0, 9.8]]), plumbline.ArgumentTypeError, "gyro"),
    "no image": (lambda e, f, t: e.add_frame(f.stamp_ns, None), plumbline.ArgumentTypeError, "both are None"),
    "image of floats": (lambda e, f, t: e.add_frame(f.stamp_ns, image(f).astype(np.float32)), plumbline.ArgumentTypeError, "float32"),
    "image of int8": (lambda e, f, t: e.add_frame(f.stamp_ns, image(f).view(np.int8)), plumbline.ArgumentTypeError, "int8"),
    "image in colour": (lambda e, f, t: e.add_frame(f.stamp_ns, np.dstack([image(f)] * 3)), plumbline.ArgumentError, "grey"),
    "image of half the size": (lambda e, f, t: e.add_frame(f.stamp_ns, image(f)[::2, :100]), plumbline.ArgumentError, "size"),
    "image turned on its side": (lambda e, f, t: e.add_frame(f.stamp_ns, image(f).T), plumbline.ArgumentError, "shape"),
    "columns not side by side": (lambda e, f, t: e.add_frame(f.stamp_ns, np.asfortranarray(image(f))), plumbline.ArgumentError, "ascontiguousarray"),
    "columns in reverse": (lambda e, f, t: e.add_frame(f.stamp_ns, image(f)[:, ::-1]), plumbline.ArgumentError, "ascontiguousarray"),
    "rows in reverse": (lambda e, f, t: e.add_frame(f.stamp_ns, image(f)[::-1]), plumbline.ArgumentError, "ascontiguousarray"),
    "every second column": (lambda e, f, t: e.add_frame(f.stamp_ns, np.repeat(image(f), 2, axis=1)[:, ::2]), plumbline.ArgumentError, "ascontiguousarray"),
    "rows that overlap": (
        lambda e, f, t: e.add_frame(f.stamp_ns, np.lib.stride_tricks.as_strided(image(f), strides=(1, 1))),
        plumbline.ArgumentError,
        "ascontiguousarray",
    ),
    "image as a list": (lambda e, f, t: e.add_frame(f.stamp_ns, image(f).tolist()), plumbline.ArgumentTypeError, "list"),
    "image as bytes": (lambda e, f, t: e.add_frame(f.stamp_ns, image(f).tobytes()), plumbline.ArgumentTypeError, "bytes"),
    "frame out of order": (lambda e, f, t: e.add_frame(f.stamp_ns - 10**9, f.left, f.right), plumbline.OutOfOrderError, "stamp"),
    "stamp too large": (lambda e, f, t: e.add_frame(2**70, f.left, f.right), plumbline.ArgumentTypeError, "stamp_ns"),
    "unknown reset": (lambda e, f, t: e.reset("cold"), plumbline.ArgumentError, "soft"),
    "unknown preset": (lambda e, f, t: plumbline.Estimator("no-such-preset"), plumbline.ConfigError, "no-such-preset"),
    "no configuration": (lambda e, f, t: plumbline.Estimator(None), plumbline.ArgumentTypeError, "config"),
}


@pytest.mark.parametrize("case", MISUSE)
def test_misuse_is_a_typed_exception(case, started):
    estimator, frame, newest_ns = started
    call, kind, part = MISUSE[case]
    with pytest.raises(kind, match=part) as raised:
        call(estimator, frame, newest_ns)
    assert isinstance(raised.value, plumbline.PlumblineError)
    # It goes on.
    estimate = estimator.add_frame(frame.stamp_ns, frame.left, frame.right)
    assert estimate.stamp_ns == pytest.approx(frame.stamp_ns, abs=10**7)


def test_an_array_stops_at_the_sample_that_is_refused(started):
    estimator, _, newest_ns = started
    stamps = newest_ns + np.array([5, 10, 8, 15]) * 10**6
    with pytest.raises(plumbline.OutOfOrderError) as raised:
        estimator.add_imu_array(stamps, np.zeros((4, 3)), np.tile([0, 0, 9.8], (4, 1)))
    assert (raised.value.index, raised.value.reason) == (2, "not later")
    estimator.add_imu(int(stamps[3]), (0, 0, 0), (0, 0, 9.8))


def test_one_camera_takes_no_right_image(inputs):
    _, frames, _ = inputs
    config = plumbline.open_recording("sim:room", mono=True, **ROOM).config
    with pytest.raises(plumbline.ArgumentError, match="one camera"):
        plumbline.Estimator(config).add_frame(frames[0].stamp_ns, frames[0].left, frames[0].right)


def test_a_second_thread_is_refused_while_the_first_works(inputs):
    config, frames, imu = inputs
    estimator = plumbline.Estimator(config)
    estimator.add_imu_array(imu.stamp_ns, imu.gyro, imu.accel)
    is_over, refused = threading.Event(), []

    def meddle():
        while not is_over.is_set():
            try:
                estimator.digest()
            except plumbline.BusyError as error:
                refused.append(error)

    thread = threading.Thread(target=meddle)
    thread.start()
    results = []
    for frame in frames:
        while True:
            try:
                results.append(estimator.add_frame(frame.stamp_ns, frame.left, frame.right, sequence=frame.sequence))
                break
            except plumbline.BusyError as error:
                refused.append(error)
    is_over.set()
    thread.join()
    # The interpreter ran the other thread while a frame was computed.
    assert refused and "another thread" in str(refused[0])
    assert len(results) == len(frames)


def test_estimators_on_threads_of_their_own_agree(inputs):
    config, frames, imu = inputs
    digests = []

    def run():
        estimator = plumbline.Estimator(config)
        estimator.add_imu_array(imu.stamp_ns, imu.gyro, imu.accel)
        for frame in frames[:12]:
            estimator.add_frame(frame.stamp_ns, frame.left, frame.right)
        digests.append(estimator.digest())

    threads = [threading.Thread(target=run) for _ in range(3)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(digests) == 3 and len(set(digests)) == 1
