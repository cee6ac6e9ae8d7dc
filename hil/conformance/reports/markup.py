"""Elements of XML and HTML, in which text from any source stays text."""

from __future__ import annotations

import re
from xml.etree.ElementTree import Element

__all__ = ["element", "legible"]

# Controls move a terminal's cursor; XML forbids most of them, and code points that are no characters.
_ILLEGIBLE = re.compile("[^\t\n\x20-\x7e\xa0-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")


def legible(text: str) -> str:
    """A text without the characters that XML forbids or a terminal obeys; lines and tabs remain."""
    return _ILLEGIBLE.sub("", text)


def element(tag: str, /, *content: Element | str, **attributes: str) -> Element:
    """An element with its attributes: ``class_`` stands for ``class``; text in it is escaped when it is written."""
    made = Element(tag, {key.rstrip("_"): legible(value) for key, value in attributes.items()})
    for part in content:
        if isinstance(part, Element):
            made.append(part)
        elif len(made):
            made[-1].tail = (made[-1].tail or "") + legible(part)
        else:
            made.text = (made.text or "") + legible(part)
    return made
