"""Address of an output (``--out``): a kind of sink, its target, and its options."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from urllib.parse import parse_qs, urlsplit

from ...errors import InputError

MAX_PORT = 65535


@dataclass(frozen=True, slots=True)
class Address:
    """The parts of ``KIND://HOST:PORT?NAME=VALUE`` or ``KIND:PATH``.

    Attributes:
        text: the address as it was given.
        kind: kind of sink.
        host: host name in lower case, or "".
        port: port; None if it is not stated.
        path: path, or "".
        place: all between // and the path, with capital letters unchanged.
        options: values of each option.

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
        """Splits ``text`` into its parts. Raises InputError if it is not an address."""
        try:
            parts = urlsplit(text)
            port = parts.port
            options = parse_qs(parts.query, strict_parsing=True) if parts.query else {}
        except ValueError as error:
            raise InputError(f"out={text}: {error}; expected something like json-udp://127.0.0.1:9000") from None
        if port == 0:
            raise InputError(f"out={text}: no program can connect to port 0; take 1 to {MAX_PORT}")
        frozen = MappingProxyType({name: tuple(values) for name, values in options.items()})
        return cls(text, parts.scheme, parts.hostname or "", port, parts.path, parts.netloc, frozen)

    def with_port(self, default: int) -> tuple[str, int]:
        """Returns host and port; ``default`` if no port is stated. Raises InputError without a host or with a path."""
        if not self.host or self.path not in ("", "/"):
            raise InputError(
                f"out={self.text}: expected {self.kind}://HOST:PORT, as in {self.kind}://127.0.0.1:{default}"
            )
        return self.host, self.port or default

    def only(self, *names: str) -> None:
        """Raises InputError if an option is stated that is not in ``names``."""
        if unknown := sorted(set(self.options) - set(names)):
            has = f"it has {', '.join(names)}" if names else "it has none"
            raise InputError(f"out={self.text}: {self.kind} has no option {unknown[0]}; {has}")
