"""Agent 3 of seven runs as firmware in QEMU, the others in onebit-node; they meet on QEMU's serial
line, which speaks slcan. All have the bits of the simulator's run of seven. (test_serial_avr.py has
the processor whose emulator takes no live line.)"""

import itertools
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time

import pytest
from simulator import BUILD, ROOT, SCENARIOS, SIMULATOR, call, rows, run

sys.path.insert(0, str(ROOT / "tools"))

import one_answer

NODE = BUILD / "bin/onebit-node"
SCENARIO = SCENARIOS / "aircraft-integer.yaml"
IN_FIRMWARE = 3  # CONFIG of ports/firmware/node.c
OTHERS = "1-2,4-7"
STEPS = 2000  # of the Cortex-M3; the others', whose code is the same, are fewer
FEW_STEPS = 300  # the clock, modulo 128, goes round twice
# Presets whose boards QEMU emulates, and what each needs.
BOARDS = {
    "cortex-m0": (("arm-none-eabi-gcc", "gcc-arm-none-eabi"), ("qemu-system-arm",) * 2),
    "cortex-m3": (("arm-none-eabi-gcc", "gcc-arm-none-eabi"), ("qemu-system-arm",) * 2),
    "cortex-m4f": (("arm-none-eabi-gcc", "gcc-arm-none-eabi"), ("qemu-system-arm",) * 2),
    "rv32imac": (
        ("riscv64-unknown-elf-gcc", "gcc-riscv64-unknown-elf"),
        ("qemu-system-riscv32", "qemu-system-misc"),
    ),
}
# Longer than any machine stands still; nothing waits so long unless it is broken.
PATIENCE = 300


def program(name, package):
    return shutil.which(name) or pytest.skip(f"program {name} is missing (Debian: {package})")


@pytest.fixture(scope="module", params=BOARDS)
def emulator(request, tmp_path_factory):
    """QEMU's command with the image, as the preset runs images; without a serial line."""
    for name, package in BOARDS[request.param]:
        program(name, package)
    folder = tmp_path_factory.mktemp(request.param)
    # Flags for a host's sanitizers are not for this compiler.
    environment = {name: text for name, text in os.environ.items() if name != "CFLAGS"}
    for command in (
        ["cmake", "--preset", request.param, "-B", folder],
        ["cmake", "--build", folder, "--target", "node"],
        ["ctest", "--test-dir", folder, "--show-only=json-v1"],
    ):
        result = subprocess.run(
            command, cwd=ROOT, env=environment, capture_output=True, text=True, check=False
        )
        assert result.returncode == 0, result.stdout + result.stderr
    (hello,) = [test for test in json.loads(result.stdout)["tests"] if test["name"] == "hello"]
    return [*hello["command"][:-1], str(folder / "bin/node.elf")]


@pytest.fixture
def board(emulator, tmp_path):
    """QEMU as it runs, and the path of its serial line."""
    line = tmp_path / "line"
    serial = emulator.index("-serial")
    assert emulator[serial + 1] == "none"
    # Instructions have a time of their own (-icount): the busy loop does not race the host's.
    assert "-icount" in emulator
    command = [
        *emulator[:serial],
        *("-chardev", f"socket,id=line,path={line},server=on,wait=off", "-serial", "chardev:line"),
        *emulator[serial + 2 :],
    ]
    with (tmp_path / "errors").open("w") as errors:
        process = subprocess.Popen(
            command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=errors, text=True
        )
    deadline = time.monotonic() + PATIENCE
    while not line.exists():
        assert process.poll() is None, (tmp_path / "errors").read_text()
        assert time.monotonic() < deadline, "QEMU offers no serial line"
        time.sleep(0.02)
    yield process, line
    if process.poll() is None:
        process.kill()
    process.communicate()


def run_others(line, *options):
    return subprocess.run(
        [
            NODE, SCENARIO, "--interface", f"slcan:{line}", "--agents", OTHERS, "--sync-master",
            "--period", "0", "--arith", "q31", *options,
        ],
        capture_output=True, text=True, timeout=PATIENCE, check=False,
    )  # fmt: skip


def replay(log, agent):
    result = call("replay", SCENARIO, log, "--agent", agent, "--arith", "q31")
    assert result.returncode == 0, result.stderr
    return result.stdout


def first_difference(text, wanted):
    """The first line in which they differ; pytest's own account of 2,000 lines takes minutes."""
    lines = itertools.zip_longest(text.splitlines(), wanted.splitlines())
    return next((pair for pair in lines if pair[0] != pair[1]), None)


def test_firmware_and_host_compute_the_simulators_bits(board, tmp_path):
    process, line = board
    steps = STEPS if "mps2-an385" in process.args else FEW_STEPS
    run(SCENARIO, arith="q31", steps=steps, out=tmp_path / "out", log=tmp_path / "sim.log")
    result = run_others(line, "--steps", str(steps), "--csv", str(tmp_path / "agent.csv"))
    assert result.returncode == 0, result.stdout + result.stderr
    assert f"SYNC sent {steps}, late 0, incomplete steps 0" in result.stdout
    output, _ = process.communicate(timeout=PATIENCE)
    assert process.returncode == 0, output

    # The six: every estimate, control and state of every step.
    for agent in (1, 2, 4, 5, 6, 7):
        csv = (tmp_path / f"agent-{agent}.csv").read_text()
        assert first_difference(csv, replay(tmp_path / "sim.log", agent)) is None, agent
        assert len(csv.splitlines()) == 1 + steps

    # The one in firmware: every estimate and control by checksum, the state after the last step.
    replayed = one_answer.replayed(SIMULATOR, tmp_path / "sim.log", IN_FIRMWARE)
    checksum = one_answer.checksums(replayed)[steps]
    last = [
        row
        for row in rows(tmp_path / "out/trajectory.csv")
        if int(row["step"]) == steps and int(row["agent"]) == IN_FIRMWARE
    ]
    unit = 2.0 ** one_answer.define("ONEBIT_CONFIG_STATE_FRACTION_BITS")
    states = [one_answer.integer(float(last[0][f"x{k}"]) * unit) for k in range(1, 5)]
    words = " ".join(f"{state & 0xFFFFFFFF:08x}" for state in states)
    assert output == (
        f"agent {IN_FIRMWARE} steps {steps} checksum {checksum:08x} states {words} "
        "late 0 refused 0 aligned 0 lines_dropped 0 bytes_lost 0\n"
    )
    # And the README's.
    if steps == STEPS:
        shown = (ROOT / "ports/slcan/README.md").read_text().splitlines()
        assert {
            f"    {text}" for text in (output.strip(), *result.stdout.splitlines()[::5][:2])
        } <= {*shown}


def test_a_stop_by_signal_ends_firmware_and_host_in_the_same_step(board, tmp_path):
    """What a person does: Ctrl-C. All agents, here and there, have then made the same steps."""
    process, line = board
    command = [
        NODE, SCENARIO, "--interface", f"slcan:{line}", "--agents", OTHERS, "--sync-master",
        "--period", "0", "--arith", "q31", "--csv", tmp_path / "agent.csv",
    ]  # fmt: skip
    host = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    deadline = time.monotonic() + PATIENCE
    csv = tmp_path / "agent-7.csv"
    while not csv.exists() or len(csv.read_text().splitlines()) < 20:
        assert time.monotonic() < deadline and host.poll() is None, host.communicate()
        time.sleep(0.02)
    host.terminate()
    text, errors = host.communicate(timeout=PATIENCE)
    assert host.returncode == 0, text + errors
    output, _ = process.communicate(timeout=PATIENCE)
    steps = int(re.search(r"agent 7: steps (\d+)", text).group(1))
    assert steps >= 18
    assert output.startswith(f"agent {IN_FIRMWARE} steps {steps} "), output


def test_a_board_that_starts_late_hears_all_the_same(board, tmp_path):
    """The host asks again and again until it answers; then it answers all that it was asked."""
    process, line = board
    process.send_signal(signal.SIGSTOP)
    command = [
        NODE, SCENARIO, "--interface", f"slcan:{line}", "--agents", OTHERS, "--sync-master",
        "--period", "0", "--steps", "20", "--arith", "q31",
    ]  # fmt: skip
    host = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    time.sleep(1.2)  # as long as two of its attempts
    process.send_signal(signal.SIGCONT)
    text, errors = host.communicate(timeout=PATIENCE)
    assert host.returncode == 0, text + errors
    output, _ = process.communicate(timeout=PATIENCE)
    assert output.startswith(f"agent {IN_FIRMWARE} steps 20 "), output
    assert output.endswith("late 0 refused 0 aligned 0 lines_dropped 0 bytes_lost 0\n"), output
