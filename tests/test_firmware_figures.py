"""The tables of ports/README.md against a new measurement, and what the library must not exceed.

Counts and bytes depend on nothing but the sources and the compilers, so they are compared as text.
"""

import os
import re
import shutil
import sys

import pytest
from simulator import ROOT

sys.path.insert(0, str(ROOT / "tools"))

import firmware_figures as figures

PROGRAMS = {
    "arm-none-eabi-gcc": "gcc-arm-none-eabi and picolibc-arm-none-eabi",
    "riscv64-unknown-elf-gcc": "gcc-riscv64-unknown-elf and picolibc-riscv64-unknown-elf",
    "avr-gcc": "gcc-avr and avr-libc",
    "qemu-system-arm": "qemu-system-arm",
    "qemu-system-riscv32": "qemu-system-misc",
    "simavr": "simavr",
}

# Instructions, cycles on AVR, in q31 at -O2: one estimator update, mean and the worst that was
# found, and the mean of a whole step.
LIMITS = {
    "cortex-m0": (85, 100, 2500),
    "cortex-m3": (50, 65, 1250),
    "cortex-m4f": (50, 65, 1250),
    "rv32imac": (60, 75, 1500),
    "avr5": (780, 950, 15500),
}

# A routine for floating-point numbers or for a division, by the names of libgcc: __aeabi_fadd,
# __aeabi_uldivmod, __divdi3, __udivmodsi4, __addsf3, __floatsidf, __fp_round (AVR).
FORBIDDEN = re.compile(
    r"__aeabi_(?:c?[fd](?:add|r?sub|mul|div|cmp|rcmp|2)|u?i2[fd]|u?l2[fd]|u?l?i?div)"
    r"|__u?(?:div|mod)|[sdt]f\d?$|__fix|__float|__fp_|__(?:add|sub|mul|div|cmp)[sd]f"
)


@pytest.fixture(scope="module")
def measured():
    for program, packages in PROGRAMS.items():
        if shutil.which(program) is None:
            message = f"no {program} here (Debian packages {packages})"
            (pytest.fail if "CI" in os.environ else pytest.skip)(message)
    return figures.measure()


def test_the_committed_tables(measured):
    table = figures.committed()
    stated = re.search(r"^With (.*)\.$", table, re.MULTILINE)
    assert stated, "the tables do not name the compilers"
    if stated[1] != figures.versions():
        message = f"the tables are of {stated[1]}; here are {figures.versions()}: not compared"
        (pytest.fail if "CI" in os.environ else pytest.skip)(message)
    assert figures.tables(measured) == table, "run tools/firmware_figures.py and commit"


@pytest.mark.parametrize("preset", figures.PRESETS)
def test_update(measured, preset):
    mean, worst = measured[preset].counts["q31", "update"]
    update_mean, update_worst, step_mean = LIMITS[preset]
    assert float(mean) <= update_mean
    assert float(mean) <= worst <= update_worst
    assert float(measured[preset].counts["q31", "step"][0]) <= step_mean


def test_f32_is_no_slower_than_erfcf_where_floating_point_is_in_hardware(measured):
    counts = measured["cortex-m4f"].counts
    mean, worst = counts["f32", "update"]
    today, _ = counts["float", "update"]
    assert worst <= 71  # what the update with erfcf takes where the project first measured it
    assert float(mean) <= float(today)


def test_flash_and_stack_on_a_cortex_m0(measured):
    for level in figures.LEVELS:
        assert 0 < measured["cortex-m0"].sizes["q31", level].stack <= 200
    whole, small = (measured["cortex-m0"].pumps[options] for options in ((), figures.SMALL))
    assert 1500 < small.flash <= 2250
    assert small.flash + 500 < whole.flash  # the check and three formats
    assert whole.support > 0  # at least memset
    assert whole.flash <= 3 * 1024
    assert 0 < whole.table == small.table <= 512


def test_the_readme_states_what_the_pump_links(measured):
    whole, small = (measured["cortex-m0"].pumps[options] for options in ((), figures.SMALL))
    text = " ".join((ROOT / "README.md").read_text().split())
    assert f"links {small.flash:,} bytes of `lib/` on a Cortex-M0 at `-Os`" in text
    assert f"without them {whole.flash:,}, the CDF's table of {whole.table:,} among them" in text
    for option in figures.SMALL:
        assert option in text


@pytest.mark.parametrize("preset", figures.PRESETS)
def test_memory(measured, preset):
    """At most 40 bytes an agent and 8 a neighbour in q31 and f32, and no variables anywhere."""
    for arithmetic in ("q31", "f32"):
        assert 0 < measured[preset].memory[arithmetic] <= 40 + 3 * 8
    assert {arithmetic for arithmetic, _ in measured[preset].sizes} >= {"q31", "f32"}
    for size in measured[preset].sizes.values():
        assert (size.data, size.bss) == (0, 0)


@pytest.mark.parametrize("level", figures.LEVELS)
@pytest.mark.parametrize("preset", figures.PRESETS)
def test_q31_links_neither_floating_point_nor_division(measured, preset, level):
    routines = measured[preset].sizes["q31", level].routines
    assert not {name for name in routines if FORBIDDEN.search(name)}


def test_the_forbidden_names_are_those_that_floating_point_links(measured):
    """Where there is no hardware for it, f32 must show what q31 must not have."""
    for preset in ("cortex-m0", "cortex-m3", "rv32imac", "avr5"):
        routines = measured[preset].sizes["f32", "-O2"].routines
        found = {name for name in routines if FORBIDDEN.search(name)}
        for operation in ("add", "mul", "div"):
            assert any(operation in name for name in found), (preset, operation, routines)


def test_stack_of_a_call_graph():
    """The walk itself, on a graph by hand: the deepest branch, loops of jumps, no recursion."""
    function = figures.Function
    graph = {
        "verb": function(8, {"shallow", "deep"}),
        "shallow": function(100),
        "deep": function(40, {"leaf"}, {"loop"}),
        "leaf": function(60),
        "loop": function(70, set(), {"deep"}),
    }
    assert figures.deepest(graph, "verb", 0) == 8 + 40 + 70
    assert figures.deepest(graph, "verb", 2) == 8 + 2 + 40 + 70
    graph["leaf"].calls.add("verb")
    with pytest.raises(figures.FiguresError, match="recursion"):
        figures.deepest(graph, "verb", 0)


@pytest.mark.parametrize(
    ("text", "frame"),
    [
        ("push\t{r4, r5, r6, r7, lr}", 20),
        ("stmdb\tsp!, {r4-r11, lr}", 36),
        ("push\tr28", 1),
        ("sub\tsp, #12", 12),
        ("sub.w\tsp, sp, #264", 264),
        ("add\tsp,sp,-32", 32),
        ("addi\tsp,sp,-16", 16),
        ("add\tsp, #20", 0),
        ("add\tsp,sp,32", 0),
        ("pop\t{r4, pc}", 0),
    ],
)
def test_frame_of_an_instruction(text, frame):
    assert figures.instruction_frame(text) == frame
