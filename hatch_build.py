"""Puts a digest of the code into every wheel: installed machine code is read again by the same code alone."""

import runpy
import tempfile
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface


class DigestHook(BuildHookInterface):
    """Writes `jounce/code.sha256` into a wheel; an editable one leads to sources, which change."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Add the digest, as the last file of the package."""
        if version == "editable":
            return
        package = Path(self.root, "src", "jounce")
        code = runpy.run_path(str(package / "core" / "code_digest.py"))
        self._folder = tempfile.TemporaryDirectory()
        path = Path(self._folder.name, code["DIGEST_FILE"])
        path.write_text(code["hash_modules"](package) + "\n", encoding="ascii", newline="\n")
        build_data["force_include"][str(path)] = f"jounce/{path.name}"

    def finalize(self, version: str, build_data: dict[str, Any], artifact_path: str) -> None:
        """Remove the file that the wheel holds now."""
        if version != "editable":
            self._folder.cleanup()
