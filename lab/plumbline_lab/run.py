"""Flights on a Dask cluster, and the table of their reports.

Every flight is one process of `plumbline replay --report`. Its report is kept in a folder beside the table as soon as it is there, under a
key of its command line and of the build: the same command goes on where it stopped, and flies nothing twice.
"""

import contextlib
import hashlib
import json
import os
import shutil
import subprocess
import tempfile
from pathlib import Path

import pandas as pd
from tqdm import tqdm

from . import LabError
from .flights import Flight


def build(program: str) -> str:
    """Version of the program, and a digest of its file."""
    file = shutil.which(program)
    if file is None:
        raise LabError(f"{program}: no such program; name the command with --program or $PLUMBLINE")
    version = subprocess.run([file, "--version"], capture_output=True, text=True, check=True).stdout
    return f"{version.splitlines()[0]} {hashlib.sha256(Path(file).read_bytes()).hexdigest()[:16]}"


def fly(program: str, arguments: list[str]) -> dict:
    """One flight: its report, or the reason why there is none."""
    with tempfile.TemporaryDirectory(prefix="plumbline-lab-") as folder:
        file = Path(folder) / "report.json"
        command = [program, "replay", *arguments, "--threads", "1", "--report", str(file)]
        ended = subprocess.run(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
        report = json.loads(file.read_text()) if file.is_file() else None
    lines = [line for line in ended.stderr.splitlines() if line.strip()]
    reason = lines[-1] if lines else f"ended with status {ended.returncode}"
    return {"report": report, "error": reason if ended.returncode != 0 else None}


def key(arguments: list[str], build: str) -> str:
    """Name under which the report of a flight is kept."""
    return hashlib.sha256(json.dumps([arguments, build]).encode()).hexdigest()[:24]


@contextlib.contextmanager
def cluster(args):
    """Client of the cluster that the arguments describe: by default this machine, one flight per core."""
    from distributed import Client, LocalCluster

    with contextlib.ExitStack() as stack:
        if args.scheduler:
            address = args.scheduler
        elif args.slurm:
            from dask_jobqueue import SLURMCluster

            # Partition, account and further options: ~/.config/dask/jobqueue.yaml.
            address = stack.enter_context(SLURMCluster(cores=1, processes=1, memory=args.memory))
            address.scale(jobs=args.slurm)
        elif args.kubernetes:
            from dask_kubernetes.operator import KubeCluster

            limits = {"limits": {"cpu": "1", "memory": args.memory.replace("GB", "G")}}
            address = stack.enter_context(
                KubeCluster(name="plumbline-lab", image=args.image, n_workers=args.kubernetes, resources=limits)
            )
        else:
            jobs = args.jobs or len(os.sched_getaffinity(0))
            # A thread of a worker waits for its process: flights share nothing.
            here = {"dashboard_address": "127.0.0.1:0", "worker_dashboard_address": "127.0.0.1:0"}
            address = stack.enter_context(LocalCluster(n_workers=1, threads_per_worker=jobs, processes=False, **here))
        yield stack.enter_context(Client(address))


def fly_all(flights: list[Flight], args, out: Path) -> pd.DataFrame:
    """Flies what is missing in the folder beside `out`, writes the table, and returns it with a row per flight."""
    from distributed import as_completed

    if not flights:
        raise LabError("there is no flight to fly; give --fault, --condition, --imu-error or --with beside --only")
    folder = out.with_suffix(".reports")
    folder.mkdir(parents=True, exist_ok=True)
    with cluster(args) as client:
        version = client.submit(build, args.program, pure=False).result()
        files = [folder / f"{key(flight.arguments(), version)}.json" for flight in flights]
        missing = {file: flight for file, flight in zip(files, flights) if not is_flown(file)}
        bar = tqdm(total=len(flights), initial=len(flights) - len(missing), unit="flight", disable=args.quiet or None)
        futures = {client.submit(fly, args.program, flight.arguments(), pure=False): file for file, flight in missing.items()}
        for future in as_completed(futures):
            file = futures[future]
            lost = future.exception()
            result = {"report": None, "error": f"worker lost: {lost}"} if lost else future.result()
            result |= {"arguments": missing[file].arguments(), "build": version}
            write(file, json.dumps(result))
            bar.update()
            if result["error"] and not args.quiet:
                bar.write(f"{' '.join(result['arguments'])}: {result['error']}")
            future.release()
        bar.close()
    table = tabulated(flights, files)
    save(table, out)
    return table


def is_flown(file: Path) -> bool:
    """True if the report of the flight is there. A flight that failed is flown again."""
    return file.is_file() and not json.loads(file.read_text())["error"]


def write(file: Path, text: str) -> None:
    """Writes a file at once or not at all."""
    new = file.with_suffix(".new")
    new.write_text(text)
    new.replace(file)


def tabulated(flights: list[Flight], files: list[Path]) -> pd.DataFrame:
    """Row per flight: labels, error, and all figures of the report under their names in it, such as `accuracy.ate_rmse_m`."""
    rows = []
    for flight, file in zip(flights, files):
        kept = json.loads(file.read_text())
        report = pd.json_normalize(kept["report"] or {}).to_dict("records")
        figures = {name: value for row in report for name, value in row.items() if not isinstance(value, list)}
        rows.append(flight.labels() | {"key": file.stem, "build": kept["build"], "error": kept["error"]} | figures)
    return pd.DataFrame(rows)


def save(table: pd.DataFrame, out: Path) -> None:
    """Writes a table as its ending says."""
    if out.suffix == ".parquet":
        table.to_parquet(out, index=False)
    else:
        table.to_csv(out, index=False)


def load(path: Path) -> pd.DataFrame:
    """Reads a table that :func:`save` wrote."""
    if not path.is_file():
        raise LabError(f"{path}: no such table; give a file that a command of plumbline-lab wrote with --out")
    table = pd.read_parquet(path) if path.suffix == ".parquet" else pd.read_csv(path)
    if "flight" not in table:
        raise LabError(f"{path}: has no column `flight`; give a table that a command of plumbline-lab wrote with --out")
    for name in table.columns.intersection(["variation", "setting", "scene", "error"]):
        table[name] = table[name].astype(object).where(table[name].notna(), "")
    return table
