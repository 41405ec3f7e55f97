"""onebit-design: from a plant and a network to constants one can trust."""

import argparse
import contextlib
import dataclasses
import errno
import json
import math
import shutil
import sys
import tempfile
from pathlib import Path

from . import (
    bus_cost,
    choose,
    conditions,
    dbc,
    formats,
    header,
    prediction,
    reader,
    report,
    scenario,
    simulate,
)
from .problem import InputError
from .system import System

DONE, FAILURE, BAD_USE = 0, 1, 2

# A prediction costs the cube of the unknowns: about half a minute for this many, one second each
# for the smaller number, of which a search asks some dozens.
PREDICTED_MAX, SEARCHED_MAX = 300, 100
WITHOUT_RATE = 1e30

DESCRIPTION = """\
Reads a machine and a network, chooses what the file leaves to `auto`, and writes into DIR:

  scenario.yaml     complete, for onebit-sim run
  onebit_config.h   constants for firmware, in any arithmetic
  design.json       every figure, condition and prediction
  onebit.dbc        the frames, for CAN tools (payload encoding)
  prediction.svg    predicted disagreement over a simulated ensemble

The report on the terminal says of each condition of the theorems whether it holds and by what
margin, or what would mend it. Exit status: 0 done, 1 failure, 2 bad use or input.
"""


def read_arguments(arguments: list[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="onebit-design",
        description=DESCRIPTION,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("system", type=Path, metavar="SYSTEM.yaml", help="the machine, the network")
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder to write to")
    parser.add_argument(
        "--objective",
        choices=("theorem", "fast"),
        default="theorem",
        help="automatic beta and gamma: what the theorems ask (default), or the least predicted "
        "error, whatever they ask",
    )
    parser.add_argument(
        "--runs",
        type=int,
        default=40,
        metavar="R",
        help="of the simulated ensemble (default 40); 0: none",
    )
    parser.add_argument("--simulator", type=Path, metavar="FILE", help="the program onebit-sim")
    options = parser.parse_args(arguments)
    if options.runs < 0 or options.runs == 1:
        parser.error("--runs: a band needs 2 runs or more; 0 leaves the simulation out")
    return options


def write_all(folder: Path, files: dict[str, bytes]) -> None:
    """Each file whole or not at all, and none put in place unless all could be written."""
    made = not folder.exists()
    for name in files:
        # The one reason for which a rename fails half-way through, seen before the first.
        if (folder / name).is_dir():
            raise IsADirectoryError(errno.EISDIR, "is a folder", str(folder / name))
    temporary: dict[str, Path] = {}
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for name, content in files.items():
            with tempfile.NamedTemporaryFile(dir=folder, prefix=f".{name}.", delete=False) as file:
                temporary[name] = Path(file.name)
                file.write(content)
            temporary[name].chmod(0o644)
        for name, path in temporary.items():
            path.replace(folder / name)
    except OSError:
        for path in temporary.values():
            path.unlink(missing_ok=True)
        if made:
            with contextlib.suppress(OSError):
                folder.rmdir()
        raise


def find_formats(request: reader.Request) -> formats.Formats:
    try:
        return formats.choose(request.system)
    except formats.FormatError as error:
        request.refuse(error.name, str(error))


def unknowns(system: System) -> int:
    """States and estimates of all agents, whose covariance a prediction follows."""
    return system.initial_states.size + len(system.links)


def predicted_error(system: System) -> float:
    """What --objective fast makes least: the disagreement after the last step or, in groups where
    that takes long, what it tends to."""
    if unknowns(system) <= SEARCHED_MAX:
        return prediction.predict(system, system.steps).mse[-1]
    moments = prediction.Moments(system, prediction.Network(system))
    limit, _, slowest = prediction.limits(moments)
    end = system.t0 + 1 + system.steps
    # Without the rate 1/t what remains of the start decides; such gains rank behind all others.
    return limit / end if math.isfinite(limit) else WITHOUT_RATE * end ** (-2 * slowest)


def design(options: argparse.Namespace) -> None:
    request = reader.read(options.system)
    system = request.system
    choices = choose.choose(request, options.objective, predicted_error)
    reader.check_numbers(request)
    chosen_formats = find_formats(request)
    system.fixed = {
        "state_fraction_bits": chosen_formats.state,
        "control_fraction_bits": chosen_formats.control,
    }
    figures = conditions.compute(system, request.controllability)
    predicted = None
    if unknowns(system) <= PREDICTED_MAX:
        predicted = prediction.predict(system, system.steps)
    costs = bus_cost.bus_cost(system)
    scenario_text = scenario.render(system, chosen_formats)
    ensemble, why_not = None, "--runs 0"
    if options.runs > 0:
        simulator = options.simulator or shutil.which("onebit-sim")
        why_not = "no program onebit-sim found; see --simulator"
        if simulator is not None:
            steps = simulate.affordable_steps(system.steps, len(system.links), options.runs)
            ensemble = simulate.run(Path(simulator), scenario_text, options.runs, steps)

    entries = report.figures_entries(system, figures, choices, chosen_formats)
    entries["prediction"] = dataclasses.asdict(predicted) if predicted else None
    entries["simulation"] = report.simulation_entries(predicted, ensemble)
    entries["bus"] = costs
    files = {
        "scenario.yaml": scenario_text.encode(),
        "onebit_config.h": header.render(system, chosen_formats).encode(),
        "design.json": (
            json.dumps(report.plain(entries), indent=2, allow_nan=False) + "\n"
        ).encode(),
    }
    if predicted is not None:
        files["prediction.svg"] = draw(predicted, ensemble)
    if system.bus["encoding"] == "payload":
        files["onebit.dbc"] = dbc.dbc_text(system).encode()
    write_all(options.out, files)

    lines = [
        *report.figures_lines(system, figures, choices, chosen_formats),
        "",
        *report.prediction_lines(predicted),
        "",
        *report.simulation_lines(predicted, ensemble, why_not),
        "",
        *bus_cost.report_lines(costs),
        "",
        f"Written to {options.out}: {', '.join(sorted(files))}",
    ]
    if "onebit.dbc" not in files:
        lines.append("No onebit.dbc: a DBC describes data bytes, the identifier encoding has none.")
    print("\n".join(lines))


def draw(predicted: prediction.Prediction, ensemble: simulate.Ensemble | None) -> bytes:
    with tempfile.TemporaryDirectory(prefix="onebit-design-") as folder:
        path = Path(folder) / "prediction.svg"
        prediction.draw(predicted, ensemble.rows if ensemble else [], path)
        return path.read_bytes()


def main(arguments: list[str] | None = None) -> int:
    options = read_arguments(arguments)
    try:
        design(options)
    except InputError as error:
        print(f"onebit-design: {error}", file=sys.stderr)
        return BAD_USE
    except (OSError, simulate.SimulatorError) as error:
        print(f"onebit-design: {error}", file=sys.stderr)
        return FAILURE
    return DONE


if __name__ == "__main__":
    sys.exit(main())
