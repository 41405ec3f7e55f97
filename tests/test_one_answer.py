"""Seven aircraft as a program print what the simulator says, whatever compiles and runs them.

The text itself, ports/firmware/aircraft.txt, is worked out from onebit-sim in Python; each
platform's preset holds its image against that file (ports/firmware/CMakeLists.txt). Here it is held
against the simulator, and against programs of the host's compilers and of a big-endian processor.
"""

import re
import subprocess
import sys

import pytest
import yaml
from programs import need, run
from simulator import ROOT, SCENARIOS, SIMULATOR

sys.path.insert(0, str(ROOT / "tools"))

from onebit_design import __main__ as design

FIRMWARE = ROOT / "ports/firmware"
SCENARIO = SCENARIOS / "aircraft-integer.yaml"
SOURCES = [
    *(FIRMWARE / name for name in ("aircraft.c", "hosted.c", "print.c")),
    ROOT / "sim/integer_plant.c",
    *sorted((ROOT / "lib").glob("*.c")),
]
FLAGS = ["-std=c99", "-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Wsign-conversion"]
FLAGS += ["-Wshadow", "-Werror"]
FLAGS += [f"-I{folder}" for folder in (FIRMWARE, ROOT / "lib", ROOT / "sim")]
MIPS = ("mips-linux-gnu-gcc", "-static")


def expected():
    return (FIRMWARE / "aircraft.txt").read_text()


def test_the_expected_text_is_the_simulators():
    assert run(sys.executable, ROOT / "tools/one_answer.py", SIMULATOR) == expected()


def test_every_agent_has_its_own_checksum_and_it_moves():
    lines = [line.split() for line in expected().splitlines()]
    assert [line[:2] for line in lines] == [
        ["step", step] for step in ("1", "10", "100", "1000", "5000")
    ]
    numbers = [number for line in lines for number in line[2:]]
    assert len(set(numbers)) == len(numbers) == 5 * 7
    assert all(re.fullmatch("[0-9a-f]{8}", number) for number in numbers)


def test_the_readme_shows_it():
    shown = "".join(f"    {line}\n" for line in expected().splitlines())
    assert shown in (ROOT / "ports/README.md").read_text()


def test_the_firmware_runs_the_scenarios_steps():
    steps = re.search(r"#define STEPS (\d+)u", (FIRMWARE / "aircraft.c").read_text())[1]
    assert int(steps) == yaml.safe_load(SCENARIO.read_text())["steps"]


def test_the_constants_are_those_that_the_design_tool_writes(tmp_path):
    assert design.main([str(SCENARIO), "--out", str(tmp_path), "--runs", "0"]) == 0
    written = (tmp_path / "onebit_config.h").read_text()
    assert written == (FIRMWARE / "onebit_config.h").read_text(), (
        f"stale; to write it anew: build/host/bin/onebit-design {SCENARIO.relative_to(ROOT)} "
        "--runs 0 --out DIR, then copy DIR/onebit_config.h to ports/firmware"
    )


@pytest.mark.parametrize("level", ["-O0", "-O2", "-Os"])
@pytest.mark.parametrize("compiler", ["gcc", "clang"])
def test_host(tmp_path, compiler, level):
    need(compiler)
    run(compiler, *FLAGS, level, *SOURCES, "-o", tmp_path / "aircraft")
    assert run(tmp_path / "aircraft") == expected()


# Each capability of lib/onebit_processor.h as this host's compiler does not have it by itself.
CAPABILITIES = [
    "ONEBIT_HAS_WIDE_PRODUCT=0",
    "ONEBIT_HAS_LEADING_ZEROS=0",
    "ONEBIT_SHIFTS_BY_ONE=1",
    "ONEBIT_FEW_REGISTERS=1",
]


@pytest.mark.parametrize("capability", CAPABILITIES)
def test_host_with_another_capability(tmp_path, capability):
    need("gcc")
    run("gcc", *FLAGS, "-O2", f"-D{capability}", *SOURCES, "-o", tmp_path / "aircraft")
    assert run(tmp_path / "aircraft") == expected()


# Options for smaller firmware; test_options.py shows that each changes the code.
FORMAT = [
    "-DONEBIT_ONLY_MODE=ONEBIT_MODE_BROADCAST",
    "-DONEBIT_ONLY_ENCODING=ONEBIT_ENCODING_PAYLOAD",
]


@pytest.mark.parametrize(
    "options",
    [["-DONEBIT_UNCHECKED"], FORMAT, ["-DONEBIT_UNCHECKED", *FORMAT]],
    ids=["unchecked", "format", "both"],
)
def test_host_with_options_for_smaller_firmware(tmp_path, options):
    need("gcc")
    run("gcc", *FLAGS, "-O2", *options, *SOURCES, "-o", tmp_path / "aircraft")
    assert run(tmp_path / "aircraft") == expected()


def test_the_library_refuses_another_format_than_it_was_compiled_for(tmp_path):
    need("gcc")
    options = [FORMAT[0], "-DONEBIT_ONLY_ENCODING=ONEBIT_ENCODING_IDENTIFIER"]
    run("gcc", *FLAGS, "-O2", *options, *SOURCES, "-o", tmp_path / "aircraft")
    done = subprocess.run([tmp_path / "aircraft"], capture_output=True, text=True, check=False)
    assert done.returncode == 1
    statuses = re.findall(r"^    (ONEBIT_\w+)", (ROOT / "lib/onebit_status.h").read_text(), re.M)
    refused = statuses.index("ONEBIT_CONFIG_FORMAT")
    assert done.stdout == f"start of agent 1: status {refused}\n"


# Not every compiler for a big-endian processor says with GCC's macro that it is one.
@pytest.mark.parametrize("order", [[], ["-U__BYTE_ORDER__"]], ids=["told", "untold"])
def test_big_endian(tmp_path, order):
    need("mips-linux-gnu-gcc", "gcc-mips-linux-gnu and libc6-dev-mips-cross")
    need("qemu-mips", "qemu-user")
    need("readelf", "binutils")
    run(*MIPS, *FLAGS, "-O2", *order, *SOURCES, "-o", tmp_path / "aircraft")
    assert "big endian" in run("readelf", "-h", tmp_path / "aircraft")
    assert run("qemu-mips", tmp_path / "aircraft") == expected()
