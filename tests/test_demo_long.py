"""The demo itself, and what its ensembles must show (label: long)."""

import os
import subprocess
import sys

import pytest
from simulator import BUILD, ROOT, rows, summary

RESULTS = BUILD / "results"
EXAMPLES = {"aircraft-fixed": [30_000, 300_000], "aircraft-markov": [100_000, 1_000_000]}
PICTURES = ROOT / "sim/pictures"


@pytest.fixture(scope="module")
def table():
    """Runs the demo as tools/run does, in a pipe; its output."""
    if BUILD != ROOT / "build/host":
        pytest.fail("the demo runs from build/host, and this test with it")
    result = subprocess.run(
        [sys.executable, ROOT / "tools/demo.py"], capture_output=True, text=True, check=False
    )
    assert result.returncode == 0, result.stderr
    assert result.stderr == ""  # no progress in a pipe, no warning for the paper's constants
    return result.stdout


@pytest.mark.parametrize("arithmetic", ["f64", "q31"])
@pytest.mark.parametrize("example", EXAMPLES)
def test_slope_of_the_ensemble(table, example, arithmetic):
    """-1 +- 0.15 over 40 runs, the window's last decade (paper, Theorems 2 and 4)."""
    result = summary(RESULTS / f"{example}-{arithmetic}-ideal")
    assert (result["runs"], result["slope_window"]) == (40, EXAMPLES[example])
    assert result["slope"] == pytest.approx(-1, abs=0.15)
    assert f"{result['slope']:.3f}" in table


@pytest.mark.parametrize("example", EXAMPLES)
def test_fixed_point_costs_less_than_two_percent(table, example):
    """Same random words: the ensembles of q31 and f64 at every row."""
    reference = rows(RESULTS / f"{example}-f64-ideal/mse.csv")
    fixed = rows(RESULTS / f"{example}-q31-ideal/mse.csv")
    for one, other in zip(reference, fixed, strict=True):
        for key in ("mse", "estimate_mse", "average_error"):
            assert float(other[key]) == pytest.approx(float(one[key]), rel=0.02), one["step"]


@pytest.mark.parametrize("example", EXAMPLES)
def test_one_run_on_the_can_bus(table, example):
    result = summary(RESULTS / f"{example}-q31-can")
    assert result["runs"] == 1
    assert result["late_frames"] == 0
    assert 0 < result["bus_load"] < 0.01
    assert 0 < result["latency_mean"] <= result["latency_max"] < 0.01


@pytest.mark.parametrize("example", EXAMPLES)
@pytest.mark.parametrize(("kind", "file"), [("altitude", "trajectory"), ("disagreement", "mse")])
def test_committed_pictures_are_fresh(table, example, kind, file):
    """The pictures that README.md shows come from today's plot.py and today's q31 results."""
    picture = f"{example}-{kind}.svg"
    assert (RESULTS / picture).stat().st_size > 10_000
    result = subprocess.run(
        [
            sys.executable,
            ROOT / "tools/plot.py",
            "--check",
            PICTURES / picture,
            RESULTS / f"{example}-q31-ideal/{file}.csv",
        ],
        capture_output=True,
        text=True,
        check=False,
        env={**os.environ, "PYTHONDONTWRITEBYTECODE": "1"},
    )
    assert result.returncode == 0, (
        f"{result.stderr}: run tools/run demo and copy build/host/results/{picture} to sim/pictures"
    )
