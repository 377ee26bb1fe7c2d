"""Writes the JSON schema of the live messages to docs/live-message.schema.json, which docs/streams.md links."""

import json
from pathlib import Path

from tipforce.live.streams import LiveMessage

SCHEMA_FILE = Path(__file__).parents[1] / "docs" / "live-message.schema.json"


def main() -> None:
    """Replaces the file."""
    schema = json.dumps(LiveMessage.model_json_schema(mode="serialization"), indent=1)
    SCHEMA_FILE.write_text(f"{schema}\n", encoding="utf-8")


if __name__ == "__main__":
    main()
