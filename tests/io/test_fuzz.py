"""Whatever a file holds, reading gives a mesh or a PqmeshError, and soon."""

from datetime import timedelta
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from pqmesh.errors import PqmeshError
from pqmesh.io.formats import MESH_FORMATS, read_mesh
from pqmesh.mesh.quadmesh import PolyMesh

MESH = PolyMesh.of(
    [[0, 0, 0], [1, 0, 0], [1, 1, 0.5], [0, 1, 0], [0.5, 2, 0], [2, 0, 0], [3, 1, 1], [2, 2, 0]],
    [[0, 1, 2, 3], [3, 2, 4], [1, 5, 6, 7, 2]],
)
VALID = {suffix: form.bytes_from_mesh(MESH) for suffix, form in MESH_FORMATS.items()}
BINARY = (
    b"ply\nformat binary_little_endian 1.0\nelement vertex 4\nproperty float x\nproperty float y\n"
    b"property float z\nelement face 2\nproperty list uchar uint vertex_indices\nend_header\n"
    + bytes(12)
    + b"\0\0\x80\x3f" * 2
    + bytes(4)
    + b"\0\0\x80\x3f" * 3
    + bytes(8)
    + b"\0\0\x80\x3f"
    + b"\3\0\0\0\0\1\0\0\0\2\0\0\0"
    + b"\3\0\0\0\0\2\0\0\0\3\0\0\0"
)
SEEDS = [*VALID.items(), (".ply", BINARY)]
NASTY = ["-1", "0", "4", "1e999", "nan", "1e300", "99999999999999999999", "9" * 5000, "abc", "#"]
NASTY += ["\\\n", "\n", "\r", "v", "f", "OFF", "list", "uchar", "double", "٣", "1_0", "\0", "1/2/3"]
NASTY += ["\ud7ff\u2028", "-9223372036854775808", "9223372036854775807", "4294967295", ""]

# Fixed examples, so that a failure is the same everywhere; the deadline is what "soon" means.
SETTINGS = settings(
    max_examples=150,
    derandomize=True,
    database=None,
    deadline=timedelta(seconds=5),
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)


def read_or_refuse(data: bytes, suffix: str, folder: Path) -> None:
    path = folder / f"fuzz{suffix}"
    path.write_bytes(data)
    text = ""
    try:
        read_mesh(path)
    except PqmeshError as error:
        text = str(error)
    assert "\n" not in text
    assert len(text) < len(str(path)) + 700
    assert path.read_bytes() == data


def test_seeds_are_valid(tmp_path: Path) -> None:
    for suffix, data in SEEDS:
        (tmp_path / f"a{suffix}").write_bytes(data)
        assert read_mesh(tmp_path / f"a{suffix}").topology.n_faces in (2, 3)


@SETTINGS
@given(data=st.binary(max_size=300), start=st.sampled_from([b"", b"OFF\n", b"ply\n", b"v 0 0 0\n"]))
def test_random_bytes_give_mesh_or_refusal(data: bytes, start: bytes, tmp_path: Path) -> None:
    for suffix in MESH_FORMATS:
        read_or_refuse(start + data, suffix, tmp_path)


@SETTINGS
@given(text=st.text(st.sampled_from("0123456789-+./ \n\r\\#vfeOFnan"), max_size=200))
def test_random_text_gives_mesh_or_refusal(text: str, tmp_path: Path) -> None:
    for suffix in MESH_FORMATS:
        read_or_refuse(text.encode(), suffix, tmp_path)


@pytest.mark.parametrize("seed", range(len(SEEDS)))
@SETTINGS
@given(data=st.data())
def test_mutated_bytes_give_mesh_or_refusal(seed: int, data: st.DataObject, tmp_path: Path) -> None:
    suffix, content = SEEDS[seed]
    for _ in range(data.draw(st.integers(1, 4))):
        start = data.draw(st.integers(0, len(content)))
        end = min(len(content), start + data.draw(st.integers(0, 12)))
        content = content[:start] + data.draw(st.binary(max_size=6)) + content[end:]
    read_or_refuse(content, suffix, tmp_path)


@pytest.mark.parametrize("seed", range(len(VALID)))
@SETTINGS
@given(data=st.data())
def test_mutated_words_give_mesh_or_refusal(seed: int, data: st.DataObject, tmp_path: Path) -> None:
    suffix, content = SEEDS[seed]
    lines = [line.split(" ") for line in content.decode().split("\n")]
    for _ in range(data.draw(st.integers(1, 3))):
        line = data.draw(st.sampled_from(lines))
        word = data.draw(st.integers(0, len(line) - 1))
        line[word] = data.draw(st.sampled_from(NASTY))
    read_or_refuse("\n".join(map(" ".join, lines)).encode(), suffix, tmp_path)


@pytest.mark.parametrize(("suffix", "content"), SEEDS)
def test_file_cut_anywhere_gives_mesh_or_refusal(
    suffix: str, content: bytes, tmp_path: Path
) -> None:
    for length in range(len(content)):
        read_or_refuse(content[:length], suffix, tmp_path)
