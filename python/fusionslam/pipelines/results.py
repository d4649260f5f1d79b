# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
"""Folders of results, described by ``run.json`` so that a later command can continue."""

import os
from collections.abc import Iterable, Iterator
from contextlib import suppress
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fusionslam.base.archive import load_json, save_json
from fusionslam.base.files import is_map_file
from fusionslam.datasets.bags.reader import bag_kind
from fusionslam.datasets.range_recording import is_recording
from fusionslam.descriptors import in_file_names
from fusionslam.errors import DataError
from fusionslam.pipelines.recording import Recording

if TYPE_CHECKING:
    from fusionslam.evaluation import DescriptorRun, VerifiedRun

FORMAT = "fusionslam.work.2"
FILE = "run.json"
_VERIFIED = "verified"


@dataclass(frozen=True)
class Work:
    """The description of a folder's results in ``run.json``.

    Attributes:
        recording: the input data.
        dataset: name of the dataset.
        command: the command line.
        configs: the configuration in force, by source.
        about: anything else that the results depend on.
        demo: whether the demo made the results, and may replace them.
    """

    recording: Recording
    dataset: str
    command: str = ""
    configs: dict[str, dict[str, Any]] = field(default_factory=dict)
    about: dict[str, Any] = field(default_factory=dict)
    demo: bool = False

    def save(self, folder: str | os.PathLike[str]) -> None:
        """Write ``run.json`` atomically. Raises DataError."""
        save_json(Path(folder) / FILE, FORMAT, asdict(self), indent=1)

    @classmethod
    def load(cls, folder: str | os.PathLike[str]) -> "Work | None":
        """Read ``run.json``; return None if there is none. Raises DataError naming the file."""
        path = Path(folder) / FILE
        if not path.exists():
            return None
        with load_json(path, FORMAT, "the description of stored work") as content:
            return cls(**content | {"recording": Recording(**content["recording"])})


def claim(folder: str | os.PathLike[str], work: Work) -> Work:
    """Claim a folder for this work; earlier work on the same data may stay there.

    Returns:
        The work, with the configurations of the earlier work that it does not replace.

    Raises:
        DataError: the folder is the recording or holds work on other data, or cannot be written.
    """
    refuse_input(work.recording, folder)
    refuse_other_data(folder, work.recording, work.dataset)
    earlier = Work.load(folder)
    if earlier is not None:
        if (earlier.dataset, earlier.about) != (work.dataset, work.about):
            different = " made with other settings or of other frames" if earlier.about else ""
            raise _other_results(folder, earlier, different)
        work = replace(work, configs=earlier.configs | work.configs)
    work.save(folder)
    return work


def refuse_other_data(folder: str | os.PathLike[str], recording: Recording, dataset: str) -> None:
    """Raise DataError if a folder holds results of other data, a map or work of any command.

    Args:
        folder: of the results.
        recording: the input data.
        dataset: name of the dataset or of its drive, which begin alike.
    """
    from fusionslam.evaluation.maps.run import RatSlamRun

    earlier, path = Work.load(folder), Path(folder) / "run.npz"
    if earlier is not None and _place(earlier.recording) != _place(recording):
        raise _other_results(folder, earlier)
    if path.exists():
        drive, names = RatSlamRun.load(path).name, (dataset, f"simulated {recording.simulated}")
        if not any(name.startswith(drive) for name in names):
            raise DataError(
                f"{folder} holds the map of {drive}: choose another folder or delete this one",
                code="other-results",
                fields=(str(folder), drive),
            )


def _other_results(folder: str | os.PathLike[str], earlier: Work, how: str = "") -> DataError:
    return DataError(
        f"{folder} holds results of {earlier.dataset} ({earlier.recording.path}){how}: choose "
        "another folder or delete this one",
        code="other-results",
        fields=(str(folder), earlier.dataset),
    )


def refuse_input(recording: Recording, target: str | os.PathLike[str]) -> None:
    """Raise DataError if results were to be written into the recording or in its place."""
    if _is_same(_place(recording), Path(target).resolve()):
        raise _output_is_input(target, "the recording")


def check_output(
    target: str | os.PathLike[str], inputs: Iterable[str | os.PathLike[str]] = ()
) -> None:
    """Check that a file can be written without losing data.

    Args:
        target: the file.
        inputs: files and folders that are read; those that are missing do not count.

    Raises:
        DataError: the file is one of the inputs (code "output-is-input"), or a recording or a map
            ("output-is-data").
    """
    path = Path(os.path.expanduser(target))  # leaves users that do not exist
    for each in inputs:
        source = Path(os.path.expanduser(each))
        if os.path.exists(source) and _is_same(source.resolve(), path.resolve()):
            raise _output_is_input(target, "a file" if source.is_file() else "a folder")
    what = None
    if os.path.isfile(path):  # False for names that cannot be, too
        is_bag = path.suffix in (".bag", ".mcap", ".db3") and bag_kind(path) is not None
        what = "a recording" if is_bag or is_recording(path) else None
        what = "a map" if is_map_file(path) else what
    if what is not None:
        raise DataError(
            f"{target} is {what}, which is not replaced: write to another place",
            code="output-is-data",
            fields=(str(target),),
        )


def _is_same(source: Path, there: Path) -> bool:
    """Whether two resolved paths are one place."""
    both = os.path.exists(there) and os.path.exists(source)
    return there == source or (both and there.samefile(source))


def _output_is_input(target: str | os.PathLike[str], what: str) -> DataError:
    return DataError(
        f"{target} is {what} that is read: write to another place",
        code="output-is-input",
        fields=(str(target),),
    )


def forget_demo(folder: str | os.PathLike[str], recording: Recording) -> None:
    """Delete the results that an earlier demo made from another drive, and nothing else.

    Raises:
        DataError: the folder holds other work, which is kept; or a file cannot be deleted.
    """
    earlier = Work.load(folder)
    if earlier is None or _place(earlier.recording) == _place(recording):
        return
    if not earlier.demo:
        raise DataError(
            f"{folder} holds results of {earlier.dataset} ({earlier.recording.path}), which the "
            "demo does not replace: choose another folder",
            code="other-results",
            fields=(str(folder), earlier.dataset),
        )
    _delete([*_runs_of(earlier, folder), Path(folder) / FILE])


def delete_page(folder: str | os.PathLike[str], name: str) -> None:
    """Delete a page of earlier results and its figures: new results without a page differ.

    Args:
        folder: of the results.
        name: of the page, without its suffix.

    Raises:
        DataError: a file cannot be deleted.
    """
    page = Path(folder) / f"{name}.html"
    if page.exists():
        _delete([page, page.with_suffix(".json"), page.with_suffix(".csv")])


def _delete(paths: Iterable[Path]) -> None:
    try:
        for path in paths:
            path.unlink(missing_ok=True)
    except OSError as error:
        raise DataError(f"cannot delete {error.filename}: {error.strerror}") from error


def _runs_of(work: Work, folder: str | os.PathLike[str]) -> Iterator[Path]:
    """Yield the runs in a folder that belong to this work; others may lie beside them."""
    from fusionslam.evaluation import DescriptorRun, VerifiedRun

    for source in work.configs:
        kinds: dict[Path, type[DescriptorRun | VerifiedRun]] = {
            runs_folder(folder): DescriptorRun,
            Path(folder) / _VERIFIED: VerifiedRun,
        }
        for inner, kind in kinds.items():
            for path in sorted(inner.glob(f"{source}-*.npz")):
                with suppress(DataError):
                    if kind.load(path).dataset == work.dataset:
                        yield path


def _place(recording: Recording) -> Path:
    """Where a recording is stored, whatever link it was opened by."""
    return Path(recording.path).resolve()


def verified_path(folder: str | os.PathLike[str], source: str, descriptor: str) -> Path:
    """Return the path of verified loops in a folder of results: verified/lidar-cm2dp.npz."""
    return Path(folder) / _VERIFIED / f"{source}-{in_file_names(descriptor)}.npz"


def load_verified(folder: str | os.PathLike[str]) -> "list[VerifiedRun]":
    """Load the verified loops of all sources in a folder of results, if there are any."""
    from fusionslam.evaluation import VerifiedRun

    return [VerifiedRun.load(path) for path in sorted((Path(folder) / _VERIFIED).glob("*.npz"))]


def runs_folder(folder: str | os.PathLike[str]) -> Path:
    """Return the folder of descriptor runs in a folder of results."""
    inner = Path(folder) / "descriptors"
    return inner if inner.is_dir() else Path(folder)


def run_path(folder: str | os.PathLike[str], source: str, descriptor: str) -> Path:
    """Return the path where ``describe_dataset`` stores a run: lidar-cm2dp-author.npz."""
    return Path(folder) / f"{source}-{in_file_names(descriptor)}.npz"


def load_runs(folder: str | os.PathLike[str]) -> "list[DescriptorRun]":
    """Load all runs in a folder. Raises DataError if there is none."""
    from fusionslam.evaluation import DescriptorRun

    paths = run_files(folder)
    if not paths:
        raise DataError(
            f"{folder} holds no descriptor runs: make some with fusionslam describe",
            code="no-runs",
        )
    return [DescriptorRun.load(path) for path in paths]


def run_files(folder: str | os.PathLike[str]) -> list[Path]:
    """Return the files of all descriptor runs in a folder, sorted by name."""
    return sorted(Path(folder).glob("*-*.npz"))
