# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Checks of the installation: what works on this machine, and what to install."""

import platform
import shutil
import tempfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from importlib import metadata

_PACKAGES = (
    *("numpy", "pillow", "platformdirs", "pydantic", "pypcd4"),
    *("pyyaml", "rich", "scipy", "trimesh", "typer"),
)
_EXTRAS = {
    "sim": (("embreex", "pycollada"), "demo and sim"),
    "bags": (("rosbags",), "bags, and sim where it records them"),
    "report": (("jinja2", "matplotlib"), "demo, bench, report and fuse --pictures"),
    "onnx": (("onnxruntime",), "the second stage of views"),
    "learn": (("torch", "safetensors", "onnx", "h5py"), "views train"),
    "tune": (("pymoo",), "tune"),
    "live": (("rerun-sdk",), "ratslam --live"),
}
"""By extra: its packages and the commands that need them."""


@dataclass(frozen=True)
class Finding:
    """Result of one check.

    Attributes:
        what: name of what was checked.
        fine: whether it works.
        detail: version or value; if it does not work, what to do.
        optional: whether it may be missing; only what needs it is then unavailable.
    """

    what: str
    fine: bool
    detail: str
    optional: bool = False


def examine(missing_extras: Sequence[str] = ()) -> list[Finding]:
    """Check everything that the commands need.

    Args:
        missing_extras: names of the extras that are not installed.
    """
    return [
        Finding("python", True, f"{platform.python_version()} on {platform.platform()}"),
        _core(),
        *_packages(),
        *_extras(missing_extras),
        Finding("cores", True, str(_machine_cores())),
        _simd_level(),
        _cache(),
    ]


def _core() -> Finding:
    try:
        from fusionslam import _core
    except ImportError as error:
        return Finding("core", False, f"{error}: install again with pip install fusionslam")
    return Finding("core", True, f"fusionslam {_core.__version__}, {_core.__file__}")


def _simd_level() -> Finding:
    import fusionslam

    try:
        return Finding("instructions", True, fusionslam.simd_level())
    except fusionslam.ConfigError as error:
        return Finding("instructions", False, str(error))


def _packages() -> Iterator[Finding]:
    for name in _PACKAGES:
        try:
            yield Finding(name, True, metadata.version(name))
        except metadata.PackageNotFoundError:
            yield Finding(name, False, f"pip install {name}")


def _extras(missing: Sequence[str]) -> Iterator[Finding]:
    for extra, (packages, use) in _EXTRAS.items():
        fine = extra not in missing
        about = f"{', '.join(_installed(name) for name in packages)}, for {use}"
        line = "" if fine else f": pip install 'fusionslam[{extra}]'"
        yield Finding(f"extra {extra}", fine, about + line, True)


def _installed(package: str) -> str:
    try:
        return f"{package} {metadata.version(package)}"
    except metadata.PackageNotFoundError:
        return f"no {package}"


def _machine_cores() -> int:
    from fusionslam.storage.machine import machine

    return int(machine()["cores"])


def _cache() -> Finding:
    from fusionslam.storage.cache import cache_folder

    folder = cache_folder()
    present = next(place for place in (folder, *folder.parents) if place.exists())
    if not _works(lambda: tempfile.TemporaryFile(dir=present).close()):
        hint = "the environment variable FUSIONSLAM_CACHE can name another folder"
        return Finding("cache", False, f"{folder} cannot be written: {hint}")
    free = shutil.disk_usage(present).free / 2**30
    return Finding("cache", True, f"{folder}, {free:.1f} GiB free")


def _works(action: Callable[[], object]) -> bool:
    try:
        action()
    except OSError:
        return False
    return True
