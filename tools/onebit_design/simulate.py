"""An ensemble of onebit-sim for the scenario that was just designed."""

import csv
import subprocess
import tempfile
from dataclasses import dataclass
from pathlib import Path

# Estimates, one a directed link a step a run, that an ensemble may cost: some seconds.
ESTIMATES_MAX = 100_000_000


class SimulatorError(Exception):
    """onebit-sim did not take the scenario; the text is what it said."""


@dataclass
class Ensemble:
    runs: int
    steps: int
    rows: list[dict[str, str]]  # of mse.csv
    warnings: list[str]


def affordable_steps(steps: int, links: int, runs: int) -> int:
    return max(1, min(steps, ESTIMATES_MAX // (links * runs)))


def run(simulator: Path, scenario: str, runs: int, steps: int) -> Ensemble:
    with tempfile.TemporaryDirectory(prefix="onebit-design-") as folder:
        path = Path(folder) / "scenario.yaml"
        path.write_text(scenario, encoding="utf-8")
        options = [f"--runs={runs}", f"--steps={steps}", f"--out={folder}"]
        done = subprocess.run(
            [simulator, "run", path, *options], capture_output=True, text=True, check=False
        )
        if done.returncode != 0:
            raise SimulatorError(f"{simulator}: {done.stderr.strip()}")
        with (Path(folder) / "mse.csv").open(newline="") as file:
            rows = list(csv.DictReader(file))
    warnings = [line for line in done.stderr.splitlines() if line.startswith("warning: ")]
    return Ensemble(runs, steps, rows, warnings)
