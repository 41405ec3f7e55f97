"""Bad scenario files through `onebit-sim run`: exit status 2, one line that names file, line and
key, and nothing left behind. Every case marks the line that must be named with the comment HERE."""

import os
import random
import re
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
PROGRAM = Path(os.environ.get("ONEBIT_BUILD", ROOT / "build" / "host")) / "bin" / "onebit-sim"
SCENARIOS = sorted((ROOT / "sim" / "scenarios").glob("*.yaml"))

GOOD = """\
# A good file, which every case spoils in one place.
name: three
plant:
  A:
    - [1, 1]
    - [0, 1]
  B: [0.5, 1]
gains:
  stabilizing: [0, -0.5]
  compression: [0.5, 0.75]
  beta: 200
  gamma: 2
  t0: 10
quantizer:
  threshold: 0
  bound: 1
noise:
  sigma: 1
topology:
  graphs:
    - edges:
        - [1, 2]
        - [2, 3]
    - edges: [[3, 1]]
  transition:
    - [0.5, 0.5]
    - [0.25, 0.75]
initial:
  states:
    - [-1, 0]
    - [1, 0]
    - [0, 0]
  estimates: 0
channel:
  mode: broadcast
bus:
  model: ideal
  bitrate: 500000
  encoding: payload
  base: 0x100
fixed:
  state_fraction_bits: 26
  control_fraction_bits: 26
period: 1
steps: 3
"""

ONE_GRAPH = GOOD.replace("    - edges: [[3, 1]]\n", "").replace(
    "  transition:\n    - [0.5, 0.5]\n    - [0.25, 0.75]\n", ""
)


def run(path, *options):
    return subprocess.run(
        [PROGRAM, "run", path, *options], capture_output=True, check=False, timeout=60
    )


def spoil(old, new, text=GOOD):
    assert text.count(old) == 1, old
    return text.replace(old, new)


def errors_of(result):
    """The lines on standard error that are no warnings; those come after a good load."""
    lines = result.stderr.decode(errors="replace").removesuffix("\n").split("\n")
    errors = [line for line in lines if not line.startswith("warning: ")]
    assert all(line.startswith("onebit-sim: ") for line in errors), lines
    return errors


def line_of_mark(text):
    lines = [number for number, line in enumerate(text.split("\n"), 1) if "HERE" in line]
    assert len(lines) == 1
    return lines[0]


def assert_refused(tmp_path, text, key, says=""):
    path = tmp_path / "bad.yaml"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    line = line_of_mark(path.read_bytes().decode("latin-1"))
    result = run(path, "--out", tmp_path / "out")
    assert result.returncode == 2, result
    assert result.stdout == b""
    message = result.stderr.decode(errors="replace")
    assert message.count("\n") == 1 and message.endswith("\n"), message
    expected = f"onebit-sim: {path}:{line}: {key}"
    assert message.startswith(expected + ": " if key else expected), (expected, message)
    assert says in message
    assert not re.search(r"[\x00-\x09\x0b-\x1f\x7f]", message)
    left = [entry for entry in tmp_path.rglob("*") if entry != path and not entry.is_dir()]
    assert left == []


def test_the_good_file_is_good(tmp_path):
    path = tmp_path / "good.yaml"
    for text in (GOOD, ONE_GRAPH):
        path.write_text(text)
        result = run(path, "--out", tmp_path / "out")
        assert result.returncode == 0, result
        assert (tmp_path / "out" / "summary.json").exists()


# Missing, unknown and repeated keys.

# The key, what is removed, the line that must be named (a section's line is that of its first key),
# and what is added to that line, or behind it, so that the section is still a mapping.
MISSING = [
    ("name", "name: three\n", "plant:\n", ""),
    ("plant", "plant:\n  A:\n    - [1, 1]\n    - [0, 1]\n  B: [0.5, 1]\n", "name: three\n", ""),
    ("plant.A", "  A:\n    - [1, 1]\n    - [0, 1]\n", "  B: [0.5, 1]\n", ""),
    ("plant.B", "  B: [0.5, 1]\n", "  A:\n", ""),
    ("gains.stabilizing", "  stabilizing: [0, -0.5]\n", "  compression: [0.5, 0.75]\n", ""),
    ("gains.compression", "  compression: [0.5, 0.75]\n", "  stabilizing: [0, -0.5]\n", ""),
    ("gains.beta", "  beta: 200\n", "  stabilizing: [0, -0.5]\n", ""),
    ("gains.gamma", "  gamma: 2\n", "  stabilizing: [0, -0.5]\n", ""),
    ("gains.t0", "  t0: 10\n", "  stabilizing: [0, -0.5]\n", ""),
    ("quantizer", "quantizer:\n  threshold: 0\n  bound: 1\n", "name: three\n", ""),
    ("quantizer.threshold", "  threshold: 0\n", "  bound: 1\n", ""),
    ("quantizer.bound", "  bound: 1\n", "  threshold: 0\n", ""),
    ("noise", "noise:\n  sigma: 1\n", "name: three\n", ""),
    ("noise.sigma", "  sigma: 1\n", "noise:\n", " {}"),
    ("topology.graphs[2].edges", "    - edges: [[3, 1]]\n", "        - [2, 3]\n", "    - {}"),
    (
        "initial.states",
        "  states:\n    - [-1, 0]\n    - [1, 0]\n    - [0, 0]\n",
        "  estimates: 0\n",
        "",
    ),
    ("initial.estimates", "  estimates: 0\n", "  states:\n", ""),
    ("channel", "channel:\n  mode: broadcast\n", "name: three\n", ""),
    ("channel.mode", "  mode: broadcast\n", "channel:\n", " {}"),
    ("bus.model", "  model: ideal\n", "  bitrate: 500000\n", ""),
    ("bus.bitrate", "  bitrate: 500000\n", "  model: ideal\n", ""),
    ("bus.encoding", "  encoding: payload\n", "  model: ideal\n", ""),
    (
        "fixed.state_fraction_bits",
        "  state_fraction_bits: 26\n",
        "  control_fraction_bits: 26\n",
        "",
    ),
    (
        "fixed.control_fraction_bits",
        "  control_fraction_bits: 26\n",
        "  state_fraction_bits: 26\n",
        "",
    ),
    ("period", "period: 1\n", "name: three\n", ""),
    ("steps", "steps: 3\n", "name: three\n", ""),
]


@pytest.mark.parametrize("key, removed, marked, left", MISSING, ids=[case[0] for case in MISSING])
def test_missing_key(tmp_path, key, removed, marked, left):
    text = spoil(removed, "", GOOD)
    if left.startswith("    "):  # a line of its own
        text = spoil(marked, f"{marked}{left} # HERE\n", text)
    else:
        text = spoil(marked, f"{marked[:-1]}{left} # HERE\n", text)
    assert_refused(tmp_path, text, key, "missing")


@pytest.mark.parametrize(
    "key, old, new",
    [
        ("nmae", "name: three\n", "name: three\nnmae: x # HERE\n"),
        ("plant.C", "  B: [0.5, 1]\n", "  B: [0.5, 1]\n  C: 1 # HERE\n"),
        ("gains.Beta", "  beta: 200\n", "  beta: 200\n  Beta: 200 # HERE\n"),
        ("topology.graphs[2].edge", "- edges: [[3, 1]]", "- {edges: [[3, 1]], edge: []} # HERE"),
        (
            "fixed.bits",
            "  control_fraction_bits: 26\n",
            "  control_fraction_bits: 26\n  bits: 3 # HERE\n",
        ),
        ("<<", "name: three\n", "name: three\n<<: {} # HERE\n"),
    ],
)
def test_unknown_key(tmp_path, key, old, new):
    assert_refused(tmp_path, spoil(old, new), key, "unknown")


@pytest.mark.parametrize(
    "key, old, new",
    [
        ("name", "period: 1\n", "period: 1\nname: four # HERE\n"),
        ("noise", "period: 1\n", "period: 1\nnoise: {sigma: 1} # HERE\n"),
        ("gains.beta", "  gamma: 2\n", "  gamma: 2\n  'beta': 200 # HERE\n"),
        ("topology.graphs[2].edges", "[[3, 1]]", "[[3, 1]]\n      edges: [[3, 1]] # HERE"),
    ],
)
def test_repeated_key(tmp_path, key, old, new):
    assert_refused(tmp_path, spoil(old, new), key, "repeated")


# Values of wrong type, size or range.

NUMBERS = {
    "plant.A[1][2]": ("    - [1, 1]\n", "    - [1, {}] # HERE\n"),
    "plant.B[1]": ("B: [0.5, 1]", "B: [{}, 1] # HERE"),
    "gains.stabilizing[2]": ("[0, -0.5]", "[0, {}] # HERE"),
    "gains.compression[1]": ("[0.5, 0.75]", "[{}, 0.75] # HERE"),
    "gains.beta": ("beta: 200", "beta: {} # HERE"),
    "gains.gamma": ("gamma: 2", "gamma: {} # HERE"),
    "quantizer.threshold": ("threshold: 0", "threshold: {} # HERE"),
    "quantizer.bound": ("bound: 1", "bound: {} # HERE"),
    "noise.sigma": ("sigma: 1", "sigma: {} # HERE"),
    "topology.transition[2][1]": ("[0.25, 0.75]", "[{}, 0.75] # HERE"),
    "initial.states[2][1]": ("    - [1, 0]\n", "    - [{}, 0] # HERE\n"),
    "initial.estimates": ("estimates: 0", "estimates: {} # HERE"),
    "bus.bitrate": ("bitrate: 500000", "bitrate: {} # HERE"),
    "period": ("period: 1", "period: {} # HERE"),
}
NOT_NUMBERS = [
    ".nan",
    "nan",
    ".inf",
    "-.inf",
    "inf",
    "infinity",
    "1e999",
    "0x10",
    "0x1p3",
    "1_000",
    "010",
    "1:30",
    "abc",
    "1.2.3",
    "1e",
    "--1",
    "+",
    "''",
    '"1"',
    "",
    "~",
    "[1]",
    "{a: 1}",
    "true",
    "1 2",
    "0b1",
    "1f",
    "1;5",
]


@pytest.mark.parametrize("key", NUMBERS)
def test_not_a_finite_number(tmp_path, key):
    old, new = NUMBERS[key]
    for value in NOT_NUMBERS:
        if value == "" and "[" in new:
            continue  # an empty item is a shorter list
        assert_refused(
            tmp_path, spoil(old, new.format(value)), key, "must be a finite decimal number"
        )


@pytest.mark.parametrize(
    "key", ["gains.beta", "gains.gamma", "quantizer.bound", "noise.sigma", "bus.bitrate", "period"]
)
def test_not_above_zero(tmp_path, key):
    old, new = NUMBERS[key]
    for value in ("0", "-1", "-0.0", "-1e-300", "1e-999"):
        assert_refused(tmp_path, spoil(old, new.format(value)), key, "above 0")


INTEGERS = {
    "gains.t0": ("t0: 10", "t0: {} # HERE", 1, 2**32 - 3),
    "steps": ("steps: 3", "steps: {} # HERE", 1, 2**32 - 2 - 10),
    "fixed.state_fraction_bits": (
        "state_fraction_bits: 26",
        "state_fraction_bits: {} # HERE",
        0,
        31,
    ),
    "fixed.control_fraction_bits": (
        "control_fraction_bits: 26",
        "control_fraction_bits: {} # HERE",
        0,
        31,
    ),
}


@pytest.mark.parametrize("key", INTEGERS)
def test_not_a_whole_number_in_range(tmp_path, key):
    old, new, least, most = INTEGERS[key]
    bad = [
        least - 1,
        most + 1,
        2**32,
        2**64,
        2**64 + 5,
        10**30,
        "1.5",
        "5.0",
        "1e3",
        "0x5",
        "+5",
        "05",
    ]
    for value in [*bad, *NOT_NUMBERS]:
        assert_refused(tmp_path, spoil(old, new.format(value)), key, f"from {least} to {most}")


PLANT_A = "A:\n    - [1, 1]\n    - [0, 1]\n"
STATES = "states:\n    - [-1, 0]\n    - [1, 0]\n    - [0, 0]\n"
GRAPHS = "graphs:\n    - edges:\n        - [1, 2]\n        - [2, 3]\n    - edges: [[3, 1]]\n"
TRANSITION = "transition:\n    - [0.5, 0.5]\n    - [0.25, 0.75]\n"
EDGE = "        - [2, 3]\n"
BUS = "model: ideal\n  bitrate: 500000\n  encoding: payload\n  base: 0x100"
CAN = "model: can # HERE\n  bitrate: 500000\n  encoding: {}\n  base: {}"
WRONG = [
    # The key, what stands there, what does in its place, words of the message.
    ("name", "name: three", "name: [three] # HERE", "text"),
    ("name", "name: three", "name: # HERE", "text"),
    ("name", "name: three", 'name: "a\\0b" # HERE', "text"),
    ("plant", f"plant:\n  {PLANT_A}  B: [0.5, 1]\n", "plant: 5 # HERE\n", "mapping"),
    ("plant.A", PLANT_A, "A: 1 # HERE\n", "list"),
    ("plant.A", PLANT_A, "A: [] # HERE\n", "must have at least 1"),
    ("plant.A", PLANT_A, f"A: {[[1] * 17] * 17} # HERE\n", "at most 16"),
    ("plant.A[1]", "    - [1, 1]\n", "    - [1, 1, 0] # HERE\n", "has 3 numbers, must have 2"),
    ("plant.A[2]", "    - [0, 1]\n", "    - [0] # HERE\n", "has 1 numbers, must have 2"),
    ("plant.A[2]", "    - [0, 1]\n", "    - 7 # HERE\n", "list"),
    ("plant.B", "[0.5, 1]", "[0.5, 1, 0] # HERE", "must have 2"),
    ("plant.B[1]", "[0.5, 1]", "[[0.5], [1]] # HERE", "a list"),
    (
        "plant.arithmetic",
        "  B: [0.5, 1]\n",
        "  B: [0.5, 1]\n  arithmetic: q15 # HERE\n",
        "double or q31",
    ),
    ("gains.stabilizing", "[0, -0.5]", "[0] # HERE", "must have 2"),
    ("gains.compression", "[0.5, 0.75]", "[] # HERE", "must have 2"),
    ("gains.beta", "beta: 200", "beta: 65536.01 # HERE", "to 65536 sigma"),
    ("gains.beta", "beta: 200", "beta: 9e-7 # HERE", "from 1e-06 sigma"),
    ("gains.gamma", "gamma: 2", "gamma: 9e-7 # HERE", "from 1e-06/sigma"),
    ("gains.gamma", "gamma: 2", "gamma: 4.1e9 # HERE", "to 4e+09/sigma"),
    ("quantizer.bound", "bound: 1", "bound: 9e-7 # HERE", "at least 1e-06 sigma"),
    ("quantizer.bound", "bound: 1", "bound: 4.001 # HERE", "at most 4"),
    (
        "quantizer.bound",
        "threshold: 0\n  bound: 1",
        "threshold: -3.1\n  bound: 1 # HERE",
        "at most 4",
    ),
    (
        "initial.states[2]",
        "    - [1, 0]\n",
        "    - [2.0001, 0] # HERE\n",
        "agent 2 has |K2 x| = 1.00005",
    ),
    ("initial.states[3]", "    - [0, 0]\n", "    - [0, -1.4] # HERE\n", "agent 3"),
    ("initial.states[3]", "    - [0, 0]\n", "    - [1e308, 1.7e308] # HERE\n", "agent 3"),
    ("initial.states[1]", "    - [-1, 0]\n", "    - [-1, 0, 0] # HERE\n", "must have 2"),
    ("initial.states", STATES, "states: [[1, 0]] # HERE\n", "at least 2"),
    ("initial.estimates", "estimates: 0", "estimates: -1.0001 # HERE", "bound"),
    ("topology.graphs", GRAPHS, "graphs: [] # HERE\n", "at least 1"),
    ("topology.graphs[2]", "- edges: [[3, 1]]", "- [[3, 1]] # HERE", "mapping"),
    ("topology.graphs[2].edges", "[[3, 1]]", "3-1 # HERE", "list"),
    ("topology.graphs[1].edges[2]", EDGE, "        - [2, 3, 1] # HERE\n", "must have 2"),
    ("topology.graphs[1].edges[2]", EDGE, "        - 2-3 # HERE\n", "list"),
    ("topology.graphs[1].edges[2]", EDGE, "        - [2, -3] # HERE\n", "whole number"),
    ("topology.graphs[1].edges[2]", EDGE, "        - [2.0, 3] # HERE\n", "whole number"),
    ("topology.graphs[1].edges[2]", EDGE, "        - [2, 4] # HERE\n", "agent 4 does not exist"),
    ("topology.graphs[1].edges[2]", EDGE, "        - [0, 3] # HERE\n", "agent 0 does not exist"),
    ("topology.graphs[1].edges[2]", EDGE, "        - [3, 3] # HERE\n", "itself"),
    (
        "topology.graphs[1].edges[3]",
        EDGE,
        "        - [2, 3]\n        - [2, 1] # HERE\n",
        "repeats edge 1",
    ),
    (
        "topology.graphs[2].edges[2]",
        "[[3, 1]]",
        "[[3, 1],\n        [3, 1]] # HERE",
        "repeats edge 1",
    ),
    ("topology.transition", TRANSITION, "transition: [[1]] # HERE\n", "must have 2"),
    ("topology.transition[2]", "[0.25, 0.75]", "[0.25, 0.7, 0.05] # HERE", "must have 2"),
    ("topology.transition[2]", "[0.25, 0.75]", "[0.25, 0.7500001] # HERE", "sum must be 1"),
    ("topology.transition[1][2]", "[0.5, 0.5]", "[0.5, -0.5] # HERE", "probability"),
    ("topology.transition[1][1]", "[0.5, 0.5]", "[1.5, -0.5] # HERE", "probability"),
    ("topology.transition[2]", "[0.25, 0.75]", "[0, 1] # HERE", "from graph 2 it never comes"),
    ("topology.transition[1]", "[0.5, 0.5]", "[1, 0] # HERE", "from graph 1 it never comes"),
    ("channel.mode", "mode: broadcast", "mode: Broadcast # HERE", "broadcast or link"),
    ("channel.mode", "mode: broadcast", "mode: [link] # HERE", "broadcast or link"),
    ("bus.model", "model: ideal", "model: lin # HERE", "ideal or can"),
    ("bus.encoding", "encoding: payload", "encoding: data # HERE", "payload or identifier"),
    ("bus.base", "base: 0x100", "base: 0x07F # HERE", "0x081..0x7EF"),
    ("bus.base", "base: 0x100", "base: 0x7EF # HERE", "0x081..0x7EF"),
    ("bus.base", "base: 0x100", "base: 2032 # HERE", "0x081..0x7EF"),
    (
        "bus.base",
        "encoding: payload\n  base: 0x100",
        "encoding: identifier\n  base: 0x7ED # HERE",
        "0x081..0x7EF",
    ),
    ("bus.base", "base: 0x100", "base: 0x10100 # HERE", "11-bit"),
    ("bus.base", "base: 0x100", "base: 0x # HERE", "11-bit"),
    ("bus.base", "base: 0x100", "base: 1g # HERE", "11-bit"),
    ("bus.base", "base: 0x100", "base: -1 # HERE", "11-bit"),
    ("bus.base", "base: 0x100", "base: 100h # HERE", "11-bit"),
    ("bus.model", BUS, CAN.format("payload", "0x7ED"), "identifiers for 2 agents, not for 3"),
    ("bus.model", BUS, CAN.format("identifier", "2026"), "identifiers for 2 agents, not for 3"),
    (
        "fixed.state_fraction_bits",
        "state_fraction_bits: 26",
        "state_fraction_bits: 31 # HERE",
        "state 1 of agent 1 begins at -1",
    ),
]


@pytest.mark.parametrize("key, old, new, says", WRONG)
def test_wrong_value(tmp_path, key, old, new, says):
    assert_refused(tmp_path, spoil(old, new), key, says)


def test_base_in_link_mode(tmp_path):
    text = spoil("mode: broadcast", "mode: link")
    assert_refused(tmp_path, spoil("base: 0x100", "base: 0x100 # HERE", text), "bus.base", "link")


def test_transition_of_one_graph(tmp_path):
    graphs = "  graphs:\n    - edges:\n        - [1, 2]\n        - [2, 3]\n"
    text = spoil(graphs, graphs + "  transition: [[0.5]] # HERE\n", ONE_GRAPH)
    assert_refused(tmp_path, text.replace("[[0.5]]", "[[0.9]]"), "topology.transition[1]", "sum")
    text = text.replace("[[0.5]]", "[[0.5, 0.5], [0.5, 0.5]]")
    assert_refused(tmp_path, text, "topology.transition", "must have 1")
    path = tmp_path / "good.yaml"
    path.write_text(text.replace("[[0.5, 0.5], [0.5, 0.5]]", "[[1]]"))
    assert run(path).returncode == 0


def test_several_graphs_without_transition(tmp_path):
    text = spoil("  transition:\n    - [0.5, 0.5]\n    - [0.25, 0.75]\n", "")
    text = spoil("  graphs:\n", "  graphs: # HERE\n", text)
    assert_refused(tmp_path, text, "topology.transition", "several graphs")


def test_agent_without_neighbours(tmp_path):
    text = spoil("        - [2, 3]\n", "", ONE_GRAPH)
    text = spoil("    - edges:\n", "    - edges: # HERE\n", text)
    assert_refused(tmp_path, text, "topology.graphs", "agent 3 has 0 neighbours")


def test_agent_with_too_many_neighbours(tmp_path):
    star = ", ".join(f"[1, {agent}]" for agent in range(2, 35))
    text = spoil("        - [1, 2]\n        - [2, 3]\n", f"        [{star}] # HERE\n", ONE_GRAPH)
    text = text.replace("    - edges:\n        [", "    - edges: [")
    states = "    - [0, 0]\n"
    text = spoil(states, states * 32, text)
    assert_refused(tmp_path, text, "topology.graphs", "agent 1 has 33 neighbours")


def test_many_agents_on_the_can_bus(tmp_path):
    """The identifier form carries (0x7EF - 0x400 - 1) / 2 = 503 agents, the ideal bus more."""
    edges = ", ".join(f"[{agent}, {agent + 1}]" for agent in range(1, 504))
    text = spoil("        - [1, 2]\n        - [2, 3]\n", f"        [{edges}]\n", ONE_GRAPH)
    text = spoil("    - [0, 0]\n", "    - [0, 0]\n" * 502, text)
    text = spoil("  encoding: payload\n  base: 0x100\n", "  encoding: identifier\n", text)
    path = tmp_path / "good.yaml"
    path.write_text(text)
    assert run(path, "--steps", "1").returncode == 0
    path.unlink()
    text = spoil("model: ideal", "model: can # HERE", text)
    assert_refused(tmp_path, text, "bus.model", "identifiers for 503 agents, not for 504")


# Files that are no scenario at all.


@pytest.mark.parametrize(
    "text",
    [
        "name: [three\nplant: 1 # HERE",
        "name: three\nplant: {A: [[1]], B: [1]\ngains: 3 # HERE\n",
        "name: three\n\tplant: 1 # HERE\n",
        "name: *nobody # HERE\n",
        "name: three\nplant: &a 1\nnoise: &a 2 # HERE\n",
        b"name: three\nperiod: 1\n\xff\xfe # HERE\n",
        b"name: three\nperiod: \x01 # HERE\n",
        "name: three\n---\nname: four # HERE\n",
        "name: three: four # HERE\n",
        "%YAML 9.9 # HERE\n---\nname: three\n",
        '{"name": "three"\n  "plant": 3} # HERE',
    ],
)
def test_not_yaml_or_not_one_document(tmp_path, text):
    if isinstance(text, str) and "\n---\n" in text and "four" in text:
        text = GOOD + "---\nname: four # HERE\n"
    assert_refused(tmp_path, text, "", "")


@pytest.mark.parametrize("text", ["", "# nothing\n", "---\n", "7\n", "- a\n- b\n", "~\n"])
def test_not_a_mapping(tmp_path, text):
    path = tmp_path / "bad.yaml"
    path.write_text(text)
    result = run(path)
    assert result.returncode == 2
    assert re.fullmatch(rf"onebit-sim: {re.escape(str(path))}:[12]: .*\n", result.stderr.decode())


def test_keys_are_words(tmp_path):
    assert_refused(
        tmp_path, spoil("period: 1\n", "? [period] # HERE\n: 1\n"), "", "keys must be words"
    )


def test_a_list_within_itself(tmp_path):
    """An alias may name the list that it stands in; the reader goes no deeper than the format."""
    matrix = "A:\n    - [1, 1]\n    - [0, 1]\n"
    assert_refused(tmp_path, spoil(matrix, "A: &a [*a] # HERE\n"), "plant.A[1][1]", "a list")
    assert_refused(
        tmp_path, spoil("plant:\n", "plant: &p # HERE\n  arithmetic: *p\n"), "plant.arithmetic"
    )


def test_hostile_texts_stay_one_line(tmp_path):
    long = "x" * 5000
    assert_refused(
        tmp_path, spoil("beta: 200", 'beta: "a\\nb\\e[31m" # HERE'), "gains.beta", "a?b?[31m"
    )
    assert_refused(tmp_path, spoil("beta: 200", f"beta: {long} # HERE"), "gains.beta", "xxx")
    assert_refused(
        tmp_path, spoil("period: 1\n", f"period: 1\n? {long} # HERE\n: 2\n"), "", "unknown"
    )


def test_files_that_cannot_be_read(tmp_path):
    for path, says in (
        (tmp_path / "nowhere.yaml", "No such file or directory"),
        (tmp_path, "Is a directory"),
        (PROGRAM / "inside.yaml", "Not a directory"),
    ):
        result = run(path, "--out", tmp_path / "out")
        assert result.returncode == 2
        message = result.stderr.decode()
        assert message.startswith(f"onebit-sim: {path}: ") and says in message
        assert message.count("\n") == 1
        assert list(tmp_path.iterdir()) == []


def test_output_folders_that_cannot_be_written(tmp_path):
    scenario = tmp_path / "good.yaml"
    scenario.write_text(GOOD)
    in_place = tmp_path / "file"
    in_place.write_text("mine")
    for folder in (in_place, in_place / "below"):
        result = run(scenario, "--out", folder)
        assert result.returncode == 2, result
        errors = errors_of(result)
        assert len(errors) == 1 and str(folder) in errors[0], errors
        assert in_place.read_text() == "mine"
        assert sorted(tmp_path.iterdir()) == [in_place, scenario]


# Anything.

CHARACTERS = "[]{}:,-&*#!|>'\"%@`\n\t 0123456789.e+\0\x07é"
EXTREMES = [
    "0",
    "-1",
    "1e308",
    "-1e308",
    "1e-308",
    "4294967295",
    "4294967294",
    "65536",
    ".nan",
    "[]",
    "{}",
    "~",
    "*a",
    "&a",
    "0x7EE",
    "1000000",
]


def mutate(generator, text):
    for _ in range(generator.choice([1, 1, 1, 2, 5])):
        kind = generator.randrange(6)
        place = generator.randrange(len(text) + 1)
        lines = text.split("\n")
        line = generator.randrange(len(lines))
        if kind == 0:
            text = text[:place] + text[place + generator.randrange(1, 20) :]
        elif kind == 1:
            text = text[:place] + generator.choice(CHARACTERS) + text[place:]
        elif kind == 2:
            text = "\n".join(lines[:line] + lines[line + 1 :])
        elif kind == 3:
            text = "\n".join([*lines[:line], generator.choice(lines), *lines[line:]])
        else:
            numbers = list(re.finditer(r"(?<![\w.])-?[0-9][0-9.ex]*", text))
            if numbers:
                match = generator.choice(numbers)
                text = text[: match.start()] + generator.choice(EXTREMES) + text[match.end() :]
        if not text:
            break
    return text


@pytest.mark.parametrize("seed", range(8))
def test_mutations_never_crash(tmp_path, seed):
    generator = random.Random(seed)
    sources = [GOOD, ONE_GRAPH, *(path.read_text(encoding="utf-8") for path in SCENARIOS)]
    path = tmp_path / "mutation.yaml"
    statuses = {0: 0, 2: 0}
    for _ in range(60):
        text = mutate(generator, generator.choice(sources))
        path.write_text(text, encoding="utf-8")
        arithmetic = generator.choice(["f64", "f32", "q31"])
        result = run(path, "--steps", "1", "--arith", arithmetic)
        assert result.returncode in statuses, (result, text)
        statuses[result.returncode] += 1
        if result.returncode == 2:
            assert len(errors_of(result)) == 1, (result, text)
    assert min(statuses.values()) > 0
