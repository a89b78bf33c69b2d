# SPDX-License-Identifier: LGPL-3.0-or-later
"""Tables of results: rows as JSON has them, shown on a terminal or as HTML.

The rows of a table are the mappings (or tuples) that are written as JSON, in SI units; its columns
say which value of a row they show, in which unit and with how many digits.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from html import escape
from math import isfinite
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import rich.table
    from rich.console import Console


@dataclass(frozen=True)
class Column:
    """A column of a table.

    Attributes:
        head: Heading, without the unit.
        of: Key or index of its value in a row, or a function of the row; None leaves a cell empty.
        show: Format specification of a number, or a function that returns its text.
        unit: Unit in which it is shown.
        factor: From the SI unit to that unit.
        words: Whether it holds words, which are set flush left.
    """

    head: str
    of: str | int | Callable[[Any], Any]
    show: str | Callable[[Any], str] = ""
    unit: str = ""
    factor: float = 1
    words: bool = False

    @property
    def title(self) -> str:
        """Heading with unit."""
        return f"{self.head} [{self.unit}]" if self.unit else self.head

    def text(self, row: Any) -> str:
        """Return the cell of a row."""
        if callable(self.of):
            value = self.of(row)
        else:
            value = row.get(self.of) if isinstance(row, Mapping) else row[self.of]
        if value is None or isinstance(value, str):
            return value or ""
        value = value * self.factor
        return self.show(value) if callable(self.show) else format(value, self.show)


PAIRS = (Column("", 0, words=True), Column("", 1, words=True))  # rows (name, value) without heading


@dataclass(frozen=True)
class Table:
    """A table.

    Attributes:
        title: What it shows.
        columns: Its columns.
        rows: A mapping, tuple or object for each row.
        note: A remark below it.
    """

    title: str
    columns: Sequence[Column]
    rows: Sequence[Any]
    note: str = ""

    @property
    def cells(self) -> list[tuple[str, ...]]:
        """The text of each cell, row by row."""
        return [tuple(column.text(row) for column in self.columns) for row in self.rows]

    @property
    def heads(self) -> list[str]:
        """Headings with units; none at all if all are empty."""
        heads = [column.title for column in self.columns]
        return heads if any(heads) else []

    def printed(self) -> "rich.table.Table":
        """Return the table for a terminal."""
        from rich import box, table
        from rich.markup import escape as plain

        out = table.Table(
            title=plain(self.title) or None,
            caption=plain(self.note) or None,
            title_justify="left",
            caption_justify="left",
            box=box.SIMPLE_HEAD,
            pad_edge=False,
            collapse_padding=True,
            show_header=bool(self.heads),
        )
        for column in self.columns:
            side: Any = "left" if column.words else "right"
            out.add_column(plain(column.title), justify=side, no_wrap=not column.words)
        for row in self.cells:
            out.add_row(*map(plain, row))
        return out

    def html(self, level: int = 3) -> str:
        """Return the table with heading and note as HTML; all that is put into it is escaped.

        Keys in the first column may be broken after an underscore; no character is added to what is
        copied.

        Args:
            level: Of the heading.
        """
        side = ['class="word"' if column.words else "" for column in self.columns]

        def cells(kind: str, texts: Iterable[str]) -> str:
            return "".join(
                f"<{kind} {of}>{text}</{kind}>" if of else f"<{kind}>{text}</{kind}>"
                for of, text in zip(side, texts, strict=True)
            )

        lines = [f"<h{level}>{escape(self.title)}</h{level}>", '<div class="wide"><table>']
        if self.heads:
            lines.append(f"<thead><tr>{cells('th', map(escape, self.heads))}</tr></thead>")
        lines.append("<tbody>")
        for first, *rest in self.cells:
            texts = escape(first).replace("_", "_<wbr>"), *map(escape, rest)
            lines.append(f"<tr>{cells('td', texts)}</tr>")
        lines.append("</tbody></table></div>")
        if self.note:
            lines.append(f'<p class="note">{escape(self.note)}</p>')
        return "\n".join(lines)


def strict(value: Any) -> Any:
    """Return the value with ``None`` for every number that JSON cannot hold (NaN, infinity)."""
    if isinstance(value, Mapping):
        return {key: strict(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [strict(entry) for entry in value]
    return None if isinstance(value, float) and not isfinite(value) else value


def show(parts: "Iterable[str | Table]", console: "Console") -> None:
    """Print lines and tables of a result."""
    for part in parts:
        if isinstance(part, Table):
            console.print(part.printed())
        else:
            console.print(part, highlight=False, markup=False, soft_wrap=True)
