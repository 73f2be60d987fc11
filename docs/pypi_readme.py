"""README.md as PyPI shows it: links and pictures of the repository with their whole addresses.

python -m docs.pypi_readme https://github.com/OWNER/NAME v0.2.0

rewrites README.md in place, of a checkout that a release is built from. In the repository its links
stay relative, so that they fit every branch and every copy.
"""

from __future__ import annotations

import re
import sys
from pathlib import Path

README = Path(__file__).parents[1] / "README.md"

_LINK = re.compile(r"(!?)\[([^\]]*)\]\((?!https?:|#|mailto:)([^)\s]+)\)")


def absolute(text: str, repository: str, tag: str) -> str:
    """Text in Markdown whose relative links lead into a repository at a tag.

    Args:
        text: what links to files of the repository's top level.
        repository: the address of its page on GitHub.
        tag: what was tagged.
    """
    page = repository.rstrip("/")
    raw = page.replace("https://github.com/", "https://raw.githubusercontent.com/", 1)

    def whole(found: re.Match[str]) -> str:
        picture, words, target = found.groups()
        base = f"{raw}/{tag}" if picture else f"{page}/blob/{tag}"
        return f"{picture}[{words}]({base}/{target})"

    return _LINK.sub(whole, text)


if __name__ == "__main__":
    text = README.read_text(encoding="utf-8")
    README.write_text(absolute(text, *sys.argv[1:3]), encoding="utf-8")
