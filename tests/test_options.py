"""Options that claim to change the build change the object code.

A misspelt option or macro is easily taken for a build of its own. So the agent is compiled as each
preset compiles it, with one option left out or another one put in, and the code must differ.
"""

import functools
import json
import os
import shlex
import shutil
import subprocess
from itertools import combinations

import pytest
from programs import run
from simulator import ROOT

PRESETS = [
    preset["name"]
    for preset in json.loads((ROOT / "CMakePresets.json").read_text())["configurePresets"]
]
HOST_PRESETS = ("host", "asan", "coverage")
PACKAGES = {
    "cortex-m0": "gcc-arm-none-eabi",
    "cortex-m3": "gcc-arm-none-eabi",
    "cortex-m4f": "gcc-arm-none-eabi",
    "rv32imac": "gcc-riscv64-unknown-elf",
    "avr5": "gcc-avr",
}
# Leave the agent's code as it is: they say what may be included and linked, where, or warn.
SILENT = ("-I", "-W", "-g", "-o", "-c", "-D", "-O", "--specs=picolibc.specs")
# Change nothing here: the language, the instruction set of which picolibc has a library, and what
# keeps fused multiply-adds out, which not every processor has (it has a test of its own).
ASSUMED = ("-std=c99", "-misa-spec=2.2", "-ffp-contract=off")


@pytest.fixture(scope="module")
def commands(tmp_path_factory):
    """A source's compile command in a preset, without its output; if not told, the q31 agent's."""

    @functools.cache
    def configured(preset):
        folder = tmp_path_factory.mktemp(preset)
        library_alone = ["-DONEBIT_BUILD_SIMULATOR=OFF", "-DONEBIT_BUILD_TESTS=OFF"]
        done = subprocess.run(
            ["cmake", "--preset", preset, "-B", folder, *library_alone],
            capture_output=True,
            text=True,
            cwd=ROOT,
        )
        if done.returncode != 0 and "CMAKE_C_COMPILER" in done.stderr:
            message = f"no compiler for {preset} here (Debian package {PACKAGES[preset]})"
            (pytest.fail if "CI" in os.environ else pytest.skip)(message)
        assert done.returncode == 0, done.stderr
        return json.loads((folder / "compile_commands.json").read_text())

    def command_of(preset, target="onebit_q31", source="onebit_agent.c"):
        for entry in configured(preset):
            words = shlex.split(entry["command"])
            place = words.index("-o")
            if words[place + 1].startswith(f"CMakeFiles/{target}.dir/{source}"):
                return words[:place] + words[place + 2 :]
        raise AssertionError(f"{preset} does not compile {source} of {target}")

    return command_of


def code(command, folder):
    """Section names and instructions of what a command compiles; None if it does not compile."""
    path = folder / "agent.o"
    done = subprocess.run([*command, "-g0", "-o", path], capture_output=True, text=True)
    if done.returncode != 0:
        return None
    objdump = command[0].removesuffix("gcc") + "objdump" if "-gcc" in command[0] else "objdump"
    assert shutil.which(objdump), objdump
    text = run(objdump, "-w", "-h", "-d", "-r", path)
    return "\n".join(line for line in text.splitlines() if str(path) not in line)


def replace(command, old, new):
    assert old in command
    return [new if word == old else word for word in command]


def test_presets_differ_from_each_other(commands, tmp_path):
    built = {preset: code(commands(preset), tmp_path) for preset in PRESETS}
    assert None not in built.values()
    for one, other in combinations(PRESETS, 2):
        assert built[one] != built[other], (one, other)


@pytest.mark.parametrize("preset", PRESETS)
def test_arithmetics_differ(commands, preset, tmp_path):
    arithmetics = ("f32", "q31") if preset == "avr5" else ("f64", "f32", "q31")
    built = [code(commands(preset, f"onebit_{name}"), tmp_path) for name in arithmetics]
    assert None not in built
    assert len(set(built)) == len(arithmetics)


@pytest.mark.parametrize("preset", PRESETS)
def test_optimisation_levels_differ(commands, preset, tmp_path):
    command = commands(preset)
    level = next(word for word in command if word.startswith("-O"))
    built = [code(replace(command, level, new), tmp_path) for new in ("-O0", "-O2", "-Os")]
    assert None not in built
    assert len(set(built)) == 3


@pytest.mark.parametrize("preset", PRESETS)
def test_every_other_option_of_a_preset_changes_the_code(commands, preset, tmp_path):
    """In one source or another: a floating-point unit is nothing to q31."""
    compiled = [
        commands(preset),
        commands(preset, "onebit_f32"),
        commands(preset, "onebit_base", "onebit_cdf_table.c"),
    ]
    built = [code(command, tmp_path) for command in compiled]
    assert None not in built
    tried = 0
    for option in dict.fromkeys(compiled[0][1:]):
        if option.endswith(".c") or option.startswith(SILENT) or option in ASSUMED:
            continue
        tried += 1
        assert any(
            code([word for word in command if word != option], tmp_path) != before
            for command, before in zip(compiled, built, strict=True)
        ), option
    assert tried > 0 or preset == "host"


# The capabilities of lib/onebit_processor.h that each preset's compiler is found to have.
CAPABILITIES = {
    preset: dict(
        zip(
            ("HAS_WIDE_PRODUCT", "HAS_LEADING_ZEROS", "SHIFTS_BY_ONE", "FEW_REGISTERS"),
            found,
            strict=True,
        )
    )
    for preset, found in {
        "cortex-m0": (0, 0, 0, 1),
        "cortex-m3": (1, 1, 0, 0),
        "cortex-m4f": (1, 1, 0, 0),
        "rv32imac": (1, 0, 0, 0),
        "avr5": (0, 0, 1, 0),
    }.items()
}


@pytest.mark.parametrize(
    ("preset", "capability"),
    [(preset, capability) for preset, found in CAPABILITIES.items() for capability in found],
)
def test_a_capability_changes_the_code(commands, preset, capability, tmp_path):
    """Set as found, it changes nothing; set otherwise, it does. Results: test_one_answer.py."""
    found = CAPABILITIES[preset][capability]
    before = code(commands(preset), tmp_path)
    option = f"-DONEBIT_{capability}="
    assert code([*commands(preset), f"{option}{found}"], tmp_path) == before
    assert code([*commands(preset), f"{option}{1 - found}"], tmp_path) not in (None, before)


@pytest.mark.parametrize("processor", ["cortex-m0", "cortex-m0plus", "cortex-m1", "cortex-m23"])
def test_thumb_1_calls_no_routine_for_a_product(commands, processor, tmp_path):
    """Cortex-M23 too, whose architecture is another: __aeabi_lmul multiplies 64 by 64 bits."""
    for level in ("-O2", "-Os"):
        command = replace(commands("cortex-m0"), "-mcpu=cortex-m0", f"-mcpu={processor}")
        text = code(replace(command, "-O2", level), tmp_path)
        assert text is not None
        assert "__aeabi_lmul" not in text
    # The name is the one that a processor taken for a larger one calls.
    assert "__aeabi_lmul" in code([*command, "-DONEBIT_HAS_WIDE_PRODUCT=1"], tmp_path)


# Options for smaller firmware (README.md); their results: test_one_answer.py.
FORMATS = [
    [f"-DONEBIT_ONLY_MODE=ONEBIT_MODE_{mode}", f"-DONEBIT_ONLY_ENCODING=ONEBIT_ENCODING_{encoding}"]
    for mode in ("BROADCAST", "LINK")
    for encoding in ("PAYLOAD", "IDENTIFIER")
]


@pytest.mark.parametrize("preset", PRESETS)
def test_each_fixed_format_is_a_code_of_its_own(commands, preset, tmp_path):
    """In the agent and in the frame codec."""
    for command in (commands(preset), commands(preset, "onebit_base", "onebit_frame.c")):
        built = [code([*command, *options], tmp_path) for options in ([], *FORMATS)]
        assert None not in built
        assert len(set(built)) == len(built)


def test_a_format_is_fixed_as_a_whole(commands):
    for option in FORMATS[0]:
        command = [*commands("host"), option, "-fsyntax-only"]
        done = subprocess.run(command, capture_output=True, text=True)
        assert done.returncode != 0
        assert "ONEBIT_ONLY_MODE and ONEBIT_ONLY_ENCODING fix the format together" in done.stderr


@pytest.mark.parametrize("preset", PRESETS)
def test_unchecked_leaves_the_check_out(commands, preset, tmp_path):
    """onebit_start no longer calls it, so that firmware does not link it."""
    whole = code(commands(preset), tmp_path)
    unchecked = code([*commands(preset), "-DONEBIT_UNCHECKED"], tmp_path)
    assert "onebit_q31_check" in whole
    assert unchecked is not None
    assert "onebit_q31_check" not in unchecked


# What else than itself the library asks a linker for: shifts of 64 bits, of libgcc; memcpy where a
# structure is copied for little space, which GCC wants of every environment.
ROUTINES = {
    "cortex-m0": {"__aeabi_lasr"},
    "cortex-m3": set(),
    "cortex-m4f": set(),
    "rv32imac": {"__ashrdi3", "memcpy"},
}


@pytest.mark.parametrize("preset", ROUTINES)
def test_what_must_be_linked(commands, preset, tmp_path):
    """With -ffreestanding at most memcpy of a C library; without it, memset in onebit_start."""
    sources = [
        *(
            commands(preset, "onebit_q31", f"onebit_{name}.c")
            for name in ("agent", "check", "valid")
        ),
        *(
            commands(preset, "onebit_base", f"onebit_{name}.c")
            for name in ("frame", "random", "cdf_table", "status")
        ),
    ]
    nm = sources[0][0].removesuffix("gcc") + "nm"
    for extra, allowed in (["-ffreestanding"], set()), ([], {"memset"}):
        for level in ("-O2", "-Os"):
            asked, defined = set(), set()
            for command in sources:
                path = tmp_path / "object.o"
                run(*replace(command, "-O2", level), *extra, "-o", path)
                for line in run(nm, "-P", path).splitlines():
                    name, letter = line.split()[:2]
                    (asked if letter == "U" else defined).add(name)
            assert asked - defined <= ROUTINES[preset] | allowed


def test_no_multiply_add_is_fused(commands, tmp_path):
    """-ffp-contract=off, on a processor that has such an instruction: Cortex-M4F's vfma."""
    command = commands("cortex-m4f", "onebit_f32")
    assert "vfma" not in code(command, tmp_path)
    assert "vfma" in code(replace(command, "-ffp-contract=off", "-ffp-contract=fast"), tmp_path)
    for preset in PRESETS:
        assert "-ffp-contract=off" in commands(preset, "onebit_f32")
