"""The program onebit-design from end to end: what it writes, tells and leaves behind."""

import json
import subprocess
import sys

import numpy as np
import pytest
import yaml
from simulator import BUILD, ROOT, SCENARIOS, SIMULATOR, call

sys.path.insert(0, str(ROOT / "tools"))

from onebit_design import __main__ as program
from onebit_design import simulate

EXAMPLES = ROOT / "tools/onebit_design/examples"
FILES = {"scenario.yaml", "onebit_config.h", "design.json", "onebit.dbc", "prediction.svg"}
# The names.
NAMES = (
    *("K1", "K2", "P", "lambda_2", "lambda_G", "lambda_QW", "lambda_QL", "alpha", "f_M", "pi"),
    *("pi_min", "beta_consensus", "beta_rate", "gamma_min", "t0_min", "d_max", "eigenvalues"),
    *("horizon", "conditions"),
)


def design(system, out, *options):
    return program.main(
        [str(system), "--out", str(out), "--simulator", str(SIMULATOR), *map(str, options)]
    )


@pytest.fixture(scope="module", params=["aircraft", "motors", "pumps"])
def designed(request, tmp_path_factory):
    """An example for users, with fewer steps; the folder and what the terminal said."""
    folder = tmp_path_factory.mktemp(request.param)
    for path in EXAMPLES.iterdir():
        text = path.read_text().replace("steps: 100000", "steps: 20000")
        (folder / path.name).write_text(text)
    done = subprocess.run(
        [
            *(BUILD / "bin/onebit-design", folder / f"{request.param}.yaml"),
            *("--out", folder / "deep/out", "--runs", "10"),
        ],
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.returncode, done.stderr) == (0, "")
    return folder / "deep/out", done.stdout


def test_writes_all_files_and_nothing_else(designed):
    out, _ = designed
    content = yaml.safe_load((out / "scenario.yaml").read_text())
    dbc = content["bus"]["encoding"] == "payload"
    assert {path.name for path in out.iterdir()} == FILES - (set() if dbc else {"onebit.dbc"})
    assert (out / "prediction.svg").read_text().startswith("<?xml")


def test_the_scenario_runs_without_warnings_in_all_arithmetics(designed):
    out, _ = designed
    for arithmetic in ("f64", "f32", "q31"):
        done = call("run", out / "scenario.yaml", "--arith", arithmetic, "--steps", 100)
        assert (done.returncode, done.stderr) == (0, "")


def test_design_json_has_the_names(designed):
    out, _ = designed
    figures = json.loads((out / "design.json").read_text())
    assert set(NAMES) <= set(figures)
    n = len(figures["K1"])
    assert np.shape(figures["P"]) == (n, n)
    assert np.shape(figures["eigenvalues"]) == (n, 2)
    assert figures["horizon"]["t"] > 0
    assert np.shape(figures["horizon"]["sensitivity"]["A"]) == (n, n)
    assert all(condition["holds"] for condition in figures["conditions"])
    assert figures["simulation"]["runs"] == 10
    assert figures["simulation"]["warnings"] == []
    assert figures["bus"]["load_mean"] > 0
    assert figures["prediction"]["mse"][-1] > 0


def test_report_tells_of_each_condition_and_choice(designed):
    out, told = designed
    figures = json.loads((out / "design.json").read_text())
    for condition in figures["conditions"]:
        assert f"  holds  {condition['name']}" in told
    for name, choice in figures["chosen"].items():
        assert f"  chose {name} = {choice['value']:g}: {choice['reason']}" in told
    assert "All hold" in told
    assert "standard errors" in told


def test_prediction_and_ensemble_agree(designed):
    """Coarsely, for ten runs; tests/test_prediction.py tests it sharply."""
    out, _ = designed
    rows = json.loads((out / "design.json").read_text())["simulation"]["rows"]
    assert len(rows) > 5
    ratios = [row["predicted"] / row["simulated"] for row in rows]
    assert 0.4 < np.exp(np.mean(np.log(ratios))) < 2.5


# Conditions that are not met.

UNMET = {
    "consensus": ({"beta": 100}, "beta for consensus", "raise beta above 498.9"),
    "rate": ({"gamma": 0.5}, "gamma > 1/lambda_2 for the rate 1/t", "raise gamma above 0.6306"),
    "rate's beta": ({"beta": 520}, "beta for the rate 1/t", "raise beta above 539.0"),
    "t0": ({"t0": 2}, "t0 > gamma d_max - 1", "raise t0 to 3"),
    "K2 B": ({"compression": [3.9, 0.9, 0.36, 0.88]}, "K2 B = 1, error", "to all digits"),
}


@pytest.mark.parametrize("case", UNMET)
def test_a_condition_that_fails_is_named_with_its_cure(case, tmp_path, capsys):
    changes, name, cure = UNMET[case]
    content = yaml.safe_load((SCENARIOS / "aircraft-fixed.yaml").read_text())
    content["gains"] |= changes
    content["steps"] = 1000
    path = tmp_path / "system.yaml"
    path.write_text(yaml.safe_dump(content))
    status = design(path, tmp_path / "out", "--runs", 0)
    output = capsys.readouterr()
    assert status == 0
    (line,) = (line for line in output.out.splitlines() if line.startswith(f"  FAILS  {name}"))
    assert cure in line
    assert "Not met: " in output.out
    figures = json.loads((tmp_path / "out/design.json").read_text())
    assert name in {entry["name"] for entry in figures["conditions"] if not entry["holds"]}


def test_a_loop_that_does_not_decay_has_no_format(tmp_path, capsys):
    """K1 = 0 leaves the aircraft's climb rate as it is: a second eigenvalue 1."""
    content = yaml.safe_load((SCENARIOS / "aircraft-fixed.yaml").read_text())
    content["gains"] |= {"stabilizing": [0, 0, 0, 0], "compression": [0, 0, 0.1, 0]}
    path = tmp_path / "system.yaml"
    path.write_text(yaml.safe_dump(content))
    assert design(path, tmp_path / "out") == 2
    assert "choose smaller roots" in capsys.readouterr().err


def test_fast_is_predicted_and_simulated_to_be_faster(tmp_path, capsys):
    """On a network where the theorem's beta is far from what one would choose, with few steps."""
    content = yaml.safe_load((EXAMPLES / "aircraft.yaml").read_text())
    content["steps"] = 2000
    path = tmp_path / "system.yaml"
    path.write_text(yaml.safe_dump(content))
    ends = {}
    for objective in ("theorem", "fast"):
        out = tmp_path / objective
        assert design(path, out, "--objective", objective, "--runs", 100) == 0
        figures = json.loads((out / "design.json").read_text())
        ends[objective] = (
            figures["prediction"]["mse"][-1],
            figures["simulation"]["rows"][-1]["simulated"],
        )
        failing = {entry["name"] for entry in figures["conditions"] if not entry["holds"]}
        assert failing == (
            set() if objective == "theorem" else {"beta for consensus", "beta for the rate 1/t"}
        )
    assert ends["fast"][0] < ends["theorem"][0]
    assert ends["fast"][1] < ends["theorem"][1]
    told = capsys.readouterr().out
    assert "Not met: beta for consensus; beta for the rate 1/t." in told
    assert "least predicted error after the last step; not the theorem's" in told


# Use.


def test_large_groups_are_not_predicted(tmp_path, capsys):
    content = yaml.safe_load((EXAMPLES / "pumps.yaml").read_text())
    agents = program.PREDICTED_MAX // 3 + 1
    content["topology"] = {"complete": 20} if agents <= 20 else {"ring": agents}
    content["initial"]["states"] = [[0.0]] * (agents - 1) + [[0.1]]
    content["gains"] |= {"beta": 100, "gamma": 3}
    content["steps"] = 100
    path = tmp_path / "system.yaml"
    path.write_text(yaml.safe_dump(content))
    assert design(path, tmp_path / "out", "--runs", 3) == 0
    assert "Prediction: none" in capsys.readouterr().out
    assert json.loads((tmp_path / "out/design.json").read_text())["prediction"] is None
    assert not (tmp_path / "out/prediction.svg").exists()


@pytest.mark.parametrize(
    "arguments",
    [
        [],
        ["system.yaml"],
        ["system.yaml", "--out", "out", "--objective", "best"],
        ["system.yaml", "--out", "out", "--runs", "1"],
        ["system.yaml", "--out", "out", "--runs", "-1"],
    ],
)
def test_bad_use(arguments, capsys):
    with pytest.raises(SystemExit) as ended:
        program.main(arguments)
    assert ended.value.code == 2
    assert "usage: onebit-design" in capsys.readouterr().err


def test_nothing_half_written_when_a_file_cannot_be(tmp_path, capsys):
    """A folder stands where design.json should: what was there before stays whole."""
    out = tmp_path / "out"
    (out / "design.json").mkdir(parents=True)
    (out / "scenario.yaml").write_text("as it was")
    assert design(EXAMPLES / "pumps.yaml", out, "--runs", 0) == 1
    assert "design.json" in capsys.readouterr().err
    assert (out / "scenario.yaml").read_text() == "as it was"
    assert sorted(path.name for path in out.iterdir()) == ["design.json", "scenario.yaml"]


def test_an_out_that_cannot_be_a_folder(tmp_path, capsys):
    (tmp_path / "file").write_text("")
    assert design(EXAMPLES / "pumps.yaml", tmp_path / "file", "--runs", 0) == 1
    assert str(tmp_path / "file") in capsys.readouterr().err


def test_a_simulator_that_fails_ends_with_1_and_writes_nothing(tmp_path, capsys):
    arguments = [str(EXAMPLES / "pumps.yaml"), "--out", str(tmp_path / "out")]
    assert program.main([*arguments, "--simulator", "/bin/false"]) == 1
    assert program.main([*arguments, "--simulator", str(tmp_path / "none")]) == 1
    assert capsys.readouterr().err.count("onebit-design: ") == 2
    assert not (tmp_path / "out").exists()


def test_same_input_same_bytes(tmp_path, capsys):
    for name in ("first", "second"):
        assert design(EXAMPLES / "pumps.yaml", tmp_path / name, "--runs", 2) == 0
    capsys.readouterr()
    for path in (tmp_path / "first").iterdir():
        assert path.read_bytes() == (tmp_path / "second" / path.name).read_bytes()


def test_an_ensemble_stays_affordable():
    assert simulate.affordable_steps(1000, 20, 40) == 1000
    assert simulate.affordable_steps(10**9, 20, 40) * 20 * 40 <= simulate.ESTIMATES_MAX
    assert simulate.affordable_steps(10**9, 10**6, 10**6) == 1
