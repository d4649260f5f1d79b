# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Every public name called with arguments of any type: ``python -m fuzz.any_arguments``.

It knows nothing of what the functions check. Each call, each object and each of its methods must be
refused with one of the package's errors or TypeError, or give no NaN.
"""

import importlib
import inspect
import os
import pkgutil
import random
import resource
import signal
import tempfile
import traceback
import warnings
from collections import Counter
from collections.abc import Callable, Iterator
from enum import Enum
from functools import partial
from typing import Annotated, Any

import numpy as np
import typer

import fusionslam
import maps
import scenes
from arrays import COLORS, DESCRIPTORS, IMAGE, POINTS, PROJECTION
from fusionslam.errors import FusionSlamError
from fuzz.hostile_values import HOSTILE_JSON
from fuzz.target import SilentError, check_numbers

_REFUSALS = (FusionSlamError, TypeError, MemoryError)
_LONGEST_S = 5.0
_LARGEST = 6 << 30  # bytes of address space
_SKIPPED = {"embedded_drive", "embedded_folder", "record", "simulate"}  # minutes of work each
_SKIPPED |= {"PoseCells.state"}  # NaN stands for what has not been seen yet


class Hang(Exception):
    """A call took longer than any should that has only small arguments."""


def public_names() -> dict[str, Any]:
    """The callable names of the package's ``__all__`` and of those of its subpackages."""
    modules = [fusionslam] + [
        importlib.import_module(f"fusionslam.{each.name}")
        for each in pkgutil.iter_modules(fusionslam.__path__)
        if each.ispkg and each.name not in ("cli", "ros", "service")
    ]
    found = {
        f"{module.__name__}.{name}": getattr(module, name)
        for module in modules
        for name in getattr(module, "__all__", ())
        if name not in _SKIPPED
    }
    # Python's own rules hold for enumerations and errors.
    own = (Enum, BaseException)
    return {
        name: value
        for name, value in found.items()
        if callable(value) and not (isinstance(value, type) and issubclass(value, own))
    }


def values() -> list[Any]:
    """Values of many types, most of them right for some function."""
    cloud, graph = scenes.place(0), fusionslam.PoseGraph()
    for _ in range(3):
        graph.add_node()
    for node in (1, 2):
        graph.add_edge(node - 1, node, np.eye(4), np.eye(6), "odometry")
    poses = np.tile(np.eye(4), (6, 1, 1))
    arrays = [
        *(POINTS, COLORS, IMAGE, PROJECTION, DESCRIPTORS, DESCRIPTORS[0], np.eye(4), np.eye(6)),
        *(poses, poses[:0], np.arange(6), np.arange(6) * 0.5, np.zeros((6, 3)), np.zeros((0, 3))),
        *(np.full(6, np.nan), np.array(["a"]), np.array(None), np.zeros(6, bool), np.eye(3)),
        np.arange(6)[None],
    ]
    objects = [
        *(cloud, fusionslam.Frame(points=POINTS), fusionslam.Camera(PROJECTION)),
        *(
            graph,
            graph.solve(),
            maps.square_run(),
            fusionslam.views.build_scene(cloud.points, cloud.colors),
        ),
        *(fusionslam.FusionConfig(), fusionslam.LoopConfig(), fusionslam.MapConfig()),
        fusionslam.registration.register(cloud, cloud),
    ]
    plain = [0, 1, 2, 3, 9, 0.5, 2.0, np.nan, np.inf, "z", "cm2dp", "robust", "file", b"x", object]
    return [*arrays, *objects, *plain, *HOSTILE_JSON, range(3), [1, 2], ["a"], lambda: None]


def calls(generator: random.Random) -> Iterator[tuple[str, Callable[[], object]]]:
    """Endless calls; of objects that could be made, methods and properties too."""
    names, pool = public_names(), values()
    while True:
        name = generator.choice(sorted(names))
        made: list[object] = []
        yield name, partial(_make, names[name], pool, generator, made)
        if made and isinstance(names[name], type):
            own = vars(type(made[0]))
            parts = [
                part
                for part in own
                if not part.startswith("_") and f"{type(made[0]).__name__}.{part}" not in _SKIPPED
            ]
            for part in generator.choices(parts, k=3) if parts else ():
                yield f"{name}.{part}", partial(_use, made[0], part, pool, generator)


def _make(function: Any, pool: list[Any], generator: random.Random, made: list[object]) -> object:
    made.append(_call(function, pool, generator))
    return None if isinstance(function, type) else made[0]  # objects may hold what they are given


def _use(item: object, part: str, pool: list[Any], generator: random.Random) -> object:
    value = getattr(item, part)
    return _call(value, pool, generator) if callable(value) else None


def _call(function: Any, pool: list[Any], generator: random.Random) -> object:
    try:
        parameters = list(inspect.signature(function).parameters.values())
    except ValueError:  # the core's functions tell Python nothing of their arguments
        return function(*generator.choices(pool, k=generator.randint(1, 4)))
    given, named = [], {}
    for each in parameters:
        if each.kind in (each.VAR_POSITIONAL, each.VAR_KEYWORD):
            continue
        if each.default is not each.empty and generator.random() < 0.6:
            continue
        value = _choose(each.annotation, pool, generator)
        if each.kind == each.POSITIONAL_ONLY:
            given.append(value)
        else:
            named[each.name] = value
    return function(*given, **named)


def _choose(annotation: Any, pool: list[Any], generator: random.Random) -> Any:
    """A value of the annotated kind more often than not."""
    if generator.random() < 0.3:
        return generator.choice(pool)
    text = annotation if isinstance(annotation, str) else str(annotation)
    kinds = {np.ndarray: "ndarray", str: "str", int: "int", float: "float"}
    wanted = [kind for kind, word in kinds.items() if word in text]
    wanted += [annotation] if isinstance(annotation, type) else []
    fitting = [value for value in pool if isinstance(value, tuple(wanted))]
    return generator.choice(fitting or pool)


def check(call: Callable[[], object]) -> str | None:
    """What is wrong with the answer of a call; None if nothing is."""
    try:
        check_numbers(call())
    except _REFUSALS:
        return None
    except (Exception, Hang) as error:
        if isinstance(error, SilentError):
            return f"SilentError: {error}"
        where = traceback.extract_tb(error.__traceback__)[-1]
        place = f"{os.path.basename(where.filename)}:{where.lineno}"
        return f"{type(error).__name__} at {place}: {str(error)[:100]}"
    return None


def _stop(*_: object) -> None:
    raise Hang(f"took more than {_LONGEST_S} s")


def main(
    count: Annotated[int, typer.Argument(help="Calls.")] = 20_000,
    seed: Annotated[int, typer.Option(help="Of the generator.")] = 0,
) -> None:
    """Call public names with arguments of any type, and count answers that nobody should give."""
    signal.signal(signal.SIGALRM, _stop)
    resource.setrlimit(resource.RLIMIT_AS, (_LARGEST, _LARGEST))
    warnings.simplefilter("ignore")
    np.seterr(all="ignore")
    output = os.fdopen(os.dup(1), "w")  # a number in the place of a path may be this one
    findings: Counter[str] = Counter()
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)
        for number, (name, call) in enumerate(calls(random.Random(seed))):
            if number == count:
                break
            signal.setitimer(signal.ITIMER_REAL, _LONGEST_S)
            if finding := check(call):
                findings[f"{name}: {finding}"] += 1
            signal.setitimer(signal.ITIMER_REAL, 0)
        os.chdir("/")
    for finding, times in findings.most_common():
        print(f"{times:5d}  {finding}", file=output)
    print(
        f"{count} calls, {findings.total()} answers that are neither refusals nor numbers",
        file=output,
    )
    output.flush()
    os._exit(1 if findings else 0)  # whatever was closed or still runs


if __name__ == "__main__":
    typer.run(main)
