"""For tests that with_can.py runs: a fresh vcan0 for each, and nothing left running after it."""

import subprocess
import sys
from pathlib import Path

import pytest

# The helpers of the other tests.
sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

import bus


def ip(*words):
    return subprocess.run(["ip", *words], capture_output=True, text=True, check=False)


@pytest.fixture
def vcan():
    """The name of an interface that is up."""
    made = ip("link", "add", "dev", "vcan0", "type", "vcan")
    if made.returncode != 0:
        pytest.fail(f"no vcan0 here ({made.stderr.strip()}); run by tests/kernel/with_can.py")
    ip("link", "set", "dev", "vcan0", "up")
    yield "vcan0"
    bus.end_all()
    ip("link", "delete", "dev", "vcan0")


@pytest.fixture(autouse=True)
def nothing_left_running():
    yield
    bus.end_all()
