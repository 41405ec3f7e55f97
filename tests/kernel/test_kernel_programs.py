"""Logs of the simulator played onto a real interface, read by programs that are not ours.

Nothing here needs onebit-node: it shows that frames and bit counts mean to can-utils, python-can
and cantools what they mean to the simulator.
"""

import re
import subprocess
import sys

import can
import pytest
import yaml
from bus import INTERFACE, Dump, all_listeners, program, start, wait_until
from simulator import ROOT, SCENARIOS, run, summary
from test_bus_cost import system_of

sys.path.insert(0, str(ROOT / "tools"))

from onebit_design.dbc import dbc_text

STEPS = 40
NAMES = ["aircraft-fixed", "aircraft-fixed-broadcast"]


@pytest.fixture(params=["payload", "identifier"])
def encoding(request):
    return request.param


@pytest.fixture(params=NAMES)
def recorded(request, tmp_path, encoding):
    """A run: its log as text, its summary, and the scenario as it was run."""
    content = yaml.safe_load((SCENARIOS / f"{request.param}.yaml").read_text())
    content["bus"] = {"model": "can", "bitrate": 500000, "encoding": encoding}
    content["period"] = 0.02
    scenario = tmp_path / "scenario.yaml"
    scenario.write_text(yaml.safe_dump(content))
    log = tmp_path / "run.log"
    run(scenario, steps=STEPS, arith="q31", out=tmp_path / "out", log=log)
    return log, summary(tmp_path / "out"), content


def frames(log):
    """The log without its times: (identifier, data) as text."""
    return [tuple(line.split()[2].split("#")) for line in log.read_text().splitlines()]


def play(log):
    """With the log's own times: a burst of all frames would fill the readers' queues."""
    subprocess.run([program("canplayer"), "-I", log], check=True, stdout=subprocess.PIPE)


@pytest.mark.usefixtures("vcan")
def test_candump_hears_what_canplayer_sends(tmp_path, recorded):
    log, _, _ = recorded
    dump = Dump(tmp_path / "heard.log")
    play(log)
    dump.stop()
    assert dump.frames() == frames(log)


@pytest.mark.usefixtures("vcan")
def test_canbusload_counts_the_bits_that_the_simulator_counts(recorded):
    """Exact mode, all frames of the run: data frames with stuff bits and interframe space."""
    log, result, _ = recorded
    before = all_listeners()
    process = start(program("canbusload"), "-e", f"{INTERFACE}@500000", stdout=subprocess.PIPE)
    wait_until("canbusload listens", lambda: all_listeners() > before)
    player = start(program("canplayer"), "-I", log)
    counted_frames = counted_bits = 0
    for line in process.stdout:
        match = re.match(r"\s*vcan0@500000\s+(\d+)\s+(\d+)\s+(\d+)\s+\d+%", line)
        if match:
            counted_frames += int(match[1])
            counted_bits += int(match[2])
            if counted_frames >= result["frames"]:
                break
    assert player.wait(timeout=10) == 0
    assert counted_frames == result["frames"]
    assert counted_bits == result["wire_bits"]


@pytest.mark.usefixtures("vcan")
def test_python_can_reads_the_interface(recorded):
    log, _, _ = recorded
    wanted = frames(log)
    with can.Bus(interface="socketcan", channel=INTERFACE) as bus:
        player = start(program("canplayer"), "-I", log)
        heard = []
        for _ in wanted:
            message = bus.recv(timeout=5)
            assert message is not None
            assert not (message.is_remote_frame or message.is_error_frame or message.is_fd)
            width = 8 if message.is_extended_id else 3
            heard.append((f"{message.arbitration_id:0{width}X}", message.data.hex().upper()))
        assert player.wait(timeout=10) == 0
    assert heard == wanted


@pytest.mark.usefixtures("vcan")
@pytest.mark.parametrize("encoding", ["payload"], indirect=True)
def test_cantools_decodes_what_candump_prints(recorded):
    """Each message by its name in the DBC, with the bit and the step that its byte holds."""
    log, _, content = recorded
    database = log.with_name("onebit.dbc")
    database.write_text(dbc_text(system_of(content)))
    wanted = frames(log)
    before = all_listeners()
    dump = start(program("candump"), "-n", len(wanted), INTERFACE, stdout=subprocess.PIPE)
    wait_until("candump listens", lambda: all_listeners() > before)
    decode = start(
        sys.executable, "-B", "-m", "cantools", "decode", "--single-line", database,
        stdin=dump.stdout, stdout=subprocess.PIPE,
    )  # fmt: skip
    play(log)
    lines = decode.communicate(timeout=60)[0].splitlines()
    assert len(lines) == len(wanted)
    for line, (identifier, data) in zip(lines, wanted, strict=True):
        name, values = re.search(r":: (\w+)\((.*)\)$", line).groups()
        if identifier == "080":
            assert (name, values) == ("SYNC", f"counter: {int(data, 16)}")
            continue
        number = int(identifier, 16)
        if len(identifier) == 8:
            assert name == f"message_{number >> 14 & 0x1FFF}_to_{number >> 1 & 0x1FFF}"
        else:
            assert name == f"message_{number - 0x100}"
        byte = int(data, 16)
        assert values == f"bit: {byte & 1}, step: {byte >> 1}"
