"""Tables of a campaign: means, consistency, variations beside the same flights without them, and honesty under faults."""

import re

import numpy as np
import pandas as pd
from tabulate import tabulate

from .compare import NEES, paired

# Beginnings of the kinds of faults, and the health bits of which one names such a fault; the longest that fits counts.
GYRO = ("gyroscope stuck", "gyroscope contradicted")
FROZEN = ("left image frozen", "right image frozen")
NAMED_BY = {
    "accel-": ("accelerometer stuck", "accelerometer contradicted", "accelerometer noisy"),
    "gyro-": GYRO,
    "imu-frozen": (*GYRO, "accelerometer stuck", "accelerometer contradicted"),
    "imu-late": ("IMU late",),
    "imu-gap": ("IMU gap",),
    "stamp-late": ("images late",),
    "clock-back": ("bad stamp",),
    "frame-gap": ("frame gap",),
    "image-black": ("no features",),
    # With noise an image does not repeat, but differs from that of the other camera.
    "image-frozen": (*FROZEN, "cameras disagree"),
    "image-repeat": FROZEN,
    # The delay begins with the repetition of an image.
    "image-late": ("cameras out of step", "cameras disagree", *FROZEN),
    "image-shift": ("cameras disagree",),
    "images-exchanged": ("cameras disagree",),
    "rig-baseline": ("scale contradicted",),
}
# Health bits that name a sensor or its clock.
SENSOR_BITS = (
    "accelerometer stuck", "accelerometer contradicted", *GYRO, "IMU late", "images late", "cameras out of step",
    "cameras disagree", *FROZEN, "scale contradicted",
)  # fmt: skip
# A fault must be named within this time, s, and no usable estimate may be off by more standard deviations.
MAX_NAMELESS_S = 1.0
MAX_SIGMAS = 5.0
SIGMAS = [f"honesty.worst_sigmas.{name}" for name in ("position", "velocity", "tilt")]


def pipe(rows, head) -> str:
    """Table in Markdown."""
    return tabulate(rows, head, "pipe", disable_numparse=True)


def number(value, digits: int) -> str:
    return "-" if value is None or not np.isfinite(value) else f"{value:.{digits}f}"


def column(table: pd.DataFrame, name: str) -> pd.Series:
    """Column of numbers; unknown where the table has none of this name."""
    return table[name].astype(float) if name in table else pd.Series(np.nan, table.index)


def nees(table: pd.DataFrame, output: str) -> str:
    means = [column(table, f"consistency.{output}.{name}.mean_ratio").mean() for name in NEES]
    return " / ".join(number(mean, 2) for mean in means)


def flights(table: pd.DataFrame) -> str:
    """Row per flight."""
    head = ["path", "scene", "seed", "start s", "variation", "setting", "completion %", "distance m", "ATE m", "ATE %"]
    head += ["NEES position / tilt / yaw / velocity / steps", "resets", "frame cpu ms p50", "digest"]
    rows = []
    for index, row in table.iterrows():
        one = table.loc[[index]]
        figure = lambda name, digits, one=one, factor=1: number(factor * column(one, name).iloc[0], digits)  # noqa: E731
        digest = row.get("estimate_digest")
        rows.append([
            row.path, row.scene, number(row.seed, 0), number(row.start_s, 1), row.variation, row.setting,
            figure("completion", 1, factor=100), figure("accuracy.distance_m", 1), figure("accuracy.ate_rmse_m", 4),
            figure("accuracy.ate_percent", 3), nees(one, "estimates"), figure("resets", 0),
            figure("frame_cpu_ms.p50", 1), digest[:16] if isinstance(digest, str) else row.error,
        ])  # fmt: skip
    return pipe(rows, head)


def means(table: pd.DataFrame, by: list[str]) -> str:
    """Row of means per group, and one of all; settings are ordered by their error, those that fail flights last."""
    if table.empty:
        return ""
    groups = list(table.groupby(by, sort=False))
    if "setting" in by:
        groups.sort(key=lambda g: (failed(g[1]).sum(), column(g[1], "accuracy.ate_percent").mean()))
    if len(groups) != 1:
        groups.append((("all",) + ("",) * (len(by) - 1), table))
    rows = []
    for names, group in groups:
        ate, percent = column(group, "accuracy.ate_rmse_m"), column(group, "accuracy.ate_percent")
        yaw = column(group, "accuracy.yaw_drift_deg_per_min").abs()
        rows.append([
            *(name or "as configured" if key == "setting" else name for key, name in zip(by, names)),
            len(group), int(failed(group).sum()), number(1e3 * ate.mean(), 3), number(percent.mean(), 4), number(percent.max(), 4),
            number(yaw.mean(), 2), nees(group, "estimates"), nees(group, "odometry"),
            number(column(group, "resets").sum(), 0), number(column(group, "frame_cpu_ms.p50").mean(), 1),
        ])  # fmt: skip
    head = [*by, "flights", "failed", "ATE mm", "ATE %", "worst ATE %", "yaw deg/min"]
    head += ["NEES position / tilt / yaw / velocity / steps", "the same of the odometry", "resets", "frame cpu ms p50"]
    return pipe(rows, head)


def failed(table: pd.DataFrame) -> pd.Series:
    """True for the flights without a pose."""
    return ~(column(table, "completion") > 0)


def variations(table: pd.DataFrame) -> str:
    """Row per variation: its errors beside those of the same flights without it."""
    table = table.assign(ate=column(table, "accuracy.ate_percent"), resets=column(table, "resets"))
    base = table[table.variation == ""].set_index(["flight", "setting"]).ate.rename("without")
    rows = []
    for variation, group in table[table.variation != ""].groupby("variation", sort=False):
        both = group.set_index(["flight", "setting"]).join(base, how="inner")
        ate, without = both.ate, both.without
        difference, ratios = paired(without, ate), ate / without
        if len(both) == 0:
            continue
        interval = f" ({difference.ratio_95[0]:.2f} to {difference.ratio_95[1]:.2f})" if difference else ""
        rows.append([
            variation, len(both), number(ate.mean(), 4), number(without.mean(), 4),
            number(ate.mean() / without.mean(), 2) + interval, f"{number(ratios.median(), 2)} / {number(ratios.max(), 2)}",
            nees(both, "estimates"), number(both.resets.sum(), 0),
        ])  # fmt: skip
    head = ["variation", "flights", "ATE %", "ATE % without", "ratio of the means (95 %)", "ratio, median / worst"]
    return pipe(rows, [*head, "NEES position / tilt / yaw / velocity / steps", "resets"]) if rows else ""


def kind(variation: str) -> str:
    """Kind of the first fault that is no disturbance; empty without one."""
    kinds = re.findall(r"(?:^|&)fault=([a-z-]+)", variation)
    return next((k for k in kinds if k not in ("stamp-jitter", "frames-missing")), "")


def named_by(variation: str) -> tuple[str, ...]:
    """Health bits of which one should name the fault; none where the estimate should only stay right."""
    fits = [beginning for beginning in NAMED_BY if kind(variation).startswith(beginning)]
    return NAMED_BY[max(fits, key=len)] if fits else ()


def raised_s(row: pd.Series) -> dict[str, float]:
    """Health bits with the time at which each was set first, s: since the fault, in a flight with one."""
    for prefix in ("honesty.since_fault_s.", "honesty.first_s."):
        bits = {c.removeprefix(prefix): row[c] for c in row.index if c.startswith(prefix) and pd.notna(row[c])}
        if bits or "fault=" in row.variation:
            return bits
    return {}


def honest(table: pd.DataFrame) -> pd.Series:
    """True for the flights whose usable estimates were as good as their covariance, and did not jump."""
    sigmas = pd.concat([column(table, name) for name in SIGMAS], axis=1)
    return (sigmas.max(axis=1) <= MAX_SIGMAS) & (column(table, "honesty.jumps") == 0)


def honesty(table: pd.DataFrame) -> str:
    """Row per flight with a fault, and a sentence that sums them up."""
    table = table[table.variation.str.contains("fault=")]
    if table.empty:
        return ""
    is_honest, rows, nameable, named = honest(table), [], 0, 0
    for index, row in table.iterrows():
        names, bits = named_by(row.variation), sorted(raised_s(row).items(), key=lambda bit: bit[1])
        first = next((bit for bit in bits if bit[0] in names), None)
        nameable += bool(names)
        named += first is not None and first[1] <= MAX_NAMELESS_S
        figure = lambda name, digits, factor=1, row=row: number(factor * row.get(f"honesty.{name}", np.nan), digits)  # noqa: E731
        others = ", ".join(f"{bit} {s:.2f}" for bit, s in bits if bit not in names)
        worst = [figure(f"worst_sigmas.{name}", 1) for name in ("position", "velocity", "tilt")]
        errors = [figure("worst_usable.position", 3), figure("worst_usable.velocity", 3), figure("worst_usable.tilt", 3, 1e3)]
        rows.append([
            row.variation, row.path, row.scene, number(row.seed, 0),
            f"{first[0]} {first[1]:.2f}" if first else "never" if names else "-", others, figure("usable", 0, 100),
            " / ".join(worst), " / ".join(errors), figure("worst.position", 3), figure("jumps", 0), number(row.resets, 0),
            number(column(table, "accuracy.ate_rmse_m")[index], 4), "yes" if is_honest[index] else "NO",
        ])  # fmt: skip
    head = ["fault", "path", "scene", "seed", "named after s", "other bits, s", "usable %"]
    head += ["of these, sigma: position / velocity / tilt", "m / m/s / mrad", "worst m", "jumps", "resets", "ATE m", "honest"]
    words = f"{is_honest.sum()} of {len(table)} honest; {named} of {nameable} that a health bit can name named within {MAX_NAMELESS_S:g} s"
    return f"{pipe(rows, head)}\n\n{words}"


def naming(table: pd.DataFrame) -> str:
    """Tables of flights with drawn failures: how often each bit named the right sensor, and how each kind fared."""
    table = table[column(table, "honesty.usable").notna()]
    bits = [raised_s(row) for _, row in table.iterrows()]
    kinds = [kind(variation) or "none" for variation in table.variation]
    names = [named_by(variation) for variation in table.variation]
    rows, claims, right = [], 0, 0
    for bit in SENSOR_BITS:
        raised = [k for k, up in enumerate(bits) if bit in up]
        wrong = [k for k in raised if bit not in names[k]]
        claims, right = claims + len(raised), right + len(raised) - len(wrong)
        rows.append([bit, len(raised), len(raised) - len(wrong), share(len(raised) - len(wrong), len(raised))])
        rows[-1].append(", ".join(sorted({kinds[k] for k in wrong})))
    rows.append(["all", claims, right, share(right, claims), ""])
    text = pipe(rows, ["health bit", "flights", "right", "share", "failures it was wrong about"])
    is_honest, rows = honest(table).tolist(), []
    for name in [*sorted(set(kinds)), "all"]:
        group = [k for k, own in enumerate(kinds) if name in (own, "all")]
        nameable = [k for k in group if names[k]]
        soon = sum(any(bits[k].get(n, np.inf) <= MAX_NAMELESS_S for n in names[k]) for k in nameable)
        other = sum(any(bit in SENSOR_BITS and bit not in names[k] for bit in bits[k]) for k in group)
        rows.append([name, len(group), sum(is_honest[k] for k in group), f"{soon} of {len(nameable)}", other])
    return text + "\n\n" + pipe(rows, ["drawn", "flights", "honest", "named within 1 s", "another sensor named"])


def share(part: int, of: int) -> str:
    return f"{100 * part / of:.0f} %" if of else "-"


def health(table: pd.DataFrame) -> str:
    """Row per health bit that was set in a flight without a variation."""
    table = table[table.variation == ""]
    bits = [(c.removeprefix("health_frames."), table[c].dropna()) for c in table if c.startswith("health_frames.")]
    rows = [[name, len(frames), int(frames.sum())] for name, frames in sorted(bits, key=lambda bit: bit[0]) if len(frames)]
    return pipe(rows, ["health bit, flights without a variation", "flights", "frames"]) if rows else ""
