"""Flights on a cluster, and the table that they become."""

import json

import pytest
from distributed import LocalCluster

from plumbline_lab import LabError, cli, flights, run


def test_digests_do_not_depend_on_the_number_of_workers(plumbline, how, tmp_path):
    planned = flights.sweep(["sim:room?duration=1.5&scale=0.3"], ["estimator.lines.enabled=true,false"], [1, 2], [], [])
    three = run.fly_all(planned, how(plumbline, 3), tmp_path / "3.csv")
    with LocalCluster(n_workers=1, threads_per_worker=1, dashboard_address=None) as remote:
        one = run.fly_all(planned, how(plumbline, scheduler=remote.scheduler_address), tmp_path / "1.parquet")
    assert len(set(one.estimate_digest)) == 4 and list(three.estimate_digest) == list(one.estimate_digest)
    # Frames without a pose have no place in the figures, and both formats of the table hold the same.
    kept = [run.load(tmp_path / name) for name in ("3.csv", "1.parquet")]
    assert list(kept[0]["frames"]) == list(kept[1]["frames"]) == [30.0] * 4


def test_a_run_goes_on_and_a_failed_flight_is_a_row_with_its_reason(stand_in, how, tmp_path):
    args, out = how(stand_in.program), tmp_path / "out.csv"
    table = run.fly_all(flights.sweep(["sim:room", "sim:bad"], [], [1, 2], [], []), args, out)
    assert len(stand_in.flown()) == 4
    failed = table[table.error.notna()]
    assert list(failed.error) == ["plumbline: sim:bad: no such scene"] * 2
    # What was flown stays; what failed and what is new is flown.
    table = run.fly_all(flights.sweep(["sim:room", "sim:bad"], [], [1, 2, 3], [], []), args, out)
    assert len(table) == 6 and sorted(stand_in.flown()[4:]) == [
        "sim:bad?seed=1", "sim:bad?seed=2", "sim:bad?seed=3", "sim:room?seed=3",
    ]  # fmt: skip
    # Another build flies all again.
    with open(stand_in.program, "a") as file:
        file.write("# another build\n")
    run.fly_all(flights.sweep(["sim:room"], [], [1, 2, 3], [], []), args, out)
    assert len(stand_in.flown()) == 11


def test_a_report_is_written_at_once_or_not_at_all(tmp_path):
    file = tmp_path / "a.json"
    run.write(file, json.dumps({"error": None}))
    assert run.is_flown(file) and list(tmp_path.iterdir()) == [file]
    run.write(file, json.dumps({"error": "x"}))
    assert not run.is_flown(file)


def test_a_program_that_is_not_there_is_named(how, tmp_path):
    with pytest.raises(LabError, match="/nowhere/plumbline: no such program"):
        run.fly_all(flights.sweep(["sim:room"], [], [], [], []), how("/nowhere/plumbline"), tmp_path / "a.csv")


def test_commands_fly_print_and_exit(stand_in, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    common = ["--quiet", "--program", stand_in.program]
    campaign = ["campaign", "--path", "yaws,hover", "--scene", "room,low", "--seeds", "1..2", "--out", "a.csv", *common]
    assert cli.main([*campaign, "--fault", "accel-dead:x@5", "--", "--mono"]) == 0
    said = capsys.readouterr().out
    assert "| fault=accel-dead:x@5 |" in said and "16 flights, 0 failed" in said
    assert cli.main([*campaign[:-4], "b.csv", *common, "--set", "a.b=1", "--against", "a.csv", "--", "--mono"]) == 0
    assert "here against a.csv: 8 flights flown by both, 8 by one alone" in capsys.readouterr().out
    assert cli.main(["compare", "a.csv", "--by", "variation"]) == 0
    assert "fault=accel-dead:x@5 against as configured: 8 flights" in capsys.readouterr().out
    assert cli.main(["sweep", "sim:room", "sim:bad", "--out", "c.csv", *common]) == 1
    assert cli.main(["campaign", "--path", "yaws", "--with", "bad=1", "--only", "--out", "e.csv", *common]) == 1, "every flight fails"
    assert cli.main(["ablation", "sim:room", "--out", "d.csv", *common]) == 0
    assert "| demo room 1 | + length filter |" in " ".join(capsys.readouterr().out.split())
    assert cli.main(["honesty", "a.csv"]) == 0 and "0 of 8 honest" in capsys.readouterr().out
    bench = ["bench", "--rounds", "1", "--program", stand_in.program]
    assert cli.main([*bench, "--out", "bench.csv"]) == 0 and cli.main([*bench, "--baseline", "bench.csv"]) == 0
    assert "worst frame over the median frame" in capsys.readouterr().out
    assert cli.main(["compare", "nothing.csv"]) == 1
    assert "nothing.csv: no such table" in capsys.readouterr().err
    with pytest.raises(SystemExit, match="0"):
        cli.main(["--help"])


def test_the_open_table_has_medians_published_figures_and_what_is_missing(stand_in, tmp_path, capsys):
    for name in ("V1_01_easy", "copies/V1_01_easy", "machine_hall/MH_01_easy/MH_01_easy", "own"):
        for sensor in ("cam0", "imu0"):
            (tmp_path / "sets" / name / "mav0" / sensor).mkdir(parents=True)
    table = ["--table", str(tmp_path / "t.md"), "--table", str(tmp_path / "t.tex"), "--out", str(tmp_path / "t.csv")]
    assert cli.main(["open-table", str(tmp_path / "sets"), *table, "--quiet", "--program", stand_in.program]) == 0
    assert len(stand_in.flown()) == 15
    text = (tmp_path / "t.md").read_text()
    rows = [line.split("|")[1].strip() for line in text.splitlines() if line.startswith("|")]
    assert rows[2:6] == ["MH_01_easy", "V1_01_easy", "own", "mean of 2 of 11"]
    assert "Missing of EuRoC: MH_02_easy" in text and "(9 of 11)" in text and "OKVIS2-X" in text and "TUM-VI" not in text
    assert "\\begin{tabular}" in (tmp_path / "t.tex").read_text()
