# SPDX-License-Identifier: LGPL-3.0-or-later
"""Input files of Abaqus: parts, instances, element and node sets, surfaces of element faces.

Instances are placed as the assembly says. A set of a part goes by its own name, by that of Abaqus,
``instance.set``, where several instances have one of this name; cells in no set are a region called
like their instance. What would make nodes or elements that are not written out is refused.
"""

import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from meshes.arrays import Array, Index
from meshes.hexmesh import boundary

# Nodes of each face of a hexahedron, S1 to S6, as Abaqus numbers them.
FACES = np.array(
    [[0, 3, 2, 1], [4, 5, 6, 7], [0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], [3, 0, 4, 7]]
)
# Elements whose name begins so are cells or facets; others (beams, masses, springs) are left out.
TYPES = {
    "C3D8": ("hexahedron", 8),
    "C3D20": ("hexahedron20", 20),
    "C3D27": ("hexahedron27", 27),
    "C3D4": ("tetra", 4),
    "C3D10": ("tetra10", 10),
    "C3D6": ("wedge", 6),
    "C3D15": ("wedge15", 15),
    "C3D5": ("pyramid", 5),
    **dict.fromkeys(("S4", "SFM3D4", "M3D4", "R3D4", "CPS4", "CPE4", "CAX4"), ("quad", 4)),
    **dict.fromkeys(("S3", "SFM3D3", "M3D3", "R3D3", "CPS3", "CPE3", "CAX3"), ("triangle", 3)),
}
REFUSED = {
    **dict.fromkeys(("NGEN", "NFILL", "NCOPY"), "makes nodes that are not written out"),
    **dict.fromkeys(("ELGEN", "ELCOPY"), "makes elements that are not written out"),
    **dict.fromkeys(("NMAP", "SYSTEM"), "moves nodes"),
    "PARAMETER": "makes numbers that are not written out",
}
Key = tuple[str, int]  # instance and number of a node or an element
Name = tuple[str, str]  # instance and name of a set, of the assembly where it is ""


@dataclass
class Card:
    """A keyword in capitals, its options, names in capitals too, and its data lines."""

    keyword: str
    options: dict[str, str]
    lines: list[str] = field(default_factory=list)

    def name(self, option: str) -> str:
        """Return the name that an option gives, empty without it."""
        return label(self.options.get(option, ""))

    @property
    def rows(self) -> Iterator[list[str]]:
        """The entries of each data line."""
        return ([entry.strip() for entry in line.split(",")] for line in self.lines)

    @property
    def entries(self) -> Iterator[str]:
        """All entries, one after the other."""
        return (entry for row in self.rows for entry in row if entry)

    @property
    def words(self) -> list[str]:
        """All entries of lines of numbers, which have no spaces in them; much faster."""
        return " ".join(self.lines).replace(",", " ").split()


@dataclass
class Model:
    """Everything of a file that makes a mesh; numbers and names belong to an instance.

    Attributes:
        nodes: Position of each node, in the file's unit.
        elements: Type and nodes of each element.
        sets: Elements of each element set.
        node_sets: Nodes of each node set.
        surfaces: Element and face, ``S1`` to ``S6`` or another word, of each facet of a surface.
        internal: Element sets that the preprocessor made for itself.
        left_out: Lines of elements of each type that is neither cell nor facet.
    """

    nodes: dict[Key, list[float]] = field(default_factory=dict)
    elements: dict[Key, tuple[str, list[int]]] = field(default_factory=dict)
    sets: dict[Name, list[Key]] = field(default_factory=dict)
    node_sets: dict[Name, list[Key]] = field(default_factory=dict)
    surfaces: dict[Name, list[tuple[Key, str]]] = field(default_factory=dict)
    internal: set[Name] = field(default_factory=set)
    left_out: dict[str, int] = field(default_factory=dict)


def label(text: str) -> str:
    """Return a name as Abaqus compares it: in any case, unless it stands in quotes."""
    text = text.strip()
    return text[1:-1] if text.startswith('"') else text.lower()


def read(path: Path) -> Any:
    """Return the mesh of an input file as meshio has it, surfaces as sets of quads.

    Raises:
        ValueError: if it cannot be understood, with the keyword and the reason.
    """
    found = Model()
    parts, instances, rest = _sorted(cards(path))
    for name, (part, placing, own) in instances.items():
        if part and part not in parts:
            raise ValueError(f"*INSTANCE, NAME={name}: no *PART, NAME={part} in the file")
        inside = Model()
        for card in (*parts.get(part, []), *own):
            _take(inside, card, name)
        turn, shift = _placement(placing, name)
        at = (np.array([*inside.nodes.values()]).reshape(-1, 3) + shift[0]) @ turn.T + shift[1]
        found.nodes.update(zip(inside.nodes, at.tolist(), strict=True))
        for kind in ("elements", "sets", "node_sets", "surfaces", "left_out"):
            getattr(found, kind).update(getattr(inside, kind))
        found.internal |= inside.internal
    for card in rest:
        _take(found, card, "")
    return _mesh(found)


def cards(path: Path) -> list[Card]:
    """Return the keywords of a file up to its first step, those of included files in their place.

    Raises:
        ValueError: if a file that is included is not there, or includes itself.
    """
    found: list[Card] = []
    _scan(path, found, ())
    return found


def _scan(path: Path, found: list[Card], above: tuple[Path, ...]) -> None:
    with open(path, encoding="utf-8", errors="replace") as file:
        for text in file:
            line = text.strip()
            if not line or line.startswith("**"):
                continue
            if not line.startswith("*"):
                if found:
                    found[-1].lines.append(line)
                continue
            while line.endswith(","):
                line += next(file, "").strip() or " "
            card = _card(line)
            if card.keyword == "STEP":
                return
            if card.keyword != "INCLUDE":
                found.append(card)
                continue
            other = path.parent / card.options.get("INPUT", "").strip('"')
            if other in (*above, path) or not other.is_file():
                raise ValueError(f"*INCLUDE, INPUT={other}: expected another file that is there")
            _scan(other, found, (*above, path))


def _card(line: str) -> Card:
    """Return the keyword of a line; a name in quotes may hold commas."""
    keyword, *words = re.findall(r'(?:"[^"]*"|[^,])+', line[1:])
    pairs = (word.partition("=") for word in words)
    options = {key.strip().upper(): value.strip() for key, _, value in pairs}
    if numbers := [key for key in options if key[:1].isdecimal()]:
        raise ValueError(f"*{keyword}: its line ends in a comma and runs on into {numbers[0]}, …")
    return Card(" ".join(keyword.upper().split()), options)


Instances = dict[str, tuple[str, list[list[str]], list[Card]]]


def _sorted(every: Iterable[Card]) -> tuple[dict[str, list[Card]], Instances, list[Card]]:
    """Return the cards of each part, part, placing and cards of each instance, and the rest."""
    parts: dict[str, list[Card]] = {}
    instances: Instances = {}
    rest: list[Card] = []
    into = rest
    for card in every:
        if card.keyword == "PART":
            into = parts.setdefault(card.name("NAME"), [])
        elif card.keyword == "INSTANCE":
            name = card.name("NAME")
            if "LIBRARY" in card.options:
                raise ValueError(f"*INSTANCE, NAME={name}: LIBRARY is another analysis, not read")
            if name in instances:
                raise ValueError(f"*INSTANCE, NAME={name}: there are two of this name")
            into = []
            instances[name] = card.name("PART"), list(card.rows), into
        elif card.keyword in ("END PART", "END INSTANCE", "END ASSEMBLY", "ASSEMBLY"):
            into = rest
        else:
            into.append(card)
    if parts and not instances:
        raise ValueError(f"parts {list(parts)}, but no *INSTANCE of any in the assembly")
    return parts, instances, rest


def _placement(rows: list[list[str]], name: str) -> tuple[Array, Array]:
    """Return how an instance is turned, and the shifts before and after, ``(3, 3)``, ``(2, 3)``."""
    turn, shift = np.eye(3), np.zeros((2, 3))
    try:
        numbers = [[float(entry or 0) for entry in row] for row in rows if any(row)]
        if numbers:
            shift[0, : len(numbers[0])] = numbers[0]
        if len(numbers) > 1:
            *ends, angle = numbers[1]
            a, b = np.reshape(ends, (2, 3))
            x, y, z = (b - a) / np.linalg.norm(b - a)
            cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
            c, s = np.cos(np.radians(angle)), np.sin(np.radians(angle))
            turn = np.eye(3) + s * cross + (1 - c) * cross @ cross
            shift[1] = a - turn @ a
        if len(numbers) > 2 or not np.isfinite(turn).all():
            raise ValueError
    except ValueError:
        raise ValueError(
            f"*INSTANCE, NAME={name}: {rows}: expected a shift of three numbers, then two points "
            "of an axis and an angle in degrees"
        ) from None
    return turn, shift


def _take(model: Model, card: Card, instance: str) -> None:
    """Add what a card holds, in a part by its instance, to a model."""
    if card.keyword in REFUSED and (card.lines or card.options):
        raise ValueError(f"*{card.keyword} {REFUSED[card.keyword]}: write the whole mesh out first")
    if card.keyword in ("NODE", "ELEMENT") and "INPUT" in card.options:
        raise ValueError(f"*{card.keyword}, INPUT: expected its lines in this file")
    take = {"NODE": _nodes, "ELEMENT": _elements, "ELSET": _set, "NSET": _set, "SURFACE": _surface}
    if card.keyword in take:
        try:
            take[card.keyword](model, card, instance)
        except (ValueError, IndexError) as error:
            first = card.lines[0] if card.lines else ""
            said = ", ".join(f"{k}={v}" if v else k for k, v in card.options.items())
            raise ValueError(f"*{card.keyword}, {said} ({first!r} …): {error}") from None


def _nodes(model: Model, card: Card, instance: str) -> None:
    if card.options.get("SYSTEM", "R").upper() not in ("R", ""):
        raise ValueError("expected rectangular coordinates")
    words, keys = card.words, []
    if len(words) == 4 * len(card.lines):
        rows: Iterable[list[str]] = (words[k : k + 4] for k in range(0, len(words), 4))
    else:  # some coordinates are left out, or normals follow
        rows = card.rows
    for number, *at in rows:
        key = instance, int(number)
        keys.append(key)
        position = [float(x or 0) for x in at[:3]]
        position += [0.0] * (3 - len(position))
        if model.nodes.setdefault(key, position) != position:
            raise ValueError(f"node {number} is given twice, at different places")
    if "NSET" in card.options:
        model.node_sets.setdefault((instance, card.name("NSET")), []).extend(keys)


def _elements(model: Model, card: Card, instance: str) -> None:
    kind = card.options.get("TYPE", "").upper()
    name = re.match(r"[A-Z]+3D\d+|[A-Z]+\d+", kind)
    if name is None or name[0] not in TYPES:
        model.left_out[kind] = model.left_out.get(kind, 0) + len(card.lines)
        return
    cell, count = TYPES[name[0]]
    numbers = list(map(int, card.words))
    if len(numbers) % (count + 1):
        raise ValueError(f"expected a number and {count} nodes for each element")
    starts = range(0, len(numbers), count + 1)
    keys = [(instance, numbers[k]) for k in starts]
    for key, k in zip(keys, starts, strict=True):
        own = cell, numbers[k + 1 : k + 1 + count]
        if model.elements.setdefault(key, own) != own:
            raise ValueError(f"element {key[1]} is given twice, with different nodes")
    if "ELSET" in card.options:
        model.sets.setdefault((instance, card.name("ELSET")), []).extend(keys)


def _set(model: Model, card: Card, instance: str) -> None:
    kind = card.keyword
    sets = model.sets if kind == "ELSET" else model.node_sets
    own = card.name("INSTANCE") or instance
    members = sets.setdefault((instance, card.name(kind)), [])
    if "INTERNAL" in card.options and kind == "ELSET":
        model.internal.add((instance, card.name(kind)))
    if "GENERATE" in card.options:
        for row in card.rows:
            first, last, step = (*map(int, filter(None, row)), 1)[:3]
            members += [(own, k) for k in range(first, last + 1, step)]
        return
    for entry in card.entries:
        members += _members(sets, entry, own)


def _members(sets: Mapping[Name, list[Key]], entry: str, instance: str) -> list[Key]:
    """Return the members that an entry means: a number or a set, maybe of an instance."""
    before, dot, after = entry.rpartition(".")
    if dot and after.isdecimal():
        return [(label(before), int(after))]
    if entry.isdecimal():
        return [(instance, int(entry))]
    for name in ((instance, label(entry)), ("", label(entry)), (label(before), label(after))):
        if name in sets:
            return sets[name]
    raise ValueError(f"no set {entry!r} before it in the file")


def _surface(model: Model, card: Card, instance: str) -> None:
    kind, name = card.options.get("TYPE", "ELEMENT").upper(), (instance, card.name("NAME"))
    if "COMBINE" in card.options or kind not in ("ELEMENT", "NODE"):
        raise ValueError("expected TYPE=ELEMENT or NODE without COMBINE")
    for entry, *face in card.rows:
        if kind == "NODE":
            members = _members(model.node_sets, entry, instance)
            model.node_sets.setdefault(name, []).extend(members)
        else:
            side = face[0].upper() if face else ""
            facets = [(key, side) for key in _members(model.sets, entry, instance)]
            model.surfaces.setdefault(name, []).extend(facets)


def _mesh(model: Model) -> Any:
    """Return the model as meshio has it."""
    import meshio

    numbers = {key: k for k, key in enumerate(model.nodes)}
    names = _called([*model.sets, *model.surfaces, *model.node_sets])
    members, blocks = _blocks(model, numbers)
    masks = {
        name: [np.flatnonzero([key in of for key in keys]) for keys in members]
        for name, of in _groups(model, names).items()
    }
    for name, facets in model.surfaces.items():
        quads = _facets(model, numbers, dict(blocks).get("hexahedron"), facets)
        for others in masks.values():
            others.append(np.zeros(0, dtype=np.int64))
        found = masks.setdefault(names[name], [np.zeros(0, dtype=np.int64)] * (len(blocks) + 1))
        found[-1] = np.arange(len(quads))
        blocks.append(("quad", quads))
    points = np.array(list(model.nodes.values())).reshape(-1, 3)
    point_sets = {
        names[n]: np.array([numbers[k] for k in of if k in numbers])
        for n, of in model.node_sets.items()
    }
    left_out = ", ".join(f"{n} lines of {kind}" for kind, n in model.left_out.items())
    return meshio.Mesh(
        points, blocks, cell_sets=masks, point_sets=point_sets, info={"left out": left_out}
    )


def _blocks(
    model: Model, numbers: Mapping[Key, int]
) -> tuple[list[list[Key]], list[tuple[str, Index]]]:
    """Return the elements of each type: their keys, and the type with their nodes."""
    keys: dict[str, list[Key]] = {}
    nodes: dict[str, list[list[int]]] = {}
    for key, (cell, own) in model.elements.items():
        if missing := [node for node in own if (key[0], node) not in numbers]:
            raise ValueError(f"element {key[1]} has node {missing[0]}, which is not there")
        keys.setdefault(cell, []).append(key)
        nodes.setdefault(cell, []).append([numbers[key[0], node] for node in own])
    return list(keys.values()), [(cell, np.array(of)) for cell, of in nodes.items()]


def _groups(model: Model, names: Mapping[Name, str]) -> dict[str, set[Key]]:
    """Return the elements of each group: sets, and instances for the cells in none."""
    sets = {n: model.sets[n] for n in model.sets if n not in model.internal}
    inside = {key for of in sets.values() for key in of}
    groups = {names[n]: set(of) for n, of in sets.items()}
    for key, (cell, _) in model.elements.items():
        if key not in inside and key[0] and cell == "hexahedron":
            groups.setdefault(key[0], set()).add(key)
    return groups


def _called(sets: Iterable[Name]) -> dict[Name, str]:
    """Return what each set is called: its own name if no other instance has one like it."""
    every = set(sets)
    count = dict.fromkeys((name for _, name in every), 0)
    for _, name in every:
        count[name] += 1
    return {(of, name): f"{of}.{name}" if of and count[name] > 1 else name for of, name in every}


def _facets(
    model: Model,
    numbers: Mapping[Key, int],
    cells: Index | None,
    facets: Iterable[tuple[Key, str]],
) -> Index:
    """Return the quads of a surface of element faces, shape ``(q, 4)``."""
    quads, free = [], None
    for key, side in facets:
        if key not in model.elements:
            continue  # of a type that is left out
        cell, own = model.elements[key]
        nodes = np.array([numbers[key[0], node] for node in own])
        if cell == "quad":
            quads.append(nodes)
        elif cell == "hexahedron" and side in ("S1", "S2", "S3", "S4", "S5", "S6"):
            quads.append(nodes[FACES[int(side[1]) - 1]])
        elif cell == "hexahedron" and not side:
            if free is None and cells is not None:
                free = {frozenset(quad) for quad in boundary(cells).tolist()}
            quads += [q for q in nodes[FACES] if frozenset(q.tolist()) in (free or ())]
        else:
            raise ValueError(f"surface: face {side!r} of a {cell}; expected faces of hexahedra")
    return np.array(quads, dtype=np.int64).reshape(-1, 4)
