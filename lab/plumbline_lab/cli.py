"""The command `plumbline-lab`."""

import argparse
import os
import sys
from pathlib import Path

from . import LabError

USAGE = """\
Experiments with Plumbline. Flights are flown by `plumbline replay`, many at a time, on this machine or a Dask cluster; their reports become
one table (.parquet or .csv) with a row per flight. A command that was stopped goes on where it stopped, and a flight that failed is a row
with its reason. Digests do not depend on the number of workers."""

FLIGHTS = """\
Options after `--` go to every `plumbline replay`, such as `-- --mono --config my.toml --cache FOLDER`.

Clusters: by default one flight per core of this machine. `--scheduler tcp://HOST:8786` uses a running Dask scheduler (`dask scheduler`, and
`dask worker` on every machine). `--slurm N` starts N jobs by dask-jobqueue (partition and account: ~/.config/dask/jobqueue.yaml),
`--kubernetes N` starts N pods by dask-kubernetes. Workers need this package, the program and the data at the same paths."""

CAMPAIGN = """examples:
  plumbline-lab campaign --duration 60 --seeds 1,2,3 --out clean.parquet         36 clean flights
  plumbline-lab campaign --imu recorded --duration 20                            inertial samples of a real sensor
  plumbline-lab campaign --condition people:33:1.2:4,blur:10:6 --path V1_02      every flight with and without each condition
  plumbline-lab campaign --fault accel-dead:x@10,gyro-sign:y@8 --duration 20     with a table of honesty
  plumbline-lab campaign --with 'blackout=6..7.5' --with 'fault=imu-gap@5+0.2&condition=night:20:4:8'
  plumbline-lab campaign --drawn 1000 --duration 12 --path yaws,hover            drawn failures: which health bits named them

""" + FLIGHTS

SWEEP = """examples:
  plumbline-lab sweep V1_01_easy MH_05_difficult --set estimator.points.sigma_px=0.3,0.4,0.5
  plumbline-lab sweep 'sim:room?path=demo&duration=10' --seeds 1..8 --set estimator.lines.enabled=true,false --paired
  plumbline-lab sweep MH_05_mono_clip --starts 0,0.5,1,1.5,2 -- --mono

A simulated flight is sim:room, sim:hall, sim:low-texture or sim:far; after ? stand options of `plumbline replay` without their dashes,
joined by &: sim:room?path=V1_02&imu=recorded&start=15&duration=20.

""" + FLIGHTS


def numbers(kind):
    """Parser of `1,2,5`, and of `1..3` for whole numbers."""

    def parse(text: str) -> list:
        values = []
        for part in text.split(","):
            first, dots, last = part.partition("..")
            if dots and kind is int:
                values += range(int(first), int(last) + 1)
            else:
                values.append(kind(part))
        if len(set(values)) != len(values) or not values:
            raise argparse.ArgumentTypeError(f"'{text}' has a number twice, or none")
        return values

    parse.__name__ = "list of numbers"
    return parse


def names(text: str) -> list[str]:
    return text.split(",")


def table_file(text: str) -> Path:
    if not text.endswith((".parquet", ".csv")):
        raise argparse.ArgumentTypeError(f"'{text}': name the table with the ending .parquet or .csv")
    return Path(text)


def add_cluster(parser: argparse.ArgumentParser, out: str) -> None:
    """Options of every command that flies."""
    group = parser.add_argument_group("table and cluster")
    default = f"default: {out}"
    group.add_argument("--out", type=table_file, default=Path(out), metavar="TABLE", help=f"table of the flights, .parquet or .csv; the reports are kept in a folder beside it ({default})")
    group.add_argument("--jobs", type=int, metavar="N", help="flights at a time on this machine (default: its cores)")
    group.add_argument("--scheduler", metavar="tcp://HOST:PORT", help="Dask scheduler to fly on")
    group.add_argument("--slurm", type=int, metavar="N", help="fly in N Slurm jobs (pip install 'plumbline-lab[slurm]')")
    group.add_argument("--kubernetes", type=int, metavar="N", help="fly in N pods (pip install 'plumbline-lab[kubernetes]')")
    group.add_argument("--image", metavar="IMAGE", help="with --kubernetes: container image with this package and the program")
    group.add_argument("--memory", default="1GB", help="memory of a Slurm job or pod (default: 1GB)")
    group.add_argument("--quiet", action="store_true", help="no progress bar")
    add_program(group)


def add_program(parser) -> None:
    parser.add_argument("--program", default=os.environ.get("PLUMBLINE", "plumbline"), help="the command to run (default: $PLUMBLINE, or `plumbline` from the path)")


def add_choice(parser: argparse.ArgumentParser) -> None:
    """Choice among the built-in simulated flights."""
    parser.add_argument("--path", type=names, default=[], metavar="NAME,NAME", help="only trajectories of EuRoC whose names begin so, or paths such as yaws, sweeps and hover, or TUM files (default: V1_02, V2_02, MH_04, V1_03)")
    parser.add_argument("--scene", type=names, default=[], metavar="NAME,NAME", help="only scenes whose names begin so: room, hall, low-texture, far (default: the first three)")
    parser.add_argument("--seeds", type=numbers(int), default=[1], metavar="1,2|1..3", help="seeds (default: 1)")
    parser.add_argument("--starts", type=numbers(float), default=[], metavar="S,S", help="starts on the trajectory, s (default: in full flight)")
    parser.add_argument("--duration", type=float, default=15, metavar="S", help="length of a flight, s (default: 15)")
    parser.add_argument("--scale", type=float, default=1, help="size of the images (default: 1); 0.5 renders four times as fast")
    parser.add_argument("--laps", type=int, default=1, help="laps of the path (default: 1)")
    parser.add_argument("--shared", metavar="FOLDER", help="folder with euroc/trajectories and euroc/imu (default: $PLUMBLINE_SHARED, or ../shared)")
    parser.add_argument("--imu", choices=["simulated", "recorded"], default="simulated", help="inertial samples: simulated, or recorded along the path")
    parser.add_argument("--calibration-error", type=float, default=0, metavar="K", help="the seed draws the estimator's calibration with K times the standard deviations of [rig]")
    parser.add_argument("--lean-deg", type=float, default=0, metavar="DEG", help="tilt of the whole scene")


def parser() -> argparse.ArgumentParser:
    """All commands with their options."""
    main = argparse.ArgumentParser("plumbline-lab", description=USAGE, formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = main.add_subparsers(dest="command", required=True, metavar="COMMAND")

    def command(name: str, words: str, more: str = "") -> argparse.ArgumentParser:
        raw = argparse.RawDescriptionHelpFormatter
        return commands.add_parser(name, help=words.replace("%", "%%"), description=words[0].upper() + words[1:] + ".", epilog=more, formatter_class=raw)

    one = command("campaign", "the built-in simulated flights, with and without faults and conditions", CAMPAIGN)
    add_choice(one)
    one.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", help="change of the configuration; may be repeated")
    one.add_argument("--fault", type=names, default=[], metavar="KIND,KIND", help="also fly every flight with each fault (`plumbline help faults`); accel- stands for all kinds that begin so, all for all")
    one.add_argument("--condition", type=names, default=[], metavar="NAME,NAME", help="also fly every flight in each condition (`plumbline help conditions`)")
    one.add_argument("--imu-error", type=names, default=[], metavar="NAME,NAME", help="also fly every flight with each error of the IMU (`plumbline help imu-errors`)")
    one.add_argument("--with", dest="variations", action="append", default=[], metavar="OPTION&OPTION", help="also fly every flight with these options of `plumbline replay`, without their dashes; may be repeated")
    one.add_argument("--only", action="store_true", help="leave out the flights without a variation")
    one.add_argument("--drawn", type=int, metavar="COUNT", help="fly so many flights with drawn failures instead")
    one.add_argument("--draw-seed", type=int, default=1, help="seed of the draws (default: 1)")
    one.add_argument("--against", type=Path, metavar="TABLE", help="compare with the table of an earlier build or configuration")
    add_cluster(one, "campaign.parquet")

    one = command("sweep", "settings of the configuration on data sets, recordings and simulated flights", SWEEP)
    one.add_argument("sources", nargs="+", metavar="SOURCE", help="data set, flight log, bag or simulated flight")
    one.add_argument("--set", action="append", default=[], metavar="KEY=A,B", help="key and its values; several keys are combined")
    one.add_argument("--seeds", type=numbers(int), default=[], metavar="1,2|1..3", help="seeds of simulated flights")
    one.add_argument("--starts", type=numbers(float), default=[], metavar="S,S", help="starts of every source, s")
    one.add_argument("--paired", action="store_true", help="compare every setting with the first, flight by flight")
    add_cluster(one, "sweep.parquet")

    one = command("ablation", "accuracy and times with each part of the line path: the tables of the paper", FLIGHTS)
    one.add_argument("sources", nargs="*", metavar="SOURCE", help="data sets, bags or simulated flights (default: the built-in simulated flights)")
    add_choice(one)
    add_cluster(one, "ablation.parquet")

    one = command("open-table", "the open table of EuRoC or TUM-VI, beside published figures", FLIGHTS)
    one.add_argument("folder", type=Path, help="folder that contains the data sets")
    one.add_argument("--table", type=Path, action="append", default=[], metavar="OUT.md|csv|tex", help="write the table; may be repeated")
    one.add_argument("--starts", type=numbers(float), default=[], metavar="S,S", help="starts of every data set, s (default: 0,1,2,3,4)")
    add_cluster(one, "open-table.parquet")

    one = command("compare", "paired differences of tables, settings or variations, with bootstrap intervals of 95 %")
    one.add_argument("tables", nargs="+", metavar="TABLE", help="one table, or several of the same flights; the first is the reference")
    one.add_argument("--by", choices=["setting", "variation"], default="setting", help="with one table: what is compared (default: setting)")

    one = command("honesty", "errors against covariances, and which health bits named each fault, of a table of flights")
    one.add_argument("table", type=Path, metavar="TABLE")

    one = command("plot", "picture of one flight with its errors and standard deviations, or of several", "example:\n  plumbline replay sim:room --states states.csv --true-trajectory truth.tum\n  plumbline-lab plot states.csv --truth truth.tum --out flight.svg")
    one.add_argument("files", nargs="+", type=Path, metavar="FILE", help="`replay --states` table, TUM trajectory (also .gz) or EuRoC table")
    one.add_argument("--truth", type=Path, metavar="FILE", help="ground truth: TUM (`replay --true-trajectory`), EuRoC table, or a data set")
    one.add_argument("--out", type=Path, required=True, metavar="OUT.svg|png|pdf")
    one.add_argument("--align", choices=["first", "origin", "yaw", "se3", "sim3", "none"], default="first", help="alignment of the truth (default: first pose, position and yaw)")
    one.add_argument("--time-offset", metavar="S|auto", help="addition to the stamps of the estimate; auto: where its motion is that of the truth")
    one.add_argument("--names", type=names, default=[], metavar="NAME,NAME", help="names of the flights in the picture")

    one = command("allan", "noise of an IMU from a recording at rest, by the Allan variance")
    one.add_argument("recording", type=Path, help="flight log, data set, table as mav0/imu0/data.csv, or ROS bag; two hours at rest")
    one.add_argument("--topic", help="topic of a bag (default: the only one of sensor_msgs/Imu)")
    one.add_argument("--config", type=Path, metavar="FILE", help="configuration whose other keys are copied")
    one.add_argument("--out", type=Path, metavar="OUT.toml", help="write the configuration with the measured keys of [imu]")
    one.add_argument("--inflate", type=float, default=1, metavar="K", help="factor of the white noise densities that are written (default: 1; in flight 10)")
    one.add_argument("--plot", type=Path, metavar="OUT.svg|png", help="draw the Allan deviations")

    one = command("mask", "masks of what the cameras see of their own vehicle")
    one.add_argument("recording", type=Path, help="flight log or data set in motion, half a minute through a textured scene")
    one.add_argument("--out", type=Path, required=True, metavar="FOLDER", help="folder for left-mask.png and right-mask.png")
    one.add_argument("--margin-px", type=int, default=8, help="margin around what is found (default: 8)")
    one.add_argument("--overwrite", action="store_true", help="replace existing files")

    one = command("bench", "times of a frame, of one build or of several in turns")
    one.add_argument("programs", nargs="*", metavar="PROGRAM", help="builds to compare; the first is the reference")
    one.add_argument("--rounds", type=int, default=3, help="rounds (default: 3)")
    one.add_argument("--duration", type=float, default=20, metavar="S", help="length of a flight, s (default: 20)")
    one.add_argument("--cache", type=Path, metavar="FOLDER", help="keep rendered frames here")
    one.add_argument("--out", type=table_file, metavar="TABLE", help="write all times")
    one.add_argument("--baseline", type=Path, metavar="TABLE", help="compare with times that --out wrote before")
    add_program(one)

    one = command("shuttle", "drift of a recording without ground truth: flown there and back", "Options after `--` go to both flights.")
    one.add_argument("recording", help="data set, flight log with images, or simulated flight such as 'sim:room?start=5&duration=30'")
    one.add_argument("--config", type=Path, help="configuration file or preset")
    one.add_argument("--start", type=float, default=0, metavar="S", help="start, s from the first frame")
    one.add_argument("--duration", type=float, metavar="S", help="seconds that are flown (default: to the end)")
    one.add_argument("--truth", type=Path, metavar="FILE", help="ground truth to compare with (default: that of the data set)")
    one.add_argument("--scratch", type=Path, metavar="FOLDER", help="folder for temporary files")
    one.add_argument("--json", action="store_true", help="print JSON")
    add_program(one)
    return main


def campaign(args) -> bool:
    from . import compare, draws, flights, run, summaries

    chosen = [flights.replace(flight, settings=tuple(args.set)) for flight in flights.campaign(args)]
    kinds = [("fault", "faults", args.fault), ("condition", "conditions", args.condition), ("imu-error", "imu-errors", args.imu_error)]
    variations = [f"{name}={text}" for name, topic, texts in kinds for text in flights.expanded(args.program, topic, texts)]
    varied = flights.varied(chosen, variations + args.variations)
    if args.drawn:
        chosen = draws.drawn(chosen, args.drawn, args.draw_seed)
    else:
        chosen = varied if args.only else chosen + varied
    if not chosen:
        raise LabError("--only: leaves no flight; give --fault, --condition, --imu-error or --with")
    table = run.fly_all(chosen, args, args.out)
    blocks = [summaries.flights(table)]
    clean = table[table.variation == ""]
    blocks += [summaries.means(clean, ["scene"])] if len(clean) else []
    blocks += [summaries.naming(table)] if args.drawn else [summaries.variations(table), summaries.honesty(table)]
    blocks.append(summaries.health(table))
    if args.against:
        tables, by = compare.variants({str(args.against): run.load(args.against), "here": table}, "setting")
        blocks.append(compare.markdown("here", str(args.against), *tables.values(), by))
    return say(blocks, table, args.out)


def sweep(args) -> bool:
    from . import compare, flights, run, summaries

    table = run.fly_all(flights.sweep(args.sources, args.set, args.seeds, args.starts, args.options), args, args.out)
    blocks = [summaries.flights(table), summaries.means(table, ["setting"])]
    if table.path.nunique() > 1:
        blocks.append(summaries.means(table, ["setting", "path"]))
    if args.paired:
        groups, by = compare.variants({"": table}, "setting")
        (base_name, base), *others = groups.items()
        blocks += [compare.markdown(name, base_name, base, other, by) for name, other in others]
    return say(blocks, table, args.out)


def ablation(args) -> bool:
    from . import ablation, flights, run

    bases = flights.sweep(args.sources, [], [], [], args.options) if args.sources else flights.campaign(args)
    table = run.fly_all(ablation.flights(bases), args, args.out)
    return say([ablation.tables(table)], table, args.out)


def open_table(args) -> bool:
    from . import open_table, run

    wrong = [path for path in args.table if path.suffix not in (".md", ".csv", ".tex")]
    if wrong:
        raise LabError(f"--table {wrong[0]}: name the file with the ending .md, .csv or .tex")
    table = run.fly_all(open_table.flights(args.folder, args.starts, args.options), args, args.out)
    for path in args.table:
        path.write_text(open_table.text(table, path.suffix))
    return say([open_table.text(table, ".md")], table, args.out)


def honesty(args) -> bool:
    from . import run, summaries

    table = run.load(args.table)
    blocks = [summaries.means(table, ["variation"]), summaries.honesty(table)]
    blocks += [summaries.naming(table)] if table.variation.str.contains("fault=").any() else []
    return say([*blocks, summaries.health(table)], table, args.table)


def say(blocks: list[str], table, out: Path) -> bool:
    """Prints the tables; false if a flight failed."""
    print("\n\n".join(block for block in blocks if block))
    failed = table[table.error.notna() & (table.error != "")]
    for _, row in failed.iterrows():
        print(f"failed: {row.flight} {row.variation} {row.setting}: {row.error}", file=sys.stderr)
    print(f"\n{out}: {len(table)} flights, {len(failed)} failed")
    return failed.empty


def main(arguments: list[str] | None = None) -> int:
    """Runs a command; the exit status is 0 if all flights were flown, 1 after an error, 2 for wrong arguments."""
    arguments = sys.argv[1:] if arguments is None else arguments
    own, more = arguments, []
    if "--" in arguments:
        own, more = arguments[: arguments.index("--")], arguments[arguments.index("--") + 1 :]
    args = parser().parse_args(own)
    args.options = more
    flown = {"campaign": campaign, "sweep": sweep, "ablation": ablation, "open-table": open_table, "honesty": honesty}
    try:
        if args.command in flown:
            return 0 if flown[args.command](args) else 1
        from importlib import import_module

        import_module(f".{args.command}", __package__).run(args)
    except LabError as error:
        print(f"plumbline-lab: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print("plumbline-lab: stopped; the same command goes on", file=sys.stderr)
        return 130
    return 0
