"""Sound flights along drawn paths: eights, spirals, hovers, dashes, yaws, throws, drops, jerks, flips, landings and recorded ones."""

from pathlib import Path

import numpy as np
from scipy.ndimage import uniform_filter1d
from scipy.spatial.transform import Rotation

from .draws import SplitMix64
from .flights import RECORDED_PATHS, SCENES, Flight, shared_folder

RATE_HZ = 200
GRAVITY_M_S2 = 9.81
# Body of EuRoC in a level vehicle: x up, z ahead.
LEVEL = Rotation.from_matrix([[0, 0, 1], [0, -1, 0], [1, 0, 0]])
KINDS = ("eight", "spiral", "hover", "dashes", "yaws", "throw", "drop", "jerk", "flip", "landing")
# Their accelerations are not those of a thrust along the body.
UPRIGHT = ("throw", "drop", "jerk", "flip")
# Shares of the flights with recorded sensors, with one camera, with jitter of the stamps and with missing frames.
RECORDED, MONO, JITTER, MISSING = 0.3, 0.2, 0.5, 0.5


def step(s):
    """From 0 at 0 to 1 at 1, with three continuous derivatives."""
    s = np.clip(s, 0, 1)
    return s**4 * (35 - 84 * s + 70 * s**2 - 20 * s**3)


def smoothed(values, width: int):
    for _ in range(3):
        values = uniform_filter1d(values, width, mode="nearest")
    return values


def bumps(random: SplitMix64, kind: str, times):
    """Heights, m, of throws, drops or jerks, each of which ends at rest and is followed by a slow return."""
    acceleration, at = np.zeros_like(times), random.range(4, 6)
    while at < times[-1] - 6:
        if kind == "throw":
            up, long, fall = random.range(10, 28), random.range(0.08, 0.12), random.range(0.2, 0.4)
            parts = [(long, up), (fall, -GRAVITY_M_S2), (0.4, (GRAVITY_M_S2 * fall - up * long) / 0.4)]
        elif kind == "drop":
            fall = random.range(0.2, 0.3)
            parts = [(fall, -GRAVITY_M_S2), (0.6, GRAVITY_M_S2 * fall / 0.6)]
        else:
            parts = [(0.12, up := random.range(8, 20)), (0.15, 0.0), (0.12, -up)]
        for long, value in parts:
            acceleration[(times >= at) & (times < at + long)] += value
            at += long
        at += random.range(7, 10)
    height = np.cumsum(np.cumsum(smoothed(acceleration, 16))) / RATE_HZ**2
    later = np.concatenate([np.zeros(4 * RATE_HZ), height])[: len(height)]
    return height - smoothed(later, 3 * RATE_HZ)


def path(random: SplitMix64, kind: str, duration_s: float):
    """Times, s, positions, m, and attitudes of a path: a second at rest, then in motion."""
    u = random.range
    times = np.arange(0, duration_s + 1, 1 / RATE_HZ)
    begun, yaw = step((times - 1) / 2.5), np.zeros_like(times)
    p, own = np.tile([0.0, 0.0, 1.2], (len(times), 1)), Rotation.identity()

    def wave(size: float, low: float, high: float):
        return size * np.sin(u(low, high) * times + u(0, 2 * np.pi))

    def move(*xyz):
        p[:] += begun[:, None] * np.stack(xyz, 1)

    if kind == "eight":
        rate, size = u(0.5, 1.6), u(0.6, 1.8)
        move(size * np.sin(rate * times), 0.6 * size * np.sin(2 * rate * times), wave(0.3, 0.3, 1))
        yaw = begun * wave(u(0, 1.5), 0.2, 0.8)
    elif kind == "spiral":
        rate, size = u(0.4, 1.5), u(0.5, 1.6)
        move(size * (np.cos(rate * times) - 1), size * np.sin(rate * times), wave(0.6, 0.15, 0.5))
        yaw = begun * times * (rate if random.below(2) else 0.0)
    elif kind == "dashes":
        last, at = np.zeros(3), 4.0
        while at < duration_s - 1:
            to = np.array([u(-1.6, 1.6), u(-1.6, 1.6), u(-0.5, 0.7)])
            way = np.linalg.norm(to - last)
            long = max(0.5, 2.2 * way / u(1, 3), np.sqrt(1.25 * way))
            p += step((times - at) / long)[:, None] * (to - last)
            last, at = to, at + long + u(0, 1)
    elif kind == "yaws":
        at, sign = 4.0, 1.0
        while at < duration_s - 2:
            angle = u(1, 3)
            long = max(2.2 * angle / u(3, 8), 0.3)
            yaw += sign * angle * step((times - at) / long)
            at, sign = at + long + u(0.3, 1.5), -sign
    elif kind in ("throw", "drop", "jerk"):
        p[:, 2] += bumps(random, kind, times) + (0.6 if kind == "drop" else 0.0)
    elif kind == "flip":
        angle, at = np.zeros_like(times), u(5, 8)
        while at < duration_s - 4:
            long = u(1.4, 2.2)
            angle += 2 * np.pi * step((times - at) / long)
            p[:, 2] += 0.5 * np.exp(-(((times - at - long / 2) / 0.5) ** 2))
            at += long + u(5, 8)
        own = Rotation.from_rotvec(angle[:, None] * ([0, 1, 0] if random.below(2) else [0, 0, 1]))
    elif kind == "landing":
        p[:, 2] += 0.9 * (step((times - 19) / 3) - step((times - 9) / 4))
        begun *= step((12 - times) / 3) + step((times - 21) / 3)
    if kind not in ("eight", "spiral", "dashes"):
        size = 0.2 if kind in ("hover", "yaws") else 0.7
        move(wave(u(0.03, size), 0.4, 1.4), wave(u(0.03, size), 0.4, 1.4), wave(0.03, 0.4, 1.4))
    acceleration = np.stack([np.gradient(np.gradient(smoothed(x, 9))) * RATE_HZ**2 for x in p.T], 1)
    up = 0.9 * acceleration * ([1, 1, 0] if kind in UPRIGHT else [1, 1, 1]) + [0, 0, GRAVITY_M_S2]
    up /= np.linalg.norm(up, axis=1)[:, None]
    left = np.cross(up, np.stack([np.cos(yaw), np.sin(yaw), 0 * yaw], 1))
    left /= np.linalg.norm(left, axis=1)[:, None]
    attitude = Rotation.from_matrix(np.stack([np.cross(left, up), left, up], 2))
    return times, p, attitude * Rotation.from_rotvec((begun * wave(0.02, 3, 7))[:, None] * [1, 0, 0]) * LEVEL * own


def sound(count: int, seed: int, args, folder: Path) -> list[Flight]:
    """`count` sound flights; paths of their own are written to `folder`."""
    folder.mkdir(parents=True, exist_ok=True)
    random, flights = SplitMix64(seed), []
    for number in range(count):
        scene = SCENES[random.below(len(SCENES))]
        is_recorded, is_mono, has_jitter, is_missing = (random.unit() < x for x in (RECORDED, MONO, JITTER, MISSING))
        parts = [f"fault=stamp-jitter:{random.range(0.1, 1):.2f}"] if has_jitter else []
        parts += [f"fault=frames-missing:{random.range(0.005, 0.05):.3f}"] if is_missing else []
        if is_recorded:
            name = sorted(RECORDED_PATHS)[random.below(len(RECORDED_PATHS))]
            start_s = RECORDED_PATHS[name] + random.range(-5, 20)
            parts += [f"path={shared_folder(args.shared) / name}.tum.gz", f"start={start_s:.1f}", "imu=recorded"]
        else:
            kind = KINDS[random.below(len(KINDS))]
            times, p, attitude = path(random, kind, args.duration)
            file = (folder / f"{seed}-{number + 1}-{kind}.tum").resolve()
            np.savetxt(file, np.column_stack([times, p, attitude.as_quat()]), fmt="%.9f")
            parts.append(f"path={file}")
        parts += [f"duration={args.duration:g}", f"scale={args.scale:g}", f"seed={number + 1}"]
        options = ["--config", "euroc" if is_recorded else "sim", *(["--mono"] if is_mono else []), *args.options]
        flights.append(Flight(f"sim:{scene}?" + "&".join(parts), tuple(options), tuple(args.set)))
    return flights
