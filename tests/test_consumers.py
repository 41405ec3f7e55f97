"""The README's ways to take the library into a project, each as its text stands there.

A program outside the tree is built with it, runs, and believes and commands what the paper's
equations say.
"""

import json
import math
import os
import re
import shlex
import shutil
import subprocess
from pathlib import Path

import pytest
from programs import need, run
from test_library_build import PUBLIC_HEADERS

ROOT = Path(__file__).resolve().parent.parent
CONSUMER = ROOT / "tests/consumer/firmware.c"
VERSION = ".".join(
    re.findall(
        r"^#define ONEBIT_VERSION_(?:MAJOR|MINOR|PATCH) (\d+)$",
        (ROOT / "lib/onebit_version.h").read_text(),
        re.M,
    )
)
ARITHMETICS = ("f64", "f32", "q31")
# What the program prints first: ONEBIT_ARITHMETIC and the size of a number. How near estimates and
# controls come: rounding in f64, the table of the CDF in f32, in q31 also the 16 bits of a gain.
IDENTITY = {"f64": "64 8", "f32": "32 4", "q31": "31 4"}
TOLERANCE = {"f64": 1e-13, "f32": 2e-6, "q31": 5e-5}

# Neither a part of another project nor an installation without the simulator looks for these.
NO_DEPENDENCIES = [
    f"-DCMAKE_DISABLE_FIND_PACKAGE_{name}=ON" for name in ("PkgConfig", "OpenMP", "Python3")
]
STRICT = "-Wall -Wextra -Wpedantic -Wconversion -Wsign-conversion -Wshadow -Wundef -Werror"

SECTION = re.search(
    r"^## Taking it into a project\n(.*?)^## ", (ROOT / "README.md").read_text(), re.M | re.S
)[1]
BLOCKS = re.findall(r"```(cmake|sh)\n(.*?)```", SECTION, re.S)


def block(kind, word):
    """The README's block of a kind that has a word in it; there must be one."""
    found = [text for language, text in BLOCKS if language == kind and word in text]
    assert len(found) == 1, (kind, word)
    return found[0]


def expected():
    """Estimates of both neighbours and the control of the program's 50 steps, from the equations
    of the paper in double precision and libm's erfc."""
    b, gain, threshold, bound, k1, k2, x = 5.0, 2.0, -0.5, 2.0, -0.5, 1.0, 0.25
    estimates = [0.0, 0.0]
    steps = []
    for t in range(11, 61):
        for k in range(2):
            bit = (7 * t + 3 * (k + 2)) % 5 < 2
            below = 0.5 * math.erfc(-(threshold - estimates[k]) / math.sqrt(2))
            moved = estimates[k] + b / t * (below - bit)
            estimates[k] = min(max(moved, -bound), bound)
        control = k1 * x + gain / (t + 1) * sum(estimate - k2 * x for estimate in estimates)
        steps.append([*estimates, control])
    return steps


def check_output(text, arithmetic):
    lines = text.split("\n")
    assert lines[:2] == [IDENTITY[arithmetic], "c4923a9c"]
    steps = [[float(word) for word in line.split()] for line in lines[2:] if line]
    wanted = expected()
    assert len(steps) == len(wanted)
    for got, want in zip(steps, wanted, strict=True):
        assert got == pytest.approx(want, rel=0, abs=TOLERANCE[arithmetic])


@pytest.fixture(autouse=True)
def plain_environment(monkeypatch):
    """No compiler flags and search paths of the caller's."""
    for name in [*os.environ]:
        if name.startswith(("CMAKE_", "PKG_CONFIG_")) or name in (
            *("CFLAGS", "CXXFLAGS", "LDFLAGS", "CC", "CXX", "DESTDIR"),
        ):
            monkeypatch.delenv(name)


@pytest.fixture(scope="module")
def tree(tmp_path_factory):
    """A copy of what a person takes, without what was built in it."""
    copy = tmp_path_factory.mktemp("taken") / "onebit"
    left_out = shutil.ignore_patterns("build", ".git", "__pycache__", ".*_cache", "pictures")
    shutil.copytree(ROOT, copy, ignore=left_out)
    return copy


@pytest.fixture
def folder(tmp_path, tree):
    """A project's folder, with the tree in it as the README has it and the program."""
    (tmp_path / "onebit").symlink_to(tree)
    shutil.copy(CONSUMER, tmp_path)
    return tmp_path


@pytest.fixture(scope="module")
def installed(tree, tmp_path_factory):
    """The installation of the README, moved from where it was put, its build folder gone."""
    place = tmp_path_factory.mktemp("install")
    (place / "onebit").symlink_to(tree)
    script = block("sh", "--install").replace("/opt/onebit", str(place / "prefix"))
    script = script.replace("cmake -S", f"cmake {' '.join(NO_DEPENDENCIES)} -S")
    run("sh", "-euc", script, cwd=place)
    shutil.rmtree(place / "onebit-build")
    return (place / "prefix").rename(place / "moved")


def write_project(folder, text, language="C"):
    """A CMake project around a block of the README, with a program of each arithmetic."""
    lines = ["cmake_minimum_required(VERSION 3.25)", f"project(consumer {language})"]
    for line in text.splitlines():
        if line.startswith("target_link_libraries"):
            assert "firmware" in line and "onebit::q31" in line
            for arithmetic in ARITHMETICS:
                source = {"C": "firmware.c", "CXX": "firmware.cpp"}[language]
                lines.append(f"add_executable({arithmetic} {source})")
                of_it = line.replace("firmware", arithmetic)
                lines.append(of_it.replace("onebit::q31", f"onebit::{arithmetic}"))
        else:
            lines.append(line)
    (folder / "CMakeLists.txt").write_text("\n".join(lines) + "\n")


def build(folder, *options):
    options = ["-DCMAKE_EXPORT_COMPILE_COMMANDS=ON", "-DCMAKE_BUILD_TYPE=Release", *options]
    run("cmake", "-S", folder, "-B", folder / "build", *NO_DEPENDENCIES, *options)
    run("cmake", "--build", folder / "build")


def check_programs(folder, *runner):
    for arithmetic in ARITHMETICS:
        check_output(run(*runner, folder / "build" / arithmetic), arithmetic)


def compile_options(folder, source):
    """Options of each compilation of a file, without those that say where things are."""
    found = []
    commands = json.loads((folder / "build/compile_commands.json").read_text())
    for command in commands:
        if Path(command["file"]).name == source:
            words = shlex.split(command["command"])[1:]
            skip = {"-o", "-c", "-isystem", "-I"}
            found.append(
                {
                    word
                    for word, before in zip(words, ["", *words], strict=False)
                    if word not in skip and before not in skip and not word.startswith("-I")
                }
            )
    assert found, source
    return found


# --- as a folder ---


def test_add_subdirectory(folder):
    write_project(folder, block("cmake", "add_subdirectory"))
    build(folder)
    check_programs(folder)

    # Ours reach no code of theirs, and theirs are not ours: no warnings, no standard.
    own = [options - {"-O3", "-DNDEBUG"} for options in compile_options(folder, "firmware.c")]
    assert all(len(options) == 1 for options in own), own
    names = {f"-DONEBIT_ARITHMETIC=ONEBIT_{arithmetic.upper()}" for arithmetic in ARITHMETICS}
    assert set.union(*own) == names
    for options in compile_options(folder, "onebit_agent.c"):
        assert not [option for option in options if option.startswith("-W")]
        assert {"-std=c99", "-ffp-contract=off"} <= options

    # The library alone, and nothing installed with the project.
    targets = run("cmake", "--build", folder / "build", "--target", "help")
    assert not re.search(r"onebit-(sim|bench|node)|unity|test_", targets)
    run("cmake", "--install", folder / "build", "--prefix", folder / "prefix")
    assert not (folder / "prefix").exists()


def test_what_is_not_linked_is_not_compiled(folder):
    text = block("cmake", "add_subdirectory")
    (folder / "CMakeLists.txt").write_text(
        "cmake_minimum_required(VERSION 3.25)\nproject(consumer C)\n"
        f"add_executable(firmware firmware.c)\n{text}"
    )
    build(folder)
    check_output(run(folder / "build/firmware"), "q31")
    archives = {path.name for path in (folder / "build").rglob("*.a")}
    assert archives == {"libonebit_base.a", "libonebit_q31.a"}


def test_cpp_project(folder):
    (folder / "firmware.c").rename(folder / "firmware.cpp")
    write_project(folder, block("cmake", "add_subdirectory"), "CXX")
    build(folder, "-DCMAKE_CXX_STANDARD=11", f"-DCMAKE_CXX_FLAGS={STRICT}")
    check_programs(folder)


def test_strict_project(folder):
    """Their warnings as errors find nothing in our headers and sources."""
    write_project(folder, block("cmake", "add_subdirectory"))
    build(folder, f"-DCMAKE_C_FLAGS={STRICT}")
    check_programs(folder)


def test_warnings_of_another_compiler_stop_nobody(folder):
    """-Waggregate-return warns of lib/'s sources, as a compiler that is not known yet may."""
    write_project(folder, block("cmake", "add_subdirectory"))
    flag = "-DCMAKE_C_FLAGS=-Waggregate-return"
    build(folder, flag)
    alone = [NO_DEPENDENCIES[0], "-DONEBIT_BUILD_SIMULATOR=OFF", flag]
    run("cmake", "-S", folder / "onebit", "-B", folder / "alone", *alone)
    run("cmake", "--build", folder / "alone")
    # In a preset, ours, warnings are errors.
    preset = json.loads((ROOT / "CMakePresets.json").read_text())["configurePresets"][0]
    name = "CMAKE_COMPILE_WARNING_AS_ERROR"
    run("cmake", folder / "alone", f"-D{name}={preset['cacheVariables'][name]}")
    done = subprocess.run(
        ["cmake", "--build", folder / "alone"], capture_output=True, text=True, check=False
    )
    assert done.returncode != 0
    assert "-Werror=aggregate-return" in done.stderr


def test_into_a_shared_library(folder):
    text = block("cmake", "add_subdirectory")
    (folder / "main.c").write_text("int firmware(void);\nint main(void) { return firmware(); }\n")
    (folder / "CMakeLists.txt").write_text(
        "cmake_minimum_required(VERSION 3.25)\nproject(consumer C)\n"
        "add_library(firmware firmware.c)\n"
        "target_compile_definitions(firmware PRIVATE main=firmware)\n"
        f"add_executable(program main.c)\ntarget_link_libraries(program PRIVATE firmware)\n{text}"
    )
    build(folder, "-DBUILD_SHARED_LIBS=ON")
    assert (folder / "build/libfirmware.so").exists()
    assert not list((folder / "build/onebit").rglob("*.so"))
    check_output(run(folder / "build/program"), "q31")


# --- fetched ---


@pytest.fixture
def repository(tree, tmp_path):
    """The copy as a repository with the branch main."""
    path = tmp_path / "repository"
    shutil.copytree(tree, path)
    git = [need("git"), "-c", "user.name=test", "-c", "user.email=test@localhost", "-C", path]
    run(*git, "init", "--quiet", "--initial-branch=main")
    run(*git, "add", "--all")
    run(*git, "commit", "--quiet", "--message=all")
    return path


def test_fetch_content(folder, repository):
    write_project(folder, block("cmake", "FetchContent"))
    build(folder, f"-DONEBIT_REPOSITORY=file://{repository}")
    check_programs(folder)


def test_fetch_content_of_an_archive(folder, tree):
    archive = shutil.make_archive(str(folder / "onebit-main"), "gztar", tree.parent, tree.name)
    text = block("cmake", "FetchContent")
    text = text.replace("GIT_REPOSITORY ${ONEBIT_REPOSITORY} GIT_TAG main", f"URL {archive}")
    assert archive in text
    write_project(folder, text)
    build(folder)
    check_programs(folder)


# --- installed ---


def test_find_package(folder, installed):
    write_project(folder, block("cmake", "find_package"))
    (folder / "onebit").unlink()
    build(folder, f"-DCMAKE_PREFIX_PATH={installed}", f"-DCMAKE_C_FLAGS={STRICT}")
    check_programs(folder)


def test_find_package_in_a_cpp_project(folder, installed):
    (folder / "firmware.c").rename(folder / "firmware.cpp")
    write_project(folder, block("cmake", "find_package"), "CXX")
    build(folder, f"-DCMAKE_PREFIX_PATH={installed}", "-DCMAKE_CXX_STANDARD=11")
    check_programs(folder)


@pytest.mark.parametrize(
    ("asked", "found"),
    [
        *(("", True), ("0.2", True), (f"{VERSION} EXACT", True)),
        *(("0.1", False), ("0.2.99", False), ("0.3", False), ("1.0", False)),
    ],
)
def test_versions(tmp_path, installed, asked, found):
    (tmp_path / "CMakeLists.txt").write_text(
        "cmake_minimum_required(VERSION 3.25)\nproject(consumer NONE)\n"
        "set(CMAKE_SIZEOF_VOID_P 8)\n"
        f'find_package(onebit {asked} QUIET)\nmessage("found: ${{onebit_FOUND}}")\n'
    )
    command = ["cmake", "-S", tmp_path, "-B", tmp_path / "build"]
    done = subprocess.run(
        [*command, f"-DCMAKE_PREFIX_PATH={installed}"], capture_output=True, text=True, check=True
    )
    assert f"found: {int(found)}" in done.stderr


def test_installed_files(installed):
    # The public ones alone: test_library_build.py has them as a list.
    assert {path.name for path in (installed / "include/onebit").iterdir()} == PUBLIC_HEADERS
    assert {path.name for path in (ROOT / "lib").glob("*.h")} > PUBLIC_HEADERS
    archives = {f"libonebit_{part}.a" for part in ("base", *ARITHMETICS)}
    assert {path.name for path in (installed / "lib").glob("*.*")} == archives
    assert {path.name for path in installed.iterdir()} == {"include", "lib"}
    # Nothing says where it was built or put.
    for path in installed.rglob("*"):
        if path.suffix in (".cmake", ".pc"):
            assert str(installed.parent) not in path.read_text(), path


def test_destdir_and_absolute_folders(tree, tmp_path):
    """As a distribution's packager installs: staged, with folders of the distribution's."""
    options = [*NO_DEPENDENCIES, "-DONEBIT_BUILD_SIMULATOR=OFF", "-DCMAKE_INSTALL_PREFIX=/usr"]
    options.append("-DCMAKE_INSTALL_LIBDIR=/usr/lib/here")
    run("cmake", "-S", tree, "-B", tmp_path / "build", *options)
    run("cmake", "--build", tmp_path / "build")
    stage = {**os.environ, "DESTDIR": str(tmp_path / "stage")}
    run("cmake", "--install", tmp_path / "build", env=stage)
    lib = tmp_path / "stage/usr/lib/here"
    assert (lib / "libonebit_q31.a").exists()
    assert (lib / "cmake/onebit/onebit-config.cmake").exists()
    asked = {**os.environ, "PKG_CONFIG_PATH": str(lib / "pkgconfig")}
    get = [need("pkg-config", "pkgconf"), "onebit-q31"]
    assert run(*get, "--variable=libdir", env=asked) == "/usr/lib/here\n"
    assert run(*get, "--variable=includedir", env=asked) == "/usr/include/onebit\n"


@pytest.mark.parametrize("arithmetic", [*ARITHMETICS, None])
def test_pkg_config(folder, installed, arithmetic):
    need("pkg-config", "pkgconf")
    script = block("sh", "pkg-config").replace("/opt/onebit", str(installed))
    name = "onebit" if arithmetic is None else f"onebit-{arithmetic}"
    (folder / "onebit").unlink()
    run("sh", "-euc", script.replace("onebit-q31", name), cwd=folder)
    check_output(run(folder / "firmware"), arithmetic or "q31")


def test_pkg_config_files(installed):
    asked = {**os.environ, "PKG_CONFIG_PATH": str(installed / "lib/pkgconfig")}
    for name in ("onebit", *(f"onebit-{arithmetic}" for arithmetic in ARITHMETICS)):
        get = [need("pkg-config", "pkgconf"), name]
        run(*get, "--validate", env=asked)
        assert run(*get, "--modversion", env=asked).strip() == VERSION


def test_all_arithmetics_in_one_program(folder, installed):
    asked = {**os.environ, "PKG_CONFIG_PATH": str(installed / "lib/pkgconfig")}
    names = [f"onebit-{arithmetic}" for arithmetic in ARITHMETICS]
    calls = "".join(f"int {name}(void);\n" for name in ARITHMETICS)
    calls += "int main(void) { return " + " + ".join(f"{name}()" for name in ARITHMETICS) + "; }\n"
    (folder / "main.c").write_text(calls)
    objects = [folder / "main.c"]
    for arithmetic in ARITHMETICS:
        flags = run("pkg-config", "--cflags", f"onebit-{arithmetic}", env=asked).split()
        objects.append(folder / f"{arithmetic}.o")
        flags += [f"-Dmain={arithmetic}", "-c", "firmware.c", "-o", objects[-1]]
        run("gcc", *flags, cwd=folder)
    libraries = run("pkg-config", "--libs", *names, env=asked).split()
    run("gcc", *objects, *libraries, "-o", folder / "all")
    lines = run(folder / "all").splitlines(keepends=True)
    third = len(lines) // 3
    for k, arithmetic in enumerate(ARITHMETICS):
        check_output("".join(lines[k * third : (k + 1) * third]), arithmetic)


# --- copied ---


@pytest.mark.parametrize("arithmetic", ARITHMETICS)
def test_copied(folder, arithmetic):
    script = block("sh", "cp -r").rstrip()
    options = {"q31": "", "f32": " -DONEBIT_ARITHMETIC=ONEBIT_F32"}
    options["f64"] = " -DONEBIT_ARITHMETIC=ONEBIT_F64 -lm"
    run("sh", "-euc", script + options[arithmetic] + "\nrm onebit", cwd=folder)
    check_output(run(folder / "firmware"), arithmetic)


# --- for another processor ---

CORTEX_M0 = """
set(CMAKE_SYSTEM_NAME Generic)
set(CMAKE_SYSTEM_PROCESSOR arm)
set(CMAKE_C_COMPILER arm-none-eabi-gcc)
set(CMAKE_TRY_COMPILE_TARGET_TYPE STATIC_LIBRARY)
set(CMAKE_C_FLAGS_INIT "-mcpu=cortex-m0 -mthumb -specs=picolibc.specs")
set(CMAKE_EXE_LINKER_FLAGS_INIT "--crt0=hosted --oslib=semihost -Wl,--defsym=__flash=0 \\
-Wl,--defsym=__flash_size=0x40000 -Wl,--defsym=__ram=0x20000000 -Wl,--defsym=__ram_size=0x4000")
"""
MICROBIT = ["-M", "microbit", "-display", "none", "-serial", "none", "-monitor", "none"]
MICROBIT += ["-chardev", "stdio,id=console"]
MICROBIT += ["-semihosting-config", "enable=on,target=native,chardev=console", "-kernel"]


@pytest.fixture
def cortex_m0(tmp_path):
    need("arm-none-eabi-gcc", "gcc-arm-none-eabi")
    need("qemu-system-arm")
    if not Path("/usr/lib/picolibc/arm-none-eabi").is_dir():
        need("picolibc", "picolibc-arm-none-eabi")
    path = tmp_path / "cortex-m0.cmake"
    path.write_text(CORTEX_M0)
    return f"-DCMAKE_TOOLCHAIN_FILE={path}"


def test_cross_compiled(folder, cortex_m0):
    write_project(folder, block("cmake", "add_subdirectory"))
    build(folder, cortex_m0)
    check_programs(folder, "qemu-system-arm", *MICROBIT)


def test_cross_compiled_and_installed(folder, tree, cortex_m0):
    """Without a word of the simulator: for another processor it is not built."""
    run("cmake", "-S", tree, "-B", folder / "library", cortex_m0, *NO_DEPENDENCIES)
    run("cmake", "--build", folder / "library")
    run("cmake", "--install", folder / "library", "--prefix", folder / "prefix")
    (folder / "onebit").unlink()
    write_project(folder, block("cmake", "find_package"))
    build(folder, cortex_m0, f"-DCMAKE_PREFIX_PATH={folder / 'prefix'}")
    check_programs(folder, "qemu-system-arm", *MICROBIT)


# --- the text itself ---


def test_five_ways_of_five_lines_at_most():
    ways = ["add_subdirectory", "FetchContent", "find_package", "pkg-config", "cp -r"]
    assert [way for _, text in BLOCKS for way in ways if way in text] == ways
    for _, text in BLOCKS:
        assert len(text.splitlines()) <= 5, text
