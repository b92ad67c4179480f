"""Digests of two seconds of a recording, by `replay` and by an `Estimator` of one's own: `make wheel-test ARCH=arm64`.

Not a test of pytest: it runs where there is nothing but Python, numpy and the package.
"""

import sys

import plumbline

FLIGHT = {"duration": 2.0}

flight = plumbline.replay(sys.argv[1], **FLIGHT)
recording = plumbline.open_recording(sys.argv[1], **FLIGHT)
estimator = plumbline.Estimator(recording.config)
for frame in recording:
    imu = recording.imu_until(estimator.imu_needed_until(frame.stamp_ns))
    estimator.add_imu_array(imu.stamp_ns, imu.gyro, imu.accel)
    estimator.add_frame(frame.stamp_ns, frame.left, frame.right)
print(plumbline.__version__, flight.digest, estimator.digest())
