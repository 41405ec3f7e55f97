"""Where the tests find the simulator, and one way to call it."""

import csv
import json
import os
import subprocess
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
BUILD = Path(os.environ.get("ONEBIT_BUILD", ROOT / "build/host")).resolve()
SIMULATOR = BUILD / "bin/onebit-sim"
SCENARIOS = ROOT / "sim/scenarios"


def call(*arguments):
    """Run onebit-sim; the completed process, whatever its status."""
    command = [str(argument) for argument in (SIMULATOR, *arguments)]
    return subprocess.run(command, capture_output=True, text=True, check=False)


def run(scenario, **options):
    """A run that must succeed; options as keywords (slope_window=(1, 2))."""
    arguments = []
    for name, value in options.items():
        values = value if isinstance(value, tuple) else (value,)
        arguments += ["--" + name.replace("_", "-"), *values]
    result = call("run", scenario, *arguments)
    assert result.returncode == 0, result.stderr
    return result


def summary(folder):
    return json.loads((folder / "summary.json").read_text())


def rows(path):
    """A CSV file as dictionaries of text."""
    with path.open(newline="") as file:
        return list(csv.DictReader(file))
