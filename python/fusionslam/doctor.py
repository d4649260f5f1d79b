# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Checks of the installation: what works on this machine, and what to install."""

import platform
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from importlib import import_module, metadata

_CORE = "fusionslam._core"
_PACKAGES = (
    *("numpy", "pillow", "platformdirs", "pydantic", "pypcd4"),
    *("pyyaml", "rich", "scipy", "trimesh", "typer"),
)


@dataclass(frozen=True)
class Extra:
    """An extra: a group of packages that only some commands need.

    Attributes:
        modules: importable module by package.
        uses: commands that need it, and uses of several commands.
    """

    modules: Mapping[str, str]
    uses: Sequence[str]


def _same(*names: str) -> dict[str, str]:
    return dict(zip(names, names, strict=True))


_KISS_MATCHER = {"kiss-matcher": "kiss_matcher"} if sys.version_info < (3, 13) else {}
_KISS_ICP = {"kiss-icp": "kiss_icp"} if sys.version_info < (3, 14) else {}
_RAY = {"ray": "ray"} if sys.version_info < (3, 14) else {}
"""These have no packages for later ones."""

EXTRAS = {
    "sim": Extra(
        {"embreex": "embreex", "pycollada": "collada"},
        ("demo", "fleet demo", "sim", "bench views", "views train places", "worlds as DATA"),
    ),
    "bags": Extra(_same("rosbags"), ("demo", "sim", "fuse", "bags and worlds as DATA")),
    "report": Extra(
        _same("jinja2", "matplotlib"),
        (
            *("demo", "bench", "bench views", "report", "ratslam", "views match", "views show"),
            *("views train", "calib-check", "fuse --pictures", "map build", "map show"),
            *("fleet report", "fleet demo"),
        ),
    ),
    "onnx": Extra(_same("onnxruntime"), ("the second stage of views",)),
    "learn": Extra(_same("torch", "safetensors", "onnx", "h5py"), ("views train",)),
    "tune": Extra(_same("pymoo"), ("tune",)),
    "live": Extra(
        {"foxglove-sdk": "foxglove", "rerun-sdk": "rerun"}, ("ratslam --live", "the node live_view")
    ),
    "map": Extra(
        _KISS_MATCHER | _same("gtsam", "pyproj"),
        (
            *("map build", "map show", "map localize", "map merge", "map forget"),
            *("map link", "map unlink", "map fix", "map undo"),
            *("map export", "map check", "fleet merge", "fleet report", "fleet demo"),
            *("the demo map", "registration without gravity", "fusionslam.mapping"),
        ),
    ),
    "odometry": Extra(_KISS_ICP, ("odometry", "ratslam --odometry lidar", "calibrate")),
    "inertial": Extra({"rko-lio": "rko_lio"}, ("odometry of scans and IMU", "--odometry inertial")),
    "fleet": Extra(
        _RAY
        | _same("lancedb", "fastapi", "uvicorn", "limits")
        | {"fastapi-offline": "fastapi_offline", "prometheus-client": "prometheus_client"},
        (
            *("fleet describe", "fleet index", "fleet query", "fleet forget", "fleet report"),
            *("fleet demo", "serve", "fusionslam.fleet", "fusionslam.service"),
        ),
    ),
}


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
    from fusionslam.base.machine import machine

    core = _check_core()
    packages = []
    for name in _PACKAGES:
        try:
            packages.append(Finding(name, metadata.version(name)))
        except metadata.PackageNotFoundError:
            packages.append(Finding(name, f"pip install {name}", "no-package", (name,)))
    return [
        Finding("python", f"{platform.python_version()} on {platform.platform()}"),
        core,
        *packages,
        *_check_extras(missing_extras),
        Finding("cores", str(machine()["cores"])),
        *([_check_simd_level()] if core.fine else []),
        _check_cache(),
    ]


def core_error() -> ImportError | None:
    """Return why the compiled core cannot be loaded; None if it can."""
    try:
        import_module(_CORE)
    except ImportError as error:
        return error
    return None


def _check_core() -> Finding:
    error = core_error()
    if error is None:
        core = import_module(_CORE)
        return Finding("core", f"fusionslam {core.__version__}, {core.__file__}")
    anew = "pip install --force-reinstall with the path of its wheel or of its sources"
    libraries: list[str] = []
    if error.path is not None and shutil.which("ldd") is not None:
        result = subprocess.run(["ldd", error.path], capture_output=True, text=True, check=False)
        lines = [line for line in result.stdout.splitlines() if line.endswith("not found")]
        # A library is listed once for each library that needs it.
        libraries = list(dict.fromkeys(line.split()[0] for line in lines))
    if not libraries:
        return Finding("core", f"{error}: install fusionslam again, {anew}", "no-core")
    packages = []
    for library in libraries:  # Debian's policy (8.1) derives the package's name from it
        name, _, version = library.partition(".so.")
        hyphen = "-" if name[-1].isdigit() else ""
        packages.append(f"{name}{hyphen}{version}".replace("_", "-").lower())
    detail = (
        f"{', '.join(libraries)} cannot be found: on Debian 12 apt-get install "
        f"{' '.join(packages)}; where these versions cannot be had, {anew}"
    )
    return Finding("core", detail, "no-library", libraries)


def _check_simd_level() -> Finding:
    import fusionslam

    try:
        return Finding("instructions", fusionslam.simd_level())
    except fusionslam.ConfigError as error:
        return Finding("instructions", str(error), "unknown-simd-level")


def _check_extras(missing: Sequence[str]) -> Iterator[Finding]:
    for extra, each in EXTRAS.items():
        packages = ", ".join(_describe_package(name) for name in each.modules)
        detail = f"{packages}, for {', '.join(each.uses)}"
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
    from fusionslam.base.cache import cache_folder

    folder = cache_folder()
    present = next(place for place in (folder, *folder.parents) if place.exists())
    try:
        tempfile.TemporaryFile(dir=present).close()
    except OSError:
        hint = "the environment variable FUSIONSLAM_CACHE can name another folder"
        return Finding("cache", f"{folder} cannot be written: {hint}", "cache-not-writable")
    free = shutil.disk_usage(present).free / 2**30
    return Finding("cache", f"{folder}, {free:.1f} GiB free")
