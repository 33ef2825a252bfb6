"""Damages files at random and reads them, until a time is up: run by `test_fuzz`, in a process of its own.

    python fuzz.py FOLDER SEED_FILE SECONDS

Prints how many files were read and how many refused; ends with 1 and leaves the file in FOLDER where a reader did
anything but read it or refuse it by an error of ours, within 20 s and 1 GB.
"""

from __future__ import annotations

import random
import resource
import signal
import sys
import time
from pathlib import Path

from trackprofile.errors import TrackprofileError
from trackprofile.reader import inspect, read

SLOWEST = 20  # s
MOST_MEMORY = 1 << 30  # bytes beyond what the libraries take
EXTREMES = [b"\x00", b"\xff", b"\x7f\xff\xff\xff", b"\xff" * 4, b"\xff" * 8, b"\x00" * 8, b"\x80" + b"\x00" * 7,
            b"1e999", b"-", b"\"", b"\n", b",", b";", b"nan", b"\xef\xbb\xbf", b"[[", b"9" * 30]  # fmt: skip


def damaged(whole: bytes, chance: random.Random) -> bytes:
    """One to eight small damages."""
    data = bytearray(whole)
    for _ in range(chance.randint(1, 8)):
        at = chance.randrange(len(data) + 1)
        match chance.randrange(7):
            case 0 if at < len(data):
                data[at] ^= 1 << chance.randrange(8)
            case 1 if at < len(data):
                data[at] = chance.randrange(256)
            case 2:
                data[at:at] = chance.choice(EXTREMES)
            case 3:
                piece = chance.choice(EXTREMES)
                data[at : at + len(piece)] = piece
            case 4:
                del data[at : at + chance.randint(1, 64)]
            case 5:
                other = chance.randrange(len(data) + 1)
                length = chance.randint(1, 64)
                data[at : at + length] = data[other : other + length]
            case 6:
                del data[at:]
        if not data:
            data = bytearray(b"\x00")
    return bytes(data)


def too_slow(*_: object) -> None:
    raise TimeoutError(f"more than {SLOWEST} s")


def main(folder: Path, seed: Path, seconds: float) -> int:
    chance, whole = random.Random(1), seed.read_bytes()
    victim = folder / f"victim{seed.suffix}"
    if seed.suffix == ".toml":
        data = seed.with_suffix(".csv")
        (folder / data.name).write_bytes(data.read_bytes())
    else:
        explained = seed.with_suffix(".toml").read_text(encoding="utf-8")
        (folder / "victim.toml").write_text(
            explained.replace(seed.name, victim.name), encoding="utf-8"
        )
    victim.write_bytes(whole)
    read(victim)
    used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (used + MOST_MEMORY, resource.RLIM_INFINITY))
    signal.signal(signal.SIGALRM, too_slow)
    good, refused, end = 0, 0, time.monotonic() + seconds
    while time.monotonic() < end:
        victim.write_bytes(damaged(whole, chance))
        for job in (read, inspect):
            if job is inspect and seed.suffix == ".toml":
                continue
            signal.alarm(SLOWEST)
            try:
                job(victim)
                good += 1
            except TrackprofileError as error:
                refused += 1
                if "\n" in str(error):
                    sys.stdout.write(f"more than one line: {error!r}\n")
                    return 1
            finally:
                signal.alarm(0)
    sys.stdout.write(f"{good} read, {refused} refused\n")
    return 0


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1]), Path(sys.argv[2]), float(sys.argv[3])))
