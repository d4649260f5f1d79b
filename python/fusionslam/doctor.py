# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Checks of the installation: what works on this machine, and what to install."""

import platform
import shutil
import tempfile
from collections.abc import Iterator, Sequence
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
        detail: version or value; if there is a problem, what to do.
        code: kind of problem, in kebab-case; empty if there is none.
        fields: values that belong to the problem, such as names of packages.
        optional: whether only a part of what was checked for suffers from the problem.
    """

    what: str
    detail: str
    code: str = ""
    fields: Sequence[str] = ()
    optional: bool = False

    @property
    def fine(self) -> bool:
        """Whether there is no problem."""
        return not self.code


def examine(missing_extras: Sequence[str] = ()) -> list[Finding]:
    """Check everything that the commands need.

    Args:
        missing_extras: names of the extras that are not installed.
    """
    from fusionslam.storage.machine import machine

    return [
        Finding("python", f"{platform.python_version()} on {platform.platform()}"),
        _check_core(),
        *_check_packages(),
        *_check_extras(missing_extras),
        Finding("cores", str(machine()["cores"])),
        _check_simd_level(),
        _check_cache(),
    ]


def _check_core() -> Finding:
    try:
        from fusionslam import _core
    except ImportError as error:
        return Finding("core", f"{error}: pip install fusionslam anew", "no-core")
    return Finding("core", f"fusionslam {_core.__version__}, {_core.__file__}")


def _check_simd_level() -> Finding:
    import fusionslam

    try:
        return Finding("instructions", fusionslam.simd_level())
    except fusionslam.ConfigError as error:
        return Finding("instructions", str(error), "unknown-simd-level")


def _check_packages() -> Iterator[Finding]:
    for name in _PACKAGES:
        try:
            yield Finding(name, metadata.version(name))
        except metadata.PackageNotFoundError:
            yield Finding(name, f"pip install {name}", "no-package", (name,))


def _check_extras(missing: Sequence[str]) -> Iterator[Finding]:
    for extra, (packages, use) in _EXTRAS.items():
        detail = f"{', '.join(_describe_package(name) for name in packages)}, for {use}"
        if extra in missing:
            detail += f": pip install 'fusionslam[{extra}]'"
            yield Finding(f"extra {extra}", detail, "no-extra", (extra,), optional=True)
        else:
            yield Finding(f"extra {extra}", detail)


def _describe_package(package: str) -> str:
    try:
        return f"{package} {metadata.version(package)}"
    except metadata.PackageNotFoundError:
        return f"no {package}"


def _check_cache() -> Finding:
    from fusionslam.storage.cache import cache_folder

    folder = cache_folder()
    present = next(place for place in (folder, *folder.parents) if place.exists())
    try:
        tempfile.TemporaryFile(dir=present).close()
    except OSError:
        hint = "the environment variable FUSIONSLAM_CACHE can name another folder"
        return Finding("cache", f"{folder} cannot be written: {hint}", "cache-not-writable")
    free = shutil.disk_usage(present).free / 2**30
    return Finding("cache", f"{folder}, {free:.1f} GiB free")
