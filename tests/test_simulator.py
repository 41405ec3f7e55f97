"""onebit-sim as a user meets it: files, options, determinism, replay, both bus models."""

import math
import re

import pytest
import yaml
from simulator import SCENARIOS, call, rows, run, summary

KEYS = [
    "scenario", "arith", "runs", "steps", "seed", "mse", "mse_se", "estimate_mse",
    "average_error", "slope", "slope_window", "frames", "late_frames", "wire_bits", "bus_load",
    "latency_mean", "latency_max", "seconds",
]  # fmt: skip
ARITHMETICS = ["f64", "f32", "q31"]


def variant(tmp_path, name, **sections):
    """A scenario file of the tree with some sections' keys replaced."""
    content = yaml.safe_load((SCENARIOS / f"{name}.yaml").read_text())
    for section, keys in sections.items():
        if isinstance(keys, dict):
            content.setdefault(section, {}).update(keys)
        else:
            content[section] = keys
    path = tmp_path / f"{name}-variant.yaml"
    path.write_text(yaml.safe_dump(content))
    return path


def test_files_of_a_run(tmp_path):
    run(SCENARIOS / "aircraft-fixed.yaml", runs=3, steps=1000, out=tmp_path / "new/folder")
    folder = tmp_path / "new/folder"
    assert sorted(path.name for path in folder.iterdir()) == [
        "mse.csv",
        "summary.json",
        "trajectory.csv",
    ]
    result = summary(folder)
    assert list(result) == KEYS
    assert (result["arith"], result["runs"], result["steps"], result["seed"]) == ("f64", 3, 1000, 1)
    assert result["slope_window"] == [100, 1000]

    mse = rows(folder / "mse.csv")
    assert list(mse[0]) == ["step", "t", "mse", "mse_se", "estimate_mse", "average_error"]
    steps = [int(row["step"]) for row in mse]
    wanted = sorted({0, 1000} | {round(10 ** (j / 20)) for j in range(61)})
    assert steps == wanted
    assert all(int(row["t"]) == 10 + 1 + int(row["step"]) for row in mse)
    for key in ("mse", "mse_se", "estimate_mse", "average_error"):
        assert float(mse[-1][key]) == pytest.approx(result[key], rel=1e-14)  # 15 digits in JSON

    trajectory = rows(folder / "trajectory.csv")
    assert list(trajectory[0]) == ["step", "agent", "x1", "x2", "x3", "x4"]
    assert [(int(row["step"]), int(row["agent"])) for row in trajectory] == [
        (step, agent) for step in wanted for agent in range(1, 8)
    ]
    assert [float(row["x3"]) for row in trajectory[:7]] == [5, 2, 4, 3, 1.5, 2.5, 1]


def test_first_row_is_what_the_file_says(tmp_path):
    """mse, estimate_mse and average_error of the initial state, by hand."""
    run(SCENARIOS / "aircraft-fixed.yaml", steps=1, out=tmp_path)
    content = yaml.safe_load((SCENARIOS / "aircraft-fixed.yaml").read_text())
    altitudes = [state[2] for state in content["initial"]["states"]]
    mean = sum(altitudes) / 7
    first = rows(tmp_path / "mse.csv")[0]
    spread = sum((altitude - mean) ** 2 for altitude in altitudes) / 7
    assert float(first["mse"]) == pytest.approx(spread, rel=1e-14)
    assert float(first["average_error"]) == pytest.approx(spread, rel=1e-14)
    degree = [3, 3, 2, 3, 3, 3, 3]
    gain = content["gains"]["compression"][2]
    error = sum(d * (gain * h) ** 2 for d, h in zip(degree, altitudes, strict=True)) / 20
    assert float(first["estimate_mse"]) == pytest.approx(error, rel=1e-14)
    assert first["mse_se"] == ""
    assert summary(tmp_path)["mse_se"] is None


def test_standard_error_and_slope_follow_from_the_runs(tmp_path):
    """The ensemble's mean and standard error from its runs' own files; the slope from its rows."""
    scenario = SCENARIOS / "two-agents.yaml"
    run(scenario, runs=5, steps=100, out=tmp_path / "all", slope_window=(10, 60))
    # The key of a run's random words is (seed, run): run 0 of an ensemble is the single run.
    run(scenario, runs=1, steps=100, out=tmp_path / "one")
    assert (tmp_path / "all/trajectory.csv").read_bytes() == (
        tmp_path / "one/trajectory.csv"
    ).read_bytes()
    run(scenario, runs=2, steps=100, out=tmp_path / "two")
    one = [float(row["mse"]) for row in rows(tmp_path / "one/mse.csv")]
    for k, row in enumerate(rows(tmp_path / "two/mse.csv")):
        other = 2 * float(row["mse"]) - one[k]
        # Two values: standard error is half their distance.
        assert float(row["mse_se"]) == pytest.approx(abs(one[k] - other) / 2, abs=1e-12)
    points = [
        (math.log10(int(row["t"])), math.log10(float(row["mse"])))
        for row in rows(tmp_path / "all/mse.csv")
        if 10 <= int(row["step"]) <= 60
    ]
    mean_x = sum(x for x, _ in points) / len(points)
    slope = sum((x - mean_x) * y for x, y in points) / sum((x - mean_x) ** 2 for x, _ in points)
    assert summary(tmp_path / "all")["slope"] == pytest.approx(slope, rel=1e-9)
    assert summary(tmp_path / "all")["slope_window"] == [10, 60]


@pytest.mark.parametrize("arithmetic", ARITHMETICS)
@pytest.mark.parametrize("name", ["aircraft-fixed", "aircraft-markov-broadcast"])
def test_same_bytes_for_any_number_of_threads(tmp_path, name, arithmetic):
    for threads in (1, 2, 5):
        run(
            SCENARIOS / f"{name}.yaml",
            arith=arithmetic,
            runs=7,
            steps=500,
            seed=9,
            threads=threads,
            out=tmp_path / str(threads),
            log=tmp_path / f"{threads}.log",
        )
    for other in ("2", "5"):
        for file in ("mse.csv", "trajectory.csv"):
            assert (tmp_path / "1" / file).read_bytes() == (tmp_path / other / file).read_bytes()
        assert (tmp_path / "1.log").read_bytes() == (tmp_path / f"{other}.log").read_bytes()
        first, second = summary(tmp_path / "1"), summary(tmp_path / other)
        del first["seconds"], second["seconds"]
        assert first == second


def test_seed_and_run_change_the_bits(tmp_path):
    for seed in (1, 2):
        run(SCENARIOS / "two-agents.yaml", seed=seed, steps=50, log=tmp_path / f"{seed}.log")
    assert (tmp_path / "1.log").read_bytes() != (tmp_path / "2.log").read_bytes()


@pytest.mark.parametrize("arithmetic", ARITHMETICS)
@pytest.mark.parametrize(
    ("name", "encoding", "suffix"),
    [
        ("aircraft-fixed", "payload", "log"),
        ("aircraft-fixed", "identifier", "pcap"),
        ("aircraft-markov", "payload", "pcap"),
        ("aircraft-fixed-broadcast", "identifier", "log"),
        ("aircraft-markov-broadcast", "payload", "log"),
    ],
)
def test_replay_believes_what_the_run_believed(tmp_path, name, encoding, suffix, arithmetic):
    """Every agent of a recorded run, bit for bit: states at the recorded rows, on the CAN bus."""
    scenario = variant(tmp_path, name, bus={"model": "can", "encoding": encoding})
    log = tmp_path / f"run.{suffix}"
    run(scenario, arith=arithmetic, steps=300, seed=4, out=tmp_path / "out", log=log)
    recorded = {
        (row["step"], row["agent"]): [row[f"x{k}"] for k in range(1, 5)]
        for row in rows(tmp_path / "out/trajectory.csv")
    }
    for agent in range(1, 8):
        result = call("replay", scenario, log, "--agent", agent, "--arith", arithmetic, "--seed", 4)
        assert result.returncode == 0, result.stderr
        lines = [line.split(",") for line in result.stdout.splitlines()]
        assert lines[0][:7] == ["step", "t", "u", "x1", "x2", "x3", "x4"]
        assert all(re.fullmatch("zhat_[1-7]", key) for key in lines[0][7:])
        assert [line[0] for line in lines[1:]] == [str(step) for step in range(300)]
        assert [line[1] for line in lines[1:]] == [str(11 + step) for step in range(300)]
        compared = 0
        for line in lines[1:]:
            if (line[0], str(agent)) in recorded:
                assert line[3:7] == recorded[line[0], str(agent)]
                compared += 1
        assert compared == len(recorded) / 7 - 1  # all rows but the one after the last step


def test_replay_ignores_what_stands_before_the_first_sync(tmp_path):
    log = tmp_path / "run.log"
    run(SCENARIOS / "two-agents.yaml", steps=20, log=log)
    arguments = ("--agent", 1)
    first = call("replay", SCENARIOS / "two-agents.yaml", log, *arguments).stdout
    log.write_text("(0.000000) can0 102#17\n" + log.read_text())
    assert call("replay", SCENARIOS / "two-agents.yaml", log, *arguments).stdout == first


def test_can_bus_with_room_believes_as_the_ideal_one(tmp_path):
    """A slow step on a quick bus loses nothing, so only times differ; the log shows the load."""
    ideal = variant(tmp_path, "aircraft-fixed", bus={"model": "ideal"})
    run(ideal, steps=200, arith="q31", out=tmp_path / "ideal", log=tmp_path / "ideal.log")
    can = variant(tmp_path, "aircraft-fixed", bus={"model": "can"})
    run(can, steps=200, arith="q31", out=tmp_path / "can", log=tmp_path / "can.log")
    assert (tmp_path / "ideal/mse.csv").read_bytes() == (tmp_path / "can/mse.csv").read_bytes()
    first, second = summary(tmp_path / "ideal"), summary(tmp_path / "can")
    for key in ("frames", "late_frames", "wire_bits", "bus_load"):
        assert first[key] == second[key]
    assert first["frames"] == 200 * 21
    assert first["bus_load"] == first["wire_bits"] / (500000 * 0.5 * 200)
    assert first["latency_max"] == 0
    # Twenty extended frames of at least 76 - 3 bits one after the other, 2 us a bit.
    assert second["latency_max"] > 20 * 73 * 2e-6
    frames = [[line.split(" ", 1)[1] for line in (tmp_path / f"{bus}.log").read_text().splitlines()]
              for bus in ("ideal", "can")]  # fmt: skip
    assert frames[0] == frames[1]
    times = [float(line[1:18]) for line in (tmp_path / "can.log").read_text().splitlines()]
    assert times == sorted(times)


def test_overloaded_can_bus_loses_the_highest_identifiers(tmp_path):
    """Room for SYNC and five of seven frames: agents 6 and 7 are never heard, the others are."""
    period = (58 + 5 * 60) / 125000
    scenario = variant(
        tmp_path, "aircraft-fixed-broadcast",
        bus={"model": "can", "bitrate": 125000}, period=period,
    )  # fmt: skip
    log = tmp_path / "run.log"
    run(scenario, steps=100, out=tmp_path / "out", log=log)
    result = summary(tmp_path / "out")
    heard = [line.split()[2].split("#")[0] for line in log.read_text().splitlines()]
    assert heard.count("080") == 100
    assert heard.count("101") == heard.count("105") == 100
    assert heard.count("107") == 0
    assert result["late_frames"] == 100 * 8 - len(heard)
    assert result["frames"] == len(heard)


def test_agents_beyond_the_identifiers_run_unencoded(tmp_path):
    """600 agents in identifier form, which carries 503: the others' messages make no frames."""
    agents = 600
    scenario = variant(
        tmp_path, "two-agents",
        bus={"model": "ideal", "encoding": "identifier"},
        channel={"mode": "broadcast"},
        topology={"graphs": [{"edges": [[i, i % agents + 1] for i in range(1, agents + 1)]}]},
        initial={"states": [[0.5 * (-1) ** i, 0] for i in range(agents)]},
    )  # fmt: skip
    result = run(scenario, steps=50, out=tmp_path / "out")
    assert "agents above 503 have no identifier" in result.stderr
    assert summary(tmp_path / "out")["frames"] == 50 * (503 + 1)
    payload = variant(
        tmp_path, "two-agents",
        channel={"mode": "broadcast"},
        topology={"graphs": [{"edges": [[i, i % agents + 1] for i in range(1, agents + 1)]}]},
        initial={"states": [[0.5 * (-1) ** i, 0] for i in range(agents)]},
    )  # fmt: skip
    run(payload, steps=50, out=tmp_path / "all")
    assert (tmp_path / "out/mse.csv").read_bytes() == (tmp_path / "all/mse.csv").read_bytes()


def test_integer_plant_runs_on_its_grid(tmp_path):
    """States are multiples of the format's unit and follow the double plant."""
    scenario = variant(tmp_path, "aircraft-fixed", plant={"arithmetic": "q31"})
    run(scenario, arith="q31", steps=1000, out=tmp_path / "integer")
    run(SCENARIOS / "aircraft-fixed.yaml", arith="q31", steps=1000, out=tmp_path / "double")
    for one, two in zip(
        rows(tmp_path / "integer/trajectory.csv"),
        rows(tmp_path / "double/trajectory.csv"),
        strict=True,
    ):
        for k in range(1, 5):
            scaled = float(one[f"x{k}"]) * 2**31
            assert scaled == int(scaled)
            # Rounding noise of 2^-27 a step through a loop whose memory is the consensus itself.
            assert float(one[f"x{k}"]) == pytest.approx(float(two[f"x{k}"]), abs=1e-3)


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        ([], "run or replay"),
        (["walk"], "walk"),
        (["run"], "file"),
        (["run", "FILE", "FILE"], "file"),
        (["run", "FILE", "--arith", "f16"], "--arith"),
        (["run", "FILE", "--runs", "0"], "--runs"),
        (["run", "FILE", "--runs", "1.5"], "--runs"),
        (["run", "FILE", "--steps", "-3"], "--steps"),
        (["run", "FILE", "--steps", "4294967290"], "--steps"),
        (["run", "FILE", "--seed", "4294967296"], "--seed"),
        (["run", "FILE", "--threads", ""], "--threads"),
        (["run", "FILE", "--slope-window", "5", "4"], "--slope-window"),
        (["run", "FILE", "--slope-window", "5"], "--slope-window"),
        (["run", "FILE", "--quick"], "--quick"),
        (["run", "FILE", "--out"], "--out"),
        (["run", "FILE", "--agent", "1"], "--agent"),
        (["replay", "FILE"], "file"),
        (["replay", "FILE", "LOG"], "--agent"),
        (["replay", "FILE", "LOG", "--agent", "0"], "--agent"),
        (["replay", "FILE", "LOG", "--agent", "3"], "--agent"),
        (["replay", "FILE", "MISSING", "--agent", "1"], "missing.log"),
        (["replay", "FILE", "BROKEN", "--agent", "1"], "broken.log:2"),
    ],
)
def test_bad_use_ends_with_one_line_and_status_2(tmp_path, arguments, word):
    (tmp_path / "run.log").write_text("(0.0) can0 080#\n")
    (tmp_path / "broken.log").write_text("(0.0) can0 080#\nnonsense\n")
    names = {
        "FILE": SCENARIOS / "two-agents.yaml",
        "LOG": tmp_path / "run.log",
        "MISSING": tmp_path / "missing.log",
        "BROKEN": tmp_path / "broken.log",
    }
    result = call(*(names.get(argument, argument) for argument in arguments))
    assert result.returncode == 2
    assert result.stderr.count("\n") == 1
    assert result.stderr.startswith("onebit-sim: ")
    assert word in result.stderr


def test_unwritable_outputs_leave_nothing(tmp_path):
    (tmp_path / "file").write_text("")
    scenario = SCENARIOS / "two-agents.yaml"
    for arguments in (
        ["--out", tmp_path / "file"],
        ["--out", tmp_path / "file/below"],
        ["--log", tmp_path],
        ["--log", tmp_path / "no/such/folder/run.log"],
    ):
        result = call("run", scenario, "--steps", 5, *arguments)
        assert result.returncode == 2, arguments
        assert result.stderr.count("\n") == 1
        assert "cannot" in result.stderr or "is a" in result.stderr
    assert sorted(path.name for path in tmp_path.iterdir()) == ["file"]


@pytest.mark.parametrize("arguments", [["--help"], ["run", "--help"], ["replay", "--help"]])
def test_help(arguments):
    result = call(*arguments)
    assert result.returncode == 0
    assert result.stdout.startswith("usage: onebit-sim")
    assert result.stderr == ""


def test_no_progress_in_a_pipe():
    result = run(SCENARIOS / "two-agents.yaml", runs=4, steps=20)
    assert result.stderr == ""
    assert "disagreement" in result.stdout


def test_unstable_loop_is_warned_of_and_only_fixed_point_refuses_it(tmp_path):
    """Eigenvalues 1 and 2: no range for q31, but a simulation may show what happens."""
    scenario = variant(tmp_path, "two-agents", gains={"stabilizing": [0, 1]})
    result = run(scenario, steps=20)
    assert "gains.stabilizing: A + B K1 has, beside 1, an eigenvalue" in result.stderr
    result = call("run", scenario, "--steps", 20, "--arith", "q31")
    assert result.returncode == 2
    assert result.stderr.count("\n") == 1
    assert "gains.stabilizing" in result.stderr


def test_warnings_look_at_the_steps_of_the_command_line(tmp_path):
    """An altitude that leaks into K1 moves the eigenvalue 1, which shows in long runs only."""
    content = yaml.safe_load((SCENARIOS / "aircraft-fixed.yaml").read_text())
    stabilizing = content["gains"]["stabilizing"]
    gains = {"stabilizing": [*stabilizing[:2], 1e-5, stabilizing[3]]}
    scenario = variant(tmp_path, "aircraft-fixed", gains=gains)
    assert "no longer holds the group" not in run(scenario, steps=100).stderr
    assert "no longer holds the group" in run(scenario, steps=200000).stderr
