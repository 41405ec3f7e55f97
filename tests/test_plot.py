"""tools/plot.py on small made-up runs: it draws, draws the same again, knows a stale picture."""

import json
import shutil
import subprocess
import sys
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import pytest

PLOT = Path(__file__).resolve().parent.parent / "tools" / "plot.py"
CSV_OF = {"trajectory": "trajectory.csv", "disagreement": "mse.csv"}
STEPS = [0, *sorted({round(10 ** (j / 20)) for j in range(81)})]


def write_run(folder, offset):
    """One output folder of onebit-sim: seven agents that meet, disagreement that falls as 1/t."""
    folder.mkdir()
    with (folder / "trajectory.csv").open("w") as file:
        file.write("step,agent,x1,x2,x3,x4\n")
        for step in STEPS:
            for agent in range(1, 8):
                file.write(f"{step},{agent},0,0,{2 + agent / (step + 1) + offset},0\n")
    with (folder / "mse.csv").open("w") as file:
        file.write("step,t,mse,mse_se,estimate_mse,average_error\n")
        for step in STEPS:
            mse = 3 / (step + 11) + offset
            file.write(f"{step},{step + 11},{mse},{mse / 10},1,0.5\n")
    summary = {"slope": -1.0, "slope_window": [1000, 10000]}
    (folder / "summary.json").write_text(json.dumps(summary))


@pytest.fixture
def runs(tmp_path):
    write_run(tmp_path / "f64", 0.0)
    write_run(tmp_path / "q31", 1e-7)
    return tmp_path


def plot(*arguments, program=PLOT):
    return subprocess.run(
        [sys.executable, program, *arguments], capture_output=True, text=True, check=False
    )


def draw(kind, runs, out):
    folders = ("--f64", runs / "f64", "--q31", runs / "q31")
    return plot(kind, *folders, "--title", "Seven <aircraft> & a bus", "--out", out)


def refused(result, *words):
    """Whether plot.py ended with status 2 and one line that has these words."""
    assert result.returncode == 2
    assert result.stdout == ""
    assert result.stderr.count("\n") == 1 and result.stderr.startswith("plot.py: ")
    return all(word in result.stderr for word in words)


@pytest.mark.parametrize("kind", CSV_OF)
def test_draws_the_same_small_picture_twice(kind, runs):
    for name in ("first.svg", "second.svg"):
        result = draw(kind, runs, runs / name)
        assert (result.returncode, result.stdout, result.stderr) == (0, "", "")
    picture = (runs / "first.svg").read_bytes()
    assert picture == (runs / "second.svg").read_bytes()
    assert len(picture) < 150_000
    assert ElementTree.fromstring(picture).tag == "{http://www.w3.org/2000/svg}svg"
    assert b"Seven &lt;aircraft&gt; &amp; a bus" in picture
    assert b"tools/plot.py" in picture


def test_one_run_without_standard_errors_is_drawn(runs):
    for name in ("f64", "q31"):
        lines = (runs / name / "mse.csv").read_text().splitlines()
        rows = [line.split(",") for line in lines[1:]]
        text = [lines[0], *(",".join([*row[:3], "", *row[4:]]) for row in rows)]
        (runs / name / "mse.csv").write_text("\n".join(text) + "\n")
    assert draw("disagreement", runs, runs / "picture.svg").returncode == 0
    assert "standard errors" not in (runs / "picture.svg").read_text()


@pytest.mark.parametrize("kind", CSV_OF)
def test_check_tells_a_changed_input(kind, runs):
    picture = runs / "picture.svg"
    draw(kind, runs, picture)
    inputs = {name: runs / name / CSV_OF[kind] for name in ("f64", "q31")}
    assert plot("--check", picture, inputs["q31"]).returncode == 0

    # The f64 run is recorded but may differ from machine to machine.
    inputs["f64"].write_text(inputs["f64"].read_text() + "\n")
    assert plot("--check", picture, inputs["q31"]).returncode == 0

    inputs["q31"].write_text(inputs["q31"].read_text() + "\n")
    result = plot("--check", picture, inputs["q31"])
    assert result.returncode == 1
    assert "out of date" in result.stdout and str(inputs["q31"]) in result.stdout


def test_check_tells_a_changed_generator(runs):
    picture = runs / "picture.svg"
    draw("trajectory", runs, picture)
    changed = runs / "plot.py"
    shutil.copy(PLOT, changed)
    data = runs / "q31" / "trajectory.csv"
    assert plot("--check", picture, data, program=changed).returncode == 0
    changed.write_text(changed.read_text() + "# changed\n")
    result = plot("--check", picture, data, program=changed)
    assert result.returncode == 1
    assert "out of date" in result.stdout and "plot.py" in result.stdout


def test_check_refuses_what_it_cannot_compare(runs):
    picture = runs / "picture.svg"
    draw("trajectory", runs, picture)
    other = runs / "q31" / "mse.csv"
    data = runs / "q31" / "trajectory.csv"
    assert refused(plot("--check", picture, other), "trajectory.csv", "not given")
    assert refused(plot("--check", picture, data, other), "mse.csv", "not drawn from")
    assert refused(plot("--check", other, data), str(other), "not a picture")
    assert refused(plot("--check", runs / "none.svg", data), "none.svg")


@pytest.mark.parametrize("kind", CSV_OF)
def test_bad_input_is_one_line_and_status_2(kind, runs):
    picture = runs / "picture.svg"
    data = runs / "q31" / CSV_OF[kind]
    good = data.read_text()
    header, first, *_ = good.splitlines()

    for text, words in (
        ("", ("no rows",)),
        (header + "\n", ("no rows",)),
        (good.replace("step,", "pace,", 1), ("no column 'step'",)),
        (f"{header}\nx{first}\n", (":2:", "'step'", "not a finite number")),
        (f"{header}\nnan{first[1:]}\n", (":2:", "'step'", "not a finite number")),
        (f"{header}\n{first}\n1\n", (":3:", "not a finite number")),
    ):
        data.write_text(text)
        assert refused(draw(kind, runs, picture), str(data), *words)
    data.write_bytes(b"\xff\xfe\x00")
    assert refused(draw(kind, runs, picture), str(data), "not CSV")
    data.unlink()
    assert refused(draw(kind, runs, picture), str(data))
    assert not picture.exists()


def test_bad_summary_or_output_is_one_line_and_status_2(runs):
    assert refused(draw("trajectory", runs, runs / "none" / "picture.svg"), "picture.svg")
    summary = runs / "q31" / "summary.json"
    for text in ("{", "{}", '{"slope": "x", "slope_window": [1, 2]}', "[]"):
        summary.write_text(text)
        assert refused(draw("disagreement", runs, runs / "picture.svg"), str(summary))
    summary.unlink()
    assert refused(draw("disagreement", runs, runs / "picture.svg"), str(summary))


@pytest.mark.parametrize(
    "arguments",
    [(), ("--check", "picture.svg"), ("trajectory",), ("pie", "--out", "x"), ("--check",)],
)
def test_bad_use_is_status_2(arguments):
    assert plot(*arguments).returncode == 2
