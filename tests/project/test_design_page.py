"""The table of packages in docs/design.md says what the import contracts say."""

import re
from pathlib import Path

from .test_import_contracts import ALLOWED, BASE

PAGE = Path(__file__).resolve().parents[2] / "docs" / "design.md"
WITHOUT_ROW = BASE | {"pipelines"}
"""Packages that the page describes in its text."""


def test_the_table_of_packages_lists_the_allowed_imports() -> None:
    rows = re.findall(r"^\| `(\w+)` \| [^|]+ \|([^|]*)\|$", PAGE.read_text(encoding="utf-8"), flags=re.M)
    stated = {package: set(re.findall(r"`(\w+)`", imports)) for package, imports in rows if package in ALLOWED}
    allowed = {package: imports - BASE for package, imports in ALLOWED.items() if package not in WITHOUT_ROW}
    assert stated == allowed
