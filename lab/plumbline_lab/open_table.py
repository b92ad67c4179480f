"""The open table of EuRoC or TUM-VI: a row per sequence with medians over its starts, what others published, and what is missing."""

import sys
from pathlib import Path

import pandas as pd
import tomlkit
from tabulate import tabulate

from . import LabError
from .compare import NEES
from .flights import Flight
from .summaries import column, failed, number

STARTS_S = (0, 1, 2, 3, 4)
# Archives of EuRoC unpack into `machine_hall/MH_01_easy/MH_01_easy/mav0`.
DEPTH = 4
RATE_HZ = 20
# Least share of a sequence's length that counts as the whole; the worst of them lacks a sixth of its frames.
WHOLE = 0.75
# Head, column, factor, decimals; medians, but the longest frame of all.
COLUMNS = [
    ("path m", "accuracy.distance_m", 1, 1),
    ("causal ATE m", "accuracy.ate_rmse_m", 1, 4),
    ("final ATE m", "places.ate_final_rmse_m", 1, 4),
    ("coverage %", "completion", 100, 1),
    ("RPE 1 s m", "accuracy.rpe_1s_m", 1, 4),
    *((f"NEES {name}", f"consistency.estimates.{name}.mean_ratio", 1, 2) for name in NEES),
    ("frame ms p50", "frame_cpu_ms.p50", 1, 1),
    ("frame ms p99", "frame_cpu_ms.p99", 1, 1),
    ("frame ms max", "frame_cpu_ms.max", 1, 1),
    ("resets", "resets", 1, 0),
]
LONGEST, ERRORS = "frame_cpu_ms.max", ("accuracy.ate_rmse_m", "places.ate_final_rmse_m")
MEANING = (
    "ATE: root mean square position error after SE(3) alignment; causal: each pose when its frame came, without loops; final: as known "
    "at the end, with loops. Coverage: frames with a pose. RPE: over each second. NEES over its expectation: 1 is honest. Frames: "
    "processor time of one thread. Digest: of all estimates from the first start."
)


def data_sets(folder: Path) -> list[Path]:
    """Data sets in ASL format (EuRoC, TUM-VI) in the folder and below, each name once."""
    found = {}
    for depth in range(DEPTH + 1):
        for mav0 in sorted(folder.glob("*/" * depth + "mav0")):
            if all((mav0 / name).is_dir() for name in ("cam0", "imu0")):
                name = mav0.parent.resolve().name
                if found.setdefault(name, mav0.parent) != mav0.parent:
                    print(f"{mav0.parent}: left out, because {found[name]} has the same name", file=sys.stderr)
    if not found:
        raise LabError(f"{folder}: contains no data set (mav0/cam0 and mav0/imu0); name the folder that contains the sequences")
    return [found[name] for name in sorted(found)]


def flights(folder: Path, starts: list[float], options: list[str]) -> list[Flight]:
    """Every data set from every start."""
    sets = [str(path.resolve()) for path in data_sets(folder)]
    return [Flight(path, tuple(options), start_s=start_s) for path in sets for start_s in starts or STARTS_S]


def suites() -> list[dict]:
    """Public data sets, their sequences, and what others have published on them."""
    known = tomlkit.parse(Path(__file__).with_name("published.toml").read_text()).unwrap()["suite"]
    return [suite | {"sequences": dict(suite["sequences"])} for suite in known]


def row(name: str, group: pd.DataFrame, length_s: float | None) -> dict:
    """Figures of a sequence over its starts, and its label."""
    flown = group[~failed(group)]
    figures = {}
    for head, source, factor, _ in COLUMNS:
        values = factor * column(flown, source)
        figures[head] = values.max() if source == LONGEST else values.median()
    reached_s = (column(group, "frames") / RATE_HZ + group.start_s).max()
    is_part = bool(length_s) and reached_s < WHOLE * length_s
    label = f"{name} (part of {reached_s:.0f} s)" if is_part else name
    count = str(len(flown)) if len(flown) == len(group) else f"{len(flown)} of {len(group)}"
    digest = flown.estimate_digest.iloc[0][:16] if len(flown) else ""
    return {"name": name, "is_part": is_part, "sequence": label, "flights": count} | figures | {"digest": digest}


def rows(table: pd.DataFrame) -> tuple[pd.DataFrame, list[dict]]:
    """Row per sequence in the order of its suite, then the means of each suite; and the suites of which there is a sequence."""
    known = suites()
    lengths = {sequence: length for suite in known for sequence, length in suite["sequences"].items()}
    order = list(lengths)
    found = [row(name, group, lengths.get(name)) for name, group in table.groupby("path", sort=True)]
    found.sort(key=lambda r: (order.index(r["name"]) if r["name"] in order else len(order), r["name"]))
    present = [suite for suite in known if any(r["name"] in suite["sequences"] for r in found)] or known
    table = pd.DataFrame(found)
    for suite in present:
        whole = table[table.name.isin(suite["sequences"]) & ~table.is_part.astype(bool)]
        if len(whole):
            mean = {"name": "", "sequence": f"mean of {len(whole)} of {len(suite['sequences'])}", "flights": "", "digest": ""}
            for head, source, *_ in COLUMNS:
                # A mean over some of the sequences would look like that of all.
                is_known = source not in ERRORS or whole[head].notna().all()
                mean[head] = (whole[head].max() if source == LONGEST else whole[head].mean()) if is_known else float("nan")
            table = pd.concat([table, pd.DataFrame([mean])], ignore_index=True)
    return table, present


def text(table: pd.DataFrame, suffix: str) -> str:
    """The table as Markdown, CSV or LaTeX."""
    figures, present = rows(table)
    if suffix == ".csv":
        return figures[figures.name != ""].drop(columns=["name", "is_part"]).to_csv(index=False)
    style, heading, remark = ("latex", "% ", "% ") if suffix == ".tex" else ("pipe", "## ", "")
    head = ["sequence", "flights", *(head for head, *_ in COLUMNS), "digest"]
    cells = [
        [r["sequence"], r["flights"], *(number(r[name], digits) for name, _, _, digits in COLUMNS), r["digest"]]
        for r in figures.to_dict("records")
    ]
    starts = ", ".join(f"{s:g}" for s in sorted(table.start_s.unique()))
    setting = table.setting.iloc[0] or "as configured"
    lines = [
        tabulate(cells, head, style, disable_numparse=True),
        f"{remark}Medians over flights from {starts} s (the longest frame: of all), {setting}, by {table.build.iloc[0]}. {MEANING}",
    ]
    for suite in present:
        published = [[f["system"], f"{f['ate_m']:.3f}", f["trajectory"], f["conditions"], f["source"]] for f in suite["published"]]
        names = ["system", "ATE m", "trajectory", "conditions", "source"]
        lines.append(f"{heading}{suite['name']}: published by others, mean of {suite['mean_of']}")
        lines.append(tabulate(published, names, style, disable_numparse=True))
        whole = set(figures.name[~figures.is_part.eq(True)])
        missing = [name for name in suite["sequences"] if name not in whole]
        if missing:
            listed = "all" if len(missing) == len(suite["sequences"]) else ", ".join(missing)
            of = f"({len(missing)} of {len(suite['sequences'])})"
            lines.append(f"{remark}Missing of {suite['name']}: {listed} {of}. Available at: {suite['available_at']}.")
    return "\n\n".join(lines) + "\n"
