"""Bad systems through onebit-design: exit status 2, one line that names file, line, key and reason,
and nothing written. Every case marks the line that must be named with the comment HERE."""

import random
import re
import sys

import pytest
from simulator import ROOT

sys.path.insert(0, str(ROOT / "tools"))

from onebit_design import __main__ as program
from onebit_design import choose, reader
from onebit_design.problem import InputError

GOOD = """\
# A good file, which every case spoils in one place.
name: four
plant:
  Ac:
    - [0, 1]
    - [0, 0]
  Bc: [0, 1]
  sample_period: 1
gains:
  roots: [0.5]
  beta: auto
  gamma: auto
  t0: auto
quantizer:
  threshold: auto
  bound: auto
noise:
  sigma: 1
topology:
  graphs:
    - edges:
        - [1, 2]
        - [2, 3]
    - edges: [[3, 4]]
  transition:
    - [0.5, 0.5]
    - [0.25, 0.75]
initial:
  states:
    - [-1, 0]
    - [1, 0]
    - [0, 0]
    - [0.5, 0]
  estimates: 0
channel:
  mode: broadcast
bus:
  model: ideal
  bitrate: 500000
  encoding: payload
steps: 30
"""
GRAPHS = GOOD[GOOD.index("  graphs:") : GOOD.index("initial:")]
STATES = GOOD[GOOD.index("  states:") : GOOD.index("  estimates:")]
PLANT = GOOD[GOOD.index("  Ac:") : GOOD.index("gains:")]


def design(path, *options):
    return program.main([str(path), "--out", str(path.parent / "out"), "--runs", "0", *options])


def test_the_good_file_is_good(tmp_path, capsys):
    path = tmp_path / "good.yaml"
    path.write_text(GOOD)
    assert design(path) == 0
    assert (tmp_path / "out/design.json").exists()
    assert capsys.readouterr().err == ""


def assert_refused(tmp_path, capsys, text, key, says, file="bad.yaml", options=()):
    path = tmp_path / "bad.yaml"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    lines = (tmp_path / file).read_text(errors="replace").split("\n")
    (line,) = (number for number, content in enumerate(lines, 1) if "HERE" in content)
    assert design(path, *options) == 2
    output = capsys.readouterr()
    assert output.out == ""
    assert output.err.count("\n") == 1 and output.err.endswith("\n")
    expected = f"onebit-design: {tmp_path / file}:{line}: {key}: "
    assert output.err.startswith(expected), (expected, output.err)
    assert says in output.err, output.err
    assert not (tmp_path / "out").exists()


def spoil(old, new):
    assert GOOD.count(old) == 1, old
    return GOOD.replace(old, new)


def replaced_plant(plant):
    """Without the mark: the cases put it on the first line of the section."""
    return GOOD.replace(PLANT, plant)


# What is replaced, by what (HERE: in the line that must be named), the key, what must be said.
CASES = {
    # Keys.
    "unknown": ("  sigma: 1\n", "  sigma: 1\n  sigmo: 2 # HERE\n", "noise.sigmo", "unknown"),
    "unknown at top": ("noise:\n", "period_s: 1 # HERE\nnoise:\n", "period_s", "unknown"),
    "repeated": ("  beta: auto\n", "  beta: auto\n  beta: 1 # HERE\n", "gains.beta", "repeated"),
    "missing": ("  beta: auto\n", "", "gains.beta", "missing"),
    "roots and rows": (
        "  roots: [0.5]\n",
        "  roots: [0.5]\n  stabilizing: [0, 1] # HERE\n",
        "gains.stabilizing",
        "unknown",
    ),
    "Ac and B": ("  Bc: [0, 1]\n", "  B: [0, 1] # HERE\n", "plant.B", "unknown"),
    # Values.
    "no number": ("sigma: 1", "sigma: one # HERE", "noise.sigma", "'one'"),
    "octal": ("sigma: 1", "sigma: 010 # HERE", "noise.sigma", "'010'"),
    "underscore": ("sigma: 1", "sigma: 1_0 # HERE", "noise.sigma", "'1_0'"),
    "infinite": ("sigma: 1", "sigma: 1e999 # HERE", "noise.sigma", "finite"),
    "quoted": ("sigma: 1", 'sigma: "1" # HERE', "noise.sigma", "finite"),
    "not positive": ("sigma: 1", "sigma: 0 # HERE", "noise.sigma", "above 0"),
    "auto where not": ("sigma: 1", "sigma: auto # HERE", "noise.sigma", "'auto'"),
    "automatic": ("t0: auto", "t0: automatic # HERE", "gains.t0", "whole number"),
    "zero t0": ("t0: auto", "t0: 0 # HERE", "gains.t0", "from 1"),
    "row of wrong size": ("    - [0, 0]\n  Bc", "    - [0] # HERE\n  Bc", "plant.Ac[2]", "has 1"),
    "vector of wrong size": ("Bc: [0, 1]", "Bc: [0, 1, 2] # HERE", "plant.Bc", "must have 2"),
    "state of wrong size": ("    - [0.5, 0]", "    - [0] # HERE", "initial.states[4]", "has 1"),
    "no section": ("noise:\n  sigma: 1\n", "noise: 3 # HERE\n", "noise", "'3'"),
    "key no word": (
        "  roots: [0.5]\n",
        "  roots: [0.5]\n  ? [1, 2] # HERE\n  : 3\n",
        "gains",
        "words",
    ),
    "mode": ("mode: broadcast", "mode: loud # HERE", "channel.mode", "link or broadcast"),
    "base": ("encoding: payload", "encoding: payload\n  base: 0x7EF # HERE", "bus.base", "agent 1"),
    "low base": (
        "encoding: payload",
        "encoding: payload\n  base: 0x07F # HERE",
        "bus.base",
        "0x081",
    ),
    "identifiers": (
        "model: ideal\n  bitrate: 500000\n  encoding: payload\n",
        "model: can # HERE\n  bitrate: 500000\n  encoding: payload\n  base: 0x7ED\n",
        "bus.model",
        "identifiers for 2 agents, not for 4",
    ),
    "too many steps": ("steps: 30", "steps: 4294967293 # HERE", "steps", "clock"),
    # Plant.
    "not controllable": ("Bc: [0, 1]", "Bc: [1, 0]", "plant", "has rank 1, must have 2"),
    "no library plant": (PLANT, "  library: rocket # HERE\n", "plant.library", "dc-motor"),
    "no parameter": (
        PLANT,
        "  library: dc-motor\n  sample_period: 1\n  parameters: {mass: 1} # HERE\n",
        "plant.parameters.mass",
        "inertia",
    ),
    "two periods": ("steps: 30", "steps: 30\nperiod: 2", "plant.sample_period", "or left out"),
    "no period": ("  sample_period: 1\n", "", "plant", "period"),
    # Roots.
    "root on the circle": ("[0.5]", "[1] # HERE", "gains.roots[1]", "inside the unit circle"),
    "root outside": ("[0.5]", "[-1.5] # HERE", "gains.roots[1]", "inside the unit circle"),
    "no root": ("[0.5]", "[half] # HERE", "gains.roots[1]", "0.3+0.2j"),
    "root nan": ("[0.5]", "[nan] # HERE", "gains.roots[1]", "0.3+0.2j"),
    "too few roots": ("[0.5]", "[] # HERE", "gains.roots", "must have 1"),
    "without conjugate": ("[0.5]", "[0.3+0.2j] # HERE", "gains.roots[1]", "0.3-0.2j"),
    # Numbers against each other.
    "bound below a state": (
        "  bound: auto\n",
        "  bound: 0.25\n",
        "initial.states[1]",
        "|K2 x| = 0.5, must be at most the bound 0.25",
    ),
    "flat": ("  bound: auto", "  bound: 4.5 # HERE", "quantizer.bound", "at most 4"),
    "auto flat": ("  sigma: 1", "  sigma: 0.1", "quantizer.bound", "auto chose 0.55; "),
    "beta large": ("beta: auto", "beta: 65537 # HERE", "gains.beta", "65536"),
    "gamma large": (
        "  beta: auto\n  gamma: auto",
        "  beta: 9\n  gamma: 4.1e9 # HERE",
        "gains.gamma",
        "4e+09",
    ),
    "q31 range": (
        "steps: 30",
        "fixed:\n  state_fraction_bits: 31 # HERE\n  control_fraction_bits: 20\nsteps: 30",
        "fixed.state_fraction_bits",
        "must be at most",
    ),
    "q31 control": (
        "steps: 30",
        "fixed:\n  state_fraction_bits: 20\n  control_fraction_bits: 31 # HERE\nsteps: 30",
        "fixed.control_fraction_bits",
        "must be at most",
    ),
    # Network.
    "no graph": (GRAPHS, "  {} # HERE\n", "topology", "one key"),
    "two families": (GRAPHS, "  ring: 4 # HERE\n  path: 4\n", "topology", "not 2"),
    "family of wrong size": (GRAPHS, "  ring: 5 # HERE\n", "topology.ring", "must have 4"),
    "ring of two": (GRAPHS, "  ring: 2 # HERE\n", "topology.ring", "from 3"),
    "odd regular": (
        GRAPHS,
        "  random_regular: {n: 4, degree: 5, seed: 1} # HERE\n",
        "topology.random_regular.degree",
        "from 1 to 3",
    ),
    "disconnected": (
        "[[3, 4]]",
        "[[1, 3]]",
        "topology",
        "falls into 2 parts, which never agree, must be joined by 1 more edges: {1, 2, 3}, {4}",
    ),
    "edge to itself": ("[[3, 4]]", "[[3, 3]] # HERE", "topology.graphs[2].edges[1]", "different"),
    "edge twice": ("[[3, 4]]", "[[3, 4], [4, 3]] # HERE", "topology.graphs[2].edges[2]", "twice"),
    "no such agent": ("[[3, 4]]", "[[3, 5]] # HERE", "topology.graphs[2].edges[1]", "1 to 4"),
    "no transition": (GRAPHS[GRAPHS.index("  tran") :], "", "topology", "transition: missing"),
    "transition rows": (
        "    - [0.5, 0.5]\n    - [0.25, 0.75]\n",
        "    - [0.5, 0.5] # HERE\n",
        "topology.transition",
        "has 1 rows",
    ),
    "sum": ("[0.25, 0.75]", "[0.25, 0.5] # HERE", "topology.transition[2]", "0.75"),
    "negative": ("[0.25, 0.75]", "[-0.25, 1.25] # HERE", "topology.transition[2][1]", "0 to 1"),
    "reducible": ("[0.25, 0.75]", "[0, 1]", "topology.transition", "classes {1}, {2}"),
    "periodic": (
        "    - [0.5, 0.5]\n    - [0.25, 0.75]\n",
        "    - [0, 1] # HERE\n    - [1, 0]\n",
        "topology.transition",
        "period 2, must have 1: let a graph stay with some probability; it goes round the classes "
        "{1}, {2}",
    ),
    "no edge-list file": (
        GRAPHS,
        "  edge_list: no.edges # HERE\n",
        "topology.edge_list",
        "No such",
    ),
}
# A section's or list's line is that of its first value.
FIRST_LINES = {
    "missing": "  roots: [0.5]",
    "not controllable": "  Ac:",
    "no period": "  Ac:",
    "two periods": "  sample_period: 1",
    "bound below a state": "    - [-1, 0]",
    "auto flat": "  bound: auto",
    "disconnected": "  graphs:",
    "no transition": "  graphs:",
    "reducible": "    - [0.5, 0.5]",
}


@pytest.mark.parametrize("name", CASES)
def test_bad_input(name, tmp_path, capsys):
    old, new, key, says = CASES[name]
    text = spoil(old, new)
    if name in FIRST_LINES:
        assert text.count(FIRST_LINES[name] + "\n") == 1 and "HERE" not in text
        text = text.replace(FIRST_LINES[name] + "\n", FIRST_LINES[name] + " # HERE\n")
    assert_refused(tmp_path, capsys, text, key, says)


def test_estimate_above_the_bound(tmp_path, capsys):
    text = spoil("  estimates: 0\n", "  estimates: -0.7 # HERE\n")
    text = text.replace("  bound: auto\n", "  bound: 0.6\n")
    assert_refused(tmp_path, capsys, text, "initial.estimates", "-0.6..0.6")


def test_edge_list_file_with_a_bad_line(tmp_path, capsys):
    text = spoil(GRAPHS, "  edge_list: four.edges\n")
    for content, says in (
        ("1 2\n2 three # HERE\n", "two agent numbers"),
        ("1 2\n\n2 5 # HERE\n", "1 to 4"),
        ("1 2\n2 1 # HERE\n", "twice"),
    ):
        (tmp_path / "four.edges").write_text(content)
        assert_refused(tmp_path, capsys, text, "topology.edge_list", says, "four.edges")


def test_more_states_than_the_library_has(tmp_path, capsys):
    n = 17
    rows = "".join(f"    - {[float(k == row + 1) for k in range(n)]}\n" for row in range(n))
    text = spoil(PLANT, f"  Ac: # HERE\n{rows}  Bc: {[0] * (n - 1) + [1]}\n  sample_period: 1\n")
    # A list's line is that of its first row.
    text = text.replace(" # HERE", "").replace(rows.split("\n")[0], rows.split("\n")[0] + " # HERE")
    assert_refused(tmp_path, capsys, text, "plant.Ac", "has 17 rows, must have at most 16")


def test_more_neighbours_than_the_library_has(tmp_path, capsys):
    rows = "".join("    - [0, 0]\n" for _ in range(34))
    text = spoil(GRAPHS, "  star: 34 # HERE\n").replace(STATES, f"  states:\n{rows}")
    assert_refused(
        tmp_path, capsys, text, "topology", "agent 1 has 33 neighbours, must have at most 32"
    )


def test_states_beyond_fixed_point(tmp_path, capsys):
    text = spoil("  sigma: 1\n", "  sigma: 1e10\n").replace("[-1, 0]", "[-4e9, 0]")
    text = text.replace("  beta: auto\n  gamma: auto", "  beta: 1e10\n  gamma: 0.3")
    text = text.replace("  Ac:\n", "  Ac: # HERE\n")
    assert_refused(tmp_path, capsys, text, "plant", "q31 holds at most 1.07e+09")


@pytest.mark.parametrize("key", ["plant", "gains", "topology", "initial", "bus"])
def test_sections_that_are_none(key, tmp_path, capsys):
    lines = GOOD.split("\n")
    first = lines.index(f"{key}:")
    last = next(k for k in range(first + 1, len(lines)) if not lines[k].startswith(" "))
    for value in ("3", "[1, 2]", "word", ""):
        text = "\n".join([*lines[:first], f"{key}: {value} # HERE", *lines[last:]])
        path = tmp_path / "bad.yaml"
        path.write_text(text)
        assert design(path) == 2
        assert capsys.readouterr().err.startswith(f"onebit-design: {path}:{first + 1}: {key}: must")


def test_no_damage_ends_in_a_traceback(tmp_path, capsys):
    """Files with tokens lost, doubled and exchanged: read, or refused in one line."""
    generator = random.Random(3)
    tokens = re.findall(r"\n *|[\w.+-]+|\W", GOOD)
    values = [*tokens, "nan", "-1", "1e308", "1e-308", "auto", "[]", "{}", "&a", "*a", "!x", "\x00"]
    refused = 0
    for _ in range(600):
        damaged = list(tokens)
        for _ in range(generator.randint(1, 3)):
            place = generator.randrange(len(damaged))
            damaged[place : place + generator.randint(0, 2)] = [generator.choice(values)]
        path = tmp_path / "bad.yaml"
        path.write_text("".join(damaged))
        try:
            request = reader.read(path)
            choose.choose(request, "theorem", None)
            reader.check_numbers(request)
            program.find_formats(request)
        except InputError as error:
            refused += 1
            assert re.match(rf"{re.escape(str(path))}:\d+: ", str(error)), error
            assert str(error).isprintable()
    assert 300 < refused < 600


def test_bad_yaml(tmp_path, capsys):
    for text in (
        "a: [1\nb: 2",
        "{}}",
        "\t",
        "a: &x [*y]",
        "--- 1\n--- 2\n",
        "",
        b"a: \xff\xfe\x00",
    ):
        path = tmp_path / "bad.yaml"
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        assert design(path) == 2
        message = capsys.readouterr().err
        assert message.startswith(f"onebit-design: {path}:") and message.count("\n") == 1


def test_no_file(tmp_path, capsys):
    assert design(tmp_path / "none.yaml") == 2
    assert "cannot be read: No such file" in capsys.readouterr().err


# Controllability that rounding spoils.


def test_gains_that_lose_half_of_their_digits(tmp_path, capsys):
    """Three leaks that a short period cannot tell apart: their powers e^(-kh) are nearly alike."""
    plant = "  Ac:\n    - [-1, 0, 0] # HERE\n    - [0, -2, 0]\n    - [0, 0, -3]\n  Bc: [1, 1, 1]\n"
    text = spoil(PLANT, plant.replace("Ac:\n", "Ac: # MARK\n") + "  sample_period: 1e-4\n")
    text = text.replace(" # HERE", "").replace("MARK", "HERE")
    text = text.replace(STATES, STATES.replace(", 0]", ", 0, 0]")).replace(
        "[0.5]\n", "[0.5, 0.4]\n"
    )
    assert_refused(tmp_path, capsys, text, "plant", "a longer sample period")


def test_units_that_cost_half_of_the_digits(tmp_path, capsys):
    """Position in thousands of kilometres, speed in micrometres a second: the cure is other
    units."""
    text = spoil("    - [0, 1]\n", "    - [0, 1e-9]\n").replace("  Ac:\n", "  Ac: # HERE\n")
    assert_refused(tmp_path, capsys, text, "plant", "measure the states in units of like size")


def test_beta_that_the_library_cannot_hold(tmp_path, capsys):
    """A long path of agents: the theorem's bound passes the library's range; `fast` does not."""
    rows = "".join(f"    - [{k / 40}, 0]\n" for k in range(40))
    text = spoil(GRAPHS, "  path: 40\n").replace(STATES, f"  states:\n{rows}")
    text = text.replace("  beta: auto\n", "  beta: auto # HERE\n")
    assert_refused(tmp_path, capsys, text, "gains.beta", "take --objective fast")
