#!/usr/bin/env python3
"""Work out what the firmware of ports/firmware/aircraft.c must print, from the simulator.

usage: tools/one_answer.py SIMULATOR > ports/firmware/aircraft.txt

SIMULATOR is onebit-sim. It runs sim/scenarios/aircraft-integer.yaml in q31 with a log of the bus,
then replays the log to each agent; the estimates and controls that a replay prints are turned back
into the library's integers, and zlib makes the checksums.
"""

import csv
import struct
import subprocess
import sys
import tempfile
import zlib
from pathlib import Path

import yaml

ROOT = Path(__file__).resolve().parent.parent
SCENARIO = ROOT / "sim/scenarios/aircraft-integer.yaml"
CONFIG = ROOT / "ports/firmware/onebit_config.h"
NOISE_FRACTION_BITS = 27  # Q4.27, the library's noise units
PRINTED = (1, 10, 100, 1000)  # and the last step


def define(name: str) -> int:
    """A number that the firmware's constants have."""
    for line in CONFIG.read_text().splitlines():
        words = line.split()
        if words[:2] == ["#define", name]:
            return int(words[2])
    raise SystemExit(f"{CONFIG}: no {name}, must be written by onebit-design")


def integer(number: float) -> int:
    """Of a number that must be whole: what the simulator prints is exact."""
    if number != int(number):
        raise SystemExit(f"{number!r} is not a whole number of units: not the run that it was")
    return int(number)


def replayed(simulator: Path, log: Path, agent: int) -> list[list[int]]:
    """For each step the agent's estimates, ascending by neighbour, and its control."""
    command = [simulator, "replay", SCENARIO, log, "--agent", str(agent), "--arith", "q31"]
    done = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True)
    sigma = yaml.safe_load(SCENARIO.read_text())["noise"]["sigma"]
    control_unit = 2.0 ** define("ONEBIT_CONFIG_CONTROL_FRACTION_BITS")
    estimate_unit = 2.0**NOISE_FRACTION_BITS / sigma
    steps = []
    for row in csv.DictReader(done.stdout.splitlines()):
        neighbours = [name for name in row if name.startswith("zhat_")]
        numbers = [integer(float(row[name]) * estimate_unit) for name in neighbours]
        steps.append([*numbers, integer(float(row["u"]) * control_unit)])
    return steps


def checksums(steps: list[list[int]]) -> dict[int, int]:
    """CRC-32 of the values so far, lowest byte first, after each step that is printed."""
    wanted, checksum = {}, 0
    for step, values in enumerate(steps, 1):
        checksum = zlib.crc32(struct.pack(f"<{len(values)}i", *values), checksum)
        if step in PRINTED or step == len(steps):
            wanted[step] = checksum
    return wanted


def main() -> None:
    if len(sys.argv) != 2:
        print("usage: tools/one_answer.py SIMULATOR > ports/firmware/aircraft.txt", file=sys.stderr)
        sys.exit(2)
    simulator = Path(sys.argv[1])
    with tempfile.TemporaryDirectory() as folder:
        log = Path(folder) / "bus.log"
        command = [simulator, "run", SCENARIO, "--arith", "q31", "--log", log]
        subprocess.run(command, stdout=subprocess.DEVNULL, check=True)
        agents = define("ONEBIT_CONFIG_AGENTS")
        columns = [checksums(replayed(simulator, log, agent + 1)) for agent in range(agents)]
    for step in columns[0]:
        print(f"step {step}", *(f"{column[step]:08x}" for column in columns))


if __name__ == "__main__":
    main()
