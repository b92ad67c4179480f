"""Flights as `plumbline replay` is asked for them, and the names by which a table pairs them."""

import itertools
import os
import re
import subprocess
from dataclasses import dataclass, replace
from pathlib import Path

from . import LabError

# Trajectories of EuRoC, and where in them the vehicle is in full flight, s.
PATHS = {"V1_02_medium": 15, "V2_02_medium": 15, "MH_04_difficult": 20, "V1_03_difficult": 15}
# Trajectories whose inertial samples were recorded, likewise.
RECORDED_PATHS = {
    "V1_01_easy": 15, "V1_02_medium": 15, "V2_01_easy": 15, "V2_02_medium": 15,
    "MH_01_easy": 50, "MH_03_medium": 25, "MH_04_difficult": 20,
}  # fmt: skip
SCENES = ("room", "hall", "low-texture")
# Start of flights along other recorded trajectories, s.
OTHER_START_S = 15


@dataclass(frozen=True)
class Flight:
    """One flight: source and options of `plumbline replay`, and what distinguishes it from its like."""

    source: str
    options: tuple[str, ...] = ()
    settings: tuple[str, ...] = ()
    variation: str = ""
    start_s: float | None = None

    @property
    def is_simulated(self) -> bool:
        return self.source.startswith("sim:")

    def arguments(self) -> list[str]:
        """Arguments of `plumbline replay`."""
        source, more = self.source, []
        if self.is_simulated:
            if self.start_s is not None:
                source = with_option(without_option(source, "start"), f"start={self.start_s:g}")
            source = with_option(source, self.variation)
        else:
            more = ["--start", f"{self.start_s:g}"] if self.start_s is not None else []
            more += [f"--{option}" for option in self.variation.split("&") if option]
        sets = [argument for setting in self.settings for argument in ("--set", setting)]
        return [source, *more, *sets, *self.options]

    def labels(self) -> dict:
        """Columns by which rows are grouped and paired."""
        option = dict(o.partition("=")[::2] for o in self.source.partition("?")[2].split("&"))
        scene = self.source.partition("?")[0].removeprefix("sim:") if self.is_simulated else ""
        path = option.get("path", "demo") if self.is_simulated else self.source
        start = option.get("start", 0) if self.start_s is None else self.start_s
        return {
            # Tables of several machines are paired, whose trajectories lie elsewhere.
            "flight": re.sub(r"path=[^&]*/", "path=", " ".join(replace(self, settings=(), variation="").arguments())),
            "path": Path(path).name.removesuffix(".tum.gz"),
            "scene": scene,
            "seed": int(option.get("seed", 1)) if self.is_simulated else None,
            "start_s": float(start),
            "variation": self.variation,
            "setting": " ".join(self.settings),
        }


def with_option(source: str, option: str) -> str:
    """Simulated flight with one more option after its question mark."""
    return source + ("&" if "?" in source else "?") + option if option else source


def without_option(source: str, name: str) -> str:
    """Simulated flight without the option `name`."""
    scene, _, options = source.partition("?")
    kept = [option for option in options.split("&") if option and option.partition("=")[0] != name]
    return with_option(scene, "&".join(kept))


def shared_folder(named: str | None) -> Path:
    """Folder of the recorded trajectories of EuRoC."""
    folder = Path(named or os.environ.get("PLUMBLINE_SHARED") or "../shared") / "euroc" / "trajectories"
    if not folder.is_dir():
        raise LabError(f"{folder}: no such folder; name the shared data with --shared or $PLUMBLINE_SHARED")
    return folder.resolve()


def chosen_paths(wanted: list[str], built_in: dict[str, int], shared: str | None) -> list[tuple[str, float]]:
    """Values of the option `path` with their starts, s. Names that are no recorded trajectory are handed to the program."""
    paths = []
    for name in wanted or [""]:
        found = [known for known in built_in if known.startswith(name)]
        if found:
            folder = shared_folder(shared)
            paths += [(str(folder / f"{known}.tum.gz"), built_in[known]) for known in found]
        elif Path(name).is_file():
            paths.append((name, OTHER_START_S))
        elif name[:1].isupper():
            file = shared_folder(shared) / f"{name}.tum.gz"
            if not file.is_file():
                raise LabError(f"--path: no trajectory '{name}', and no {file}")
            paths.append((str(file), OTHER_START_S))
        else:
            paths.append((name, 0))
    return paths


def chosen_scenes(wanted: list[str]) -> list[str]:
    """Scenes whose names begin with one of `wanted`; all without any. `far` is flown by its full name only."""
    unknown = [name for name in wanted if not any(scene.startswith(name) for scene in (*SCENES, "far"))]
    if unknown:
        raise LabError(f"--scene: no scene '{unknown[0]}'; choose {', '.join(SCENES)} or far")
    return [s for s in (*SCENES, "far") if any(s.startswith(name) for name in wanted or SCENES)]


def campaign(args) -> list[Flight]:
    """Flights of a campaign without variations: every path in every scene from every start with every seed."""
    is_recorded = args.imu == "recorded"
    paths = chosen_paths(args.path, RECORDED_PATHS if is_recorded else PATHS, args.shared)
    more = [f"scale={args.scale:g}"] if args.scale != 1 else []
    more += ["imu=recorded"] if is_recorded else []
    more += [f"calibration-error={args.calibration_error:g}"] if args.calibration_error else []
    more += [f"lean-deg={args.lean_deg:g}"] if args.lean_deg else []
    more += [f"laps={args.laps}"] if args.laps != 1 else []
    options = list(args.options)
    # The rig of a campaign does not depend on the path.
    options += [] if "--config" in options else ["--config", "euroc" if is_recorded else "sim"]
    flights = []
    for scene, (path, full_flight_s) in itertools.product(chosen_scenes(args.scene), paths):
        for start_s, seed in itertools.product(args.starts or [full_flight_s], args.seeds):
            parts = [f"path={path}", f"start={start_s:g}", f"duration={args.duration:g}", f"seed={seed}", *more]
            flights.append(Flight(f"sim:{scene}?" + "&".join(parts), tuple(options)))
    return flights


def sweep(sources, axes, seeds, starts, options) -> list[Flight]:
    """Flights of a sweep: every setting on every source with every seed from every start."""
    keys = [axis.partition("=") for axis in axes]
    bad = [axis for axis, (key, _, values) in zip(axes, keys) if not (key and values)]
    if bad:
        raise LabError(f"--set {bad[0]}: write KEY=VALUE,VALUE")
    settings = itertools.product(*([f"{key}={value}" for value in split(values)] for key, _, values in keys))
    if seeds and not any(source.startswith("sim:") for source in sources):
        raise LabError("--seeds: none of the flights is simulated; name one such as sim:room, or leave the option out")
    flights = []
    for setting, source in itertools.product(settings, sources):
        if not source.startswith("sim:") and not Path(source).exists():
            raise LabError(f"{source}: does not exist; give a data set, a log, a bag or a simulated flight such as sim:room")
        is_seeded = seeds and source.startswith("sim:")
        seeded = [with_option(without_option(source, "seed"), f"seed={seed}") for seed in seeds] if is_seeded else [source]
        for one, start_s in itertools.product(seeded, starts or [None]):
            flights.append(Flight(one, tuple(options), setting, start_s=start_s))
    return flights


def split(values: str) -> list[str]:
    """Values between commas that are in no brackets: `1,[2,3]` has two."""
    parts, depth = [""], 0
    for letter in values:
        depth += (letter in "[{") - (letter in "]}")
        if letter == "," and depth == 0:
            parts.append("")
        else:
            parts[-1] += letter
    return parts


def expanded(program: str, topic: str, wanted: list[str]) -> list[str]:
    """Names with doses as they are; `all`, and a beginning such as `accel-`, as the names that `plumbline help TOPIC` lists."""
    names = []
    for text in wanted:
        if text != "all" and not text.endswith("-"):
            names.append(text)
            continue
        listed = subprocess.run([program, "help", topic], capture_output=True, text=True, check=True).stdout
        known = re.findall(r"^  ([a-z][a-z-]+)\b", listed, re.MULTILINE)
        found = [name for name in known if text == "all" or name.startswith(text)]
        if not found:
            raise LabError(f"'{text}' begins no name of `plumbline help {topic}`: {', '.join(known)}")
        names += found
    return names

