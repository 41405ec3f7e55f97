#!/usr/bin/env python3
"""Draw what onebit-sim recorded: one state of every agent, or the group's disagreement.

  plot.py trajectory   --f64 DIR --q31 DIR --title T --out FILE [--state K] [--label L]
  plot.py disagreement --f64 DIR --q31 DIR --title T --out FILE
  plot.py --check PICTURE CSV...

Each DIR is an output folder of `onebit-sim run`. The pictures are SVG and depend on nothing but
the inputs and this file: drawn again, they are the same bytes. Each one records the SHA-256 of this
file and of its CSV inputs, and --check compares them with the files that are there now: 0 says that
PICTURE is what this file draws from the given CSV files, 1 that it is out of date, 2 bad use or
input. Give --check the CSV files of the q31 run. Those of the f64 run are recorded too but not
compared, because their last digits depend on the mathematics library of the machine.
"""

import argparse
import csv
import hashlib
import json
import math
import re
import sys
from pathlib import Path

GENERATOR = "tools/plot.py"
RECORD = re.compile(r"\b(generator|f64|q31) (\S+) sha256 ([0-9a-f]{64})")

# Okabe and Ito's colours, told apart by colour-blind readers too; the yellow, too pale for a thin
# line on white, is replaced by grey. On paper without colour the marker tells the agent.
AGENT_COLOURS = ("#000000", "#D55E00", "#0072B2", "#009E73", "#CC79A7", "#E69F00", "#777777")
AGENT_MARKERS = ("o", "s", "^", "D", "v", "P", "X")
# One dark, one light: they stay apart on paper without colour.
F64_COLOUR, Q31_COLOUR, FIT_COLOUR = "#1B4F9C", "#F0A000", "#000000"

STYLE = {
    # Text stays text, so that it can be searched and read aloud. Widths are those of the first
    # font, a wide one, so whichever of them the reader's machine has, nothing overlaps.
    "svg.fonttype": "none",
    "font.sans-serif": ["DejaVu Sans", "Verdana", "Helvetica", "Arial", "sans-serif"],
    "font.size": 10,
    # Identifiers inside the file come from a hash; with a fixed salt they never change.
    "svg.hashsalt": "onebit",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.titlesize": 12,
    "axes.titlelocation": "left",
    "axes.titlepad": 12,
    "legend.frameon": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "#DDDDDD",
    "grid.linewidth": 0.6,
    "hatch.linewidth": 0.5,
}


class InputError(Exception):
    """A file that cannot be used; the text is the one line for the person."""


def sha256(path):
    try:
        return hashlib.sha256(path.read_bytes()).hexdigest()
    except OSError as error:
        raise InputError(f"{path}: {error.strerror}") from error


def read_columns(path, names, may_be_empty=()):
    """The named columns of a CSV file as lists of numbers; an empty field that may be is NaN."""
    try:
        with path.open(newline="", encoding="utf-8") as file:
            rows = list(csv.DictReader(file, strict=True))
    except OSError as error:
        raise InputError(f"{path}: {error.strerror}") from error
    except (UnicodeDecodeError, csv.Error) as error:
        raise InputError(f"{path}: not CSV: {error}") from error
    if not rows:
        raise InputError(f"{path}: no rows")
    columns = {}
    for name in names:
        if name not in rows[0]:
            raise InputError(f"{path}: no column '{name}'")
        column = []
        for line, row in enumerate(rows, start=2):
            field = row[name]
            if field == "" and name in may_be_empty:
                column.append(math.nan)
                continue
            try:
                column.append(float(field))
            except (TypeError, ValueError):
                column.append(math.nan)
            if not math.isfinite(column[-1]):
                raise InputError(f"{path}:{line}: column '{name}': not a finite number")
        columns[name] = column
    return columns


def read_slope(path):
    """Slope and its first and last step, from a run's summary."""
    try:
        summary = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(f"{path}: {error.strerror}") from error
    except ValueError as error:
        raise InputError(f"{path}: not JSON: {error}") from error
    try:
        first, last = summary["slope_window"]
        return float(summary["slope"]), float(first), float(last)
    except (KeyError, TypeError, ValueError):
        raise InputError(f"{path}: no usable 'slope' and 'slope_window'") from None


def power_of_ten(value, _position=None):
    """1, 10, 100, 1,000, then 10⁴ ..: plain text, which every renderer places the same way."""
    if value == 0:
        return "0"
    exponent = round(math.log10(value))
    if 0 <= exponent <= 3:
        return f"{10**exponent:,}"
    return "10" + str(exponent).translate(str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"))


def signed(value):
    return f"{value:.3f}".replace("-", "−")


def new_axes(title):
    """Matplotlib is loaded here and not above, so that --check and a refusal answer at once."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    plt.rcParams.update(STYLE)
    # An opaque white card with a margin: the picture reads the same on a dark page.
    figure, axes = plt.subplots(figsize=(7.2, 4.4), layout="constrained", facecolor="white")
    figure.get_layout_engine().set(w_pad=0.16, h_pad=0.16)
    axes.set_title(title)
    return figure, axes


def agent_look(place):
    """Colour and marker of the agent at this place of the list; each pair of them comes once."""
    colours, markers = len(AGENT_COLOURS), len(AGENT_MARKERS)
    return {
        "color": AGENT_COLOURS[place % colours],
        "marker": AGENT_MARKERS[(place + place // colours) % markers],
        "markersize": 4.5,
        "markerfacecolor": "white",
        "markeredgewidth": 1.0,
    }


def draw_trajectory(options):
    column = f"x{options.state}"
    runs = {}
    for arithmetic, folder in (("f64", options.f64), ("q31", options.q31)):
        columns = read_columns(folder / "trajectory.csv", ("step", "agent", column))
        agents = runs.setdefault(arithmetic, {})
        for step, agent, state in zip(*columns.values(), strict=True):
            steps, states = agents.setdefault(int(agent), ([], []))
            steps.append(step)
            states.append(state)

    figure, axes = new_axes(options.title)
    from matplotlib.lines import Line2D
    from matplotlib.ticker import FixedLocator, FuncFormatter

    nothing = ([], [])
    handles = [
        Line2D(*nothing, color="#444444", linewidth=1.0, label="line: f64"),
        Line2D(*nothing, **agent_look(0) | {"color": "#444444"}, linestyle="none"),
    ]
    handles[1].set_label("marker: q31")
    agents = sorted(runs["f64"].keys() | runs["q31"].keys())
    for place, agent in enumerate(agents):
        look = agent_look(place)
        axes.plot(*runs["f64"].get(agent, nothing), color=look["color"], linewidth=1.0, zorder=2)
        # Each agent's markers begin at a row of their own, so that where the agents agree they
        # take turns along the common line and do not hide each other.
        turns = (place, len(agents))
        axes.plot(
            *runs["q31"].get(agent, nothing), **look, linestyle="none", markevery=turns, zorder=3
        )
        handles.append(Line2D(*nothing, **look, linewidth=1.0, label=f"agent {agent}"))

    last = max(steps[-1] for agents in runs.values() for steps, _ in agents.values())
    # Logarithmic from step 1 on; 0, which has no logarithm, stands one short linear piece before.
    axes.set_xscale("symlog", linthresh=1, linscale=0.4)
    decades = [10.0**k for k in range(int(math.log10(max(last, 1))) + 1)]
    minor = [decade * m for decade in decades for m in range(2, 10)]
    axes.xaxis.set_major_locator(FixedLocator([0.0, *decades]))
    axes.xaxis.set_minor_locator(FixedLocator(minor))
    axes.xaxis.set_major_formatter(FuncFormatter(power_of_ten))
    axes.set_xlim(-0.12, max(last, 1) * 1.2)
    axes.set_xlabel("step")
    axes.set_ylabel(options.label)
    figure.legend(handles=handles, loc="outside right center", handlelength=2.4)
    return figure, "trajectory.csv"


def draw_disagreement(options):
    runs = {}
    for arithmetic, folder in (("f64", options.f64), ("q31", options.q31)):
        columns = read_columns(folder / "mse.csv", ("step", "t", "mse", "mse_se"), ("mse_se",))
        runs[arithmetic] = (columns, read_slope(folder / "summary.json"))

    figure, axes = new_axes(options.title)
    import numpy as np
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    # The two arithmetics nearly coincide, so q31 is drawn over f64 and leaves half of it visible:
    # dashes on a line, hatching on a tint, dots on a line.
    lines = {
        "f64": {"color": F64_COLOUR, "linewidth": 1.6},
        "q31": {"color": Q31_COLOUR, "linewidth": 1.6, "linestyle": (0, (4, 3))},
    }
    bands = {
        "f64": {"facecolor": F64_COLOUR, "alpha": 0.18, "linewidth": 0},
        "q31": {"facecolor": "none", "edgecolor": Q31_COLOUR, "hatch": "///", "linewidth": 0},
    }
    fits = {
        "f64": {"color": FIT_COLOUR, "linewidth": 2.0},
        "q31": {"color": Q31_COLOUR, "linewidth": 2.0, "linestyle": (0, (1, 1.5))},
    }
    handles, labels = [], []
    fit_handles, fit_labels = [], []
    reference = None
    for arithmetic, (columns, (slope, first, last)) in runs.items():
        step, t, mse, mse_se = (np.array(column) for column in columns.values())
        (line,) = axes.plot(t, mse, zorder=3, **lines[arithmetic])
        if np.isfinite(mse_se).any():
            # An edge at or below zero has no logarithm: the band then reaches far down.
            lower = np.maximum(mse - 2 * mse_se, mse * 1e-3)
            band = axes.fill_between(t, lower, mse + 2 * mse_se, zorder=1, **bands[arithmetic])
            handles.append((band, line))
            labels.append(f"{arithmetic} ± 2 standard errors")
        else:
            handles.append(line)
            labels.append(arithmetic)
        inside = (step >= first) & (step <= last) & (mse > 0)
        if not inside.any():
            continue
        # Least squares passes through the mean of the points, which gives the line its height.
        ends = np.array([t[inside][0], t[inside][-1]])
        height = np.mean(np.log(mse[inside])) - slope * np.mean(np.log(t[inside]))
        (fit,) = axes.plot(ends, np.exp(height) * ends**slope, zorder=4, **fits[arithmetic])
        fit_handles.append(fit)
        fit_labels.append(
            f"fit to {arithmetic}: slope {signed(slope)}, steps {first:,.0f} to {last:,.0f}"
        )
        if reference is None:
            above = 4 * np.exp(height) * ends[0] ** slope
            reference = (ends, above * (ends / ends[0]) ** -1)
    if reference is not None:
        (line,) = axes.plot(*reference, color="#555555", linewidth=1.2, linestyle="-.")
        fit_handles.append(line)
        fit_labels.append("slope −1, to compare")

    axes.set_xscale("log")
    axes.set_yscale("log")
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_locator(LogLocator(numticks=20))
        axis.set_major_formatter(FuncFormatter(power_of_ten))
        axis.set_minor_formatter(NullFormatter())
    axes.set_ylim(bottom=axes.get_ylim()[0] / 2)  # room for the legend under the curve
    axes.set_xlabel("clock t")
    axes.set_ylabel("mean square disagreement")
    axes.legend(handles + fit_handles, labels + fit_labels, loc="lower left", handlelength=2.8)
    return figure, "mse.csv"


def write_picture(figure, options, name):
    import matplotlib.pyplot as plt

    record = [f"generator {GENERATOR} sha256 {sha256(Path(__file__))}"]
    for arithmetic, folder in (("f64", options.f64), ("q31", options.q31)):
        record.append(f"{arithmetic} {name} sha256 {sha256(folder / name)}")
    try:
        figure.savefig(
            options.out,
            format="svg",
            facecolor="white",
            metadata={
                "Creator": GENERATOR,
                "Date": None,
                "Title": options.title,
                "Description": "; ".join(record),
            },
        )
    except OSError as error:
        raise InputError(f"{options.out}: {error.strerror}") from error
    plt.close(figure)


def check(picture, inputs):
    """Whether the picture was drawn by this file from the given q31 inputs; says what differs."""
    try:
        text = picture.read_text(encoding="utf-8")
    except OSError as error:
        raise InputError(f"{picture}: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise InputError(f"{picture}: not a picture of {GENERATOR}") from error
    records = RECORD.findall(text)
    if not any(role == "generator" for role, _, _ in records):
        raise InputError(f"{picture}: not a picture of {GENERATOR}")
    fresh = True
    now = {path.name: (path, sha256(path)) for path in inputs}
    now[GENERATOR] = (Path(__file__), sha256(Path(__file__)))
    for role, name, recorded in records:
        if role == "f64":
            continue
        if name not in now:
            raise InputError(f"{picture}: drawn from {name}, which is not given")
        path, actual = now.pop(name)
        if actual != recorded:
            print(f"{picture}: out of date: {path} has changed since it was drawn")
            fresh = False
    for path, _ in now.values():
        raise InputError(f"{picture}: not drawn from {path.name}")
    return fresh


def arguments(argv):
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--check", nargs="+", type=Path, metavar=("PICTURE", "CSV"))
    kinds = parser.add_subparsers(dest="kind", metavar="trajectory|disagreement")
    for kind, draw, text in (
        ("trajectory", draw_trajectory, "one state of every agent over the steps"),
        ("disagreement", draw_disagreement, "mean square disagreement over t, with its slope"),
    ):
        one = kinds.add_parser(kind, help=text, description=f"Draw {text}.")
        one.add_argument("--f64", required=True, type=Path, metavar="DIR", help="the f64 run")
        one.add_argument("--q31", required=True, type=Path, metavar="DIR", help="the q31 run")
        one.add_argument("--title", required=True, metavar="T")
        one.add_argument("--out", required=True, type=Path, metavar="FILE", help="SVG to write")
        one.set_defaults(draw=draw)
        if kind == "trajectory":
            one.add_argument("--state", type=int, default=3, metavar="K", help="default 3")
            one.add_argument("--label", default="altitude", metavar="L", help="default altitude")
    options = parser.parse_args(argv)
    if (options.check is None) == (options.kind is None):
        parser.error("give one of trajectory, disagreement and --check")
    if options.check is not None and len(options.check) < 2:
        parser.error("--check wants a picture and the CSV files it was drawn from")
    return options


def main(argv):
    options = arguments(argv)
    try:
        if options.check is not None:
            return 0 if check(options.check[0], options.check[1:]) else 1
        figure, name = options.draw(options)
        write_picture(figure, options, name)
    except InputError as error:
        print(f"plot.py: {error}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
