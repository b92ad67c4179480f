"""The bits of `Estimate.health`. Made by `make messages`, of estimator/src/health.rs."""

from enum import IntFlag

from plumbline._native import health_bits


class Health(IntFlag):
    """Errors and warnings of an estimate. `Health(estimate.health)` names the bits of one."""

    NOT_POSITIVE_DEFINITE = 1 << 0
    IMU_SATURATED = 1 << 1
    NO_FEATURES = 1 << 2
    FEW_FEATURES = 1 << 3
    VELOCITY_UNCERTAIN = 1 << 4
    IMU_GAP = 1 << 5
    FRAME_GAP = 1 << 6
    LEFT_IMAGE_MISSING = 1 << 7
    RIGHT_IMAGE_MISSING = 1 << 8
    BAD_STAMP = 1 << 9
    BAD_IMAGE_SIZE = 1 << 10
    STATIONARY = 1 << 11
    DEGRADED = 1 << 12
    CAMERAS_DISAGREE = 1 << 13
    IMU_CONTRADICTED = 1 << 14
    ACCELEROMETER_NOISY = 1 << 15
    GYROSCOPE_STUCK = 1 << 16
    ACCELEROMETER_STUCK = 1 << 17
    LEFT_IMAGE_FROZEN = 1 << 18
    RIGHT_IMAGE_FROZEN = 1 << 19
    IMU_LATE = 1 << 20
    IMAGES_LATE = 1 << 21
    ROTATION_DISPUTED = 1 << 22
    BLURRED = 1 << 24
    ACCELEROMETER_CONTRADICTED = 1 << 27
    GYROSCOPE_CONTRADICTED = 1 << 28
    CAMERAS_OUT_OF_STEP = 1 << 29
    SCALE_CONTRADICTED = 1 << 30


_KNOWN = {bit: name.upper().replace(" ", "_") for bit, name in health_bits()}
if _KNOWN != {bit.value: bit.name for bit in Health}:
    raise ImportError("plumbline: the native module is of another version than the package; install plumbline again")
