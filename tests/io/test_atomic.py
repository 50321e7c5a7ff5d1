"""Files that appear whole or not at all."""

import errno
import os
import stat
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from pqmesh.errors import FormatError
from pqmesh.io import atomic, formats
from pqmesh.io.atomic import write_all, write_bytes
from pqmesh.mesh.quadmesh import PolyMesh

FULL = OSError(errno.ENOSPC, "No space left on device")


def tree(folder: Path) -> dict[str, bytes | None]:
    """Everything in a folder, hidden things included."""
    found = sorted(folder.rglob("*")) if folder.exists() else []
    return {str(p.relative_to(folder)): p.read_bytes() if p.is_file() else None for p in found}


def failing(
    original: Callable[..., object], at: int, error: BaseException
) -> Callable[..., object]:
    """The function, but its call number `at` raises; later calls work."""
    calls = iter(range(10**6))

    def call(*args: object, **kwargs: object) -> object:
        if next(calls) == at:
            raise error
        return original(*args, **kwargs)

    return call


@pytest.fixture
def umask_027() -> Iterator[None]:
    earlier = os.umask(0o027)
    yield
    os.umask(earlier)


# --- one file -------------------------------------------------------------------------------


def test_write_bytes_writes_and_replaces(tmp_path: Path) -> None:
    write_bytes(tmp_path / "a", b"one")
    write_bytes(str(tmp_path / "a"), b"two")
    assert tree(tmp_path) == {"a": b"two"}


@pytest.mark.parametrize("error", [FULL, KeyboardInterrupt(), MemoryError()])
@pytest.mark.parametrize("step", ["_write_new", "_keep_permissions", "replace"])
@pytest.mark.parametrize("earlier", [None, b"one"])
def test_write_bytes_interrupted_leaves_old_file(
    error: BaseException,
    step: str,
    earlier: bytes | None,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    if earlier:
        (tmp_path / "a").write_bytes(earlier)
    before = tree(tmp_path)
    owner = Path if step == "replace" else atomic
    monkeypatch.setattr(owner, step, failing(getattr(owner, step), 0, error))
    with pytest.raises(FormatError if error is FULL else type(error)):
        write_bytes(tmp_path / "a", b"two")
    assert tree(tmp_path) == before


def test_half_written_data_are_removed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def half(path: Path, data: bytes) -> None:
        path.write_bytes(data[:1])
        raise FULL

    (tmp_path / "a").write_bytes(b"one")
    monkeypatch.setattr(atomic, "_write_new", half)
    with pytest.raises(
        FormatError, match=r"found: No space left on device\. Nothing was changed\."
    ):
        write_bytes(tmp_path / "a", b"two")
    assert tree(tmp_path) == {"a": b"one"}


def test_write_mesh_interrupted_leaves_old_mesh(
    mixed: PolyMesh, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    formats.write_mesh(mixed, tmp_path / "a.obj")
    before = tree(tmp_path)
    monkeypatch.setattr(Path, "replace", failing(Path.replace, 0, KeyboardInterrupt()))
    with pytest.raises(KeyboardInterrupt):
        formats.write_mesh(mixed.reversed(), tmp_path / "a.obj")
    assert tree(tmp_path) == before


def test_write_bytes_refuses_missing_folder_and_folder(tmp_path: Path) -> None:
    with pytest.raises(FormatError, match="the result must be written here; found: No such file"):
        write_bytes(tmp_path / "none" / "a", b"")
    (tmp_path / "b").mkdir()
    with pytest.raises(FormatError, match="must go to a file; found a folder"):
        write_bytes(tmp_path / "b", b"")
    assert tree(tmp_path) == {"b": None}


def test_write_protected_file_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "a").write_bytes(b"one")
    # Asked through os.access, since the super-user may write anything.
    monkeypatch.setattr(os, "access", lambda path, mode: False)
    with pytest.raises(FormatError, match="the file must be writable; found it write-protected"):
        write_bytes(tmp_path / "a", b"two")
    with pytest.raises(FormatError, match="the file must be writable; found it write-protected"):
        write_all(tmp_path, {"b": b"", "a": b"two"})
    assert tree(tmp_path) == {"a": b"one"}


@pytest.mark.skipif(os.name != "posix", reason="permissions of POSIX")
def test_new_files_follow_umask_and_replaced_ones_keep_theirs(
    umask_027: None, tmp_path: Path
) -> None:
    def mode(name: str) -> int:
        return stat.S_IMODE((tmp_path / name).stat().st_mode)

    (tmp_path / "old").write_bytes(b"")
    (tmp_path / "old").chmod(0o604)
    write_bytes(tmp_path / "new", b"")
    write_bytes(tmp_path / "old", b"")
    write_all(tmp_path, {"x/new": b"", "old": b"1"})
    assert (mode("new"), mode("old"), mode("x/new"), mode("x")) == (0o640, 0o604, 0o640, 0o750)


@pytest.mark.skipif(os.name != "posix", reason="links of POSIX")
def test_write_bytes_follows_link(tmp_path: Path) -> None:
    (tmp_path / "there").mkdir()
    (tmp_path / "there" / "a").write_bytes(b"one")
    (tmp_path / "link").symlink_to(tmp_path / "there" / "a")
    write_bytes(tmp_path / "link", b"two")
    assert (tmp_path / "link").is_symlink()
    assert (tmp_path / "there" / "a").read_bytes() == b"two"


# --- several files --------------------------------------------------------------------------

RESULT = {"mesh.obj": b"new mesh", "figures/plan.png": b"new plan", "figures/a/b.png": b"new b"}


def test_write_all_makes_folders_and_keeps_other_files(tmp_path: Path) -> None:
    folder = tmp_path / "deep" / "out"
    write_all(folder, RESULT)
    (folder / "notes.txt").write_bytes(b"mine")
    write_all(folder, {**RESULT, "mesh.obj": b"newer"})
    assert {k: v for k, v in tree(folder).items() if v is not None} == {
        **{os.path.join(*name.split("/")): data for name, data in RESULT.items()},
        "mesh.obj": b"newer",
        "notes.txt": b"mine",
    }


@pytest.mark.parametrize("error", [FULL, KeyboardInterrupt()])
@pytest.mark.parametrize("step", ["mkdir", "replace", "_write_new", "_keep_permissions"])
@pytest.mark.parametrize("at", range(8))
@pytest.mark.parametrize("fresh", [True, False])
def test_write_all_interrupted_at_any_step_changes_nothing(
    error: BaseException,
    step: str,
    at: int,
    fresh: bool,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    folder = tmp_path / "deep" / "out"
    if not fresh:
        (folder / "figures").mkdir(parents=True)
        (folder / "mesh.obj").write_bytes(b"old mesh")
        (folder / "figures" / "plan.png").write_bytes(b"old plan")
        (folder / "notes.txt").write_bytes(b"mine")
    before = tree(tmp_path)
    owner = Path if step in ("mkdir", "replace") else atomic
    monkeypatch.setattr(owner, step, failing(getattr(owner, step), at, error))
    try:
        write_all(folder, RESULT)
    except (FormatError, KeyboardInterrupt):
        assert tree(tmp_path) == before
    else:
        # The step is called less often than `at`.
        assert tree(folder)["mesh.obj"] == b"new mesh"


def test_write_all_refuses_when_a_folder_is_in_the_way(tmp_path: Path) -> None:
    (tmp_path / "mesh.obj").mkdir()
    before = tree(tmp_path)
    with pytest.raises(FormatError, match=r"mesh\.obj: a result must go to a file; found a folder"):
        write_all(tmp_path, RESULT)
    assert tree(tmp_path) == before


def test_write_all_refuses_when_a_file_is_in_the_way(tmp_path: Path) -> None:
    (tmp_path / "figures").write_bytes(b"mine")
    with pytest.raises(FormatError, match="must be written here; found: figures is not a folder"):
        write_all(tmp_path, RESULT)
    with pytest.raises(FormatError, match="must be written here; found: figures is not a folder"):
        write_all(tmp_path / "figures", RESULT)
    assert tree(tmp_path) == {"figures": b"mine"}


@pytest.mark.parametrize("name", ["../a", "a/../../b", "", ".", "/a"])
def test_write_all_refuses_names_outside(name: str, tmp_path: Path) -> None:
    with pytest.raises(FormatError, match="must differ and stay inside their folder"):
        write_all(tmp_path / "out", {"ok": b"", name: b""})
    assert tree(tmp_path) == {}


@pytest.mark.parametrize("names", [("a", "./a"), ("a", "a/b")])
def test_write_all_refuses_names_that_clash(names: tuple[str, str], tmp_path: Path) -> None:
    with pytest.raises(FormatError, match=r"must differ|a file or a folder, not both"):
        write_all(tmp_path / "out", dict.fromkeys(names, b""))
    assert tree(tmp_path) == {}


def test_same_result_gives_same_tree(tmp_path: Path) -> None:
    write_all(tmp_path / "a", RESULT)
    write_all(tmp_path / "b", RESULT)
    assert tree(tmp_path / "a") == tree(tmp_path / "b")
