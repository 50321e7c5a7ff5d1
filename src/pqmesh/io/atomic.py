"""Files that appear whole or not at all: written under another name and moved into place."""

from __future__ import annotations

import errno
import os
import secrets
import shutil
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path, PurePath

from pqmesh.errors import FormatError

PathLike = str | os.PathLike[str]


def write_bytes(path: PathLike, data: bytes) -> None:
    """Write a file so that it is complete or, whatever happens, as it was before.

    A link is followed; the file behind it is replaced. New files have the permissions of the
    umask, replaced ones keep theirs.

    Parameters
    ----------
    path : str or path
        In a folder that exists.
    data : bytes

    Raises
    ------
    FormatError
        When the folder or the file cannot be written, or the disk is full.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     write_bytes(Path(folder, "a.txt"), b"roof")
    ...     Path(folder, "a.txt").read_bytes()
    b'roof'
    """
    with _named_errors(path):
        target = Path(os.path.realpath(path))
        _check_target(target, shown_path(path))
        staged = target.parent / _hidden_name()
        try:
            _write_new(staged, data)
            _keep_permissions(target, staged)
            staged.replace(target)
        except BaseException:
            with suppress(OSError):
                staged.unlink()
            raise


def write_all(folder: PathLike, files: Mapping[str, bytes]) -> None:
    """Write the files of one result, all or none; files of other names stay.

    Everything is written into a hidden folder first, then moved into place. When that fails
    or is interrupted, earlier files come back and new ones go.

    Parameters
    ----------
    folder : str or path
        Created, with the folders above it, when it does not exist.
    files : mapping of name to bytes
        Names are relative and may have folders, with `/`: "figures/plan.png".

    Raises
    ------
    FormatError
        When a name leaves the folder, or something cannot be written.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     write_all(folder, {"report.json": b"{}", "figures/plan.png": b"..."})
    ...     sorted(p.name for p in Path(folder).rglob("*"))
    ['figures', 'plan.png', 'report.json']
    """
    names = _checked_names(files)
    root = Path(folder)
    made: list[Path] = []
    with _named_errors(folder):
        try:
            _make_folders(root, made)
            for name in names:
                _check_target(root / name, shown_path(root / name))
            _stage_and_move(root, {name: files[text] for name, text in names.items()}, made)
        except BaseException:
            for path in reversed(made):
                with suppress(OSError):
                    path.rmdir()
            raise


def shown_path(path: PathLike) -> str:
    """A path as a message of one line may name it."""
    text = os.fspath(path)
    return text if text.isprintable() else repr(text)


# --- several files --------------------------------------------------------------------------


def _checked_names(files: Mapping[str, bytes]) -> dict[PurePath, str]:
    """Names as relative paths, in the order given."""
    names: dict[PurePath, str] = {}
    for text in files:
        name = PurePath(text)
        if name.is_absolute() or not name.parts or ".." in name.parts or name in names:
            raise FormatError(
                f"Names of files must differ and stay inside their folder; found {text!r}. Use "
                f"relative names without '..'."
            )
        names[name] = text
    for name in names:
        above = [parent for parent in name.parents if parent in names]
        if above:
            raise FormatError(
                f"A name must be a file or a folder, not both; found {str(above[0])!r} and "
                f"{str(name)!r}. Rename one."
            )
    return names


def _stage_and_move(root: Path, files: Mapping[PurePath, bytes], made: list[Path]) -> None:
    """Write all files into a hidden folder of root, then move them; undo on any exception."""
    hidden = root / _hidden_name()
    staged, earlier = hidden / "new", hidden / "old"
    try:
        for name, data in files.items():
            for base in (staged, earlier):
                (base / name).parent.mkdir(parents=True, exist_ok=True)
            _write_new(staged / name, data)
            _keep_permissions(root / name, staged / name)
        try:
            for name in files:
                _make_folders((root / name).parent, made)
                if os.path.lexists(root / name):
                    (root / name).replace(earlier / name)
                (staged / name).replace(root / name)
        except BaseException:
            # What stands where tells what was done, so an interrupt may come at any point.
            for name in files:
                if os.path.lexists(earlier / name):
                    (earlier / name).replace(root / name)
                elif not os.path.lexists(staged / name):
                    (root / name).unlink()
            raise
    finally:
        shutil.rmtree(hidden, ignore_errors=True)


def _make_folders(folder: Path, made: list[Path]) -> None:
    """Create a folder and those above it; remember which."""
    missing = [path for path in (folder, *folder.parents) if not path.exists()]
    for path in reversed(missing):
        path.mkdir(exist_ok=True)
        made.append(path)
    if not folder.is_dir():
        raise NotADirectoryError(errno.ENOTDIR, f"{folder.name} is not a folder")


# --- one file -------------------------------------------------------------------------------


def _hidden_name() -> str:
    """A name beside the target that nothing else has."""
    return f".pqmesh-{secrets.token_hex(6)}"


def _write_new(path: Path, data: bytes) -> None:
    """Write a file that must not exist yet."""
    # Mode "x" gives the permissions of the umask; the tempfile module would give 0600.
    with path.open("xb") as file:
        file.write(data)


def _keep_permissions(earlier: Path, new: Path) -> None:
    """Give the new file the permissions of the one that it replaces."""
    if earlier.exists():
        shutil.copymode(earlier, new)


def _check_target(path: Path, shown: str) -> None:
    """Refuse to replace what is not a file, or is write-protected."""
    if not path.exists():
        return
    if not path.is_file():
        raise FormatError(
            f"{shown}: a result must go to a file; found a folder or a device there. Choose "
            f"another name."
        )
    # Moving into place would go round the protection of the file.
    if not os.access(path, os.W_OK):
        raise FormatError(
            f"{shown}: the file must be writable; found it write-protected. Allow writing, or "
            f"choose another name."
        )


@contextmanager
def _named_errors(path: PathLike) -> Iterator[None]:
    """Failures of the system as a FormatError that names the path and what to do."""
    try:
        yield
    except FormatError:
        raise
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise FormatError(
            f"{shown_path(path)}: the result must be written here; found: {reason}. Nothing was "
            f"changed. Check that the folder exists and is writable and that the disk has space, "
            f"or choose another place."
        ) from error
