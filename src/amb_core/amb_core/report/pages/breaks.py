"""Where the text of a cell may break: never inside a number with its unit, and inside words that are too long."""

from __future__ import annotations

import re

from amb_core.ground.extras import extra

with extra("figures"):
    from markupsafe import Markup, escape

LONGEST = 24  # letters of a word that has no place to break
PIECE = 16  # letters between two places at which a longer word may break

_NUMBER = r"[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?j?"
_UNIT = r"(?:%|°|dB|[kM]?Hz|[mµu]?m|[mµu]?s|A|V|N|A/m|A s/m|1/s|µm/A)(?![\w/])"
_PART = re.compile(
    rf"(?P<number>(?<![\w.]){_NUMBER}(?: ?± ?{_NUMBER})?(?: {_UNIT})?(?![\w.]*\w))|(?P<word>[^\s_]{{{LONGEST + 1},}})"
)


def breakable(text: str) -> Markup:
    """A text as HTML that breaks where a reader expects it.

    Parameters
    ----------
    text : str
        Plain text of a cell.

    Returns
    -------
    Markup
        The same letters, escaped: numbers that a browser might break, such as `0.24 ± 0.71j` or `5 Hz`, are kept
        together, and words longer than `LONGEST`, such as hashes and paths, may break.
    """
    pieces, end = [Markup("")], 0
    for part in _PART.finditer(text):
        piece = part.group()
        pieces.append(escape(text[end : part.start()]))
        if part.lastgroup == "word":
            parts = (piece[start : start + PIECE] for start in range(0, len(piece), PIECE))
            pieces.append(Markup("<wbr>").join(parts))
        elif re.search(r"[\s±+-]", piece):
            pieces.append(Markup('<span class="number">{}</span>').format(piece))
        else:
            pieces.append(escape(piece))
        end = part.end()
    return Markup("").join([*pieces, escape(text[end:])])
