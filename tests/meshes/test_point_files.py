# SPDX-License-Identifier: LGPL-3.0-or-later
import codecs

import numpy as np
import pytest

from meshes.profiles.measured import read
from meshes.profiles.orientation import Axes
from meshes.profiles.point_files import read_points
from meshes.profiles.profiles import rail_54e1, s1002

HEAD = rail_54e1()
POINTS = HEAD.at(np.linspace(0, HEAD.length, 120)).round(7)  # of 54E1, to 0.1 µm


def table(separator=";", comma=False, scale=1e3, digits=4, header="", end="\n"):
    """Return the points as a table, by default in mm."""
    lines = [separator.join(f"{x:.{digits}f}" for x in row) for row in POINTS * scale]
    text = end.join([*([header] if header else []), *lines]) + end
    return text.replace(".", ",") if comma else text


def numbered(header):
    lines = [f"{k};{y:.4f};{z:.4f}" for k, (y, z) in enumerate(POINTS * 1e3, 1)]
    return "\n".join([*([header] if header else []), *lines])


TABLES = {
    "decimal commas between semicolons": table(comma=True),
    "decimal commas between tabs": table("\t", comma=True),
    "decimal commas between blanks": table("  ", comma=True),
    "decimal commas in quotes": "\n".join(
        f'"{y:.4f}","{z:.4f}"'.replace(".", ",").replace('","', '"§"').replace("§", ",")
        for y, z in POINTS * 1e3
    ),
    "commas": table(","),
    "commas and blanks": table(", "),
    "a separator at the end": table(";", end=";\n"),
    "byte order mark, no header": codecs.BOM_UTF8 + table().encode(),
    "utf-16": table("\t").encode("utf-16"),
    "utf-16 without a mark": table().encode("utf-16-le"),
    "utf-16, big end first, without a mark": table().encode("utf-16-be"),
    "utf-32": table().encode("utf-32"),
    "latin-1 in the header": table(header="Temperatur=21 °C, Müller").encode("latin-1"),
    "old line ends": table(end="\r"),
    "Windows line ends": table(end="\r\n"),
    "comments": "# 54E1\n! new\n" + table(end="  % a remark\n") + "\n// end\n",
    "a header of numpy": table(" ", header="# y z"),
    "exponents of Fortran": table(" ", digits=7).replace("\n", "D0\n"),
    "minus signs of typesetters": table().replace("-", "\N{MINUS SIGN}"),
    "point numbers in front, named": numbered("n;y;z"),
    "point numbers in front, not named": numbered(""),
    "a third column of zeros": table(" ", end=" 0.0\n"),
    "metres by the header": table(",", scale=1, digits=7, header="y [m], z [m]"),
    "millimetres by the names": table(",", header="y_mm,z_mm"),
    "inches by the header": table(" ", scale=1 / 0.0254, digits=9, header="y (in)  z (in)"),
    "centimetres by the header": table(" ", scale=100, digits=6, header="units: cm"),
}


@pytest.mark.parametrize("way", TABLES)
def test_a_table_is_read_whole(tmp_path, way):
    """54E1 in 120 points, however written: the same 120 points within the digits of the file."""
    text = TABLES[way]
    path = tmp_path / "rail.csv"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    found = read(path, "rail")
    assert found.points.shape == POINTS.shape
    assert found.points == pytest.approx(POINTS, abs=1.1e-7)


def test_columns_go_by_their_names(tmp_path):
    """z before y, with a radius between: y is lateral, z the height, the radius is left out."""
    path = tmp_path / "rail.csv"
    rows = "\n".join(f"{z:.4f},{y**2:.4f},{y:.4f}" for y, z in POINTS * 1e3)
    path.write_text(f"z,r,y\n{rows}\n")
    found = read(path, "rail")
    assert found.points == pytest.approx(POINTS, abs=1e-7)
    assert "columns y and z of 3" in found.in_words()


def test_heights_at_whole_millimetres_keep_their_decimals(tmp_path):
    """Lateral in whole mm, heights with decimal commas: heights to 0.5 µm, not cut to whole mm."""
    y = np.arange(-30, 31)
    z = np.interp(y * 1e-3, *HEAD.points.T)
    path = tmp_path / "rail.csv"
    path.write_text(
        "".join(f"{a};{b * 1e3:.3f}\n".replace(".", ",") for a, b in zip(y, z, strict=True))
    )
    assert read(path, "rail").points[:, 1] == pytest.approx(z, abs=5.1e-7)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (b"", "got 0"),
        (b"\x7fELF\x00\x01\x02\x00\x00\x03" * 40, "binary data"),
        (b"\x89PNG\r\n\x1a\n" * 9, "binary data|got 0"),
        (table().encode("utf-16")[:-1], "breaks off"),
        (table().encode() + b"10;nan\n", "finite"),
        (table().encode() + b"see page 3\n", r"line 121: expected two numbers, got 'see page 3'"),
        (table().encode() + b"36;-35;1\n", r"line 121: expected 2 numbers as in the lines before"),
        (table(",", comma=True).encode(), r"two columns, got 4; .*semicolons"),
        (
            table(header="y [m];z [m]").encode(),
            r"to 0\.4 m, got 72 m, taken in m; it would fit in mm",
        ),
        (b"0;0\n" * 60000, "at most 50000 lines, got 60000; keep every 12th point"),
        (b"1e300;0\n-1e300;0\n5;5\n6;6\n", "expected finite points, less than"),
        (b"5;5\n" * 9, "width"),
        (b"-30;0\n0;0\n30;-3\n0;1\n-30;0.5\n", "ends meet"),
    ],
)
def test_what_is_no_profile_is_refused(tmp_path, text, message):
    """One sentence that says what was got and what is expected."""
    path = tmp_path / "bad.csv"
    path.write_bytes(text)
    with pytest.raises(ValueError, match=f"(?s)bad.csv: .*({message})"):
        read(path)


MINIPROF = """ProgramName=MiniProf for Windows
Date=08/07/2015
Side=%L
Xoffset={0}
RefPoint2=10.0000, 0.0000
ColumnDef={1}
XYPoints=200
WheelDiameterTaperline=70.0000

{2}
"""
WHEEL = s1002()
TREAD = WHEEL.at(np.linspace(0, WHEEL.length, 200))


@pytest.mark.parametrize(
    ("offset", "columns", "rows"),
    [
        ("0.0000", "X,Y", lambda y, z: f" {y:.4f}  {z:.4f} "),
        ("-1.5", "X,Y,A,C", lambda y, z: f"{y + 1.5:.4f},{z:.4f},0.1,0"),
        ("", "A,Y,X", lambda y, z: f"0.3 {z:.4f} {y:.4f}"),
        ("0", "X,Y", lambda y, z: f'{y:.4f} {z:.4f} read again\n" {y:.2f} {z:.2f}'),
    ],
)
def test_miniprof_wheel(tmp_path, offset, columns, rows):
    """S1002 as MiniProf has it, lateral from the flange back: it comes back at the tape circle.

    An offset is added, columns go by ColumnDef, what follows a quotation mark is a comment.
    """
    body = "\n".join(rows(y, z) for y, z in TREAD * 1e3 + [70.0, 0.0])
    path = tmp_path / "wheel.whl"
    path.write_text(MINIPROF.format(offset, columns, body))
    found = read(path)
    assert (found.kind, found.oriented.origin) == ("wheel", "flange-back")
    assert found.points == pytest.approx(TREAD, abs=1e-7)
    assert "taper line at 70.0000" in found.in_words()


def test_miniprof_of_the_old_kind(tmp_path):
    """Free lines, one of them of numbers, above an empty line: only what follows are points."""
    rows = "\n".join(f"{y:.4f} {z:.4f} 0.000" for y, z in TREAD * 1e3)
    path = tmp_path / "wheel.whl"
    path.write_text(f"MINIPROF 101 148 1994 3 24\nStock.......:\n32.58 37.11 14.71\n\n{rows}\n")
    assert read(path).points == pytest.approx(TREAD, abs=1e-7)


def test_miniprof_of_several_profiles(tmp_path):
    """Two profiles in a .mpt file: which one is asked for, and the asked one is read."""
    part = "[Profile{0}Info]\nColumnDef=X,Y\n\n[Profile{0}Points]\n{1}\n\n"
    rows = ["\n".join(f"{y:.4f} {z:.4f}" for y, z in p * 1e3) for p in (POINTS[:80], POINTS)]
    path = tmp_path / "rail.mpt"
    path.write_text("[FileInfo]\nDate=1\n\n" + "".join(map(part.format, (1, 2), rows)))
    assert read(path, "rail", Axes(part=2)).points == pytest.approx(POINTS, abs=1e-7)
    with pytest.raises(ValueError, match=r"holds 2 profiles, of 80, 120 points; expected part"):
        read_points(path)
    with pytest.raises(ValueError, match="part = 3: expected 1 to 2"):
        read_points(path, 3)


SIMPACK = """! *** SIMPACK ***
header.begin
  version = 1     ! flag
  type    = {type}
header.end
spline.begin
  approx.smooth = 0.0
  comment       = 'S = 1; ! of a rail'
  {options}
  point.begin
    ! y z weight
{rows}
  point.end
spline.end
"""


@pytest.mark.parametrize(
    ("options", "undo"),
    [
        ("units.len.f = 1000.", lambda p: p * [1e3, -1e3]),
        ("mirror.y = 1\n inversion = 1", lambda p: (p * [-1, -1])[::-1]),
        ("mirror.z = 1", lambda p: p),
        ("shift.y = 5.0\n shift.z = -2\n units.len.f = 1e3", lambda p: p * [1e3, -1e3] - [5, -2]),
        ("rotate = 90\n units.ang.f = 57.29577951308232", lambda p: p[:, ::-1] * [-1, -1]),
        ("point.dist.min = 1e-5", lambda p: np.repeat(p, 2, axis=0) * [1, -1]),
        (
            "bound.y.min = -100\n bound.y.max = 0.2",
            lambda p: np.vstack([p * [1, -1], [[0.3, 0.1], [0.31, 0.2]]]),
        ),
    ],
)
def test_simpack_rail(tmp_path, options, undo):
    """54E1, heights counted down, written as the options of the file undo it: it comes back.

    Turned by 90 degrees (y, z) becomes (-z, y); so a point (a, b) is written as (b, -a), and the
    file of a rail whose heights count down has b = -z: (-z, -y).
    """
    rows = "\n".join(f"{y:.9E} {z:.9E} 1.0" for y, z in undo(POINTS))
    path = tmp_path / "rail.prr"
    path.write_text(SIMPACK.format(type=0, options=options, rows=rows))
    found = read(path)
    assert found.kind == "rail" and found.file.format == "SIMPACK"
    assert found.points == pytest.approx(POINTS, abs=1e-9)


def test_the_kind_of_a_file_must_fit(tmp_path):
    """A SIMPACK file that says wheel is no rail, whatever its name."""
    rows = "\n".join(f"{y:.9E} {z:.9E}" for y, z in TREAD)
    path = tmp_path / "wheel.prr"
    path.write_text(SIMPACK.format(type=1, options="", rows=rows))
    assert read(path).kind == "wheel"
    with pytest.raises(
        ValueError, match="expected a rail, got a file that is said to hold a wheel"
    ):
        read(path, "rail")
