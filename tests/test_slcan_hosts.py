"""The device's end of a slcan line against a host's that shares no code with it: python-can's; and
what onebit-node says of a line that is not as it should be."""

import os
import pty
import subprocess
import tty

import can
import pytest
from simulator import BUILD, SCENARIOS
from slcan_line import FRAMES, Device, message, same

NODE = BUILD / "bin/onebit-node"


@pytest.fixture
def device():
    device = Device()
    yield device
    assert device.close() == 0


@pytest.fixture
def host(device):
    # It waits two seconds for boards that restart when their line is opened; this one does not.
    with can.Bus(interface="slcan", channel=device.path, bitrate=500000, sleep_after_open=0) as bus:
        yield bus


def test_python_can_sends(device, host):
    for frame in FRAMES:
        host.send(message(*frame))
        assert device.received() == frame


def test_python_can_receives(device, host):
    # Known to be open once a frame has come through.
    host.send(message(*FRAMES[0]))
    device.received()
    for frame in FRAMES:
        device.send(*frame)
        heard = host.recv(60)
        while heard is None:  # it passes the answer to what it sent over in silence
            heard = host.recv(60)
        assert same(heard, frame)


def test_python_can_asks(device, host):
    assert host.get_version(60) == (1, 1)
    assert host.get_serial_number(60) == "0001"
    # Answered again after what came before.
    host.send(message(*FRAMES[0]))
    assert device.received() == FRAMES[0]


# --- onebit-node on lines that are not as they should be ---


def node(path, *options):
    return subprocess.run(
        [
            NODE, SCENARIOS / "aircraft-integer.yaml", "--interface", f"slcan:{path}",
            "--arith", "q31", *options,
        ],
        capture_output=True, text=True, timeout=300, check=False,
    )  # fmt: skip


WHOLE = ("--agents", "1-7", "--sync-master")


@pytest.mark.parametrize(
    ("path", "options", "words"),
    [
        ("/nonexistent/tty", WHOLE, "/nonexistent/tty: cannot be opened: No such file"),
        ("/dev/null", WHOLE, "/dev/null: cannot be set up as a serial line"),
        ("/dev/ttyS0@12345", WHOLE, "/dev/ttyS0@12345: no such speed"),
        ("/dev/ttyS0@", WHOLE, "/dev/ttyS0@: no such speed"),
        ("/dev/ttyS0@115200x", WHOLE, "/dev/ttyS0@115200x: no such speed"),
        ("", WHOLE, "must be the path of a terminal or a socket"),
        ("/dev/null", ("--agents", "1-6"), "goes with --agents and --sync-master"),
        ("/dev/null", ("--sync-master",), "goes with --agents and --sync-master"),
        ("/dev/null", ("--sync", *WHOLE), "goes with --agents and --sync-master"),
    ],
)
def test_bad_use_is_told_in_a_line(path, options, words):
    result = node(path, *options)
    assert result.returncode == 2, result.stderr
    assert words in result.stderr
    assert len(result.stderr.splitlines()) == 1
    assert result.stdout == ""


def test_a_line_that_says_nothing_is_told_and_used_all_the_same():
    """Some adapters never answer."""
    ours, theirs = pty.openpty()
    tty.setraw(ours)
    result = node(os.ttyname(theirs), *WHOLE, "--steps", "3", "--period", "0")
    assert result.returncode == 0, result.stderr
    assert result.stderr == f"onebit-node: slcan:{os.ttyname(theirs)}: nobody answers; going on\n"
    text = b""
    while not text.endswith(b"t00020200\rV\rC\r"):
        text += os.read(ours, 65536)
    os.close(ours)
    os.close(theirs)
    # What it asked six times, and the three steps of the whole group.
    asked, frames = text.split(b"t", 1)
    assert asked == 6 * b"\r\rC\rS6\rO\r"
    lines = [b"t" + line for line in frames.split(b"\rt")]
    assert [line[:4] for line in lines[:-1]] == 3 * [
        b"t080", b"t101", b"t102", b"t103", b"t104", b"t105", b"t106", b"t107",
    ]  # fmt: skip
    # SYNC counts from t0 + 1 = 11.
    assert lines[0:-1:8] == [b"t08010B", b"t08010C", b"t08010D"]


def test_a_line_that_goes_down_ends_the_run():
    ours, theirs = pty.openpty()
    tty.setraw(ours)
    process = subprocess.Popen(
        [
            NODE, SCENARIOS / "aircraft-integer.yaml", "--interface",
            f"slcan:{os.ttyname(theirs)}", "--agents", "1-6", "--sync-master", "--period", "0",
        ],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    while b"O\r" not in os.read(ours, 64):
        pass
    os.close(theirs)  # the other end is the program's alone now
    os.write(ours, b"\r\r\r")
    while b"t" not in os.read(ours, 64):  # the first step's
        pass
    os.close(ours)
    output, errors = process.communicate(timeout=300)
    assert process.returncode == 1, output + errors
    assert errors.endswith("the line went down\n")
