"""Other programs, as tests call them: one that is missing skips the test, but in CI fails it."""

import os
import shutil
import subprocess

import pytest


def need(program, package=None):
    """The program's name; without it the test is skipped and names its Debian package."""
    if shutil.which(program):
        return program
    message = f"{program} is not installed (package {package or program})"
    if "CI" in os.environ:
        pytest.fail(message)
    pytest.skip(message)


def run(*command, **options):
    """What a command that must succeed prints; options as subprocess.run takes them."""
    words = [str(word) for word in command]
    done = subprocess.run(words, capture_output=True, text=True, check=False, **options)
    assert done.returncode == 0, f"{' '.join(words)}\n{done.stdout}{done.stderr}"
    return done.stdout
