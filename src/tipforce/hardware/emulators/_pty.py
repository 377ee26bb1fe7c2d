"""Emulates a serial port on this machine: a pseudo-terminal whose other end a thread serves."""

import os
import select
import threading
from pathlib import Path
from typing import Self

_POLL_S = 0.002


class PtyDevice:
    """Base of devices at a serial port. ``path``: a link to the port, the same after it was plugged in again."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._stopped = threading.Event()
        self._lock = threading.Lock()
        self._master: int | None = None
        self._thread = threading.Thread(target=self._run, daemon=True)

    def received(self, data: bytes) -> None:
        """Processes ``data`` from the driver."""

    def step(self) -> None:
        """Does the work of a few milliseconds; called at this interval."""

    def send(self, text: str) -> None:
        """Writes ``text`` to the driver; it is lost while the port is unplugged."""
        with self._lock:
            if self._master is not None:
                os.write(self._master, text.encode())

    def plug_in(self) -> None:
        """Makes the port, and the link to it under its lasting name."""
        import tty

        master, slave = os.openpty()
        tty.setraw(slave)
        os.set_blocking(master, False)
        new_link = self.path.with_name(self.path.name + ".new")
        new_link.unlink(missing_ok=True)
        new_link.symlink_to(os.ttyname(slave))
        new_link.replace(self.path)
        with self._lock:
            self._master, self._slave = master, slave

    def unplug(self) -> None:
        """Removes the port while it is in use."""
        with self._lock:
            master, self._master = self._master, None
        if master is not None:
            os.close(master)
            os.close(self._slave)
            self.path.unlink(missing_ok=True)

    def _run(self) -> None:
        """Passes the bytes from the driver to `received`, and calls `step`, every two milliseconds."""
        while not self._stopped.is_set():
            with self._lock:
                data = b""
                if self._master is not None and select.select([self._master], [], [], 0)[0]:
                    try:
                        data = os.read(self._master, 4096)
                    except OSError:  # no program has it open
                        data = b""
            if data:
                self.received(data)
            self.step()
            self._stopped.wait(_POLL_S)

    def __enter__(self) -> Self:
        self.plug_in()
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stopped.set()
        self._thread.join()
        self.unplug()
