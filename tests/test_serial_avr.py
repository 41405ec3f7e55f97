"""An agent on an ATmega328P hears the other six by its USART and has the simulator's bits.

simavr plays bytes to the USART at given times: what a host and the other agents of the simulator's
run say as slcan. What the image sends and its checksum of all estimates and controls must be the
simulator's. (tests/test_mixed_bus.py has the processors whose emulators take a live line.)
"""

import os
import re
import shutil
import subprocess
import sys

import pytest
from simulator import ROOT, SCENARIOS, SIMULATOR, run

sys.path.insert(0, str(ROOT / "tools"))

import one_answer

SCENARIO = SCENARIOS / "aircraft-integer.yaml"
AGENT = 3  # CONFIG of ports/firmware/node.c
STEPS = 300  # the clock, modulo 128, goes round twice
PACKAGES = {"avr-gcc": "gcc-avr and avr-libc", "simavr": "simavr"}

# Microseconds. A byte takes 85 at 117,647 bit/s; a step's 54 bytes and the agent's work on them
# are over well within PERIOD.
BYTE = 100
PERIOD = 12_000


def call(*command, **options):
    done = subprocess.run(
        [str(word) for word in command], capture_output=True, text=True, check=False, **options
    )
    assert done.returncode == 0, f"{' '.join(done.args)}\n{done.stdout}{done.stderr}"
    return done.stdout


@pytest.fixture(scope="module")
def image(tmp_path_factory):
    for program, package in PACKAGES.items():
        if shutil.which(program) is None:
            message = f"no {program} here (Debian package {package})"
            (pytest.fail if "CI" in os.environ else pytest.skip)(message)
    folder = tmp_path_factory.mktemp("avr5")
    call("cmake", "--preset", "avr5", "-B", folder, cwd=ROOT)
    call("cmake", "--build", folder, "--target", "node")
    return folder / "bin/node.elf"


def frames(log):
    """Identifier and data of each frame of a candump log."""
    for line in log.read_text().splitlines():
        identifier, _, data = line.split()[2].partition("#")
        yield int(identifier, 16), data


def schedule(log):
    """Time and byte of all that the others and their host send."""
    sent, time = [], 0

    def send(line, at):
        nonlocal time
        time = max(time, at)
        for character in f"{line}\r":
            sent.append((time, ord(character)))
            time += BYTE

    for command in ("C", "S6", "O"):
        send(command, PERIOD)
    step = 1
    for identifier, data in frames(log):
        if identifier == 0x080:
            step += 1
        if identifier != 0x100 + AGENT:
            send(f"t{identifier:03X}{len(data) // 2}{data}", step * PERIOD)
    send("t00020200", (step + 1) * PERIOD)  # CANopen's stop of all nodes ends the last step
    send("C", (step + 2) * PERIOD)
    send("", (step + 20) * PERIOD)  # simavr ends with its input
    return sent


def write_input(path, sent):
    """A value change dump of simavr's own names: uar0_0 is the input of USART0."""
    head = "$timescale 1us $end\n$var wire 8 ! uar0_0 $end\n$enddefinitions $end\n"
    path.write_text(head + "".join(f"#{time}\nb{byte:08b} !\n" for time, byte in sent))


def test_the_bits_are_the_simulators(image, tmp_path):
    log = tmp_path / "bus.log"
    run(SCENARIO, arith="q31", steps=STEPS, log=log)
    write_input(tmp_path / "line.vcd", schedule(log))
    output = call(ROOT / "ports/avr5/simulate.sh", image, "-i", tmp_path / "line.vcd", timeout=300)

    # simavr breaks long lines, and writes a point where a CR was.
    text = output.replace("\n", "")
    said = re.findall(rf"t{0x100 + AGENT:03X}1([0-9A-F]{{2}})", text)
    assert said == [data for identifier, data in frames(log) if identifier == 0x100 + AGENT]
    assert len(said) == STEPS

    checksum = one_answer.checksums(one_answer.replayed(SIMULATOR, log, AGENT))[STEPS]
    assert f"agent {AGENT} steps {STEPS} checksum {checksum:08x} " in text
    assert text.endswith("late 0 refused 0 aligned 0 lines_dropped 0 bytes_lost 0")
