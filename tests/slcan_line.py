"""slcan-device as a test's subject, the device's end of a slcan line on a pty, and frames."""

import selectors
import subprocess

import can
from simulator import BUILD

EXTENDED = 1
REMOTE = 2
PATIENCE = 60  # seconds; a line that works needs none


def payload(flags, length):
    return bytes(length) if flags & REMOTE else bytes(range(250 - length, 250))


# Every kind and length, limits of the identifiers: identifier, flags, length, data.
FRAMES = [
    (identifier, flags, length, payload(flags, length))
    for flags, identifiers in (
        (0, (0, 0x080, 0x103, 0x7FF)),
        (REMOTE, (0, 0x103, 0x7FF)),
        (EXTENDED, (0, 0x7FF, 0x800, 0x1000C006, 0x1FFFFFFF)),
        (EXTENDED | REMOTE, (0, 0x1000C006, 0x1FFFFFFF)),
    )
    for identifier in identifiers
    for length in range(9)
]


def message(identifier, flags, length, data):
    """A frame as python-can has it."""
    return can.Message(
        arbitration_id=identifier,
        is_extended_id=bool(flags & EXTENDED),
        is_remote_frame=bool(flags & REMOTE),
        dlc=length,
        data=None if flags & REMOTE else data,
    )


def same(heard, frame):
    """Whether a message of python-can's is that frame."""
    identifier, flags, length, data = frame
    return (
        (heard.arbitration_id, heard.dlc) == (identifier, length)
        and (heard.is_extended_id, heard.is_remote_frame)
        == (bool(flags & EXTENDED), bool(flags & REMOTE))
        and (heard.is_remote_frame or heard.data == data)
    )


class Device:
    def __init__(self):
        self.process = subprocess.Popen(
            [BUILD / "bin/slcan-device"], stdin=subprocess.PIPE, stdout=subprocess.PIPE, bufsize=0
        )
        self.text = b""
        self.path = self.read_line()

    def read_line(self):
        """The next it prints; waits for it."""
        with selectors.DefaultSelector() as selector:
            selector.register(self.process.stdout, selectors.EVENT_READ)
            while b"\n" not in self.text:
                assert selector.select(PATIENCE), "slcan-device hears nothing"
                data = self.process.stdout.read(65536)
                assert data, f"slcan-device ended with {self.process.wait()}"
                self.text += data
        line, self.text = self.text.split(b"\n", 1)
        return line.decode()

    def send(self, identifier, flags, length, data):
        self.process.stdin.write(f"{identifier:x} {flags:x} {length} {data.hex()}\n".encode())

    def received(self):
        """The next frame; waits for it."""
        words = self.read_line().split()
        assert words[0] != "not", f"slcan-device: {' '.join(words)}"
        data = bytes.fromhex(words[3]) if len(words) == 4 else b""
        return int(words[0], 16), int(words[1], 16), int(words[2]), data

    def close(self):
        """Its exit status."""
        self.process.stdin.close()
        status = self.process.wait(timeout=PATIENCE)
        self.process.stdout.close()
        return status
