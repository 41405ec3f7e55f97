"""onebit-node on a real kernel as a person meets it: bad use, check, demo.sh."""

import ctypes
import json
import platform
import socket
import struct
import subprocess

import pytest
from bus import INTERFACE, NODE, PERIOD, start, start_nodes, wait_until
from simulator import ROOT, SCENARIOS
from test_simulator import variant

TWO = SCENARIOS / "two-agents.yaml"


def call(*arguments, **options):
    return subprocess.run(
        [str(word) for word in (NODE, *arguments)],
        capture_output=True, text=True, check=False, timeout=20, **options,
    )  # fmt: skip


@pytest.mark.usefixtures("vcan")
@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        (["--interface", "vcan7", "--agent", 1, "--sync"], "vcan7"),
        (["--interface", "a-name-that-is-much-too-long", "--agent", 1, "--sync"], "interface"),
        (["--interface", "lo", "--agent", 1, "--sync"], "lo"),
        (["--interface", INTERFACE, "--agent", 3, "--sync"], "agent"),
        (["--interface", INTERFACE, "--agent", 0, "--sync"], "agent"),
        (["--interface", INTERFACE, "--agents", "1-3", "--sync"], "agent"),
        (["--interface", INTERFACE, "--agents", "2-1", "--sync"], "agent"),
        (["--interface", INTERFACE, "--agent", 1, "--arith", "q15", "--sync"], "arith"),
        (["--interface", INTERFACE, "--agent", 1, "--period", "0"], "period"),
        (["--interface", INTERFACE, "--agent", 1, "--period", "10 parsecs"], "period"),
        (["--interface", INTERFACE, "--sync"], "agent"),
        (["--interface", INTERFACE, "--sync-master", "--agent", 1], "agent"),
        (["--agent", 1, "--sync"], "interface"),
        (["--interface", "vcan7", "--sync-master", "--period", "10ms"], "vcan7"),
        (["--interface", INTERFACE, "--agent", 1, "--sync", "--csv", "/no/such/folder/a"], "/no"),
    ],
)
def test_bad_use_ends_with_one_line_and_status_2(arguments, word):
    result = call(TWO, *arguments)
    assert result.returncode == 2, result
    assert result.stderr.count("\n") == 1
    assert result.stderr.startswith("onebit-node: ")
    assert word in result.stderr
    assert result.stdout == ""


def forbid_can_sockets():
    """As a container may: socket(AF_CAN, ..) fails with EPERM in this process from now on."""
    allow, refuse = 0x7FFF0000, 0x00050001  # SECCOMP_RET_ALLOW; SECCOMP_RET_ERRNO, EPERM
    program = b"".join(
        struct.pack("=HBBI", *instruction)
        for instruction in [
            (0x20, 0, 0, 0),  # load the system call's number
            (0x15, 0, 3, 41),  # socket, on x86-64
            (0x20, 0, 0, 16),  # load the first argument
            (0x15, 0, 1, socket.AF_CAN),
            (0x06, 0, 0, refuse),
            (0x06, 0, 0, allow),
        ]
    )
    text = ctypes.create_string_buffer(program)
    header = struct.pack("@HP", len(program) // 8, ctypes.addressof(text))
    libc = ctypes.CDLL(None, use_errno=True)
    no_new_privileges, set_seccomp, filter_mode = 38, 22, 2
    if libc.prctl(no_new_privileges, 1, 0, 0, 0) or libc.prctl(
        set_seccomp, filter_mode, ctypes.create_string_buffer(header), 0, 0
    ):
        raise OSError(ctypes.get_errno(), "seccomp")


@pytest.mark.usefixtures("vcan")
@pytest.mark.skipif(platform.machine() != "x86_64", reason="numbers of x86-64's system calls")
def test_no_permission():
    words = ["--interface", INTERFACE]
    result = call(TWO, *words, "--agent", 1, "--sync", preexec_fn=forbid_can_sockets)
    assert result.returncode == 2
    assert result.stderr.count("\n") == 1
    assert "permi" in result.stderr.lower()
    result = call("check", *words, preexec_fn=forbid_can_sockets)
    assert result.returncode == 1
    assert "right" in result.stdout


@pytest.mark.usefixtures("vcan")
def test_interface_that_is_down_is_bad_use():
    subprocess.run(["ip", "link", "set", "dev", INTERFACE, "down"], check=True)
    result = call(TWO, "--interface", INTERFACE, "--agent", 1, "--sync")
    assert result.returncode == 2
    assert result.stderr.count("\n") == 1
    assert f"ip link set {INTERFACE} up" in result.stderr


@pytest.mark.usefixtures("vcan")
@pytest.mark.parametrize(
    ("own", "peers"),
    [("payload", "identifier"), ("identifier", "payload")],
)
def test_payload_form_that_the_peers_do_not_use(tmp_path, own, peers):
    """One node reads a scenario with the other encoding: it says so instead of hearing nobody."""
    name = "aircraft-fixed-broadcast"
    (tmp_path / "peers").mkdir()
    (tmp_path / "own").mkdir()
    others = variant(tmp_path / "peers", name, bus={"encoding": peers})
    scenario = variant(tmp_path / "own", name, bus={"encoding": own})
    start_nodes(tmp_path / "peers", others, agents=range(1, 7))
    (node,) = start_nodes(tmp_path / "own", scenario, agents=[7])
    start(
        NODE, others, "--interface", INTERFACE, "--sync-master", "--period", PERIOD,
        stdout=subprocess.PIPE, stderr=subprocess.PIPE,
    )  # fmt: skip
    assert node.wait() == 2
    lines = node.errors.read_text().splitlines()
    assert len(lines) == 1
    assert lines[0].startswith("onebit-node: agent 7: ")
    assert f"broadcast, {peers}" in lines[0]


@pytest.mark.usefixtures("vcan")
def test_ends_cleanly_with_a_summary(tmp_path):
    """SIGTERM and Ctrl-C: status 0, what was done on standard output, as text or as JSON."""
    csv = tmp_path / "agent.csv"
    for number, options in ((15, ()), (2, ()), (15, ("--json",)), (2, ("--json",))):
        csv.unlink(missing_ok=True)
        process = start(
            NODE, TWO, "--interface", INTERFACE, "--agent", 1, "--period", "20ms", "--csv", csv,
            *options, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
        )  # fmt: skip
        wait_until(
            "the node has made some steps",
            lambda: csv.exists() and csv.read_text().count("\n") > 20,
        )
        process.send_signal(number)
        output, errors = process.communicate(timeout=10)
        assert process.returncode == 0, errors
        if options:
            summary = json.loads(output)
            assert summary["steps"] >= 20
            # On a busy machine a step may be over before its message left.
            assert summary["frames_out"] + summary["late"] >= summary["steps"]
        else:
            assert "steps" in output


def test_check_says_what_is_missing_and_what_mends_it(vcan):
    good = call("check", "--interface", vcan)
    assert good.returncode == 0, good
    subprocess.run(["ip", "link", "set", "dev", vcan, "down"], check=True)
    down = call("check", "--interface", vcan)
    assert down.returncode == 1
    assert f"ip link set {vcan} up" in down.stdout
    missing = call("check", "--interface", "vcan7")
    assert missing.returncode == 1
    assert "ip link add" in missing.stdout
    assert "vcan7" in missing.stdout
    other = call("check", "--interface", "lo")
    assert other.returncode == 1
    assert "CAN" in other.stdout


def test_what_check_proposes_works(tmp_path):
    """Its commands, done one after the other, end in an interface that a node takes."""
    try:
        for _ in range(4):
            result = call("check", "--interface", "vcan3")
            if result.returncode == 0:
                break
            command = next(line for line in result.stdout.splitlines() if "ip link" in line)
            # The tests are root where they run, and need no sudo there.
            command = command.replace("sudo ", "")
            subprocess.run(["sh", "-c", command], check=True)
        assert result.returncode == 0, result.stdout
    finally:
        subprocess.run(["ip", "link", "delete", "dev", "vcan3"], check=False)


def test_demo_runs_to_its_end_and_leaves_nothing(tmp_path):
    def links():
        return subprocess.run(
            ["ip", "-o", "link"], capture_output=True, text=True, check=True
        ).stdout

    def processes():
        return subprocess.run(
            ["ps", "-e", "-o", "args"], capture_output=True, text=True, check=True
        ).stdout

    before = links()
    result = subprocess.run(
        [ROOT / "ports/socketcan/demo.sh"],
        capture_output=True, text=True, check=False, timeout=120, cwd=tmp_path,
    )  # fmt: skip
    assert result.returncode == 0, result.stdout + result.stderr
    assert "SYNC sent 600" in result.stdout
    # Of each picture the last column.
    spreads = [
        float(line.split()[-2]) for line in result.stdout.splitlines() if line.endswith(" m")
    ]
    assert len(spreads) > 5
    assert spreads[-1] < spreads[0]
    assert links() == before
    assert "onebit-node" not in processes()
    assert list(tmp_path.iterdir()) == []
