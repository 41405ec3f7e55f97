"""Ensembles and random words of the simulator against the oracle (quick)."""

import csv
import math
import os
import re
import subprocess
from pathlib import Path

import numpy as np
import oracle
import pytest

ROOT = Path(__file__).resolve().parent.parent
SCENARIOS = ROOT / "sim/scenarios"
SIMULATOR = Path(os.environ.get("ONEBIT_BUILD", ROOT / "build/host")).resolve() / "bin/onebit-sim"


def simulate(scenario_path, **options):
    arguments = [text for key, value in options.items() for text in (f"--{key}", str(value))]
    subprocess.run([SIMULATOR, "run", scenario_path, *arguments], check=True)


# Threefry: lines `threefry2x32 20` of Random123's kat_vectors; counter, key, answer. The last ones
# are digits of pi.


@pytest.mark.parametrize(
    ("counter", "key", "answer"),
    [
        ((0x00000000, 0x00000000), (0x00000000, 0x00000000), (0x6B200159, 0x99BA4EFE)),
        ((0xFFFFFFFF, 0xFFFFFFFF), (0xFFFFFFFF, 0xFFFFFFFF), (0x1CB996FC, 0xBB002BE7)),
        ((0x243F6A88, 0x85A308D3), (0x13198A2E, 0x03707344), (0xC4923A9C, 0x483DF7A0)),
    ],
)
def test_threefry_known_answers(counter, key, answer):
    assert oracle.threefry2x32(key, counter) == answer


# The bits on the bus. A line of `candump -L` is "(seconds) interface identifier#data".

SYNC = 0x080
FRAME = re.compile(r"\(\d+\.\d+\) \S+ ([0-9A-F]{3}|[0-9A-F]{8})#((?:[0-9A-F]{2})*)")


def frames_of_steps(log):
    """For each SYNC what follows it until the next: {identifier: payload}."""
    steps = []
    for line in log.read_text(encoding="ascii").splitlines():
        match = FRAME.fullmatch(line.strip())
        assert match, line
        identifier, payload = int(match[1], 16), bytes.fromhex(match[2])
        if identifier == SYNC:
            steps.append({})
        else:
            assert (len(match[1]) == 8) == (identifier > 0x7FF), line
            assert identifier not in steps[-1], line
            steps[-1][identifier] = payload
    return steps


def expected_frames(scenario, step):
    """Payload form: bit 0 the message's bit, bits 7..1 the clock modulo 128."""
    if scenario.broadcast:
        identifiers = [scenario.identifier_base + agent for agent in range(1, scenario.agents + 1)]
        sending = np.ones(scenario.agents, dtype=bool)
    else:
        identifiers = [
            0x10000000 + (sender + 1 << 14) + (receiver + 1 << 1)
            for sender, receiver in zip(scenario.senders, scenario.receivers, strict=True)
        ]
        sending = step.heard
    return {
        identifier: bytes([(step.t % 128) << 1 | int(bit)])
        for identifier, bit, sends in zip(identifiers, step.messages, sending, strict=True)
        if sends
    }


@pytest.mark.parametrize("name", ["two-agents", "aircraft-markov", "aircraft-markov-broadcast"])
def test_every_bit_is_a_threefry_word(name, tmp_path):
    """The closed loop derived again from the seed alone: who sends at each step (the chain), every
    bit and every residue. A bit could only differ where a word is within rounding of F * 2^31."""
    path, log, steps, seed = SCENARIOS / f"{name}.yaml", tmp_path / "bus.log", 200, 5
    simulate(path, arith="f64", runs=1, steps=steps, seed=seed, log=log, out=tmp_path)
    scenario = oracle.read_scenario(path)
    words = oracle.LibraryWords(scenario, seed, run=0)
    logged = frames_of_steps(log)
    assert len(logged) == steps
    for step, frames in zip(oracle.simulate(scenario, words, steps), logged, strict=True):
        assert frames == expected_frames(scenario, step), f"t = {step.t}"


# Ensembles.

RUNS = 400
STEPS = 3000
ROWS = (10, 100, 316, 1000, 3000)
ORACLE_SEED, SIMULATOR_SEED = 1501, 1502

# Seeds are fixed, so the test always gives the same answer; 4.6 standard errors is how rarely a
# right program would have met a seed that fails: 4.2e-6 a comparison (two-sided, normal), so by
# Bonferroni at most 7e-4 for the family of 4 scenarios * 2 arithmetics * 5 rows * 4 comparisons.
# The difference of two equally distributed means is symmetric, which takes away the skewness of the
# squared errors, and 400 runs leave little of the rest.
STANDARD_ERRORS = 4.6


@pytest.fixture(
    scope="module",
    params=[
        "aircraft-fixed",
        "aircraft-markov",
        "aircraft-fixed-broadcast",
        "aircraft-markov-broadcast",
    ],
)
def ensemble(request):
    """The scenario's path, and {row: {error: one number a run}} of the oracle with own noise."""
    path = SCENARIOS / f"{request.param}.yaml"
    scenario = oracle.read_scenario(path)
    noise = oracle.GaussianNoise(scenario, ORACLE_SEED, (RUNS,))
    rows = {}
    for completed, step in enumerate(oracle.simulate(scenario, noise, STEPS, (RUNS,)), start=1):
        if completed in ROWS:
            rows[completed] = oracle.errors(scenario, step.next_states, step.estimates, completed)
    return path, rows


@pytest.mark.parametrize("arithmetic", ["f64", "q31"])
def test_ensemble(ensemble, arithmetic, tmp_path):
    path, oracle_rows = ensemble
    simulate(path, arith=arithmetic, runs=RUNS, steps=STEPS, seed=SIMULATOR_SEED, out=tmp_path)
    with (tmp_path / "mse.csv").open(newline="", encoding="ascii") as file:
        rows = {int(row["step"]): row for row in csv.DictReader(file)}
    first = oracle.read_scenario(path).t0 + 1
    worst = 0.0
    for completed, errors in oracle_rows.items():
        row = {name: float(value) for name, value in rows[completed].items()}
        assert row["t"] == first + completed
        for name, values in errors.items():
            own = values.std(ddof=1) / math.sqrt(RUNS)
            # The file has a standard error for `mse` alone; for the others the oracle's serves.
            other = row["mse_se"] if name == "mse" else own
            distance = abs(row[name] - values.mean()) / math.hypot(own, other)
            assert distance <= STANDARD_ERRORS, (completed, name)
            worst = max(worst, distance)
        # The standard error itself. That of a sample's deviation s, relative to s, is
        # sqrt((m4/s^4 - 1)/(4 R)); the logarithm of a ratio of two has sqrt(2) times that.
        values = errors["mse"]
        kurtosis = ((values - values.mean()) ** 4).mean() / values.var() ** 2
        deviation = math.sqrt(2 * (kurtosis - 1) / (4 * RUNS))
        ratio = row["mse_se"] / (values.std(ddof=1) / math.sqrt(RUNS))
        distance = abs(math.log(ratio)) / deviation
        assert distance <= STANDARD_ERRORS, (completed, "mse_se")
        worst = max(worst, distance)
    print(f"\n{path.stem} {arithmetic}: worst distance {worst:.2f} standard errors")
