"""Memory over 10,000 frames, and the cost of a frame beside the same without Python: `make wheel-soak`.

The cost is processor time of the calling thread, in turns with replays on one thread, whose report has the processor time of
frames without Python. The median of the ratios counts.
"""

import argparse
import statistics
import sys
import time

import plumbline

FLIGHT = {"start": 2.0, "duration": 4.0}
#: Most that a frame through Python may cost, against the same without.
MAX_RATIO = 1.05
#: Most that the process may grow after the first tenth, MB.
MAX_GROWTH_MB = 2.0


def resident_mb():
    with open("/proc/self/status", encoding="ascii") as status:
        (line,) = [line for line in status if line.startswith("VmRSS")]
    return int(line.split()[1]) / 1024


def kept(scale):
    recording = plumbline.open_recording("sim:room", scale=scale, **FLIGHT)
    return recording.config, list(recording), recording.imu_until()


def lap(estimator, frames, imu, shift_ns, times_ms):
    """Flies all frames once, later by `shift_ns`."""
    row = 0
    for frame in frames:
        needed = estimator.imu_needed_until(frame.stamp_ns + shift_ns)
        end = row
        while end < len(imu) and (end == row or imu.stamp_ns[end - 1] + shift_ns < needed):
            end += 1
        batch = imu.stamp_ns[row:end] + shift_ns, imu.gyro[row:end], imu.accel[row:end]
        called = time.thread_time()
        estimator.add_imu_array(*batch)
        estimate = estimator.add_frame(frame.stamp_ns + shift_ns, frame.left, frame.right)
        _ = estimate.position, estimate.orientation, estimate.covariance
        times_ms.append(1e3 * (time.thread_time() - called))
        row = end
    return estimate


def soak(count):
    config, frames, imu = kept(0.5)
    estimator = plumbline.Estimator(config)
    span_ns = int(imu.stamp_ns[-1] - imu.stamp_ns[0]) + 10**7
    flown, first_mb = 0, None
    while flown < count:
        # Each lap is a flight of its own, as after a restart; stamps go on.
        estimator.reset("hard")
        estimate = lap(estimator, frames, imu, (flown // len(frames)) * span_ns, [])
        flown += len(frames)
        if first_mb is None and flown >= count // 10:
            first_mb = resident_mb()
    growth_mb = resident_mb() - first_mb
    print(f"{flown} frames: {resident_mb():.1f} MB resident, {growth_mb:+.2f} MB since the first tenth; {estimate!r}")
    return growth_mb <= MAX_GROWTH_MB


def cost(turns):
    config, frames, imu = kept(1.0)
    ratios = []
    for _ in range(turns):
        times_ms = []
        lap(plumbline.Estimator(config), frames, imu, 0, times_ms)
        alone = plumbline.replay("sim:room", threads=1, loops=False, **FLIGHT).report["frame_cpu_ms"]
        ratios.append(statistics.median(times_ms) / alone["p50"])
        print(f"a frame: {statistics.median(times_ms):.3f} ms through Python, {alone['p50']:.3f} ms without, ratio {ratios[-1]:.4f}")
    ratio = statistics.median(ratios)
    print(f"ratio {ratio:.4f}, at most {MAX_RATIO}")
    return ratio <= MAX_RATIO


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--frames", type=int, default=10_000)
    parser.add_argument("--turns", type=int, default=5)
    arguments = parser.parse_args()
    is_cheap, is_flat = cost(arguments.turns), soak(arguments.frames)
    sys.exit(0 if is_cheap and is_flat else 1)


if __name__ == "__main__":
    main()
