"""The committed sim/wire_tables.h is what tools/wire_tables.py prints."""

import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent


def test_tables_are_fresh():
    command = [sys.executable, ROOT / "tools/wire_tables.py"]
    result = subprocess.run(command, capture_output=True, text=True, check=True)
    assert (ROOT / "sim/wire_tables.h").read_text() == result.stdout
