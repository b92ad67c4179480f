"""Flights with drawn failures: kind, axis, size, moment and noise, among jitter of stamps, missing frames and crowds."""

from dataclasses import replace

from .flights import Flight, with_option, without_option

# Moment of a failure, s after the first frame; share of the flights without one, and of those with each disturbance.
MOMENT_S = (4.0, 8.0)
SOUND_SHARE = 0.15
DISTURBED_SHARE = 0.25

AXIS, PAIRS, ALL, CAMERA = ("x", "y", "z"), ("xy", "yz", "xz"), ("xyz",), ("left", "right")
NOISE = (0.5, 2.0)
# Kind, targets, range of the dose, whether the dose has either sign, range of the length in seconds.
FAMILIES = (
    ("accel-pulse", AXIS, (10.0, 60.0), True, (0.1, 1.0)),
    ("accel-step", AXIS, (2.0, 10.0), True, None),
    ("accel-clip", ALL, (3.0, 12.0), False, None),
    ("accel-dead", AXIS, NOISE, False, None),
    ("accel-frozen", AXIS, NOISE, False, None),
    ("accel-sign", AXIS, None, False, None),
    ("accel-exchanged", PAIRS, None, False, None),
    ("gyro-pulse", AXIS, (1.0, 6.0), True, (0.1, 1.0)),
    ("gyro-step", AXIS, (0.05, 0.5), True, None),
    ("gyro-dead", AXIS, NOISE, False, None),
    ("gyro-frozen", AXIS, NOISE, False, None),
    ("gyro-sign", AXIS, None, False, None),
    ("gyro-exchanged", PAIRS, None, False, None),
    ("imu-frozen", ALL, NOISE, False, None),
    ("imu-late", None, (20.0, 100.0), False, None),
    ("image-late", CAMERA, (1.0, 3.5), False, None),
    ("image-frozen", CAMERA, NOISE, False, None),
    ("image-shift", CAMERA, (4.0, 8.0), False, None),
    ("stamp-late", None, (50.0, 200.0), False, None),
    ("frame-gap", None, None, False, (0.2, 0.8)),
)


class SplitMix64:
    """Pseudo-random numbers (Steele, Lea and Flood 2014): the same draws in every version of Python."""

    def __init__(self, seed: int):
        self.state = seed

    def bits(self) -> int:
        mask = (1 << 64) - 1
        self.state = (self.state + 0x9E3779B97F4A7C15) & mask
        z = self.state
        z = (z ^ (z >> 30)) * 0xBF58476D1CE4E5B9 & mask
        z = (z ^ (z >> 27)) * 0x94D049BB133111EB & mask
        return z ^ (z >> 31)

    def below(self, limit: int) -> int:
        return self.bits() * limit >> 64

    def unit(self) -> float:
        return (self.bits() >> 11) / (1 << 53)

    def range(self, low: float, high: float) -> float:
        return low + (high - low) * self.unit()


def draw_failure(random: SplitMix64) -> tuple[str, float]:
    """A failure as `--fault` takes it, and its moment, s."""
    kind, targets, doses, is_signed, length_s = FAMILIES[random.below(len(FAMILIES))]
    text = kind
    if targets:
        text += ":" + targets[random.below(len(targets))]
    if doses:
        dose = random.range(*doses)
        sign = -1.0 if is_signed and random.below(2) == 1 else 1.0
        # Whole frames and pixels.
        is_whole = targets is CAMERA and kind != "image-frozen"
        text += f":{int(dose)}" if is_whole else f":{sign * dose:.2f}"
    moment = f"{random.range(*MOMENT_S):.2f}"
    text += f"@{moment}"
    if length_s:
        text += f"+{random.range(*length_s):.2f}"
    return text, float(moment)


def drawn(sound: list[Flight], count: int, seed: int) -> list[Flight]:
    """`count` flights drawn from the `sound` ones, each with a failure or none and with disturbances or none."""
    random, flights = SplitMix64(seed), []
    for number in range(count):
        flight = sound[random.below(len(sound))]
        source = with_option(without_option(flight.source, "seed"), f"seed={number + 1}")
        is_sound = random.unit() < SOUND_SHARE
        failure, from_s = draw_failure(random)
        jitter, missing, crowd = (random.unit() < DISTURBED_SHARE for _ in range(3))
        jitter_ms, share, percent = random.range(0.5, 2.0), random.range(0.05, 0.3), random.range(15.0, 35.0)
        parts = [] if is_sound else [f"fault={failure}"]
        parts += [f"fault=stamp-jitter:{jitter_ms:.2f}@{from_s:.2f}"] if jitter else []
        parts += [f"fault=frames-missing:{share:.2f}@{from_s:.2f}"] if missing else []
        parts += [f"condition=people:{percent:.0f}:1.2:{from_s:.1f}"] if crowd else []
        flights.append(replace(flight, source=source, variation="&".join(parts)))
    return flights
