"""Processes on a CAN interface of this kernel: onebit-node, candump and what tests ask of them."""

import json
import re
import shutil
import subprocess
import time
from pathlib import Path

import pytest
from simulator import BUILD, call

NODE = BUILD / "bin/onebit-node"
INTERFACE = "vcan0"
SYNC = 0x080
# A step of seven nodes on one processor under user-mode-linux takes a few milliseconds.
PERIOD = "20ms"

running = []


def program(name, package="can-utils"):
    return shutil.which(name) or pytest.fail(f"program {name} is missing (Debian: {package})")


def start(*command, **options):
    """A process that the end of the test ends, if nothing else does."""
    process = subprocess.Popen([str(word) for word in command], text=True, **options)
    running.append(process)
    return process


def end_all():
    for process in running:
        if process.poll() is None:
            process.kill()
        process.wait()
        for stream in (process.stdout, process.stderr):
            if stream:
                stream.close()
    running.clear()


def wait_until(what, condition, seconds=20):
    """Polls until the condition is true."""
    deadline = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < deadline, f"not within {seconds} s: {what}"
        time.sleep(0.02)


def listeners(identifier):
    """How many raw sockets the kernel has on INTERFACE for one 11-bit identifier."""
    count = 0
    for path in Path("/proc/net/can").glob("rcvlist_*"):
        for line in path.read_text().splitlines():
            words = line.split()
            if len(words) == 7 and words[0] == INTERFACE and words[6] == "raw":
                count += int(words[1], 16) == identifier
    return count


def all_listeners():
    """How many filters raw sockets have on INTERFACE."""
    count = 0
    for path in Path("/proc/net/can").glob("rcvlist_*"):
        for line in path.read_text().splitlines():
            words = line.split()
            count += len(words) == 7 and words[0] == INTERFACE and words[6] == "raw"
    return count


def send(frame):
    """One frame by cansend, in its notation: identifier#data."""
    subprocess.run([program("cansend"), INTERFACE, frame], check=True)


class Dump:
    """candump -L of the interface from now on."""

    def __init__(self, path):
        self.path = path
        before = all_listeners()
        with path.open("w") as file:
            # -D: it stays when the interface goes down; -r: room for a burst.
            self.process = start(
                program("candump"), "-L", "-D", "-r", "16000000", INTERFACE, stdout=file
            )
        wait_until("candump listens", lambda: all_listeners() > before)

    def stop(self):
        # Behind on a busy processor, it has yet to write what the kernel holds for it.
        size = -1
        while size != self.path.stat().st_size:
            size = self.path.stat().st_size
            time.sleep(0.5)
        self.process.terminate()
        self.process.wait(timeout=10)
        return self.path

    def frames(self):
        """(identifier's text, data) of each line."""
        form = re.compile(r"\(\d+\.\d{6}\) vcan0 ([0-9A-F]+)#(.*)")
        return [form.fullmatch(line).groups() for line in self.path.read_text().splitlines()]


class Node:
    """One onebit-node process, its CSV and its summary."""

    def __init__(self, folder, scenario, agent, *options, name=None, sync=True):
        name = name or f"agent-{agent}"
        self.agent = agent
        self.csv = folder / f"{name}.csv"
        self.output = folder / f"{name}.json"
        self.errors = folder / f"{name}.err"
        pace = ("--sync",) if sync else ()
        with self.output.open("w") as output, self.errors.open("w") as errors:
            self.process = start(
                NODE, scenario, "--interface", INTERFACE, "--agent", agent, *pace,
                "--csv", self.csv, "--json", *options,
                stdout=output, stderr=errors,
            )  # fmt: skip

    def wait(self, seconds=30):
        """Its exit status, when it has ended by itself."""
        try:
            return self.process.wait(timeout=seconds)
        except subprocess.TimeoutExpired:
            pytest.fail(f"agent {self.agent} still runs; {self.errors.read_text()}")

    def stop(self):
        """Ends it as Ctrl-C and systemd do, politely; the exit status."""
        self.process.terminate()
        return self.wait(10)

    def summary(self):
        return json.loads(self.output.read_text())

    def text(self):
        return self.csv.read_text()

    def rows(self):
        """Its CSV: a dictionary of text a step."""
        header, *lines = self.text().splitlines()
        return [dict(zip(header.split(","), line.split(","), strict=True)) for line in lines]


def start_nodes(folder, scenario, *options, agents=range(1, 8)):
    """Nodes that are ready for the first SYNC."""
    before = listeners(SYNC)
    nodes = [Node(folder, scenario, agent, *options) for agent in agents]

    def ready():
        for node in nodes:
            assert node.process.poll() is None, node.errors.read_text()
        return listeners(SYNC) >= before + len(nodes)

    wait_until("all nodes listen to SYNC", ready)
    return nodes


def start_master(scenario, *, period=PERIOD, steps=None, seed=1):
    """Period 0 is as fast as the group answers: it knows by the seed which links a step has."""
    limit = ("--steps", steps) if steps else ()
    return start(
        NODE, scenario, "--interface", INTERFACE, "--sync-master", "--period", period,
        "--seed", seed, *limit,
        stdout=subprocess.PIPE, stderr=subprocess.PIPE,
    )  # fmt: skip


def finish(master, nodes, seconds=120):
    """Waits for the master and then the nodes, all of which must end well by themselves."""
    try:
        output, errors = master.communicate(timeout=seconds)
    except subprocess.TimeoutExpired:
        pytest.fail("the master still runs")
    assert master.returncode == 0, output + errors
    # In lock step a machine that stands still for long loses messages, and that is no bug.
    assert "incomplete steps 0" in output, f"the machine is too busy for this test: {output}"
    for node in nodes:
        assert node.wait() == 0, node.errors.read_text()


def disagreement(nodes, step):
    """Mean squared distance of the nodes' states to their mean, before that step."""
    states = []
    for node in nodes:
        row = node.rows()[step]
        states.append([float(value) for key, value in row.items() if re.fullmatch(r"x\d+", key)])
    mean = [sum(column) / len(states) for column in zip(*states, strict=True)]
    return sum(
        (value - middle) ** 2 for state in states for value, middle in zip(state, mean, strict=True)
    ) / len(states)


def replay(scenario, log, agent, arithmetic="q31", seed=1):
    result = call(
        "replay", scenario, log, "--agent", agent, "--arith", arithmetic, "--seed", seed
    )  # fmt: skip
    assert result.returncode == 0, result.stderr
    return result.stdout
