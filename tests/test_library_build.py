"""What lib/ promises of its build: warnings, freestanding objects, headers, size, arithmetics."""

import hashlib
import itertools
import re
import subprocess
import sys
from pathlib import Path

import pytest
from programs import need, run

ROOT = Path(__file__).resolve().parent.parent
LIB = ROOT / "lib"
WARNINGS = [
    "-std=c99",
    "-Wall",
    "-Wextra",
    "-Wpedantic",
    "-Wconversion",
    "-Wsign-conversion",
    "-Wdouble-promotion",
    "-Wcast-align",
    "-Wshadow",
    "-Werror",
]
COMPILERS = ("gcc", "clang")
ARITHMETICS = ("f64", "f32", "q31")
LEVELS = ("-O0", "-O2", "-Os")
VERBS = {"check", "start", "encode", "receive", "receive_message", "control", "advance"}
# GCC and clang may call these from any code, freestanding or not.
COMPILER_SUPPORT = {"memcpy", "memmove", "memset", "memcmp"}


def compile_library(folder, compiler, arithmetic, level):
    """Objects of lib/*.c by name."""
    objects = {}
    for source in sorted(LIB.glob("*.c")):
        objects[source.stem] = folder / f"{source.stem}.o"
        run(
            need(compiler),
            *WARNINGS,
            level,
            f"-DONEBIT_ARITHMETIC=ONEBIT_{arithmetic.upper()}",
            "-c",
            source,
            "-o",
            objects[source.stem],
        )
    assert "onebit_agent" in objects
    return objects


def symbols(objects):
    """Pairs of name and type letter, as nm has them."""
    found = set()
    for path in objects.values():
        for line in run("nm", "-P", path).splitlines():
            name, letter = line.split()[:2]
            found.add((name, letter))
    return found


@pytest.mark.parametrize(
    ("compiler", "arithmetic", "level"), list(itertools.product(COMPILERS, ARITHMETICS, LEVELS))
)
def test_objects(tmp_path, compiler, arithmetic, level):
    objects = compile_library(tmp_path, compiler, arithmetic, level)
    found = symbols(objects)

    # Nothing from outside but what the compiler itself needs, and erfc where it is said.
    defined = {name for name, letter in found if letter not in "Uwv"}
    undefined = {name for name, letter in found if letter == "U"} - defined
    assert undefined - COMPILER_SUPPORT == ({"erfc"} if arithmetic == "f64" else set())

    # No variables: data, bss, common and their small forms.
    assert not {name for name, letter in found if letter in "DdBbCcGgSs"}
    for path in objects.values():
        for line in run("size", "-A", path).splitlines():
            if match := re.match(r"(\.t?(?:data|bss)\S*)\s+(\d+)", line):
                assert match[1].startswith(".data.rel.ro") or int(match[2]) == 0, line

    # The arithmetic's own names, and no other arithmetic's.
    verbs = {f"onebit_{arithmetic}_{verb}" for verb in VERBS}
    offered = {name for name, letter in found if letter == "T"}
    assert {name for name in offered if re.match("onebit_(f64|f32|q31)_", name)} == verbs


@pytest.mark.parametrize("compiler", COMPILERS)
def test_arithmetic_changes_the_object_code(tmp_path, compiler):
    code = {}
    for arithmetic in ARITHMETICS:
        folder = tmp_path / arithmetic
        folder.mkdir()
        path = compile_library(folder, compiler, arithmetic, "-O2")["onebit_agent"]
        run("objcopy", "-O", "binary", "-j", ".text", path, folder / "text")
        code[arithmetic] = hashlib.sha256((folder / "text").read_bytes()).hexdigest()
    assert len(set(code.values())) == len(ARITHMETICS)


def test_default_arithmetic_is_q31(tmp_path):
    run("gcc", "-std=c99", "-c", LIB / "onebit_agent.c", "-o", tmp_path / "agent.o")
    assert ("onebit_q31_control", "T") in symbols({"agent": tmp_path / "agent.o"})


def test_unknown_arithmetic_is_refused():
    done = subprocess.run(
        ["gcc", "-fsyntax-only", "-DONEBIT_ARITHMETIC=16", LIB / "onebit_agent.c"],
        capture_output=True,
        text=True,
    )
    assert done.returncode != 0
    assert "ONEBIT_ARITHMETIC must be" in done.stderr


def test_headers_included():
    allowed = {"stdint.h", "stdbool.h", "stddef.h", "limits.h"}
    for path in LIB.glob("*.[ch]"):
        text = path.read_text(encoding="utf-8")
        own = {header.name for header in LIB.glob("*.h")}
        for header in re.findall(r'#\s*include\s*[<"]([^>"]+)[>"]', text):
            if header == "math.h":
                assert path.name == "onebit_floating.h"
            else:
                assert header in allowed | own, f"{path.name} includes {header}"


@pytest.mark.parametrize("arithmetic", ARITHMETICS)
def test_math_header_only_in_f64(arithmetic):
    definition = f"-DONEBIT_ARITHMETIC=ONEBIT_{arithmetic.upper()}"
    read = run("gcc", "-M", definition, LIB / "onebit_agent.c")
    assert ("/math.h" in read) == (arithmetic == "f64")


def clang_for(target, source, tmp_path, *options):
    """Compiles C for another processor; freestanding, so that no C library is needed for it."""
    path = tmp_path / "target.c"
    path.write_text(source, encoding="utf-8")
    run(
        need("clang"),
        f"--target={target}",
        "-ffreestanding",
        "-fsyntax-only",
        "-std=c99",
        "-Wall",
        "-Wextra",
        "-Werror",
        f"-I{LIB}",
        *options,
        path,
    )


@pytest.mark.parametrize("arithmetic", ["f32", "q31"])
def test_memory_on_a_32_bit_target(tmp_path, arithmetic):
    source = """
        #include "onebit.h"
        typedef char pointers_have_32_bits[sizeof(void *) == 4 ? 1 : -1];
        typedef char agent_has_at_most_32_bytes[sizeof(onebit_agent) <= 32 ? 1 : -1];
        typedef char link_has_8_bytes[sizeof(onebit_estimate) == 8 ? 1 : -1];
    """
    definition = f"-DONEBIT_ARITHMETIC=ONEBIT_{arithmetic.upper()}"
    clang_for("thumbv7em-none-eabi", source, tmp_path, definition)


@pytest.mark.parametrize("arithmetic", ["f32", "q31"])
@pytest.mark.parametrize("source", sorted(path.name for path in LIB.glob("*.c")))
def test_compiles_where_int_has_16_bits(tmp_path, source, arithmetic):
    """8-bit AVR: constants and shifts that count on an int of 32 bits are told by warnings."""
    text = f"""
        typedef char int_has_16_bits[sizeof(int) == 2 ? 1 : -1];
        #include "{LIB / source}"
    """
    definition = f"-DONEBIT_ARITHMETIC=ONEBIT_{arithmetic.upper()}"
    # Clang misses an AVR toolchain to link with, which a syntax check does not need.
    quiet = ("-Wno-unknown-warning-option", "-Wno-avr-rtlib-linking-quirks")
    clang_for("avr", text, tmp_path, "-mmcu=atmega328p", *quiet, definition)


def test_table_is_what_its_tool_writes():
    written = subprocess.run(
        [sys.executable, ROOT / "tools" / "cdf_table.py"], capture_output=True, check=True
    ).stdout
    assert written == (LIB / "onebit_cdf_table.c").read_bytes()


def code_lines(path):
    """Lines that hold more than space and comments; no string in lib/ has a comment's mark."""
    text = re.sub(r"/\*.*?\*/", "", path.read_text(encoding="utf-8"), flags=re.DOTALL)
    return sum(1 for line in text.splitlines() if line.strip() and line.strip()[:2] != "//")


def test_size_of_the_source():
    total = sum(code_lines(path) for path in LIB.glob("*.[ch]"))
    assert 300 < total < 1200, total
