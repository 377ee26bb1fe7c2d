"""What stands behind ``--out``: a kind of sink, where it sends to, and its options."""

import importlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any
from urllib.parse import parse_qs, urlsplit

from ...errors import InputError, MissingExtraError

_MOST_PORT = 65535


def import_extra(name: str) -> Any:
    """Import a package of the extra ``[stream]``; its contents are unknown to the type checker.

    Raises:
        MissingExtraError: it is not installed.
    """
    try:
        return importlib.import_module(name)
    except ModuleNotFoundError as error:
        package = {"foxglove": "foxglove-sdk"}.get(name, name)
        raise MissingExtraError(package, extra="stream") from error


@dataclass(frozen=True, slots=True)
class Address:
    """``KIND://HOST:PORT?NAME=VALUE`` or ``KIND:PATH``, taken apart.

    ``text``: as it was given; ``place``: all between // and the path, in its own case.

    >>> Address.of("json-udp://127.0.0.1:9000?rate_hz=10").options
    mappingproxy({'rate_hz': ('10',)})
    """

    text: str
    kind: str
    host: str = ""
    port: int | None = None
    path: str = ""
    place: str = ""
    options: Mapping[str, Sequence[str]] = field(default_factory=lambda: MappingProxyType({}))

    @classmethod
    def of(cls, text: str) -> "Address":
        """Take ``text`` apart. Raises InputError where it is no address."""
        try:
            parts = urlsplit(text)
            port = parts.port
            options = parse_qs(parts.query, strict_parsing=True) if parts.query else {}
        except ValueError as error:
            raise InputError(f"out={text}: {error}; expected something like json-udp://127.0.0.1:9000") from None
        if port == 0:
            raise InputError(f"out={text}: port 0 is none that anyone could connect to; take 1 to {_MOST_PORT}")
        frozen = MappingProxyType({name: tuple(values) for name, values in options.items()})
        return cls(text, parts.scheme, parts.hostname or "", port, parts.path, parts.netloc, frozen)

    def with_port(self, default: int) -> tuple[str, int]:
        """Host and port; ``default`` where none is stated. Raises InputError without a host or with a path."""
        if not self.host or self.path not in ("", "/"):
            raise InputError(
                f"out={self.text}: expected {self.kind}://HOST:PORT, as in {self.kind}://127.0.0.1:{default}"
            )
        return self.host, self.port or default

    def only(self, *names: str) -> None:
        """Raises InputError where an option is stated that is not among ``names``."""
        if unknown := sorted(set(self.options) - set(names)):
            has = f"it has {', '.join(names)}" if names else "it has none"
            raise InputError(f"out={self.text}: {self.kind} has no option {unknown[0]}; {has}")
