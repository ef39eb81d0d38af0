"""Errors that are the user's to mend: they carry what was found, what was expected and how to mend it."""

from __future__ import annotations

from pathlib import Path


class DynhairError(Exception):
    """A problem with a file, an option or a capture that the user can mend.

    The command line prints it without a traceback.

    Args:
        message: what was found, in one sentence.
        path: the file or folder concerned.
        expected: what was expected instead.
        mend: what the user can do about it.
    """

    def __init__(
        self, message: str, *, path: Path | str | None = None, expected: str | None = None, mend: str | None = None
    ) -> None:
        self.message, self.path, self.expected, self.mend = message, path, expected, mend
        lines = [f"{path}: {message}" if path is not None else message]
        if expected is not None:
            lines.append(f"expected: {expected}")
        if mend is not None:
            lines.append(f"to mend it: {mend}")
        super().__init__("\n".join(lines))
