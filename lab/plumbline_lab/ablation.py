"""What each part of the line path brings, as the two tables of the paper, and what loops and the end of the flight add."""

import itertools
from dataclasses import replace

import numpy as np
import pandas as pd

from .flights import Flight
from .summaries import column, number, pipe

NO_PLACES = "estimator.places.enabled=false"
FILTER = "estimator.lines.length_filter"
# The odometry is the same with and without places: only the last variant makes a map.
VARIANTS = {
    "points": ("estimator.lines.enabled=false", NO_PLACES),
    "+ raw segments": (f"{FILTER}=false", NO_PLACES),
    "+ length filter": (f"{FILTER}=true",),
}
STAGES = ("extract", "describe", "match")


def flights(bases: list[Flight]) -> list[Flight]:
    """Every flight in every variant."""
    return [replace(flight, settings=settings) for settings, flight in itertools.product(VARIANTS.values(), bases)]


def tables(table: pd.DataFrame) -> str:
    """The paper's tables 1 (segments and times) and 2 (errors)."""
    names = {" ".join(settings): name for name, settings in VARIANTS.items()}
    table = table.assign(variant=table.setting.map(names))
    segments, errors = [], []
    for _, group in table.groupby("flight", sort=False):
        rows = group.set_index("variant")
        label = " ".join(str(part) for part in rows.iloc[0][["path", "scene"]] if part)
        label += f" {rows.seed.iloc[0]:.0f}" if pd.notna(rows.seed.iloc[0]) else ""
        for name in list(VARIANTS)[1:]:
            times = [column(rows, f"stage_ms.lines_{stage}.p50").get(name, np.nan) for stage in STAGES]
            figures = [number(time, 2) for time in (*times, sum(times))]
            segments.append([label, name, number(column(rows, "lines.kept").get(name, np.nan), 0), *figures])
        ates = [column(rows, "ate_rmse_m").get(name, np.nan) for name in VARIANTS]
        last = rows.loc[["+ length filter"]]
        # Without a loop the map adds nothing.
        has_loops = column(last, "places.loops_used").iloc[0] > 0
        of_map = [column(last, f"places.ate_{kind}_rmse_m").iloc[0] if has_loops else np.nan for kind in ("map", "final")]
        errors.append([label, *ates, *of_map])
    head = [*VARIANTS, "+ loops, as flown", "as known at the end"]
    known = pd.DataFrame(errors, columns=["flight", *head]).dropna(subset=list(VARIANTS), how="all").dropna(axis=1, how="all")
    text = pipe(segments, ["flight", "variant", "segments", *(f"{stage} ms" for stage in STAGES), "sum ms"])
    if known.empty:
        return text
    rows = [[row.iloc[0], *(number(ate, 4) for ate in row.iloc[1:])] for _, row in known.iterrows()]
    means = known.iloc[:, 1:].mean()
    rows.append(["mean", *(f"{mean:.4f} ({100 * (mean / means.iloc[0] - 1):+.0f} %)" for mean in means)])
    return f"{text}\n\n{pipe(rows, ['ATE RMSE m', *known.columns[1:]])}"
