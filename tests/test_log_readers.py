"""The bus logs of a run, read by programs that are not ours: python-can, can-utils, scapy.

All of them must find the same frames at the same times, in the text and in the pcap file.
"""

import importlib
import os
import re
import shutil
import subprocess
from typing import NamedTuple

import pytest
import yaml
from simulator import SCENARIOS, run, summary

STEPS = 150  # more than SYNC counts
SYNC = 0x080


class Frame(NamedTuple):
    microseconds: int
    identifier: int
    extended: bool
    remote: bool
    data: bytes


def missing(what):
    """Where CI is set everything must be there; elsewhere a test may be left out."""
    if os.environ.get("CI"):
        pytest.fail(f"{what} is missing")
    pytest.skip(f"{what} is missing")


def module(name):
    try:
        return importlib.import_module(name)
    except ImportError:
        return missing(f"Python module {name}")


def program(name):
    return shutil.which(name) or missing(f"program {name} (Debian, Ubuntu: can-utils)")


@pytest.fixture(scope="module", params=["two-agents", "aircraft-fixed-broadcast"])
def logs(request, tmp_path_factory):
    """The same run logged as text and as pcap, what it says of itself, and its t0."""
    folder = tmp_path_factory.mktemp(request.param)
    scenario = SCENARIOS / f"{request.param}.yaml"
    text, pcap = folder / "bus.log", folder / "bus.pcap"
    run(scenario, steps=STEPS, out=folder / "out", log=text)
    run(scenario, steps=STEPS, out=folder / "out", log=pcap)
    t0 = yaml.safe_load(scenario.read_text())["gains"]["t0"]
    return text, pcap, summary(folder / "out"), t0


def own_frames(text):
    """The text's frames by the rules of candump -L alone."""
    line_form = re.compile(r"\((\d{10})\.(\d{6})\) vcan0 ([0-9A-F]{3}|[0-9A-F]{8})#([0-9A-F]*)")
    frames = []
    for line in text.read_text().splitlines():
        match = line_form.fullmatch(line)
        assert match, line
        seconds, fraction, identifier, data = match.groups()
        frames.append(
            Frame(
                int(seconds) * 1_000_000 + int(fraction),
                int(identifier, 16),
                len(identifier) == 8,
                False,
                bytes.fromhex(data),
            )
        )
    return frames


def test_log_holds_the_run(logs):
    text, _, result, t0 = logs
    frames = own_frames(text)
    assert len(frames) == result["frames"]
    assert frames[0].identifier == SYNC
    counters = [frame.data for frame in frames if frame.identifier == SYNC]
    assert counters == [bytes([t % 128 or 128]) for t in range(t0 + 1, t0 + 1 + STEPS)]
    assert bytes([128]) in counters and bytes([0]) not in counters
    assert all(frame.identifier <= 0x7EF for frame in frames if not frame.extended)
    assert all(len(frame.data) <= 1 for frame in frames)
    times = [frame.microseconds for frame in frames]
    assert times == sorted(times)


def test_python_can_reads_the_text(logs):
    text, *_ = logs
    with module("can").CanutilsLogReader(text) as reader:
        frames = [
            Frame(
                round(message.timestamp * 1e6),
                message.arbitration_id,
                message.is_extended_id,
                message.is_remote_frame,
                bytes(message.data),
            )
            for message in reader
            if not (message.is_error_frame or message.is_fd)
        ]
    assert frames == own_frames(text)


def test_can_utils_read_the_text(logs):
    text, *_ = logs
    with text.open() as file:
        result = subprocess.run(
            [program("log2long")], stdin=file, capture_output=True, text=True, check=True
        )
    line_form = re.compile(
        r"\((\d+)\.(\d{6})\)  vcan0  +([0-9A-F]+)  +\[(\d)\] ((?: [0-9A-F]{2})*)"
    )
    frames = []
    for line in result.stdout.splitlines():
        match = line_form.match(line)
        assert match, line
        seconds, fraction, identifier, length, data = match.groups()
        assert int(length) == len(data.split())
        frames.append(
            Frame(
                int(seconds) * 1_000_000 + int(fraction),
                int(identifier, 16),
                len(identifier) == 8,
                "remote request" in line,
                bytes.fromhex(data),
            )
        )
    assert frames == own_frames(text)


def test_scapy_reads_the_pcap(logs):
    text, pcap, *_ = logs
    can = module("scapy.layers.can")
    frames = []
    for packet in module("scapy.utils").rdpcap(str(pcap)):
        assert type(packet) is can.CAN
        frames.append(
            Frame(
                round(packet.time * 1_000_000),
                packet.identifier,
                "extended" in packet.flags,
                "remote_transmission_request" in packet.flags,
                bytes(packet.data)[: packet.length],
            )
        )
        assert "error" not in packet.flags
    assert frames == own_frames(text)
