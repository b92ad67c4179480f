"""Flights: their command lines and draws."""

from types import SimpleNamespace

import pytest

from plumbline_lab import LabError, draws, flights
from plumbline_lab.flights import Flight


def choice(**more):
    given = {"path": [], "scene": [], "seeds": [1], "starts": [], "duration": 15, "scale": 1, "imu": "simulated"}
    given |= {"calibration_error": 0, "lean_deg": 0, "laps": 1, "shared": None, "options": []}
    return SimpleNamespace(**given | more)


def test_a_campaign_is_every_path_in_every_scene_with_every_seed(tmp_path):
    folder = tmp_path / "euroc" / "trajectories"
    folder.mkdir(parents=True)
    chosen = flights.campaign(choice(shared=str(tmp_path), seeds=[1, 2]))
    assert len(chosen) == 24
    first = f"sim:room?path={folder}/V1_02_medium.tum.gz&start=15&duration=15&seed=1"
    assert chosen[0].arguments() == [first, "--config", "sim"]
    assert chosen[0].labels()["path"] == "V1_02_medium" and chosen[-1].labels()["start_s"] == 15
    recorded = flights.campaign(choice(shared=str(tmp_path), imu="recorded", path=["MH_01"], scene=["hall"], lean_deg=0.2))
    assert recorded[0].source.endswith("MH_01_easy.tum.gz&start=50&duration=15&seed=1&imu=recorded&lean-deg=0.2")
    with pytest.raises(LabError, match="no trajectory 'V9'"):
        flights.campaign(choice(shared=str(tmp_path), path=["V9"]))
    with pytest.raises(LabError, match="no scene 'moon'"):
        flights.campaign(choice(scene=["moon"], path=["yaws"]))
    # Built-in paths need no shared data.
    assert len(flights.campaign(choice(shared="/nowhere", path=["yaws", "hover"]))) == 6


def test_variations_settings_and_starts_become_options_of_replay(tmp_path):
    flight = Flight("sim:room?start=2&seed=3", ("--mono",), ("a.b=1",), "fault=imu-late:20&flicker", 5.0)
    assert flight.arguments() == ["sim:room?seed=3&start=5&fault=imu-late:20&flicker", "--set", "a.b=1", "--mono"]
    recording = Flight(str(tmp_path), (), (), "fault=imu-late:20", 1.5)
    assert recording.arguments() == [str(tmp_path), "--start", "1.5", "--fault=imu-late:20"]
    assert flight.labels()["flight"] == "sim:room?seed=3&start=5 --mono"


def test_a_sweep_combines_settings_sources_seeds_and_starts(tmp_path):
    planned = flights.sweep(["sim:room?seed=7", str(tmp_path)], ["a=1,2", "b=[1,2],[3]"], [1, 2], [0, 1], [])
    assert len(planned) == 4 * (4 + 2) and len({tuple(flight.arguments()) for flight in planned}) == 24
    assert planned[0].settings == ("a=1", "b=[1,2]")
    with pytest.raises(LabError, match="KEY=VALUE,VALUE"):
        flights.sweep(["sim:room"], ["a"], [], [], [])
    with pytest.raises(LabError, match="none of the flights is simulated"):
        flights.sweep([str(tmp_path)], [], [1], [], [])
    with pytest.raises(LabError, match="/nowhere: does not exist"):
        flights.sweep(["/nowhere"], [], [], [], [])


def test_draws_are_those_of_splitmix64_and_of_their_seed_alone():
    random = draws.SplitMix64(1_234_567)
    assert [random.bits() for _ in range(3)] == [6457827717110365317, 3203168211198807973, 9817491932198370423]
    sound = [Flight("sim:room?path=yaws"), Flight("sim:room?path=hover")]
    drawn = draws.drawn(sound, 400, 7)
    assert drawn == draws.drawn(sound, 400, 7) != draws.drawn(sound, 400, 8)
    assert drawn[4].source.endswith("&seed=5")
    assert all(any(f"fault={kind}" in flight.variation for flight in drawn) for kind, *_ in draws.FAMILIES)
