"""The command run in this process, in a folder of its own, and what must hold of every failure."""

import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

import pytest

from pqmesh import cli

# Nothing may take longer, in seconds of this process; the machine may be busy with others.
LONGEST = 25


class Run(NamedTuple):
    """What one run of the command left."""

    code: int
    out: str
    err: str

    @property
    def line(self) -> str:
        """The one line of a failure; lines that tell of progress do not count."""
        lines = [text for text in self.err.splitlines() if not text.endswith(" ...")]
        assert len(lines) == 1, self.err
        return lines[0]


Command = Callable[..., Run]


def _too_long(number: int, frame: object) -> None:
    raise AssertionError(f"more than {LONGEST} seconds")


@contextmanager
def _bounded() -> Iterator[None]:
    """Turns a hang into a failure, where the system can count a process's own time."""
    if not hasattr(signal, "SIGVTALRM"):
        yield
        return
    earlier = signal.signal(signal.SIGVTALRM, _too_long)
    signal.setitimer(signal.ITIMER_VIRTUAL, LONGEST)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_VIRTUAL, 0)
        signal.signal(signal.SIGVTALRM, earlier)


@pytest.fixture
def pqmesh(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> Command:
    """Runs the command; capture is by file descriptor, so that libraries in C are heard too."""
    monkeypatch.chdir(tmp_path)
    terminate = signal.getsignal(signal.SIGTERM)

    def run(*arguments: object) -> Run:
        monkeypatch.setattr("sys.argv", ["pqmesh", *map(str, arguments)])
        capfd.readouterr()
        try:
            with pytest.raises(SystemExit) as ended, _bounded():
                cli.main()
        finally:
            # The command turns it into an interrupt; the tests keep their own.
            signal.signal(signal.SIGTERM, terminate)
        code = ended.value.code
        assert isinstance(code, int)
        return Run(code, *capfd.readouterr())

    return run


def tree(folder: Path) -> dict[str, bytes | None]:
    """Every path below a folder with its content, hidden ones too."""
    return {
        str(path.relative_to(folder)): path.read_bytes() if path.is_file() else None
        for path in sorted(folder.rglob("*"))
    }


@pytest.fixture
def refused(pqmesh: Command, tmp_path: Path) -> Callable[..., str]:
    """Runs what must fail: code 2, one line that names and advises, not a byte changed on disk."""

    def run(*arguments: object) -> str:
        before = tree(tmp_path)
        result = pqmesh(*arguments)
        assert result.code == 2, result
        assert result.out == ""
        assert tree(tmp_path) == before
        line = result.line
        assert line.startswith("pqmesh: ")
        assert line.isprintable()
        assert len(line) < 600
        # What to do is a sentence of its own, unless the form that is wanted says it.
        advice = any(mark in line for mark in (". ", "? ", "range [low, high]"))
        assert advice, line
        return line

    return run
