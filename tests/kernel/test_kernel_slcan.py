"""slcan against others: the kernel's line discipline, which slcand attaches, as the host of our
device, and slcanpty as the device of our host."""

import fcntl
import os
import pty
import struct
import subprocess
import termios
from pathlib import Path

import bus
import can
import pytest
from simulator import SCENARIOS, run
from slcan_line import FRAMES, Device, message, same

LINE_DISCIPLINE = 17  # N_SLCAN of linux/tty.h
STEPS = 1000


@pytest.fixture
def device():
    """The device's end, whose line slcand makes the interface slcan0."""
    ours, theirs = pty.openpty()
    try:
        fcntl.ioctl(theirs, termios.TIOCSETD, struct.pack("i", LINE_DISCIPLINE))
    except OSError as error:
        pytest.skip(f"no line discipline of slcan's here, or no right to it: {error}")
    finally:
        os.close(theirs)
        os.close(ours)
    device = Device()
    daemon = bus.start(bus.program("slcand"), "-F", "-o", "-c", "-s6", device.path, "slcan0")

    def made():
        assert daemon.poll() is None, "slcand ended"
        return Path("/sys/class/net/slcan0").exists()

    bus.wait_until("slcand makes slcan0", made)
    subprocess.run(["ip", "link", "set", "slcan0", "up"], check=True)
    yield device
    bus.end_all()
    assert device.close() == 0


def test_the_kernel_sends(device):
    with can.Bus(interface="socketcan", channel="slcan0") as host:
        for frame in FRAMES:
            host.send(message(*frame), timeout=10)
            assert device.received() == frame


def test_the_kernel_receives(device):
    with can.Bus(interface="socketcan", channel="slcan0") as host:
        # Known to be open once a frame has come through.
        host.send(message(*FRAMES[0]), timeout=10)
        assert device.received() == FRAMES[0]
        for frame in FRAMES:
            device.send(*frame)
            heard = host.recv(60)
            assert heard is not None and same(heard, frame), (heard, frame)


@pytest.mark.usefixtures("vcan")
@pytest.mark.parametrize("name", ["aircraft-integer", "aircraft-markov"])
def test_part_of_a_group_behind_an_adapter(tmp_path, name):
    """Agents 1 to 3 and the master on slcanpty's line, the others on the interface behind it."""
    scenario = SCENARIOS / f"{name}.yaml"
    run(scenario, arith="q31", steps=STEPS, out=tmp_path / "out", log=tmp_path / "sim.log")
    adapter = bus.start(
        # It writes the path into a buffer otherwise, and ends with its input.
        bus.program("stdbuf", "coreutils"), "-oL", bus.program("slcanpty"), "/dev/ptmx", "vcan0",
        stdin=subprocess.PIPE, stdout=subprocess.PIPE,
    )  # fmt: skip
    path = adapter.stdout.readline().split()[-1]
    others = bus.start_nodes(tmp_path, scenario, "--arith", "q31", agents=range(4, 8))
    # slcanpty writes all that passes.
    bus.start("cat", stdin=adapter.stdout, stdout=subprocess.DEVNULL)
    result = subprocess.run(
        [
            bus.NODE, scenario, "--interface", f"slcan:{path}", "--agents", "1-3", "--sync-master",
            "--period", "0", "--steps", str(STEPS), "--arith", "q31",
            "--csv", tmp_path / "agent.csv",
        ],
        capture_output=True, text=True, timeout=300, check=False,
    )  # fmt: skip
    assert result.returncode == 0, result.stdout + result.stderr
    assert f"SYNC sent {STEPS}, late 0, incomplete steps 0" in result.stdout, result.stdout
    for node in others:
        assert node.wait() == 0, node.errors.read_text()
        same_bits = node.text() == bus.replay(scenario, tmp_path / "sim.log", node.agent)
        assert same_bits, node.agent
    for agent in (1, 2, 3):
        csv = (tmp_path / f"agent-{agent}.csv").read_text()
        same_bits = csv == bus.replay(scenario, tmp_path / "sim.log", agent)
        assert same_bits, agent
