"""An IMU that fails for a while: examples/send_imu.py with samples that are silent, NaN or the same one again from FROM to TO seconds.

    faulty_imu.py EXAMPLE MODE FROM TO ARGUMENTS_OF_THE_EXAMPLE...
"""

import importlib.util
import math
import sys
import time

example, mode, begin, end = sys.argv[1:5]
sys.argv[1:5] = []
spec = importlib.util.spec_from_file_location("send_imu", example)
send_imu = importlib.util.module_from_spec(spec)
spec.loader.exec_module(send_imu)
sound = send_imu.samples


def samples(dataset, start_ns):
    held = None
    for time_ns, gyro, accel in sound(dataset, start_ns):
        if not float(begin) <= (time_ns - start_ns) * 1e-9 < float(end):
            yield time_ns, gyro, accel
        elif mode == "nan":
            yield time_ns, [math.nan] * 3, accel
        elif mode == "repeated":
            held = held or (time_ns, gyro, accel)
            while time.monotonic_ns() < time_ns:
                time.sleep(0.001)
            yield held


send_imu.samples = samples
send_imu.main()
