# SPDX-License-Identifier: LGPL-3.0-or-later
"""Branches around what no cell of a batch needs, and requests for the history of the next batch.

Lanes cannot branch one by one: both sides of a conditional are computed, and each lane takes its
own. But where its condition holds in no lane at all, what only its first side reads can be left
out: nothing of the return to a yield surface is computed in a batch of cells that stays elastic.
"""

from collections import Counter
from collections.abc import Iterator
from typing import Any

import ffcx.codegeneration.lnodes as L

WORTH = 4  # statements that a branch saves at least


class If(L.Statement):
    """Statements for batches in any lane of which a condition holds."""

    def __init__(self, condition: Any, body: list[Any]) -> None:
        self.condition, self.body = condition, body


class Prefetch(L.Statement):
    """A request for the history of the next batch at the same point, while this one computes.

    Without it half of the time goes by waiting for memory, where history is the most that is read.
    """

    def __init__(self, array: Any, first: Any, count: int) -> None:
        self.array, self.first, self.count = array, first, count


def add_branches(code: Any) -> None:
    """Put branches around what only the first side of a conditional reads, in place."""
    reads = Counter(name for value in _values(code) for name in symbols(value))
    for block in _blocks(code):
        block.statements = _branched(block.statements, reads)


def _blocks(node: Any) -> Iterator[Any]:
    """Yield all lists of statements below a node."""
    if isinstance(node, L.ForRange):
        yield from _blocks(node.body)
    elif isinstance(node, L.Section | L.StatementList):
        yield node
        for statement in node.statements:
            yield from _blocks(statement)


def _values(code: Any) -> Iterator[Any]:
    """Yield what the statements below a node read."""
    for block in _blocks(code):
        for s in [*getattr(block, "declarations", ()), *block.statements]:
            if isinstance(s, L.VariableDecl):
                yield s.value
            elif hasattr(s, "expr"):
                yield s.expr


def _branched(statements: list[Any], reads: Counter[str]) -> list[Any]:
    """Return statements with branches.

    Args:
        statements: The statements.
        reads: How many statements of the whole code read a name.
    """
    for at in reversed(range(len(statements))):
        s = statements[at]
        if not isinstance(s, L.VariableDecl) or not isinstance(s.value, L.Conditional):
            continue
        inside = _only_for(s.value, statements[:at], reads)
        if len(inside) >= WORTH:
            rest = [x for i, x in enumerate(statements[:at]) if i not in inside]
            body = _branched([statements[i] for i in inside], reads)
            branch = If(s.value.condition, [*body, L.Assign(s.symbol, s.value)])
            start = L.VariableDecl(s.symbol, s.value.false)
            return [*_branched(rest, reads), start, branch, *statements[at + 1 :]]
    return statements


def _only_for(choice: Any, before: list[Any], reads: Counter[str]) -> list[int]:
    """Return which declarations before a choice are read for nothing but its first side."""
    if symbols(choice.true) & (symbols(choice.condition) | symbols(choice.false)):
        return []
    inside: list[int] = []
    found = Counter(symbols(choice.true))  # how many statements inside read a name
    for i in reversed(range(len(before))):
        s = before[i]
        if isinstance(s, L.VariableDecl) and 0 < found[s.symbol.name] == reads[s.symbol.name]:
            inside.insert(0, i)
            found.update(symbols(s.value))
    return inside


def symbols(node: Any) -> set[str]:
    """Return the names that an expression reads."""
    if isinstance(node, L.Symbol):
        return {node.name}
    fields = ("lhs", "rhs", "arg", "array", "condition", "true", "false")
    parts = [getattr(node, name) for name in fields if hasattr(node, name)]
    parts += [*getattr(node, "args", ()), *getattr(node, "indices", ())]
    return set().union(*map(symbols, parts))
