#!/usr/bin/env python3
"""Run both examples of the paper in f64 and q31; print a table and draw the pictures.

Wants the `host` build and no arguments: `tools/run demo` makes the one and calls this. An ensemble
of runs goes over the ideal bus, one run over a CAN bus; results go to build/host/results/.
"""

import json
import os
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
SIMULATOR = ROOT / "build" / "host" / "bin" / "onebit-sim"
RESULTS = ROOT / "build" / "host" / "results"
ENSEMBLE_RUNS = 40
ARITHMETICS = ("f64", "q31")


@dataclass
class Example:
    scenario: str
    topology: str
    steps: int
    slope_window: tuple[int, int]  # steps; before it the estimator's noise still fills its bounds


EXAMPLES = (
    Example("aircraft-fixed", "fixed topology", 300_000, (30_000, 300_000)),
    Example("aircraft-markov", "Markov-switching topology", 1_000_000, (100_000, 1_000_000)),
)

COLUMNS = (
    "arith",
    "bus",
    "runs",
    "final disagreement",
    "slope",
    "frames a run",
    "wire bits a run",
    "bus load",
    "late",
    "latency mean, max",
    "time",
)


class DemoError(Exception):
    """What ends the demo; the text is the one line for the person."""


def on_can_bus(path, copy):
    """Write a copy of the scenario that differs in the bus alone, and so in one word of text."""
    text = path.read_text(encoding="utf-8")
    ideal = "model: ideal"
    if text.count(ideal) != 1:
        raise DemoError(f"{path}: '{ideal}' wanted once, to run the scenario on a CAN bus too")
    copy.write_text(text.replace(ideal, "model: can"), encoding="utf-8")
    return copy


def simulate(example, arithmetic, bus, progress):
    """One call of the simulator; its summary with the bus and the time that passed."""
    scenario = ROOT / "sim" / "scenarios" / f"{example.scenario}.yaml"
    folder = results_of(example, arithmetic, bus)
    folder.mkdir(parents=True, exist_ok=True)
    if bus == "can":
        scenario = on_can_bus(scenario, folder / "scenario.yaml")
    runs = ENSEMBLE_RUNS if bus == "ideal" else 1
    first, last = (str(step) for step in example.slope_window)
    command = [SIMULATOR, "run", scenario, "--arith", arithmetic, "--runs", str(runs)]
    command += ["--steps", str(example.steps), "--threads", str(os.cpu_count() or 1)]
    command += ["--slope-window", first, last, "--out", folder]
    progress(f"{example.scenario}, {arithmetic}, {bus} bus, {runs} runs of {example.steps:,} steps")
    begin = time.monotonic()
    # Standard error stays the simulator's: its warnings, its progress, its one line if it fails.
    status = subprocess.run(command, stdout=subprocess.DEVNULL, check=False).returncode
    if status != 0:
        raise DemoError(f"onebit-sim ended with status {status} on {scenario} in {arithmetic}")
    summary = json.loads((folder / "summary.json").read_text(encoding="utf-8"))
    return summary | {"bus": bus, "elapsed": time.monotonic() - begin}


def results_of(example, arithmetic, bus):
    return RESULTS / f"{example.scenario}-{arithmetic}-{bus}"


def table_row(summary):
    error = summary["mse_se"]
    row = [
        summary["arith"],
        summary["bus"],
        f"{summary['runs']}",
        f"{summary['mse']:.2e}" + (f" +- {error:.1e}" if error is not None else ""),
        f"{summary['slope']:.3f}",
        f"{summary['frames']:,.0f}",
        f"{summary['wire_bits']:,.0f}",
    ]
    # An ideal bus has no bit rate, so nothing on it loads, waits or comes late.
    if summary["bus"] == "can":
        row += [f"{100 * summary['bus_load']:.2f} %", f"{summary['late_frames']:,.0f}"]
        if "latency_mean" in summary:
            mean, longest = (1e3 * summary[f"latency_{which}"] for which in ("mean", "max"))
            row.append(f"{mean:.2f}, {longest:.2f} ms")
        else:
            row.append("-")
    else:
        row += ["-", "-", "-"]
    return [*row, f"{summary['elapsed']:.1f} s"]


def print_table(example, summaries):
    first, last = example.slope_window
    print(
        f"{example.scenario}: seven aircraft, {example.topology}, {example.steps:,} steps,"
        f" slope over steps {first:,} to {last:,}"
    )
    rows = [COLUMNS, *(table_row(summary) for summary in summaries)]
    widths = [max(len(row[place]) for row in rows) for place in range(len(COLUMNS))]
    for row in rows:
        # Figures to the right, but for the one with an error behind it.
        cells = [
            cell.ljust(width) if place in (0, 1, 3) else cell.rjust(width)
            for place, (cell, width) in enumerate(zip(row, widths, strict=True))
        ]
        print("  " + "  ".join(cells).rstrip())
    print(flush=True)


def draw(example):
    """The example's two pictures, from the ensembles."""
    pictures = (
        ("trajectory", "altitude", "altitudes of one run"),
        ("disagreement", "disagreement", f"disagreement, {ENSEMBLE_RUNS} runs"),
    )
    written = []
    for kind, name, subject in pictures:
        picture = RESULTS / f"{example.scenario}-{name}.svg"
        command = [sys.executable, ROOT / "tools" / "plot.py", kind, "--out", picture]
        for arithmetic in ARITHMETICS:
            command += [f"--{arithmetic}", results_of(example, arithmetic, "ideal")]
        command += ["--title", f"Seven aircraft, {example.topology}: {subject}"]
        if subprocess.run(command, check=False).returncode != 0:
            raise DemoError(f"{picture} could not be drawn")
        written.append(picture)
    return written


def main():
    if len(sys.argv) > 1:
        wanted_help = sys.argv[1:] in (["--help"], ["-h"])
        print(__doc__, end="", file=sys.stdout if wanted_help else sys.stderr)
        return 0 if wanted_help else 2

    def progress(line):
        if sys.stderr.isatty():
            print(line, file=sys.stderr, flush=True)

    pictures = []
    try:
        for example in EXAMPLES:
            summaries = [
                simulate(example, arithmetic, bus, progress)
                for bus in ("ideal", "can")
                for arithmetic in ARITHMETICS
            ]
            print_table(example, summaries)
            pictures += draw(example)
    except (DemoError, OSError) as error:
        print(f"demo.py: {error}", file=sys.stderr)
        return 1
    print(f"CSV files and pictures in {RESULTS.relative_to(ROOT)}/:")
    for picture in pictures:
        print(f"  {picture.name}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
