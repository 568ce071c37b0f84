"""Tables in text and HTML, for what objects show of themselves."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from html import escape


def text_table(
    headings: Sequence[str], rows: Iterable[Sequence[str]], left: Collection[str] = ()
) -> str:
    """A table in fixed-width text; words to the left, numbers to the right."""
    lines = [headings, *rows]
    widths = [max(map(len, column)) for column in zip(*lines)]
    aligned = [
        [x.ljust(w) if name in left else x.rjust(w) for name, x, w in zip(headings, row, widths)]
        for row in lines
    ]
    return "\n".join("  ".join(row).rstrip() for row in aligned)


def html_table(
    headings: Sequence[str], rows: Iterable[Sequence[str]], left: Collection[str] = ()
) -> str:
    """The same table in HTML, for notebooks."""

    def line(tag: str, row: Sequence[str]) -> str:
        sides = ["left" if name in left else "right" for name in headings]
        cells = (
            f'<{tag} style="text-align: {side}">{escape(x)}</{tag}>' for side, x in zip(sides, row)
        )
        return f"<tr>{''.join(cells)}</tr>"

    body = "".join(line("td", row) for row in rows)
    return f"<table><thead>{line('th', headings)}</thead><tbody>{body}</tbody></table>"


def html_facts(title: str, facts: Iterable[tuple[str, str]]) -> str:
    """A title and a table of two columns, for notebooks."""
    rows = "".join(
        f'<tr><td style="text-align: left">{escape(name)}</td>'
        f'<td style="text-align: left">{escape(value)}</td></tr>'
        for name, value in facts
    )
    return f"<p>{escape(title)}</p><table><tbody>{rows}</tbody></table>"
