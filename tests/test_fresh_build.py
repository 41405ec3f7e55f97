"""A build folder that has seen nothing yet."""

import os

import pytest
from programs import run
from simulator import ROOT


@pytest.fixture
def fresh(tmp_path):
    options = ["-DONEBIT_BUILD_TESTS=OFF", "-DCMAKE_BUILD_TYPE=Debug"]
    run("cmake", "-S", ROOT, "-B", tmp_path / "build", *options)
    return tmp_path / "build"


def test_benchmark_builds_alone_and_tells_sizes(fresh):
    """It shows the sizes of objects that no program links, so nothing else asks for them."""
    run("cmake", "--build", fresh, "--target", "onebit-bench", "--parallel", min(2, os.cpu_count()))
    assert (fresh / "bin/onebit-bench").exists()
    sizes = (fresh / "sim/object_sizes.txt").read_text()
    assert sizes.count("onebit_agent") == 3
