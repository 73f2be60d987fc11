"""Formulas of the built pages as MathML, which browsers draw without a script from afar."""

from __future__ import annotations

import html
import re
import shutil
from pathlib import Path

import ziamath
from latex2mathml.converter import convert

FONT = Path(ziamath.__file__).parent / "fonts" / "STIXTwoMath-Regular.ttf"
"""A font with the measures that formulas need (SIL Open Font License): many machines have none."""

_FORMULA = re.compile(
    r'<(?P<tag>span|div) class="arithmatex">\s*\\[(\[](?P<tex>.*?)\\[)\]]\s*</(?P=tag)>', re.DOTALL
)
_FUNCTION = re.compile(
    r"(<mi>(?:sin|cos|tan|arg|atan2|det|log)</mi>"
    r"|<msup><mi>(?:sin|cos)</mi><mn>2</mn></msup>)(?=<m(?:i|n|frac|sub|sup|style)\b)"
)
_TAG = re.compile(r"\\tag\{(.+?)\}")


def render_formulas(site: Path) -> int:
    r"""Replace every \(...\) and \[...\] of the pages; how many there were.

    Raises:
        ValueError: a formula that cannot be read, or with a command that is not known.
    """
    shutil.copyfile(FONT, site / "site" / "math.ttf")
    count = 0
    for page in sorted(site.rglob("*.html")):
        text, found = _FORMULA.subn(_mathml, page.read_text())
        if found:
            page.write_text(text)
            count += found
    return count


def _mathml(match: re.Match[str]) -> str:
    tex = html.unescape(match["tex"]).strip()
    numbers = _TAG.findall(tex)
    display = "block" if match["tag"] == "div" else "inline"
    # latex2mathml knows no \arg, and sets a \tag inside of the formula.
    plain = re.sub(r"\\arg\b", r"\\operatorname{arg}", _TAG.sub("", tex))
    try:
        drawn = convert(plain, display=display)
    except Exception as error:
        raise ValueError(f"no formula that latex2mathml can read: {tex}") from error
    if "\\" in drawn:
        raise ValueError(f"a formula has a command that latex2mathml does not know: {tex}")
    drawn = _FUNCTION.sub(r'\1<mspace width="0.17em"/>', drawn)
    if display == "inline":
        return drawn
    number = f'<span class="number">({numbers[0]})</span>' if numbers else ""
    return f'<div class="formula">{drawn}{number}</div>'
