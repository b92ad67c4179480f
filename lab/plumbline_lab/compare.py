"""Paired comparisons: two variants over the same flights, and how far the mean of their differences can be trusted.

Flights differ from each other by far more than variants do; the differences on each flight do not. The interval is that of the bootstrap
over flights (Efron and Tibshirani 1993, chapter 13), with its percentiles moved outwards for few flights (Hesterberg 2015, "What teachers
should know about the bootstrap", section 5.3).
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from scipy import stats
from tabulate import tabulate

from . import LabError
from .run import load

RESAMPLINGS = 10_000
# Fewer flights than this decide nothing.
MIN_FLIGHTS = 8
NEES = ("position", "tilt", "yaw", "velocity", "steps")
# Name, column of the table, factor, decimals.
FIGURES = [
    ("ATE mm", "accuracy.ate_rmse_m", 1e3, 3),
    ("ATE %", "accuracy.ate_percent", 1, 5),
    *((f"NEES {name}", f"consistency.estimates.{name}.mean_ratio", 1, 3) for name in NEES),
    *((f"NEES {name}, odometry", f"consistency.odometry.{name}.mean_ratio", 1, 3) for name in NEES),
    ("resets", "resets", 1, 2),
]


@dataclass
class PairedDifference:
    """One figure of two variants over the same flights; intervals are of 95 %."""

    flights: int
    base_mean: float
    mean: float
    difference_95: tuple[float, float]
    ratio_95: tuple[float, float]

    @property
    def difference(self) -> float:
        return self.mean - self.base_mean

    @property
    def ratio(self) -> float:
        return self.mean / self.base_mean if self.base_mean else np.nan

    @property
    def is_significant(self) -> bool:
        """True if the interval of the difference lies on one side of zero."""
        return self.difference_95[0] > 0 or self.difference_95[1] < 0


def paired(base, other) -> PairedDifference | None:
    """Compares the figures of the same flights; `None` for fewer than two that both have."""
    base, other = np.asarray(base, float), np.asarray(other, float)
    is_known = np.isfinite(base) & np.isfinite(other)
    base, other = base[is_known], other[is_known]
    n = len(base)
    if n < 2:
        return None
    picks = np.random.default_rng(1).integers(n, size=(RESAMPLINGS, n))
    means, others = base[picks].mean(axis=1), other[picks].mean(axis=1)
    tail = stats.norm.sf(np.sqrt(n / (n - 1)) * stats.t.ppf(0.975, n - 1))
    with np.errstate(divide="ignore", invalid="ignore"):
        ratios = others / means
    interval = lambda values: tuple(np.quantile(values, [tail, 1 - tail]))  # noqa: E731
    return PairedDifference(n, base.mean(), other.mean(), interval(others - means), interval(ratios))


def markdown(name: str, base_name: str, base: pd.DataFrame, other: pd.DataFrame, by: list[str]) -> str:
    """Table of the comparison of two variants over the flights with the same columns `by`."""
    base, other = (table.drop_duplicates(by).set_index(by) for table in (base, other))
    both = base.index.intersection(other.index)
    if both.empty:
        raise LabError(f"no flight was flown by both {name} and {base_name}: source, options, seeds and starts must agree")
    flights, alone, rows = len(both), len(base) + len(other) - 2 * len(both), []
    for figure, column, unit, digits in FIGURES:
        if d := paired(*(table.loc[both].get(column, []) for table in (base, other))):
            low, high = (unit * v for v in d.difference_95)
            percent = [f"{100 * (v - 1):+.1f}" if np.isfinite(v) else "-" for v in (d.ratio, *d.ratio_95)]
            mark = "*" if d.is_significant else ""
            rows.append([
                figure, d.flights, f"{unit * d.base_mean:.{digits}f}", f"{unit * d.mean:.{digits}f}",
                f"{unit * d.difference:+.{digits}f}{mark}", f"{low:+.{digits}f} to {high:+.{digits}f}",
                percent[0], f"{percent[1]} to {percent[2]}",
            ])  # fmt: skip
    head = ["figure", "flights", base_name, name, "difference", "95 %", "ratio %", "95 %"]
    few = f"; {MIN_FLIGHTS} are needed to decide" if flights < MIN_FLIGHTS else ""
    title = f"{name} against {base_name}: {flights} flights flown by both, {alone} by one alone{few}"
    return f"{title}\n\n{tabulate(rows, head, 'pipe', disable_numparse=True)}"


def variants(tables: dict[str, pd.DataFrame], by: str) -> tuple[dict[str, pd.DataFrame], list[str]]:
    """Variants by name, the reference first, and the columns by which their flights are paired."""
    if len(tables) == 1:
        (table,) = tables.values()
        groups = {name or "as configured": group for name, group in table.groupby(by, sort=False)}
        return groups, ["flight", "setting" if by == "variation" else "variation"]
    is_one = all(table["setting"].nunique() == 1 for table in tables.values())
    return tables, ["flight", "variation"] if is_one else ["flight", "variation", "setting"]


def each(tables: dict[str, pd.DataFrame], by: str) -> list[str]:
    """Tables of every variant against the first."""
    groups, pairs = variants(tables, by)
    (base_name, base), *others = groups.items()
    if not others:
        raise LabError(f"there is only one {by}; give a second table, or one with several")
    return [markdown(name, base_name, base, other, pairs) for name, other in others]


def run(args) -> None:
    """Prints the comparisons of the tables."""
    print("\n\n".join(each({str(path): load(Path(path)) for path in args.tables}, args.by)))
