# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Changes the file of a map under its writer at random moments, and counts what is lost.

The writer acknowledges each change. Then it is killed, and another process opens the map: what was
acknowledged must be there, or the loss be told, by the writer or by whoever opens the map.
"""

import os
import random
import shutil
import signal
import tempfile
import time
from collections import Counter
from pathlib import Path
from typing import BinaryIO

from fusionslam.errors import DataError
from fusionslam.mapping.map_file import MapFile

HOWS = ("killed", "restored", "flipped", "without its log", "replaced", "removed", "forked")
LONGEST_S = 0.12
"""Of a writer: it makes its first change after 10 ms to 30 ms."""
_NOTICED_S = 0.15
"""After a file was taken away its writer makes some more changes."""
_TOLD = b"E"


def change_at_random_moments(count: int, seed: int = 3) -> Counter[tuple[str, str]]:
    """Return how often each change ended as "kept", "told", "lost" or "false alarm".

    A false alarm is a map that is refused after its writer was killed and nothing else was done.
    """
    rng, ends = random.Random(seed), Counter[tuple[str, str]]()
    for number in range(count):
        how = HOWS[number % len(HOWS)]
        with tempfile.TemporaryDirectory() as folder:
            ends[how, _change(Path(folder), how, rng)] += 1
    return ends


def _change(folder: Path, how: str, rng: random.Random) -> str:
    path, backup = folder / "a.fsmap", folder / "backup.fsmap"
    with MapFile(path) as file:
        _store(file, 0)
    shutil.copyfile(path, backup)
    if rng.random() < 0.5:  # else the backup is of the file that the writer opens
        with MapFile(path) as file:
            _store(file, 0.5)
    reading, writing = os.pipe()
    child = os.fork()
    if not child:
        _write(path, writing, is_forked=how == "forked")
    os.close(writing)
    time.sleep(rng.uniform(0, LONGEST_S))
    if how == "replaced":
        os.replace(backup, path)
    elif how == "removed":
        path.unlink()
    if how in ("replaced", "removed"):
        time.sleep(_NOTICED_S)
    os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)
    with os.fdopen(reading, "rb") as said:
        last, is_told = _acknowledged(said)
    _damage(path, backup, how, rng)
    return _end(path, how, last, is_told, read_only=rng.random() < 0.5)


def _store(file: MapFile, number: float) -> None:
    with file.transaction():
        file.store_setting("number", number)


def _write(path: Path, said: int, *, is_forked: bool) -> None:
    """Change a map again and again, and acknowledge each change; does not return."""
    rng = random.Random(os.getpid())
    try:
        file = MapFile(path)
        for number in range(1, 10**6):
            with file.transaction():
                file.store_setting(f"more {number % 5}", "y" * rng.choice([10, 200_000]))
                file.store_setting("number", number)
            os.write(said, b"%d\n" % number)
            if is_forked and not os.fork():
                file.close()  # which must not take the parent's lock or log away
                os._exit(0)
    except DataError:
        os.write(said, _TOLD + b"\n")
    finally:
        os._exit(0)


def _acknowledged(said: BinaryIO) -> tuple[int, bool]:
    """The last change that the writer acknowledged, and whether it told that it cannot go on."""
    lines = said.read().split(b"\n")[:-1]
    numbers = [int(line) for line in lines if line != _TOLD]
    return max(numbers, default=0), _TOLD in lines


def _damage(path: Path, backup: Path, how: str, rng: random.Random) -> None:
    log = path.with_name(f"{path.name}-wal")
    if how == "restored":
        shutil.copyfile(backup, path)
    elif how == "flipped" and log.exists() and log.stat().st_size:
        content = bytearray(log.read_bytes())
        content[rng.randrange(len(content))] ^= 1 << rng.randrange(8)
        log.write_bytes(content)
    elif how == "without its log":
        for suffix in ("-wal", "-shm"):
            path.with_name(path.name + suffix).unlink(missing_ok=True)


def _end(path: Path, how: str, last: int, is_told: bool, *, read_only: bool) -> str:
    """What whoever opens the map finds of it, where change ``last`` was acknowledged."""
    try:
        with MapFile(path, read_only=read_only) as file:
            found, problems = file.setting("number") or 0, file.check()
    except DataError:
        return "told" if how not in ("killed", "forked") else "false alarm"
    if problems:
        return "told" if how not in ("killed", "forked") else "false alarm"
    if found >= last:
        return "kept"
    return "told" if is_told else "lost"
