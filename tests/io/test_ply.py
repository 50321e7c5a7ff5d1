"""PLY."""

import struct

import pytest

from pqmesh.errors import FormatError
from pqmesh.io.ply import ply_from_mesh, polygons_from_ply
from pqmesh.mesh.quadmesh import PolyMesh

POINTS = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0], [2.0, 0.5, 0.0]]
MIXED = [[0, 1, 2, 3], [1, 4, 2]]
UNIFORM = [[0, 1, 2], [0, 2, 3], [1, 4, 2]]
CODES = {"uchar": "B", "char": "b", "ushort": "H", "short": "h", "uint": "I", "int": "i"}
CODES |= {"uint8": "B", "int16": "h", "uint32": "I", "int32": "i"}
AXES = "property float x\nproperty float y\nproperty float z\n"


def ascii_ply(
    body: str, vertices: str = "vertex 5", faces: str = "face 2", axes: str = AXES
) -> bytes:
    head = f"ply\nformat ascii 1.0\ncomment Süd\nelement {vertices}\n{axes}element {faces}\n"
    return (head + "property list uchar int vertex_indices\nend_header\n" + body).encode("latin-1")


def binary_ply(
    faces: list[list[int]], order: str, real: str, count: str, index: str, end: str = "\n"
) -> bytes:
    """A file with everything around: normals, colours, an element before and one after."""
    mark = "<" if order == "little" else ">"
    lines = ["ply", f"format binary_{order}_endian 1.0", "obj_info none", "element camera 1"]
    lines += ["property list ushort double path", f"element vertex {len(POINTS)}"]
    lines += [f"property {real} {n}" for n in ("nx", "x", "y")] + ["property uchar red"]
    lines += [f"property {real} z", f"element face {len(faces)}", "property short group"]
    lines += [f"property list {count} {index} vertex_index", "property list uchar float texcoord"]
    lines += [
        "element edge 2",
        "property int a",
        "property int b",
        "element nothing 99",
        "end_header",
    ]
    body = struct.pack(f"{mark}Hdd", 2, 1.5, 2.5)
    code = "f" if real in ("float", "float32") else "d"
    for x, y, z in POINTS:
        body += struct.pack(f"{mark}3{code}B{code}", 9.0, x, y, 7, z)
    for face in faces:
        body += struct.pack(f"{mark}h{CODES[count]}{len(face)}{CODES[index]}", -1, len(face), *face)
        body += struct.pack(f"{mark}B2f", 2, 0.5, 0.5)
    body += struct.pack(f"{mark}4i", 0, 1, 1, 2)
    return end.join(lines).encode() + end.encode() + body


@pytest.mark.parametrize("faces", [MIXED, UNIFORM])
@pytest.mark.parametrize("order", ["little", "big"])
@pytest.mark.parametrize("real", ["float", "double", "float32", "float64"])
@pytest.mark.parametrize(
    ("count", "index"),
    [
        *(("uchar", "int"), ("uint8", "int32"), ("char", "uint"), ("int", "ushort")),
        *(("uint", "uchar"), ("ushort", "short"), ("short", "char")),
        *(("uint32", "int16"), ("int32", "uint32")),
    ],
)
def test_binary_of_every_type_is_read(
    faces: list[list[int]], order: str, real: str, count: str, index: str
) -> None:
    polygons = polygons_from_ply(binary_ply(faces, order, real, count, index))
    assert polygons.vertices.tolist() == POINTS
    assert polygons.face_lists() == faces


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
def test_header_line_end_decides_where_binary_begins(end: str) -> None:
    # The body begins with bytes that look like line ends.
    head = ["ply", "format binary_little_endian 1.0", "element first 1", "property uchar a"]
    head += ["element vertex 3", *AXES.split("\n")[:3], "element face 1"]
    head += ["property list uchar uchar vertex_indices", "end_header"]
    body = b"\n" + struct.pack("<9f", 0, 0, 0, 1, 0, 0, 0, 1, 0) + bytes([3, 0, 1, 2])
    data = "".join(line + end for line in head).encode() + body
    assert polygons_from_ply(data).face_lists() == [[0, 1, 2]]


@pytest.mark.parametrize("order", ["little", "big"])
def test_binary_cut_anywhere_is_refused(order: str) -> None:
    data = binary_ply(MIXED, order, "float", "uchar", "int")
    for length in range(len(data)):
        with pytest.raises(FormatError):
            polygons_from_ply(data[:length])
    with pytest.raises(FormatError, match="found 1 more bytes"):
        polygons_from_ply(data + b"\n")


def test_ascii_with_other_properties_is_read() -> None:
    axes = "property float nx\n" + AXES + "property uchar red\n"
    body = "".join(f"nan {x} {y} {z} 255\n" for x, y, z in POINTS) + "4 0 1 2 3\n3 1 4 2\n"
    polygons = polygons_from_ply(ascii_ply(body, axes=axes))
    assert polygons.vertices.tolist() == POINTS
    assert polygons.face_lists() == MIXED


def test_ascii_lists_before_and_after_are_read_over() -> None:
    axes = "property list uchar float path\n" + AXES
    body = "".join(f"2 8 9 {x} {y} {z}\n" for x, y, z in POINTS) + "4 0 1 2 3\n3 1 4 2\n"
    polygons = polygons_from_ply(ascii_ply(body, axes=axes))
    assert polygons.vertices.tolist() == POINTS


FIVE = "0 0 0\n1 0 0\n1 1 0\n0 1 0\n2 0.5 0\n"


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"OFF\n", r"Line 1: the file must begin with the line 'ply'; found 'OFF\\+n'"),
        (b"plyx\n", "Line 1: the file must begin with the line 'ply'"),
        (b"ply\nformat ascii 1.0\n", "header must end with the line 'end_header'; there is none"),
        (
            b"ply\nend_header\n",
            "must have a line 'format', with one of ascii, binary_little_endian",
        ),
        (
            b"ply\nformat text 1.0\nend_header\n",
            "Line 2: a header line must be .* found 'format text 1.0'",
        ),
        (b"ply\nproperty int a\nend_header\n", "Line 2: a header line must be"),
        (b"ply\nelement vertex -5\nend_header\n", "Line 2: .* found 'element vertex -5'"),
        (b"ply\nelement vertex x\nend_header\n", "Line 2: .* found 'element vertex x'"),
        (b"ply\nelement vertex 1\nproperty half x\nend_header\n", "Line 3: .* 'property half x'"),
        (
            b"ply\nelement f 1\nproperty list float int a\nend_header\n",
            "Line 3: .* 'property list float",
        ),
        (
            b"ply\nformat ascii 1.0\nend_header\n",
            "must have vertices with x, y and z; found 0 with no",
        ),
        (
            ascii_ply("", axes="property float x\n"),
            "must have vertices with x, y and z; found 5 with 'x'",
        ),
        (
            ascii_ply("", axes=AXES + "property int x\n"),
            "Names in the header must differ; 'x' stands twice",
        ),
        (ascii_ply("", faces="tristrips 2"), "must have faces with one list .* found 0 faces"),
        (ascii_ply("", faces="face 0"), "must have faces with one list .* found 0 faces"),
        (
            ascii_ply("").replace(b"int vertex_indices", b"float vertex_indices"),
            "found 2 faces with 0 such",
        ),
        (
            ascii_ply("0 0 0\n1 1"),
            "must hold 5 records of element 'vertex' by its header; .* after 1",
        ),
        (ascii_ply(FIVE + "4 0 1 2 3\n"), "must hold 2 records of element 'face' .* after 1"),
        (ascii_ply(FIVE + "4 0 1 2 3\n3 1 4"), "must hold 2 records of element 'face' .* after 1"),
        (ascii_ply(FIVE + "4 0 1 2 3\n3 1 4 2 9\n"), "Nothing may follow .* found 1 more words"),
        (ascii_ply(FIVE + "4 0 1 2 3\n-3 1 4 2\n"), "Line 17: the length of a list .* found '-3'"),
        (ascii_ply(FIVE + "4 0 1 2 3\n3 1 4 x\n"), "Line 17: .* whole number; found 'x'"),
        (ascii_ply(FIVE + "4 0 1 2 3\n3 1 4 2.0\n"), "Line 17: .* whole number; found '2.0'"),
        (ascii_ply("0 0 0\n0 x 0\n" + FIVE), "Line 12: .* finite number; found 'x'"),
        (
            ascii_ply(FIVE, vertices="vertex 1000000000000000000"),
            "hold 1000000000000000000 records",
        ),
        (
            ascii_ply(FIVE + "3 0 1 2\n", faces="face 1000000000000000000"),
            "hold 1000000000000000000 rec",
        ),
        (ascii_ply("", vertices="vertex " + "9" * 5000), "Line 4: a header line must be"),
    ],
)
def test_refusal_says_what_is_wrong(data: bytes, message: str) -> None:
    with pytest.raises(FormatError, match=message):
        polygons_from_ply(data)


@pytest.mark.parametrize("element", ["vertex 4000000000", "vertex 1000000000000000000"])
def test_promise_of_absurd_size_takes_no_memory(element: str) -> None:
    data = binary_ply(MIXED, "little", "double", "uint", "int")
    with pytest.raises(FormatError, match="element 'vertex' by its header"):
        polygons_from_ply(data.replace(b"vertex 5", element.encode()))


@pytest.mark.parametrize(("kind", "size"), [("uint", 2**32 - 1), ("int", -1)])
def test_absurd_list_length_takes_no_memory(kind: str, size: int) -> None:
    head = f"ply\nformat binary_little_endian 1.0\nelement vertex 1\n{AXES}element face 1\n"
    head += f"property list {kind} int vertex_indices\nend_header\n"
    body = struct.pack("<3f" + CODES[kind], 0, 0, 0, size)
    with pytest.raises(FormatError, match="a list length makes no sense, after 0"):
        polygons_from_ply(head.encode() + body)


def test_corners_outside_are_left_to_the_mesh() -> None:
    assert polygons_from_ply(ascii_ply(FIVE + "4 0 1 2 3\n3 1 4 -2\n")).face_lists()[1] == [
        1,
        4,
        -2,
    ]


def test_count_type_holds_the_largest_polygon(mesh: PolyMesh) -> None:
    count_type = "int" if mesh.topology.face_sizes.max() > 255 else "uchar"
    assert f"property list {count_type} int vertex_indices\n".encode() in ply_from_mesh(mesh)
