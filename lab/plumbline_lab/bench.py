"""Times of a frame on simulated scenes, of one build or of several in turns: what slows one round slows every build of it."""

import tempfile

import pandas as pd
from tqdm import tqdm

from . import LabError
from .flights import SCENES
from .run import fly, load, save
from .summaries import number, pipe

# The vehicle is in full flight from here on, s.
START_S = 3
FIGURES = ("p50", "p95", "p99", "max")


def measure(programs: list[str], rounds: int, duration_s: float, cache: str) -> pd.DataFrame:
    """Row per build, round, scene and stage: processor time in ms."""
    rows = []
    turns = [(turn, scene, program) for turn in range(rounds) for scene in SCENES for program in programs]
    for turn, scene, program in tqdm(turns, unit="flight", disable=None):
        result = fly(program, [f"sim:{scene}?start={START_S}&duration={duration_s:g}", "--cache", cache])
        if result["error"]:
            raise LabError(f"{program}: {scene}: {result['error']}")
        report = result["report"]
        stages = {"frame": report["frame_cpu_ms"], "frame (wall)": report["frame_ms"], **report["stage_ms"]}
        rows += [
            {"flight": scene, "program": program, "round": turn, "stage": stage, **{name: times[name] for name in FIGURES}}
            for stage, times in stages.items()
        ]
    return pd.DataFrame(rows)


def text(table: pd.DataFrame) -> str:
    """Medians over the rounds, with the ratios to the first build."""
    medians = table.groupby(["flight", "stage", "program"], sort=False)[list(FIGURES)].median()
    programs, rows = list(table.program.unique()), []
    for scene, stage in dict.fromkeys(key[:2] for key in medians.index):
        base = medians.loc[(scene, stage, programs[0])]
        for program in programs:
            if (scene, stage, program) not in medians.index:
                continue
            times = medians.loc[(scene, stage, program)]
            ratios = [number(times[name] / base[name], 3) if base[name] > 0 else "-" for name in ("p50", "p99")]
            rows.append([scene, stage, program, *(number(times[name], 3) for name in FIGURES), *ratios])
    frames = medians.xs("frame", level="stage").loc[(slice(None), programs[0]), :]
    worst = f"worst frame over the median frame: {frames['max'].max() / frames['p50'].median():.2f} ({programs[0]})"
    return pipe(rows, ["scene", "stage, ms", "build", *FIGURES, "p50 ratio", "p99 ratio"]) + "\n\n" + worst


def run(args) -> None:
    """Measures the builds, or adds a table that was measured before as the first."""
    programs = args.programs or [args.program]
    with tempfile.TemporaryDirectory(prefix="plumbline-bench-") as scratch:
        table = measure(programs, args.rounds, args.duration, str(args.cache or scratch))
    if args.out:
        save(table, args.out)
    if args.baseline:
        before = load(args.baseline)
        table = pd.concat([before.assign(program=str(args.baseline)), table], ignore_index=True)
    print(text(table))
