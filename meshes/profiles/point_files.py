# SPDX-License-Identifier: LGPL-3.0-or-later
"""Profile files: points as MiniProf, SIMPACK or a table of text has them, and what headers say.

MiniProf (.ban rails, .whl wheels, .mpt several profiles) and SIMPACK (.prr rails, .prw wheels) are
read as the user guide of CONTACT describes them (E. Vollebregt, CONTACT user guide, Vtech CMCC,
section on wheel and rail profiles, and the profile readers of its open source version).
"""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from meshes.arrays import Array

Kind = Literal["wheel", "rail"]

UNITS = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "inch": 0.0254}
LARGEST = 20_000_000  # bytes
MOST = 50_000  # lines
HUGE = 1e9  # no coordinate is that large in any unit
SAMPLE = 1000  # of the lines by which the separator is found
KINDS: dict[str, Kind] = {".ban": "rail", ".prr": "rail", ".whl": "wheel", ".prw": "wheel"}
MINIPROF = (".ban", ".whl", ".mpt")
SIMPACK = (".prr", ".prw")
BOMS = (  # the longer ones first: that of utf-16 begins that of utf-32
    (b"\xef\xbb\xbf", "utf-8-sig"),
    (b"\xff\xfe\x00\x00", "utf-32"),
    (b"\x00\x00\xfe\xff", "utf-32"),
    (b"\xff\xfe", "utf-16"),
    (b"\xfe\xff", "utf-16"),
)
NUMBER = re.compile(r"[+-]?(?:(?:\d+\.?\d*|\.\d+)(?:[ed][+-]?\d+)?|nan|inf(?:inity)?)", re.I)
REMARK = re.compile(r"[#%!\"*']|//")  # from here on a line is a comment
UNIT = r"(mm|cm|m|inch(?:es)?|in)"
BRACKETED = re.compile(rf"[\[(]\s*{UNIT}\s*[\])]", re.I)
NAMED = (BRACKETED, re.compile(rf"\bunits?\s*[:=]\s*['\"]?{UNIT}\b", re.I))
SUFFIX = re.compile(rf"_{UNIT}$", re.I)
COLUMNS = (("y", "z"), ("x", "y"), ("x", "z"), ("lateral", "outward"), ("lateral", "vertical"))
SEPARATORS = {";": "semicolons", " ": "blanks", ",": "commas"}


@dataclass(frozen=True)
class PointFile:
    """Points of a profile as a file has them.

    Attributes:
        points: Lateral and vertical coordinate, shape ``(n, 2)``, in ``unit``.
        format: What the file is, in words.
        encoding: How its characters are encoded.
        unit: Unit of the coordinates, one of ``UNITS``; empty where the file does not say.
        kind: What it holds; None where it does not say.
        outward: Sign of the vertical axis away from the material by convention, 0 if there is none.
        notes: What its header says that a reader should know.
    """

    points: Array
    format: str
    encoding: str
    unit: str = ""
    kind: Kind | None = None
    outward: int = 0
    notes: tuple[str, ...] = ()


def read_points(path: Path, part: int | None = None) -> PointFile:
    """Return the points of a profile file.

    Args:
        path: File to read; what it is is told by its ending and its contents.
        part: Which profile of a MiniProf file that holds several, from 1.

    Raises:
        FileNotFoundError: if there is no such file.
        ValueError: if it is no text, too large, or a line is not what its format has there.
    """
    if not path.is_file():
        raise FileNotFoundError("no such file")
    if path.stat().st_size > LARGEST:
        raise ValueError(f"expected a file of at most {LARGEST / 1e6:.0f} MB")
    text, encoding = decoded(path.read_bytes())
    lines = text.splitlines()
    if len(lines) > MOST:
        every = -(-len(lines) // 5000)
        raise ValueError(
            f"expected at most {MOST} lines, got {len(lines)}; keep every {every}th point"
        )
    ending = path.suffix.lower()
    if ending in SIMPACK or re.search(r"^\s*spline\.begin", text, re.M):
        return _simpack(lines, encoding, KINDS.get(ending))
    if ending in MINIPROF or re.search(r"^\"?(ColumnDef|MPTypeNo)=", text, re.M):
        return _miniprof(lines, encoding, KINDS.get(ending), part)
    return _table(lines, encoding)


def decoded(data: bytes) -> tuple[str, str]:
    """Return the text of a file and its encoding: by byte order mark, by zeros, utf-8, latin-1.

    Raises:
        ValueError: if it is no text.
    """
    encoding = next((name for mark, name in BOMS if data.startswith(mark)), "")
    if not encoding and b"\0" in data:
        odd, even = data[1::2].count(0), data[::2].count(0)
        if min(odd, even) > 0 or max(odd, even) < 0.3 * len(data):
            raise ValueError("expected a text file, got binary data")
        encoding = "utf-16-le" if odd else "utf-16-be"
    try:
        text = data.decode(encoding or "utf-8")
    except UnicodeDecodeError as error:
        if encoding:
            raise ValueError(
                f"expected text in {encoding}, which breaks off or is damaged"
            ) from error
        text, encoding = data.decode("latin-1"), "latin-1"
    if re.search(r"[\0-\x08\x0e-\x19\x1b-\x1f]", text):
        raise ValueError("expected a text file, got binary data")
    return text.replace("\N{MINUS SIGN}", "-"), (encoding or "utf-8").removesuffix("-sig")


def numbers(line: str, separator: str) -> list[float] | None:
    """Return the numbers of a line, None if it holds anything else or fewer than two.

    Between blanks and semicolons a comma is a decimal one, unless the number has a point as well.
    """
    words = line.split() if separator == " " else line.strip().strip(separator).split(separator)
    found = []
    for word in map(str.strip, words):
        if separator != "," and re.fullmatch(r"[^.,]*\d,\d[^.,]*", word):
            word = word.replace(",", ".")
        if not NUMBER.fullmatch(word):
            return None
        found.append(_float(word))
    return found if len(found) > 1 else None


def _float(word: str) -> float:
    return float(word.lower().replace("d", "e"))


def short(line: str) -> str:
    """Return a line as a message may show it."""
    line = line.strip()
    return repr(line if len(line) <= 60 else f"{line[:57]}...")


def _table(lines: list[str], encoding: str) -> PointFile:
    """Read a table of numbers, a point a line, below a header if there is one."""
    bare = [_bare(line) for line in lines]
    some = bare[:: len(bare) // SAMPLE + 1]
    rows = {s: sum(numbers(line, s) is not None for line in some) for s in SEPARATORS}
    separator = max(rows, key=lambda s: rows[s])
    if rows[separator] < 4:
        raise ValueError(
            f"expected lines of two numbers, 4 points or more, got {rows[separator]}; separators "
            "are semicolons, blanks, tabs or commas"
        )
    start = next(k for k, line in enumerate(bare) if numbers(line, separator))
    found = []
    for k, line in enumerate(bare[start:], start):
        values = numbers(line, separator)
        if values:
            found.append(values)
        elif line:
            raise ValueError(f"line {k + 1}: expected two numbers, got {short(lines[k])}")
        if values and len(values) != len(found[0]):
            raise ValueError(
                f"line {k + 1}: expected {len(found[0])} numbers as in the lines before, "
                f"got {short(lines[k])}"
            )
    header = [line for line in lines[:start] if line.strip()]
    names, units = _named(header, len(found[0]))
    table = np.array(found)
    columns = _columns(table, names)
    comma = separator != "," and any(re.search(r"\d,\d", line) for line in bare[start:])
    notes = []
    if len(found[0]) > 2 or columns != (0, 1):
        called = [names[c] if names else f"no. {c + 1}" for c in columns]
        notes.append(f"columns {called[0]} and {called[1]} of {len(found[0])}")
    if len(units) > 1:
        notes.append(f"the header names the units {' and '.join(sorted(units))}, none is taken")
    return PointFile(
        table[:, columns],
        f"text, {SEPARATORS[separator]}, decimal {'commas' if comma else 'points'}",
        encoding,
        unit=units.pop() if len(units) == 1 else "",
        notes=tuple(notes),
    )


def _bare(line: str) -> str:
    """Return a line without comments, and without the quotes of numbers."""
    line = re.sub(r'"([\s\d.,+-]*)"', lambda quoted: quoted[1].replace(",", "."), line)
    return REMARK.split(line, maxsplit=1)[0].strip()


def _named(header: list[str], columns: int) -> tuple[list[str], set[str]]:
    """Return names of the columns, if the last line of the header has as many, and its units."""
    units = {m[1] for line in header for pattern in NAMED for m in pattern.finditer(line)}
    last = BRACKETED.sub("", header[-1]) if header else ""
    names = [w for w in re.split(r"[;,\s]+", last.strip(" #%!;,\t\"*'/")) if w]
    if len(names) != columns:
        names = []
    units |= {m[1] for name in names if (m := SUFFIX.search(name))}
    plain = {u.lower() for u in units}
    called = {"in": "inch", "inches": "inch"}
    return [SUFFIX.sub("", n).strip("\"'").lower() for n in names], {
        called.get(u, u) for u in plain
    }


def _columns(table: Array, names: list[str]) -> tuple[int, int]:
    """Return which columns are lateral and vertical: by name, or the two that are left.

    A column that counts the points and columns of one value are left out.
    """
    for lateral, vertical in COLUMNS:
        if lateral in names and vertical in names:
            return names.index(lateral), names.index(vertical)
    if table.shape[1] == 2:
        return 0, 1
    counts = (np.diff(table[:, 0]) == 1).all() and table[0, 0] in (0, 1)
    left = [c for c in range(int(counts), table.shape[1]) if np.ptp(table[:, c]) > 0]
    if len(left) != 2:
        raise ValueError(
            f"expected two columns, got {table.shape[1]}; name them in a line above, y and z; "
            "with decimal commas, put semicolons between"
        )
    return left[0], left[1]


def _miniprof(lines: list[str], encoding: str, kind: Kind | None, part: int | None) -> PointFile:
    """Read MiniProf files, lines ``key=value`` above rows whose columns ``ColumnDef`` names.

    Lines from a quotation mark on are comments. Old files have free lines above an empty one.
    """
    blocks = list(_blocks(lines))
    if not blocks:
        raise ValueError("expected a MiniProf file with rows of numbers, got none")
    if part is None and len(blocks) > 1:
        sizes = ", ".join(str(len(rows)) for _, rows in blocks)
        raise ValueError(f"the file holds {len(blocks)} profiles, of {sizes} points; expected part")
    if not 1 <= (part or 1) <= len(blocks):
        raise ValueError(f"part = {part}: expected 1 to {len(blocks)}, the profiles of the file")
    keys, rows = blocks[(part or 1) - 1]
    columns = re.split(r"[,;\s]+", keys.get("columndef", "X,Y").upper())
    if "X" not in columns or "Y" not in columns:
        raise ValueError(f"ColumnDef = {short(keys['columndef'])}: expected X and Y among them")
    x, y = columns.index("X"), columns.index("Y")
    found = []
    for number, line in rows:
        values = [NUMBER.fullmatch(word) for word in re.split(r"[,;\s]+", line)[: max(x, y) + 1]]
        if None in values or len(values) <= max(x, y):
            raise ValueError(f"line {number}: expected {len(columns)} numbers, got {short(line)}")
        found.append([_float(values[c][0]) for c in (x, y)])  # type: ignore[index]
    offset = [_number(keys, name) or 0.0 for name in ("xoffset", "yoffset")]
    notes = [
        f"{name} {keys[key]}"
        for key, name in (
            ("wheeldiametertaperline", "taper line at"),
            ("railgaugepoint", "gauge measured at"),
            ("rail", "rail"),
            ("side", "side"),
        )
        if keys.get(key)
    ]
    return PointFile(
        np.array(found) + offset, "MiniProf", encoding, "mm", kind, outward=1, notes=tuple(notes)
    )


def _blocks(lines: list[str]) -> Iterator[tuple[dict[str, str], list[tuple[int, str]]]]:
    """Yield the keys in force and the numbered rows of each profile of a MiniProf file."""
    keys: dict[str, str] = {}
    rows: list[tuple[int, str]] = []
    sections = any(re.match(r"\[.*Points\]", line) for line in lines)
    old = not any("=" in line for line in lines)  # free lines, some of numbers, above an empty one
    reading = not (sections or old)
    for number, line in enumerate(lines, 1):
        bare = REMARK.split(line, maxsplit=1)[0].strip()
        key, equals, value = line.partition("=")
        if sections and bare.startswith("["):
            reading = bare.endswith("Points]")
            if reading and rows:
                yield keys, rows
                rows = []
        elif equals and not rows:
            keys[key.strip(' "').lower()] = value.strip(' "%')
        elif old and not line.strip():
            reading = True
        elif reading and bare and (rows or NUMBER.match(bare)):
            rows.append((number, bare))
    if rows:
        yield keys, rows


def _number(keys: dict[str, str], name: str) -> float | None:
    """Return the number of a key, None if it has none.

    Raises:
        ValueError: if its value is no number.
    """
    value = keys.get(name, "").strip("'")
    if not value:
        return None
    if not NUMBER.fullmatch(value) or not abs(number := _float(value)) < HUGE:
        raise ValueError(f"{name} = {short(value)}: expected a number, less than {HUGE:.0e}")
    return number


def _simpack(lines: list[str], encoding: str, kind: Kind | None) -> PointFile:
    """Read SIMPACK files, sections ``header``, ``spline`` and ``point``, and do what they ask for.

    Points are thinned, shifted, turned, cut, clipped and mirrored, in that order; the height of a
    rail counts down, that of a wheel outward. Smoothing that they ask for is told, not done.
    """
    keys: dict[str, str] = {}
    rows: list[Sequence[float]] = []
    section: list[str] = []
    for k, line in enumerate(lines, 1):
        bare = re.split("[!%]", line, maxsplit=1)[0].strip()
        name, dot, word = bare.rpartition(".")
        key, equals, value = bare.partition("=")
        if dot and word in ("begin", "end") and not equals:
            section = [*section, name] if word == "begin" else section[:-1]
        elif equals:
            keys[".".join([*section[-1:], key.strip()])] = value.strip()
        elif bare and section[-1:] == ["point"]:
            values = numbers(bare, " ")
            if values is None:
                raise ValueError(f"line {k}: expected two numbers, got {short(bare)}")
            rows.append(values[:2])
    if not rows:
        raise ValueError("expected a SIMPACK profile with lines between point.begin and point.end")
    if not (np.abs(rows) < HUGE).all():
        raise ValueError(f"expected finite points, less than {HUGE:.0e}")
    flag = _number(keys, "header.type")
    if flag is not None:
        kind = "wheel" if flag == 1 else "rail"
    points = _processed(np.array(rows), keys)
    factor = _number(keys, "spline.units.len.f")
    if factor is not None and not 0 < factor < np.inf:
        raise ValueError(f"units.len.f = {factor}: expected a positive number, 1000 for mm")
    notes = []
    if _number(keys, "spline.approx.smooth"):
        notes.append(f"approx.smooth = {keys['spline.approx.smooth']} is left to profile_smoothing")
    return PointFile(
        points / (factor or 1.0),
        "SIMPACK",
        encoding,
        unit="m" if factor else "",
        kind=kind,
        outward=-1 if kind == "rail" else 1,
        notes=tuple(notes),
    )


def _processed(points: Array, keys: dict[str, str]) -> Array:
    """Return points with what the section ``spline`` asks for done to them, in the file's unit."""

    def of(name: str, default: float = 0.0) -> float:
        value = _number(keys, f"spline.{name}")
        return default if value is None else value

    apart = of("point.dist.min")
    if apart > 0:
        kept = [0]
        for k in range(1, len(points)):
            if np.hypot(*(points[k] - points[kept[-1]])) >= apart:
                kept.append(k)
        points = points[kept]
    points = points + np.array([of("shift.y"), of("shift.z")])
    angle = of("rotate") / (of("units.ang.f", 1.0) or 1.0)
    c, s = np.cos(angle), np.sin(angle)
    points = points @ np.array([[c, s], [-s, c]])
    low, high = of("bound.y.min", 1.0), of("bound.y.max")
    if low < high:
        points = points[(points[:, 0] >= low) & (points[:, 0] <= high)]
    low, high = of("bound.z.min", 1.0), of("bound.z.max")
    if low < high:
        points = np.column_stack([points[:, 0], np.clip(points[:, 1], low, high)])
    return points * [1 - 2 * (of("mirror.y") == 1), 1 - 2 * (of("mirror.z") == 1)]
