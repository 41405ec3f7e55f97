"""onebit-node among programs that were not written here: can-utils and python-can."""

import math
import subprocess
import time

import can
import pytest
import yaml
from bus import (
    INTERFACE,
    Dump,
    disagreement,
    finish,
    program,
    replay,
    send,
    start,
    start_master,
    start_nodes,
)
from simulator import SCENARIOS, run
from test_simulator import variant

TWO = SCENARIOS / "two-agents.yaml"
STEP_MODULUS = 128


@pytest.mark.usefixtures("vcan")
@pytest.mark.parametrize("counted", [True, False], ids=["counter", "no-counter"])
def test_a_frame_made_by_hand_is_taken_as_a_bit(tmp_path, counted):
    """Two agents, the second of them cansend; the estimates again from the paper's equation. SYNC
    with its counter and, as other masters send it, without."""
    content = yaml.safe_load(TWO.read_text())
    t0, beta = content["gains"]["t0"], content["gains"]["beta"]
    (node,) = start_nodes(tmp_path, TWO, "--arith", "f64", agents=[1])
    bits = [1, 0, 0, None, 1, 1, 0, 1, 1, 1]  # None: silent for a step
    for step, bit in enumerate(bits):
        send(f"080#{(t0 + 1 + step) % STEP_MODULUS or STEP_MODULUS:02X}" if counted else "080#")
        if bit is not None:
            send(f"10008002#{(t0 + 1 + step) % STEP_MODULUS << 1 | bit:02X}")
    send("000#0200")
    assert node.wait() == 0
    rows = node.rows()
    assert len(rows) == len(bits)
    estimate = content["initial"]["estimates"]
    for step, (row, bit) in enumerate(zip(rows, bits, strict=True)):
        t = t0 + 1 + step
        assert int(row["t"]) == t
        if bit is not None:
            # threshold 0, sigma 1, bound 1
            distribution = (1 + math.erf(-estimate / math.sqrt(2))) / 2
            estimate = max(-1, min(1, estimate + beta / t * (distribution - bit)))
        assert float(row["zhat_2"]) == pytest.approx(estimate, abs=1e-12)
    summary = node.summary()
    assert summary["taken"] == len(bits) - 1
    assert summary["frames_out"] == len(bits)


@pytest.mark.usefixtures("vcan")
def test_canplayer_plays_a_neighbour(tmp_path):
    """The other agent's part of a recorded run, in its own time; the node adds its own."""
    scenario = variant(tmp_path, "two-agents", period=0.02, bus={"model": "can"})
    log = tmp_path / "run.log"
    run(scenario, arith="q31", steps=100, log=log)
    others = tmp_path / "others.log"
    own = "10004004"
    lines = [line for line in log.read_text().splitlines(True) if f" {own}#" not in line]
    assert len(lines) == 200
    others.write_text("".join(lines))
    dump = Dump(tmp_path / "heard.log")
    (node,) = start_nodes(tmp_path, scenario, "--arith", "q31", agents=[1])
    subprocess.run([program("canplayer"), "-I", others], check=True, stdout=subprocess.PIPE)
    time.sleep(0.05)
    send("000#0200")
    assert node.wait() == 0
    dump.stop()
    assert node.text() == replay(scenario, log, 1) == replay(scenario, dump.path, 1)


def hostile_frames(identifiers):
    """Frames that must be refused or not even be let through, one of each kind an identifier."""
    for identifier, extended in identifiers:
        common = {"arbitration_id": identifier, "is_extended_id": extended}
        yield can.Message(**common, is_remote_frame=True, dlc=1)
        yield can.Message(**common, data=b"")
        yield can.Message(**common, data=bytes(8))
        yield can.Message(**common, data=b"\x17", is_fd=True)
        yield can.Message(**common, data=bytes(64), is_fd=True, bitrate_switch=True)
        # Another agent's number in the other format of identifier.
        yield can.Message(
            arbitration_id=identifier & 0x7FF, is_extended_id=not extended, data=b"\0"
        )


@pytest.mark.usefixtures("vcan")
@pytest.mark.parametrize(
    ("name", "identifiers"),
    [
        ("aircraft-fixed-broadcast", [(0x100 + agent, False) for agent in range(1, 8)]),
        ("aircraft-fixed", [(0x10000000 + (2 << 14) + (1 << 1), True), (0x10004004, True)]),
    ],
)
def test_frames_that_only_look_like_bits_change_nothing(tmp_path, name, identifiers):
    """Remote, too long, empty, CAN FD: refused and counted, and the seven compute the same bits."""
    steps = 200
    scenario = SCENARIOS / f"{name}.yaml"
    log = tmp_path / "sim.log"
    run(scenario, arith="q31", steps=steps, log=log)
    nodes = start_nodes(tmp_path, scenario, "--arith", "q31")
    master = start_master(scenario, period="0", steps=steps)
    sent = 0
    with can.Bus(interface="socketcan", channel=INTERFACE, fd=True) as bus:
        while master.poll() is None:
            for message in hostile_frames(identifiers):
                bus.send(message)
                sent += 1
            time.sleep(0.02)
    finish(master, nodes)
    assert sent > 100
    for node in nodes:
        assert node.text() == replay(scenario, log, node.agent)
    refused = nodes[0].summary()["refused"]
    assert min(refused["remote"], refused["length"], refused["flexible"]) > 0


@pytest.mark.usefixtures("vcan")
def test_seven_agree_while_cangen_floods(tmp_path):
    """Random frames of every kind: standard, extended, remote, CAN FD, any length.

    Random identifiers may hit SYNC or a neighbour, so bits may differ; agreement must not.
    """
    steps = 400
    scenario = SCENARIOS / "aircraft-fixed.yaml"
    nodes = start_nodes(tmp_path, scenario, "--arith", "q31")
    master = start_master(scenario, steps=steps)
    flood = start(program("cangen"), INTERFACE, "-m", "-g", "1", "-i", stdout=subprocess.PIPE)
    finish(master, nodes)
    assert flood.poll() is None
    flood.kill()
    first, last = disagreement(nodes, 0), disagreement(nodes, min(len(n.rows()) for n in nodes) - 1)
    assert last < first / 2
    for node in nodes:
        assert node.summary()["steps"] >= steps * 0.98
        assert node.summary()["lost"] == 0
