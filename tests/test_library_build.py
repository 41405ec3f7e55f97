"""What lib/ promises of its build: warnings, freestanding objects, headers, size, arithmetics."""

import hashlib
import itertools
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from programs import need, run
from simulator import ROOT

sys.path.insert(0, str(ROOT / "tools"))

from onebit_design.header import coefficient, fixed

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
VERBS = {"check", "valid", "start", "control", "advance"}
VERBS |= {"encode", "send", "send_message", "receive", "receive_message"}
# The sources that are compiled for an arithmetic; the others are the same for all.
OF_ARITHMETIC = ("onebit_agent", "onebit_check", "onebit_valid")
# Installed; the others are private to the library's sources.
PUBLIC_HEADERS = {
    *("onebit.h", "onebit_types.h", "onebit_frame.h", "onebit_status.h"),
    *("onebit_limits.h", "onebit_random.h", "onebit_version.h"),
}
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
        for name, path in compile_library(folder, compiler, arithmetic, "-O2").items():
            run("objcopy", "-O", "binary", "-j", ".text", path, folder / "text")
            text = hashlib.sha256((folder / "text").read_bytes()).hexdigest()
            code.setdefault(name, set()).add(text)
    for name, texts in code.items():
        assert len(texts) == (len(ARITHMETICS) if name in OF_ARITHMETIC else 1), name


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


# clang has no macro that tells of parts of -ffast-math but for that it takes all numbers as finite.
FAST_MATH = ["-ffast-math", "-Ofast", "-ffinite-math-only"]
REORDERED = "-fassociative-math -fno-signed-zeros -fno-trapping-math"


@pytest.mark.parametrize("source", OF_ARITHMETIC)
@pytest.mark.parametrize("arithmetic", ARITHMETICS)
@pytest.mark.parametrize(
    ("compiler", "options"),
    [*itertools.product(COMPILERS, FAST_MATH), ("gcc", REORDERED)],
)
def test_fast_math_is_refused_where_numbers_are_floating(compiler, options, arithmetic, source):
    definition = f"-DONEBIT_ARITHMETIC=ONEBIT_{arithmetic.upper()}"
    done = subprocess.run(
        [need(compiler), "-fsyntax-only", *options.split(), definition, LIB / f"{source}.c"],
        capture_output=True,
        text=True,
    )
    if arithmetic == "q31":
        assert (done.returncode, done.stderr) == (0, "")
    else:
        assert done.returncode != 0
        assert "compile f64 and f32 without -ffast-math" in done.stderr


REAL, COEFFICIENT = "onebit_real", "onebit_coefficient"
# Initializers at the ends of the ranges: what stands just inside, and what stands just outside.
IN_RANGE = [
    *((REAL, f"ONEBIT_NOISE({number})") for number in ("-16.0", "0.0", "15.99999999")),
    *((REAL, f"ONEBIT_REAL({number}, 30)") for number in ("-2.0", "1", "1.999999999")),
    *((REAL, f"ONEBIT_REAL({number}, 0)") for number in ("-2147483648.0", "2147483647.0")),
    (REAL, "ONEBIT_REAL(0.0001, 44)"),
    *(
        (COEFFICIENT, f"ONEBIT_COEFFICIENT({number})")
        for number in ("4.7e-10", "1", "4294967295.9")
    ),
]
OUT_OF_RANGE = [
    *((REAL, f"ONEBIT_NOISE({number})") for number in ("17.0", "16.0", "-16.01", "0.0 / 0.0")),
    *((REAL, f"ONEBIT_REAL({number}, 30)") for number in ("2.1", "2", "-2.1", "1e300")),
    (REAL, "ONEBIT_REAL(1, 31)"),
    *(
        (COEFFICIENT, f"ONEBIT_COEFFICIENT({number})")
        for number in ("-1.0", "0.0", "4.6e-10", "4294967296.0", "5e9", "0.0 / 0.0")
    ),
]


@pytest.mark.parametrize("arithmetic", ARITHMETICS)
@pytest.mark.parametrize("language", ["c", "c++"])
@pytest.mark.parametrize("compiler", COMPILERS)
def test_constants_out_of_range_do_not_compile(tmp_path, compiler, language, arithmetic):
    """Whatever warnings are on. In C++ for what is constexpr: other static data is initialized by
    code where its initializer is not constant."""
    standard = {"c": "-std=c99", "c++": "-std=c++11"}[language]
    definition = f"-DONEBIT_ARITHMETIC=ONEBIT_{arithmetic.upper()}"
    command = [need(compiler), "-x", language, standard, "-w", f"-I{LIB}", definition]
    word = {"c": "static const", "c++": "static constexpr"}[language]
    path = tmp_path / "constant"
    for kind, initializer in [*IN_RANGE, *OUT_OF_RANGE]:
        path.write_text(f'#include "onebit.h"\n{word} {kind} constant = {initializer};\n')
        done = subprocess.run([*command, "-fsyntax-only", path], capture_output=True, text=True)
        taken = (kind, initializer) in IN_RANGE
        assert (done.returncode == 0) == taken, f"{initializer}: {done.stderr}"


@pytest.mark.parametrize("compiler", COMPILERS)
def test_constants_are_those_of_the_design_tool(tmp_path, compiler):
    """q31's integers of 400 numbers over the whole ranges: the compiler's and Python's."""
    random = np.random.default_rng(9)
    rows, gains = [], []
    for bits in range(47):
        rows += [(value, bits) for value in random.uniform(-1, 1, 4) * 2.0 ** (31 - bits)]
    for exponent in range(-31, 32):
        gains += [*(random.uniform(1, 2, 3) * 2.0**exponent), 2.0**exponent]
    assert len(rows) + len(gains) > 400
    path = tmp_path / "constants.c"
    path.write_text(
        '#include "onebit.h"\n#include <inttypes.h>\n#include <stdio.h>\n'
        "static const onebit_real rows[] = {\n"
        + "".join(f"    ONEBIT_REAL({value!r}, {bits}),\n" for value, bits in map(plain, rows))
        + "};\nstatic const onebit_coefficient gains[] = {\n"
        + "".join(f"    ONEBIT_COEFFICIENT({float(value)!r}),\n" for value in gains)
        + "};\nint main(void)\n{\n"
        "    for (unsigned k = 0; k < sizeof rows / sizeof rows[0]; ++k) {\n"
        '        printf("%" PRId32 "\\n", rows[k]);\n    }\n'
        "    for (unsigned k = 0; k < sizeof gains / sizeof gains[0]; ++k) {\n"
        '        printf("%" PRIu32 "u %d\\n", gains[k].value, gains[k].fraction_bits);\n    }\n'
        "    return 0;\n}\n"
    )
    run(need(compiler), *WARNINGS, f"-I{LIB}", path, "-o", tmp_path / "constants")
    wanted = [str(fixed(*row)) for row in map(plain, rows)]
    wanted += ["{1} {2}".format(*coefficient(float(gain))) for gain in gains]
    assert run(tmp_path / "constants").splitlines() == wanted


def plain(row):
    """Without NumPy's types, whose text is no C."""
    return float(row[0]), int(row[1])


EXAMPLE = r"""
#include "pump.h"

#include <stdio.h>

#define STEPS 200u
#if ONEBIT_ARITHMETIC == ONEBIT_Q31
#define VALUE(number) ((double)(number) / (double)(1 << 26))
#else
#define VALUE(number) ((double)(number))
#endif

void pump_send(const onebit_frame *frame)
{
    printf("%lx %02x ", (unsigned long)frame->identifier, frame->data[0]);
}

int main(void)
{
    onebit_frame heard = {0x102u, 0, 1, {0}};
    onebit_real change;
    if (!pump_start()) {
        return 1;
    }
    for (unsigned step = 0; step < STEPS; ++step) {
        if (!pump_step_begins(ONEBIT_REAL(0.75, 26))) {
            return 1;
        }
        for (heard.identifier = 0x102u; heard.identifier <= 0x103u; ++heard.identifier) {
            unsigned bit = step % (heard.identifier - 0x100u) == 0;
            heard.data[0] = (uint8_t)((21 + step) << 1 | bit);
            pump_receive(&heard);
        }
        if (!pump_step_ends(&change)) {
            return 1;
        }
        printf("%.12f\n", VALUE(change));
    }
    return 0;
}
"""


@pytest.mark.parametrize("compiler", COMPILERS)
def test_the_example_is_one_text_for_all_arithmetics(tmp_path, compiler):
    """They send the same frames, and move the pump alike."""
    (tmp_path / "main.c").write_text(EXAMPLE)
    frames, changes = {}, {}
    for arithmetic in ARITHMETICS:
        definition = f"-DONEBIT_ARITHMETIC=ONEBIT_{arithmetic.upper()}"
        sources = [tmp_path / "main.c", LIB / "example/pump.c", *LIB.glob("*.c")]
        folders = [f"-I{LIB}", f"-I{LIB / 'example'}"]
        program = tmp_path / arithmetic
        run(need(compiler), *WARNINGS, definition, *folders, *sources, "-lm", "-o", program)
        lines = [line.split() for line in run(program).splitlines()]
        frames[arithmetic] = [line[:2] for line in lines]
        changes[arithmetic] = [float(line[2]) for line in lines]
    assert [identifier for identifier, _ in frames["f64"]] == ["101"] * 200
    assert len({data for _, data in frames["f64"]}) > 100
    assert frames["q31"] == frames["f32"] == frames["f64"]
    assert len(set(changes["f64"])) > 100
    # Estimates within 5e-5 (shared/DESIGN.md), of two neighbours, times a gain of at most 1/21.
    assert changes["q31"] == pytest.approx(changes["f64"], rel=0, abs=2 * 5e-5 / 21)
    assert changes["f32"] == pytest.approx(changes["f64"], rel=0, abs=2 * 5e-5 / 21)


CPP = """
#include "onebit.h"
#include "onebit_frame.h"
#include "onebit_limits.h"
#include "onebit_random.h"
#include "onebit_status.h"
#include "onebit_types.h"
#include "onebit_version.h"

constexpr onebit_real row[] = {ONEBIT_REAL(-0.5, 30), ONEBIT_REAL_AS(1.0, 1073741824)};
constexpr onebit_real noise = ONEBIT_NOISE(2.0);
constexpr onebit_coefficient gain = ONEBIT_COEFFICIENT(25.0);
constexpr onebit_coefficient written = ONEBIT_COEFFICIENT_AS(25.0, 3355443200u, 27);
constexpr onebit_format formats[] = {
    ONEBIT_FORMAT_BROADCAST_PAYLOAD,
    ONEBIT_FORMAT_BROADCAST_IDENTIFIER,
    ONEBIT_FORMAT_LINK_PAYLOAD,
    ONEBIT_FORMAT_LINK_IDENTIFIER,
};

unsigned used(const onebit_config *config, const onebit_agent *agent);
unsigned used(const onebit_config *config, const onebit_agent *agent)
{
    onebit_config own = onebit_config();
    own.stabilizing = row;
    own.bound = noise;
    own.estimator_gain = gain;
    own.control_gain = written;
    own.format = formats[config->format.mode];
    unsigned refused = onebit_valid(&own, agent) ? 1u : 0u;
    for (int k = 0; k < ONEBIT_REFUSALS; ++k) {
        refused += agent->refused[k];
    }
    return refused + onebit_message_count(config) + (onebit_is_message(ONEBIT_OK) ? 1u : 0u) +
           ONEBIT_ALL_LINKED + ONEBIT_VERSION_MAJOR + ONEBIT_WIRE_FORMAT + ONEBIT_STEP_MODULUS +
           ONEBIT_NEIGHBOURS_MAX;
}
"""


@pytest.mark.parametrize("arithmetic", ARITHMETICS)
@pytest.mark.parametrize("compiler", ["g++", "clang++"])
def test_the_public_headers_in_cpp(tmp_path, compiler, arithmetic):
    """All of them and the macros that make initializers, by the warnings of a strict project."""
    assert {*re.findall(r'#include "(.*)"', CPP)} == PUBLIC_HEADERS
    (tmp_path / "used.cpp").write_text(CPP)
    warnings = ["-Wall", "-Wextra", "-Wpedantic", "-Wold-style-cast"]
    warnings += ["-Wconversion", "-Wsign-conversion", "-Wdouble-promotion", "-Wshadow", "-Wundef"]
    warnings.append("-Werror")
    definition = f"-DONEBIT_ARITHMETIC=ONEBIT_{arithmetic.upper()}"
    command = [need(compiler), "-std=c++11", *warnings, definition, f"-I{LIB}"]
    run(*command, "-c", tmp_path / "used.cpp", "-o", tmp_path / "used.o")


@pytest.mark.parametrize("name", sorted(PUBLIC_HEADERS))
def test_a_public_header_brings_no_private_one(name):
    """It compiles alone, and what it includes is installed with it."""
    read = run("gcc", "-std=c99", "-M", "-x", "c", LIB / name)
    own = {path.name for path in LIB.glob("*.h")}
    assert {Path(word).name for word in read.split()} & own <= PUBLIC_HEADERS


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
    path.write_text(source + "\n", encoding="utf-8")
    run(
        need("clang"),
        f"--target={target}",
        "-ffreestanding",
        "-fsyntax-only",
        *WARNINGS,
        f"-I{LIB}",
        *options,
        path,
    )


@pytest.mark.parametrize("arithmetic", ["f32", "q31"])
def test_memory_on_a_32_bit_target(tmp_path, arithmetic):
    source = """
        #include "onebit.h"
        typedef char pointers_have_32_bits[sizeof(void *) == 4 ? 1 : -1];
        typedef char agent_has_at_most_40_bytes[sizeof(onebit_agent) <= 40 ? 1 : -1];
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
    assert 300 < total < 1600, total
