"""Seven processes on a real interface compute the simulator's bits, and nothing else."""

import pytest
from bus import (
    NODE,
    SYNC,
    Dump,
    finish,
    listeners,
    replay,
    start,
    start_master,
    start_nodes,
    wait_until,
)
from simulator import SCENARIOS, rows, run
from test_simulator import variant

STEPS = 2000
SEED = 5
AGENTS = range(1, 8)
REFUSED = (
    *("foreign", "length", "remote", "error_frame", "flexible"),
    *("unknown", "unlinked", "repeated", "stale", "early"),
)


def simulate(scenario, folder, steps):
    """The reference: onebit-sim's states at the rows of its file, and its bus log."""
    run(
        scenario, arith="q31", steps=steps, seed=SEED, out=folder / "out", log=folder / "sim.log"
    )  # fmt: skip
    states = {}
    for row in rows(folder / "out/trajectory.csv"):
        key = int(row["step"]), int(row["agent"])
        states[key] = [row[f"x{k}"] for k in range(1, 5)]
    return states


def same_frames(dump, log):
    """Of each step the same frames, SYNC's counter too; within it processes come in any order."""

    def steps(frames):
        groups = []
        for identifier, data in frames:
            if identifier == f"{SYNC:03X}":
                groups.append([])
            groups[-1].append((identifier, data))
        return [sorted(group) for group in groups]

    heard = dump.frames()
    assert heard.pop() == ("000", "0200")  # the master's end
    wanted = [tuple(line.split()[2].split("#")) for line in log.read_text().splitlines()]
    assert steps(heard) == steps(wanted)


@pytest.mark.usefixtures("vcan")
@pytest.mark.parametrize(
    ("name", "encoding"),
    [
        ("aircraft-fixed", "payload"),
        ("aircraft-fixed-broadcast", "payload"),
        ("aircraft-markov", "payload"),
        ("aircraft-markov-broadcast", "identifier"),
    ],
)
def test_processes_compute_the_simulators_bits(tmp_path, name, encoding):
    scenario = variant(tmp_path, name, bus={"model": "ideal", "encoding": encoding})
    states = simulate(scenario, tmp_path, STEPS)
    dump = Dump(tmp_path / "heard.log")
    nodes = start_nodes(tmp_path, scenario, "--arith", "q31", "--seed", SEED)
    master = start_master(scenario, period="0", steps=STEPS, seed=SEED)
    finish(master, nodes)
    dump.stop()
    same_frames(dump, tmp_path / "sim.log")
    for node in nodes:
        compared = 0
        for row in node.rows():
            key = int(row["step"]), node.agent
            if key in states:
                assert [row[f"x{k}"] for k in range(1, 5)] == states[key], key
                compared += 1
        assert compared == len(states) / len(AGENTS) - 1  # all but that after the last step
        # States, controls and estimates of every step, from either log.
        assert node.text() == replay(scenario, tmp_path / "sim.log", node.agent, seed=SEED)
        assert node.text() == replay(scenario, dump.path, node.agent, seed=SEED)
        summary = node.summary()
        assert (summary["steps"], summary["aligned"], summary["lost"]) == (STEPS, 0, 0)
        # In broadcast all send in every step, and links that are off are refused.
        degree = sum(key.startswith("zhat_") for key in node.rows()[0])
        silent = degree * STEPS - summary["taken"]
        unlinked = silent if name == "aircraft-markov-broadcast" else 0
        assert summary["refused"] == dict.fromkeys(REFUSED, 0) | {"unlinked": unlinked}
        assert (silent > 0) == name.startswith("aircraft-markov")


@pytest.mark.usefixtures("vcan")
@pytest.mark.parametrize("arithmetic", ["f64", "f32"])
def test_all_agents_in_one_process(tmp_path, arithmetic):
    """Floating arithmetics have the same bits in the programs of one build."""
    steps = 300
    scenario = SCENARIOS / "aircraft-fixed.yaml"
    log = tmp_path / "sim.log"
    run(scenario, arith=arithmetic, steps=steps, seed=SEED, log=log)
    process = start(
        NODE, scenario, "--interface", "vcan0", "--agents", "1-7", "--sync",
        "--arith", arithmetic, "--seed", SEED, "--csv", tmp_path / "node.csv",
    )  # fmt: skip
    wait_until("seven sockets listen", lambda: listeners(SYNC) == len(AGENTS))
    finish(start_master(scenario, period="0", steps=steps, seed=SEED), [])
    assert process.wait(timeout=10) == 0
    for agent in AGENTS:
        text = (tmp_path / f"node-{agent}.csv").read_text()
        assert text == replay(scenario, log, agent, arithmetic, seed=SEED)
