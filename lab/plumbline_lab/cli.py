"""The command `plumbline-lab`."""

import argparse
import os
import sys
from dataclasses import replace
from importlib import import_module
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
  plumbline-lab campaign --sound 200 --duration 30 --scale 0.5                   sound flights: false alarms

""" + FLIGHTS

SWEEP = """examples:
  plumbline-lab sweep V1_01_easy MH_05_difficult --set estimator.points.sigma_px=0.3,0.4,0.5
  plumbline-lab sweep 'sim:room?path=demo&duration=10' --seeds 1..8 --set estimator.lines.enabled=true,false --paired
  plumbline-lab sweep MH_05_mono_clip --starts 0,0.5,1,1.5,2 -- --mono

A simulated flight is sim:room, sim:hall, sim:low-texture or sim:far; after ? stand options of `plumbline replay` without their dashes,
joined by &: sim:room?path=V1_02&imu=recorded&start=15&duration=20.

""" + FLIGHTS


PLOT = """example:
  plumbline replay sim:room --states states.csv --true-trajectory truth.tum
  plumbline-lab plot states.csv --truth truth.tum --out flight.svg"""


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


def add(parser, *options: str, **more) -> None:
    """Adds options that are written as `--name METAVAR: help (default: value)`."""
    for option in options:
        form, _, words = option.partition(": ")
        name, _, metavar = form.partition(" ")
        default = more.get("default")
        words += f" (default: {default})" if isinstance(default, int | float | str) else ""
        shown = {} if not metavar else {"metavar": metavar}
        parser.add_argument(name, help=words.replace("%", "%%"), **shown, **more)


def add_cluster(parser: argparse.ArgumentParser, out: str) -> None:
    """Options of every command that flies."""
    group = parser.add_argument_group("table and cluster")
    add(group, "--out TABLE: table, .parquet or .csv; reports are kept in a folder beside it", type=table_file, default=out)
    add(group, "--jobs N: flights at a time on this machine; by default as many as it has cores", type=int)
    add(group, "--scheduler tcp://HOST:PORT: Dask scheduler to fly on", "--image IMAGE: image of the pods: this package and the program")
    add(group, "--slurm N: fly in N Slurm jobs", "--kubernetes N: fly in N pods", type=int)
    add(group, "--memory SIZE: memory of a Slurm job or pod", default="1GB")
    add(group, "--quiet: no progress bar", action="store_true")
    add_program(group)


def add_program(parser) -> None:
    add(parser, "--program COMMAND: the program, as $PLUMBLINE names it", default=os.environ.get("PLUMBLINE", "plumbline"))


def add_choice(parser: argparse.ArgumentParser) -> None:
    """Choice among the built-in simulated flights."""
    words = "trajectories of EuRoC whose names begin so, paths such as yaws, or TUM files; by default V1_02, V2_02, MH_04 and V1_03"
    add(parser, f"--path NAME,NAME: {words}", type=names, default=[])
    add(parser, "--scene NAME,NAME: scenes whose names begin so; by default room, hall and low-texture", type=names, default=[])
    add(parser, "--seeds 1,2|1..3: seeds; by default 1", type=numbers(int), default=[1])
    add(parser, "--starts S,S: starts on the trajectory, s; by default in full flight", type=numbers(float), default=[])
    add(parser, "--duration S: length of a flight, s", type=float, default=15)
    add(parser, "--scale K: size of the images; 0.5 renders four times as fast", type=float, default=1)
    add(parser, "--laps N: laps of the path", type=int, default=1)
    add(parser, "--shared FOLDER: folder with euroc/trajectories and euroc/imu; by default $PLUMBLINE_SHARED, or ../shared")
    add(parser, "--imu: inertial samples, simulated or recorded along the path", choices=["simulated", "recorded"], default="simulated")
    add(parser, "--calibration-error K: draw the estimator's calibration with K times the sigmas of [rig]", type=float, default=0)
    add(parser, "--lean-deg DEG: tilt of the whole scene", type=float, default=0)


def parser() -> argparse.ArgumentParser:
    """All commands with their options."""
    raw = {"formatter_class": argparse.RawDescriptionHelpFormatter}
    main = argparse.ArgumentParser("plumbline-lab", description=USAGE, **raw)
    commands = main.add_subparsers(dest="command", required=True, metavar="COMMAND")

    def command(name: str, words: str, more: str = "") -> argparse.ArgumentParser:
        text = words.replace("%", "%%")
        return commands.add_parser(name, help=text, description=text[0].upper() + text[1:] + ".", epilog=more, **raw)

    one = command("campaign", "the built-in simulated flights, with and without faults and conditions", CAMPAIGN)
    add_choice(one)
    add(one, "--set KEY=VALUE: change of the configuration; may be repeated", action="append", default=[])
    for name in ("fault", "condition", "imu-error"):
        words = f"also fly every flight with each (`plumbline help {name}s`); accel- is all that begin so, all is all"
        add(one, f"--{name} NAME[:DOSE],...: {words}", type=names, default=[])
    words = "also fly every flight with these options of `plumbline replay`, without their dashes; may be repeated"
    add(one, f"--with OPTION&OPTION: {words}", dest="variations", action="append", default=[])
    add(one, "--only: leave out the flights without a variation", action="store_true")
    add(one, "--drawn COUNT: fly so many flights with drawn failures instead", type=int)
    add(one, "--sound COUNT: fly so many sound flights along drawn paths instead, to count false alarms", type=int)
    add(one, "--draw-seed N: seed of the draws", type=int, default=1)
    add(one, "--against TABLE: compare with the table of another build or configuration", type=Path)
    add_cluster(one, "campaign.parquet")

    one = command("sweep", "settings of the configuration on data sets, recordings and simulated flights", SWEEP)
    add(one, "sources SOURCE: data set, flight log, bag or simulated flight", nargs="+")
    add(one, "--set KEY=A,B: key and its values; several keys are combined", action="append", default=[])
    add(one, "--seeds 1,2|1..3: seeds of simulated flights", type=numbers(int), default=[])
    add(one, "--starts S,S: starts of every source, s", type=numbers(float), default=[])
    add(one, "--paired: compare every setting with the first, flight by flight", action="store_true")
    add_cluster(one, "sweep.parquet")

    one = command("ablation", "accuracy and times with each part of the line path: the tables of the paper", FLIGHTS)
    add(one, "sources SOURCE: data sets, bags or simulated flights; by default the built-in ones", nargs="*")
    add_choice(one)
    add_cluster(one, "ablation.parquet")

    one = command("open-table", "the open table of EuRoC or TUM-VI, beside published figures", FLIGHTS)
    add(one, "folder: folder that contains the data sets", type=Path)
    add(one, "--table OUT.md|csv|tex: write the table; may be repeated", type=Path, action="append", default=[])
    add(one, "--starts S,S: starts of every data set, s; by default 0,1,2,3,4", type=numbers(float), default=[])
    add_cluster(one, "open-table.parquet")

    one = command("compare", "paired differences of tables, settings or variations, with intervals of 95 %")
    add(one, "tables TABLE: one table, or several of the same flights; the first is the reference", nargs="+")
    add(one, "--by: with one table: what is compared", choices=["setting", "variation"], default="setting")

    one = command("honesty", "errors against covariances, and which health bits named each fault, of a table of flights")
    add(one, "table TABLE: table that `campaign` wrote", type=Path)

    one = command("plot", "picture of one flight with its errors and standard deviations, or of several", PLOT)
    add(one, "files FILE: table of `replay --states`, TUM trajectory (also .gz) or EuRoC table", nargs="+", type=Path)
    add(one, "--truth FILE: truth: TUM (`replay --true-trajectory`), EuRoC table or data set", type=Path)
    add(one, "--out OUT.svg|png|pdf: picture", type=Path, required=True)
    alignments = ["first", "se3", "sim3", "none"]
    add(one, "--align: alignment of the truth; first: position and yaw of the first pose", choices=alignments, default="first")
    add(one, "--time-offset S|auto: addition to the stamps of the estimate; auto: where its motion is that of the truth")
    add(one, "--names NAME,NAME: names of the flights in the picture", type=names, default=[])

    one = command("allan", "noise of an IMU from a recording at rest, by the Allan variance")
    add(one, "recording: flight log, data set, table as mav0/imu0/data.csv, or ROS bag; two hours at rest", type=Path)
    add(one, "--topic TOPIC: topic of a bag; by default the only one of sensor_msgs/Imu")
    add(one, "--config FILE: configuration whose other keys are copied", "--out OUT.toml: write it with the measured keys of [imu]",
        "--plot OUT.svg|png: draw the Allan deviations", type=Path)  # fmt: skip
    add(one, "--inflate K: factor of the white noise densities that are written; in flight 10", type=float, default=1)

    one = command("mask", "masks of what the cameras see of their own vehicle")
    add(one, "recording: flight log or data set in motion, half a minute through a textured scene", type=Path)
    add(one, "--out FOLDER: folder for left-mask.png and right-mask.png", type=Path, required=True)
    add(one, "--margin-px PX: margin around what is found", type=int, default=8)
    add(one, "--overwrite: replace existing files", action="store_true")

    one = command("knock", "copy of a data set whose cameras are turned on the body, drawn in angle, axis and moment")
    add(one, "dataset: data set in ASL layout, of 20 s or more", type=Path)
    add(one, "--out FOLDER: folder of the copy", type=Path, required=True)
    add(one, "--draw N: number of the draw; odd ones go to and fro", type=int, default=0)

    one = command("bench", "times of a frame, of one build or of several in turns")
    add(one, "programs PROGRAM: builds to compare; the first is the reference", nargs="*")
    add(one, "--rounds N: rounds", type=int, default=3)
    add(one, "--duration S: length of a flight, s", type=float, default=20)
    add(one, "--cache FOLDER: keep rendered frames here", "--baseline TABLE: times that --out wrote before, as the reference", type=Path)
    add(one, "--out TABLE: write all times", type=table_file)
    add_program(one)

    one = command("shuttle", "drift of a recording without ground truth: flown there and back", "Options after `--` go to both flights.")
    add(one, "recording: data set, flight log with images, or simulated flight such as 'sim:room?start=5&duration=30'")
    add(one, "--config FILE: configuration", "--truth FILE: truth; by default that of the data set", type=Path)
    add(one, "--start S: start, s from the first frame", type=float, default=0)
    add(one, "--duration S: seconds that are flown; by default to the end", type=float)
    add(one, "--scratch FOLDER: folder for temporary files")
    add(one, "--json: print JSON", action="store_true")
    add_program(one)
    return main


def campaign(args):
    """Flies the campaign; returns the tables to print, and the table of the flights."""
    from . import compare, draws, flights, paths, run, summaries

    chosen = [replace(flight, settings=tuple(args.set)) for flight in flights.campaign(args)]
    kinds = [("fault", args.fault), ("condition", args.condition), ("imu-error", args.imu_error)]
    variations = [f"{kind}={text}" for kind, texts in kinds for text in flights.expanded(args.program, f"{kind}s", texts)]
    varied = [replace(flight, variation=variation) for variation in variations + args.variations for flight in chosen]
    if args.drawn:
        chosen = draws.drawn(chosen, args.drawn, args.draw_seed)
    elif args.sound:
        chosen = paths.sound(args.sound, args.draw_seed, args, args.out.with_suffix(".paths"))
    else:
        chosen = varied if args.only else chosen + varied
    table = run.fly_all(chosen, args, args.out)
    blocks = [summaries.flights(table), summaries.means(table[table.variation == ""], ["scene"])]
    blocks += [summaries.naming(table)] if args.drawn else [summaries.variations(table), summaries.honesty(table)]
    blocks.append(summaries.health(table))
    if args.against:
        tables, by = compare.variants({str(args.against): run.load(args.against), "here": table}, "setting")
        blocks.append(compare.markdown("here", str(args.against), *tables.values(), by))
    return blocks, table


def sweep(args):
    """Flies the sweep; as :func:`campaign`."""
    from . import compare, flights, run, summaries

    table = run.fly_all(flights.sweep(args.sources, args.set, args.seeds, args.starts, args.options), args, args.out)
    blocks = [summaries.flights(table), summaries.means(table, ["setting"])]
    blocks += [summaries.means(table, ["setting", "path"])] if table.path.nunique() > 1 else []
    return blocks + (compare.each({"": table}, "setting") if args.paired else []), table


def ablation(args):
    """Flies the ablation; as :func:`campaign`."""
    from . import ablation, flights, run

    bases = flights.sweep(args.sources, [], [], [], args.options) if args.sources else flights.campaign(args)
    table = run.fly_all(ablation.flights(bases), args, args.out)
    return [ablation.tables(table)], table


def open_table(args):
    """Flies the data sets and writes the open table; as :func:`campaign`."""
    from . import open_table, run

    wrong = [path for path in args.table if path.suffix not in (".md", ".csv", ".tex")]
    if wrong:
        raise LabError(f"--table {wrong[0]}: name the file with the ending .md, .csv or .tex")
    table = run.fly_all(open_table.flights(args.folder, args.starts, args.options), args, args.out)
    for path in args.table:
        path.write_text(open_table.text(table, path.suffix))
    return [open_table.text(table, ".md")], table


def honesty(args):
    """Judges a table; as :func:`campaign`."""
    from . import run, summaries

    table, args.out = run.load(args.table), args.table
    judged = [summaries.honesty(table), summaries.naming(table)] if table.variation.str.contains("fault=").any() else []
    return [summaries.means(table, ["variation"]), *judged, summaries.health(table)], table


def main(arguments: list[str] | None = None) -> int:
    """Runs a command; the exit status is 0 if all flights were flown, 1 after an error, 2 for wrong arguments."""
    arguments = sys.argv[1:] if arguments is None else arguments
    end = arguments.index("--") if "--" in arguments else len(arguments)
    args = parser().parse_args(arguments[:end])
    args.options = arguments[end + 1 :]
    flown = {"campaign": campaign, "sweep": sweep, "ablation": ablation, "open-table": open_table, "honesty": honesty}
    try:
        if args.command not in flown:
            import_module(f".{args.command}", __package__).run(args)
            return 0
        blocks, table = flown[args.command](args)
    except LabError as error:
        print(f"plumbline-lab: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print("plumbline-lab: stopped; the same command goes on", file=sys.stderr)
        return 130
    print("\n\n".join(block for block in blocks if block))
    failed = table[table.error.notna() & (table.error != "")]
    for row in failed.itertuples():
        print(f"failed: {row.flight} {row.variation} {row.setting}: {row.error}", file=sys.stderr)
    print(f"\n{args.out}: {len(table)} flights, {len(failed)} failed")
    return 0 if failed.empty else 1
