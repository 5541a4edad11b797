"""A camera's pipeline without a camera, for the tests of kind = "command": `writer` makes its argument list.

Run as a script it does what its arguments say, one after the other: each is a verb and its numbers.
"""

import os
import signal
import sys
import time

SIZE = (64, 48)  # of its frames, in BGR


def writer(*verbs: str) -> tuple[str, ...]:
    """The command that does so."""
    return (sys.executable, "-I", "-S", __file__, *verbs)


def raw_frame(number: int, size: tuple[int, int] = SIZE) -> bytes:
    """One in BGR whose every byte is its number."""
    return bytes([number % 256]) * (size[0] * size[1] * 3)


def main(verbs: list[str]) -> None:
    for verb in verbs:
        name, _, said = verb.partition(" ")
        words = said.split()
        VERBS[name](*words)


def frames(count: str, period_s: str = "0", width: str = "64", height: str = "48") -> None:
    for number in range(int(count)):
        time.sleep(float(period_s))
        write(1, raw_frame(number + 1, (int(width), int(height))))


def picture(count: str, period_s: str) -> None:
    """Frames of noise, which are a picture to the doctor."""
    for _ in range(int(count)):
        time.sleep(float(period_s))
        write(1, os.urandom(SIZE[0] * SIZE[1] * 3))


def timed(count: str, age_ms: str = "500", step_ms: str = "5") -> None:
    """Frames behind the line of their time on descriptor 3: from an age by CLOCK_MONOTONIC on, a step apart."""
    began_ms = time.monotonic() * 1e3 - float(age_ms)
    for number in range(int(count)):
        write(3, b"%.6f\n" % (began_ms + number * float(step_ms)))
        write(1, raw_frame(number + 1))


def pid(path: str) -> None:
    with open(f"{path}.new", "w") as file:
        file.write(str(os.getpid()))
    os.rename(f"{path}.new", path)


def leave(path: str) -> None:
    """A process in a session of its own, whose parent is gone, as a daemon is."""
    if os.fork():
        os.wait()
        return
    os.setsid()
    if os.fork():
        os._exit(0)
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    pid(path)
    time.sleep(1000)


def flood(megabytes: str) -> None:
    for _ in range(int(megabytes)):
        write(2, b"x" * 999_999 + b"\n")


def write(fd: int, data: bytes) -> None:
    while data:
        data = data[os.write(fd, data) :]


VERBS = {
    "frames": frames,
    "picture": picture,
    "timed": timed,
    "part": lambda count: write(1, bytes(int(count))),
    "text": lambda *words: write(1, " ".join(words).encode().decode("unicode_escape").encode("latin-1")),
    "say": lambda *words: write(2, " ".join(words).encode() + b"\n"),
    "line": lambda *words: write(3, " ".join(words).encode() + b"\n"),
    "age": lambda age_ms: write(3, b"%.6f\n" % (time.monotonic() * 1e3 - float(age_ms))),
    "close": lambda fd: os.close(int(fd)),
    "pid": pid,
    "leave": leave,
    "flood": flood,
    "deaf": lambda: signal.signal(signal.SIGTERM, signal.SIG_IGN),
    "sleep": lambda seconds="1000": time.sleep(float(seconds)),
    "exit": lambda status: os._exit(int(status)),
    "die": lambda: os.kill(os.getpid(), signal.SIGKILL),
}

if __name__ == "__main__":
    main(sys.argv[1:])
