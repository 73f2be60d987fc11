"""Integer codes that each have a sentence."""

from __future__ import annotations

from enum import IntEnum


class Code(IntEnum):
    """An integer for arrays and exit codes, and what it means as a sentence.

    Members are written as `NAME = number, "sentence"`.
    """

    message: str

    def __new__(cls, code: int, message: str) -> Code:
        """A member of this number and meaning."""
        member = int.__new__(cls, code)
        member._value_ = code
        member.message = message
        return member
