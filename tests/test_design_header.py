"""onebit_config.h: compiles alone, the library accepts it, and it commands what onebit-sim does."""

import math
import re
import shutil
import subprocess
import sys

import pytest
import yaml
from simulator import ROOT, SCENARIOS, call, rows, run

sys.path.insert(0, str(ROOT / "tools"))

from onebit_design import __main__ as program

LIBRARY = ROOT / "lib"
EXAMPLES = ROOT / "tools/onebit_design/examples"
WARNINGS = ["-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Wsign-conversion", "-Werror"]
WARNINGS += ["-Wdouble-promotion", "-Wcast-align", "-Wshadow", "-Wundef"]
COMPILERS = [
    *(("gcc", "-std=c99"), ("g++", "-std=c++11"), ("g++", "-std=c++20")),
    *(("clang", "-std=c99"), ("clang++", "-std=c++11")),
]

# Checks every configuration; the states and frames of one agent come as text on standard input:
# "S t" begins a step with the agent's states as they were measured, "F identifier length data"
# is a frame as it stood in the log. The control's integer is printed after each step.
REPLAY = r"""
#include "onebit_config.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#if ONEBIT_ARITHMETIC == ONEBIT_Q31
static onebit_real measured_from(double value)
{
    double scaled = value * (double)((uint64_t)1 << ONEBIT_CONFIG_STATE_FRACTION_BITS);
    return (onebit_real)(scaled + (scaled < 0 ? -0.5 : 0.5));
}
#define STATE_VALUE(value) measured_from(value)
#else
#define STATE_VALUE(value) ((onebit_real)(value))
#endif

int main(int argc, char **argv)
{
    static onebit_estimate links[ONEBIT_CONFIG_NEIGHBOURS];
    onebit_real estimates[ONEBIT_CONFIG_NEIGHBOURS];
    onebit_real x[ONEBIT_CONFIG_STATES];
    onebit_agent agent;
    char kind;
    int stepping = 0;
    for (unsigned k = 0; k < ONEBIT_CONFIG_AGENTS; ++k) {
        if (onebit_configs[k]->agent != k + 1 || onebit_check(onebit_configs[k]) != ONEBIT_OK) {
            fprintf(stderr, "agent %u: status %d\n", k + 1, (int)onebit_check(onebit_configs[k]));
            return 1;
        }
    }
    if (argc != 2) {
        return 0;
    }
    const onebit_config *config = onebit_configs[atoi(argv[1]) - 1];
    for (unsigned k = 0; k < ONEBIT_CONFIG_NEIGHBOURS; ++k) {
        estimates[k] = ONEBIT_CONFIG_ESTIMATE;
    }
    if (onebit_start(config, &agent, links, estimates) != ONEBIT_OK) {
        return 1;
    }
    for (;;) {
        int more = scanf(" %c", &kind);
        if (more != 1 || kind == 'S') {
            onebit_real u;
            if (stepping) {
                if (onebit_control(config, &agent, x, &u) != ONEBIT_OK) {
                    return 1;
                }
                printf("%.17g\n", (double)u);
            }
            if (more != 1) {
                return 0;
            }
            stepping = 1;
            for (unsigned k = 0; k < ONEBIT_CONFIG_STATES; ++k) {
                double value;
                if (scanf("%lf", &value) != 1) {
                    return 1;
                }
                x[k] = STATE_VALUE(value);
            }
        } else {
            onebit_frame frame;
            unsigned long identifier;
            unsigned length;
            unsigned data;
            unsigned extended;
            if (scanf("%lx %u %u %x", &identifier, &extended, &length, &data) != 4) {
                return 1;
            }
            memset(&frame, 0, sizeof frame);
            frame.identifier = (uint32_t)identifier;
            frame.flags = extended ? ONEBIT_FRAME_EXTENDED : 0;
            frame.length = (uint8_t)length;
            frame.data[0] = (uint8_t)data;
            onebit_receive(config, &agent, &frame);
        }
    }
}
"""


def design(system, out):
    assert program.main([str(system), "--out", str(out), "--runs", "0"]) == 0


@pytest.fixture(scope="module", params=["aircraft-markov", "motors", "estimate"])
def designed(request, tmp_path_factory):
    """Link mode with a chain; broadcast by the tool's own choices; an initial estimate and base."""
    folder = tmp_path_factory.mktemp("designed")
    if request.param == "motors":
        source = EXAMPLES / "motors.yaml"
    elif request.param == "aircraft-markov":
        source = SCENARIOS / "aircraft-markov.yaml"
    else:
        content = yaml.safe_load((SCENARIOS / "two-agents.yaml").read_text())
        # A late start, so that the first bits do not push the initial estimate out.
        content["initial"]["estimates"] = -0.37
        content["gains"] |= {"beta": 24.7, "gamma": 0.97, "t0": 1000}
        # Far from rest, though K2 x is not: what dies out sets the states' range.
        content["initial"]["states"][0] = [28.5, -20]
        content["channel"]["mode"] = "broadcast"
        content["bus"] |= {"base": 0x203, "encoding": "identifier"}
        content["name"] = "a */ in a comment /* \u00e4"
        content["plant"]["arithmetic"] = "q31"
        source = folder / "system.yaml"
        source.write_text(yaml.safe_dump(content))
    design(source, folder / "out")
    return folder / "out"


@pytest.fixture(scope="module")
def library(tmp_path_factory):
    """The library's objects, once for each arithmetic."""
    objects = {}
    for arithmetic in ("Q31", "F32"):
        folder = tmp_path_factory.mktemp(arithmetic)
        objects[arithmetic] = []
        for name in ("agent", "frame", "random", "cdf_table"):
            objects[arithmetic].append(folder / f"{name}.o")
            command = ["gcc", "-std=c99", *options_of(arithmetic), f"-I{LIBRARY}"]
            command += ["-c", LIBRARY / f"onebit_{name}.c", "-o", folder / f"{name}.o"]
            subprocess.run(command, check=True)
    return objects


def options_of(arithmetic):
    return ["-O2", "-ffp-contract=off", f"-DONEBIT_ARITHMETIC=ONEBIT_{arithmetic}"]


def build(compiler, standard, folder, arithmetic, library):
    """The replay program: C even where C++ compiles it."""
    if shutil.which(compiler) is None:
        pytest.skip(f"no {compiler} here")
    path = folder / ("replay.cpp" if "++" in compiler else "replay.c")
    path.write_text(REPLAY)
    binary = folder / "replay"
    command = [compiler, standard, *options_of(arithmetic), *WARNINGS]
    command += [f"-I{LIBRARY}", f"-I{folder}", path, *library[arithmetic], "-o", binary]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return binary


@pytest.mark.parametrize("arithmetic", ["Q31", "F32"])
@pytest.mark.parametrize(("compiler", "standard"), COMPILERS)
def test_compiles_and_the_library_accepts_it(
    designed, compiler, standard, arithmetic, library, tmp_path
):
    shutil.copy(designed / "onebit_config.h", tmp_path)
    subprocess.run([build(compiler, standard, tmp_path, arithmetic, library)], check=True)


@pytest.mark.parametrize("arithmetic", ["Q31", "F32"])
@pytest.mark.parametrize(("compiler", "standard"), COMPILERS)
def test_compiles_alone(designed, compiler, standard, arithmetic, tmp_path):
    if shutil.which(compiler) is None:
        pytest.skip(f"no {compiler} here")
    path = tmp_path / ("alone.cpp" if "++" in compiler else "alone.c")
    path.write_text('#include "onebit_config.h"\n#include "onebit_config.h"\n')
    command = [compiler, standard, *WARNINGS, f"-DONEBIT_ARITHMETIC=ONEBIT_{arithmetic}"]
    command += [f"-I{LIBRARY}", f"-I{designed}", "-fsyntax-only", path]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")


def replayed_controls(designed, tmp_path, agent, arithmetic, library, steps=3000):
    """The controls of one agent, in the simulator's replay and in the header's program, as
    integers (q31) or floats."""
    log = tmp_path / "bus.log"
    scenario = designed / "scenario.yaml"
    run(scenario, arith=arithmetic.lower(), steps=steps, log=log)
    done = call("replay", scenario, log, "--agent", agent, "--arith", arithmetic.lower())
    assert done.returncode == 0, done.stderr
    (tmp_path / "replay.csv").write_text(done.stdout)
    believed = rows(tmp_path / "replay.csv")
    assert len(believed) == steps
    states = [name for name in believed[0] if name.startswith("x")]
    shutil.copy(designed / "onebit_config.h", tmp_path)

    text, step = [], 0
    for line in log.read_text().splitlines():
        identifier, _, data = line.split()[2].partition("#")
        if identifier == "080":
            text.append("S " + " ".join(believed[step][name] for name in states))
            step += 1
        else:
            length = len(data) // 2
            extended = int(len(identifier) == 8)
            text.append(f"F {identifier} {extended} {length} {data or 0}")
    binary = build("gcc", "-std=c99", tmp_path, arithmetic, library)
    done = subprocess.run(
        [binary, str(agent)], input="\n".join(text), capture_output=True, text=True, check=True
    )
    commanded = [float(line) for line in done.stdout.split()]
    bits = yaml.safe_load(scenario.read_text())["fixed"]["control_fraction_bits"]
    scale = 2.0**-bits if arithmetic == "Q31" else 1.0
    return [float(row["u"]) for row in believed], [scale * value for value in commanded]


@pytest.mark.parametrize("arithmetic", ["Q31", "F32"])
@pytest.mark.parametrize("agent", [1, 2])
def test_controls_are_those_of_the_simulator_to_the_bit(
    designed, agent, arithmetic, library, tmp_path
):
    simulated, commanded = replayed_controls(designed, tmp_path, agent, arithmetic, library)
    assert commanded == simulated
    assert len(set(simulated)) > 100  # not a row of zeros


def numbers_of(header, name):
    """The integers of an array or, alone, of a definition of the header; none if it has no such."""
    array = re.search(rf"{name}\[\] = {{(.*?)}}", header, re.S)
    found = array or re.search(rf"#define {name} (-?\d+)", header)
    return [int(number) for number in re.findall(r"-?\d+", found[1])] if found else []


def nearest(value, shift):
    """value 2^-shift, halves up, saturated to 32 bits; in whole numbers of any length."""
    scaled = (value + (1 << (shift - 1))) >> shift if shift > 0 else value << -shift
    return min(max(scaled, -(2**31)), 2**31 - 1)


def test_integer_plant_moves_as_the_simulators(designed, tmp_path):
    """Only where the scenario has one; stepped here in Python on the simulator's controls."""
    header = (designed / "onebit_config.h").read_text()
    scenario = designed / "scenario.yaml"
    content = yaml.safe_load(scenario.read_text())
    A, B, initial = (
        numbers_of(header, f"onebit_config_{name}")
        for name in ("plant_A", "plant_B", "initial_states")
    )
    if content["plant"].get("arithmetic") != "q31":
        assert not A and not B and not initial
        return
    n = len(B)
    (A_bits,) = numbers_of(header, "ONEBIT_CONFIG_PLANT_A_FRACTION_BITS")
    (B_bits,) = numbers_of(header, "ONEBIT_CONFIG_PLANT_B_FRACTION_BITS")
    state_bits = content["fixed"]["state_fraction_bits"]
    control_bits = content["fixed"]["control_fraction_bits"]
    log = tmp_path / "bus.log"
    run(scenario, arith="q31", steps=1000, log=log)
    for agent in (1, 2):
        done = call("replay", scenario, log, "--agent", agent, "--arith", "q31")
        (tmp_path / "replay.csv").write_text(done.stdout)
        x = initial[(agent - 1) * n : agent * n]
        for row in rows(tmp_path / "replay.csv"):
            assert [float(row[f"x{k + 1}"]) * 2**state_bits for k in range(n)] == x
            u = int(float(row["u"]) * 2**control_bits)
            free = [nearest(sum(A[k * n + m] * x[m] for m in range(n)), A_bits) for k in range(n)]
            driven = [nearest(B[k] * u, B_bits + control_bits - state_bits) for k in range(n)]
            x = [nearest(free[k] + driven[k], 0) for k in range(n)]


def test_formats_are_those_that_the_simulator_would_choose(designed, tmp_path):
    """Without `fixed` the simulator chooses by itself: the run must be the same to the byte."""
    scenario = designed / "scenario.yaml"
    content = yaml.safe_load(scenario.read_text())
    del content["fixed"]
    bare = tmp_path / "bare.yaml"
    bare.write_text(yaml.safe_dump(content, default_flow_style=None, allow_unicode=True))
    for path, name in ((scenario, "with"), (bare, "without")):
        run(path, arith="q31", steps=300, out=tmp_path / name)
    with_formats = (tmp_path / "with/trajectory.csv").read_bytes()
    assert with_formats == (tmp_path / "without/trajectory.csv").read_bytes()


def test_the_scenario_brings_no_warnings(designed):
    done = call("run", designed / "scenario.yaml", "--steps", 10)
    assert (done.returncode, done.stderr) == (0, "")


def test_other_arithmetics_are_refused(designed, tmp_path):
    path = tmp_path / "double.c"
    path.write_text('#include "onebit_config.h"\n')
    command = ["gcc", "-std=c99", "-DONEBIT_ARITHMETIC=ONEBIT_F64", f"-I{LIBRARY}", f"-I{designed}"]
    done = subprocess.run(
        [*command, "-fsyntax-only", path], capture_output=True, text=True, check=False
    )
    assert done.returncode != 0
    assert "ONEBIT_Q31 and ONEBIT_F32" in done.stderr


def test_comments_state_the_ranges(designed):
    """The reason of each format, as a comment: bits, worst case and what 32 bits reach."""
    text = (designed / "onebit_config.h").read_text()
    bits = yaml.safe_load((designed / "scenario.yaml").read_text())["fixed"]
    for name, key in (("States", "state_fraction_bits"), ("Control", "control_fraction_bits")):
        assert f"{name}: {bits[key]} bits." in text
        assert f"{2.0 ** (31 - bits[key]):.4g}" in text
    assert math.isfinite(bits["state_fraction_bits"])
