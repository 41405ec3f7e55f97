#!/usr/bin/env python3
"""Runs a command on a kernel with CAN and ends with its exit status.

That kernel is the host's own where it has vcan: the command then has a network of its own, as root
of a user namespace where that is allowed, so that no interface of the machine is touched. Where the
host has none it is user-mode-linux (Debian's package of this name), a Linux kernel that runs as an
ordinary process on the host's file system. There the file system is read only, TMPDIR is in the
guest's memory and there is one processor. Either way the command finds no interface but lo, has the
right to make them, and leaves none behind.

Where neither is there the exit status is 77, which CTest takes as skipped, and with CI in the
environment 1. Status 124 is the time limit's and 125 that of a kernel that did not get to the end.
"""

import argparse
import contextlib
import os
import selectors
import shlex
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

SKIPPED = 77
TIMED_OUT = 124
KERNEL_FAILED = 125
GUEST_MEGABYTES = 512
# The other variables of the host do not belong in the guest (DISPLAY, XDG_RUNTIME_DIR, ..).
PASSED_ON = ("CI", "LANG", "LC_ALL", "PYTHONPATH", "UBSAN_OPTIONS", "ASAN_OPTIONS")
# Programs in sbin are not on every user's path.
PATH = os.environ.get("PATH", "") + ":/usr/local/sbin:/usr/sbin:/sbin"
OPEN_RAW_SOCKET = "import socket; socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW)"


def note(text):
    print(f"with_can.py: {text}", file=sys.stderr, flush=True)


def namespaces():
    """Words that start a command in a network of its own on a kernel with vcan, or None."""
    if not shutil.which("unshare", path=PATH) or not shutil.which("ip", path=PATH):
        return None
    # A namespace of processes too: the end of its first process ends all that a test forgot.
    apart = ["--net", "--mount", "--pid", "--fork", "--kill-child", "--mount-proc"]
    python = shlex.join([sys.executable, "-c", OPEN_RAW_SOCKET])
    try_out = f"ip link add dev vcan0 type vcan && {python}"
    choices = [["--user", "--map-root-user"]]
    if os.geteuid() == 0:
        choices.append([])
    for choice in choices:
        words = ["unshare", *choice, *apart, "--"]
        result = subprocess.run(
            [*words, "sh", "-c", try_out],
            env={**os.environ, "PATH": PATH},
            capture_output=True,
            check=False,
        )
        if result.returncode == 0:
            return words
    return None


def script(command, folder):
    """The command as a shell script for the guest, in the present folder and environment."""
    names = [name for name in os.environ if name in PASSED_ON or name.startswith("ONEBIT_")]
    lines = [f"export {name}={shlex.quote(os.environ[name])}" for name in names]
    lines += [
        f"export PATH={shlex.quote(PATH)}",
        f"export TMPDIR={folder} HOME={folder}",
        f"mkdir -p {folder}",
        f"cd {shlex.quote(str(Path.cwd()))}",
        "exec " + shlex.join(command),
    ]
    return "\n".join(lines) + "\n"


def memory_folder():
    """Where user-mode-linux keeps the guest's memory: in the host's, if programs may run there."""
    folder = Path("/dev/shm")
    if folder.is_dir() and os.access(folder, os.W_OK):
        status = os.statvfs(folder)
        room = status.f_bavail * status.f_frsize
        if not status.f_flag & os.ST_NOEXEC and room > GUEST_MEGABYTES << 20:
            return str(folder)
    return tempfile.gettempdir()


def kill_group(process):
    """A guest's processes are children of user-mode-linux, in its group."""
    with contextlib.suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)
    process.wait()


def pass_on(source, process, deadline):
    """The pipe's text to standard output until its end; False at the deadline."""
    with selectors.DefaultSelector() as selector:
        selector.register(source, selectors.EVENT_READ)
        while True:
            left = deadline - time.monotonic()
            if left <= 0:
                return False
            if selector.select(min(left, 1)):
                data = os.read(source, 65536)
                if not data:
                    return True
                sys.stdout.buffer.write(data)
                sys.stdout.buffer.flush()
            elif process.poll() is not None:
                return True


def run_in_guest(program, command, time_limit):
    with tempfile.TemporaryDirectory(prefix="onebit-kernel-") as name:
        folder = Path(name)
        shutil.copy(Path(__file__).resolve().parent / "guest.sh", folder)
        (folder / "command").write_text(script(command, "/run/onebit"))
        arguments = [
            program, f"mem={GUEST_MEGABYTES}M", "root=/dev/root", "rootfstype=hostfs",
            "rootflags=/", "ro", f"init={folder}/guest.sh", "loglevel=1",
        ]  # fmt: skip
        # Each system call of the guest is two switches between its threads, which take ten times
        # as long on two processors of the host as on one (onebit-bench socketcan: 10,000 and
        # 100,000 frames a second).
        os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})
        read_end, write_end = os.pipe()
        started = time.monotonic()
        with (folder / "kernel.log").open("wb") as log:
            # The first console is the kernel's, a panic shows there; the second the command's.
            arguments += ["con=null", f"con0=null,fd:{log.fileno()}", f"con1=null,fd:{write_end}"]
            process = subprocess.Popen(
                arguments,
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=log,
                pass_fds=(log.fileno(), write_end),
                # It keeps a folder for each guest in HOME, and panics where it cannot.
                env={**os.environ, "TMPDIR": memory_folder(), "HOME": name},
                start_new_session=True,
            )
        os.close(write_end)
        try:
            in_time = pass_on(read_end, process, started + time_limit)
            if in_time:
                try:
                    process.wait(timeout=10)
                except subprocess.TimeoutExpired:
                    in_time = False
        finally:
            kill_group(process)
            os.close(read_end)
        log = (folder / "kernel.log").read_text(errors="replace")
        status = folder / "status"
        if status.exists() and status.read_text().strip():
            return int(status.read_text())
        if in_time:
            note(f"the kernel ended with status {process.returncode} before the command did:")
        else:
            note(f"not done after {time_limit:.0f} s; ended it. The kernel's messages:")
        # Of a panic the first lines say what, of anything else the last.
        at = log.find("Kernel panic")
        text = log[at : at + 3000] if at >= 0 else log[-3000:]
        print(text.strip(), file=sys.stderr)
        return KERNEL_FAILED if in_time else TIMED_OUT


def run_on_host(words, command, time_limit):
    with tempfile.TemporaryDirectory(prefix="onebit-kernel-") as folder:
        # What /sys tells of interfaces belongs to the network it was mounted in.
        lines = 'mount -t sysfs sysfs /sys 2>/dev/null; ip link set lo up; exec "$@"'
        process = subprocess.Popen(
            [*words, "sh", "-c", lines, "sh", *command],
            stdin=subprocess.DEVNULL,
            env={**os.environ, "PATH": PATH, "TMPDIR": folder, "HOME": folder},
            start_new_session=True,
        )
        try:
            return process.wait(timeout=time_limit)
        except subprocess.TimeoutExpired:
            note(f"not done after {time_limit:.0f} s; ended it")
            return TIMED_OUT
        finally:
            kill_group(process)


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("--kernel", choices=["any", "host", "uml"], default="any")
    parser.add_argument("--time-limit", type=float, default=900, metavar="SECONDS")
    parser.add_argument("command", nargs=argparse.REMAINDER, metavar="COMMAND ..")
    arguments = parser.parse_args()
    if not arguments.command:
        parser.error("a command is needed")
    # SIGTERM ends the kernel with this program as Ctrl-C does.
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(128 + signal.SIGTERM))
    words = namespaces() if arguments.kernel != "uml" else None
    if words:
        return run_on_host(words, arguments.command, arguments.time_limit)
    guest = shutil.which("linux.uml", path=PATH) if arguments.kernel != "host" else None
    if guest and shutil.which("insmod", path=PATH):
        return run_in_guest(guest, arguments.command, arguments.time_limit)
    note(
        "no vcan in this kernel, or no right to use it, and no user-mode-linux "
        "(Debian packages user-mode-linux and kmod)"
    )
    return 1 if os.environ.get("CI") else SKIPPED


if __name__ == "__main__":
    sys.exit(main())
