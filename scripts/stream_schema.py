"""Writes the JSON schema of the live messages into docs/streams.md."""

import json
import re
from pathlib import Path

from tipforce.live.streams import LiveMessage

PAGE = Path(__file__).parents[1] / "docs" / "streams.md"
BLOCK = re.compile(r"(```json schema\n).*?(```)", re.DOTALL)


def main() -> None:
    """Replace the block ``json schema``."""
    schema = json.dumps(LiveMessage.model_json_schema(mode="serialization"), indent=1)
    page = PAGE.read_text(encoding="utf-8")
    PAGE.write_text(BLOCK.sub(lambda found: f"{found[1]}{schema}\n{found[2]}", page), encoding="utf-8")


if __name__ == "__main__":
    main()
