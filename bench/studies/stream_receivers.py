"""Receivers of `bench.studies.streams`, each a process of its own that imports nothing of tipforce.

    python -m bench.studies.stream_receivers KIND PORT

Prints "ready", and when the stream has ended a JSON list of pairs: number of the update, or -1 for "in the order sent",
and when it was received, in ns of the machine's monotonic clock.
"""

import json
import socket
import struct
import sys
import time
from collections.abc import Callable

QUIET_S = 3.0
"""A receiver ends when nothing comes for so long."""
Times = list[tuple[int, int]]
Ready = Callable[[], None]


def receive_udp(port: int, ready: Ready) -> Times:
    """JSON datagrams."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as receiver:
        receiver.bind(("127.0.0.1", port))
        ready()
        times: Times = []
        try:
            while True:
                text = receiver.recv(1 << 16)
                times.append((json.loads(text)["number"], time.monotonic_ns()))
                receiver.settimeout(QUIET_S)
        except TimeoutError:
            return times


def receive_igtl(port: int, ready: Ready) -> Times:
    """OpenIGTLink: a transform and a string each; the string is the later one."""
    head = struct.Struct(">H12s20sIIQQ")
    with socket.create_server(("127.0.0.1", port)) as server:
        ready()
        connection, _ = server.accept()
        times: Times = []
        while header := connection.recv(head.size, socket.MSG_WAITALL):
            kind, size = head.unpack(header)[1], head.unpack(header)[5]
            connection.recv(size, socket.MSG_WAITALL)
            if kind.startswith(b"STRING"):
                times.append((-1, time.monotonic_ns()))
        return times


def receive_websocket(port: int, ready: Ready) -> Times:
    """JSON over WebSocket."""
    from websockets.sync.client import connect

    with connect(f"ws://127.0.0.1:{port}") as client:
        ready()
        times: Times = []
        try:
            while True:
                text = client.recv(QUIET_S if times else None)
                times.append((json.loads(text)["number"], time.monotonic_ns()))
        except TimeoutError:
            return times


def receive_foxglove(port: int, ready: Ready) -> Times:
    """All topics; the JSON comes last of an update."""
    from websockets.sync.client import connect

    with connect(f"ws://127.0.0.1:{port}", subprotocols=["foxglove.sdk.v1"], compression=None) as client:  # type: ignore[list-item]
        channels: dict[str, int] = {}
        while len(channels) < 3:
            said = json.loads(client.recv())
            channels |= {each["topic"]: each["id"] for each in said.get("channels", [])}
        wanted = [{"id": k, "channelId": channel} for k, channel in enumerate(channels.values())]
        client.send(json.dumps({"op": "subscribe", "subscriptions": wanted}))
        live = list(channels).index("/live")
        time.sleep(0.3)
        ready()
        times: Times = []
        try:
            while True:
                data = client.recv(QUIET_S if times else None)
                if isinstance(data, bytes) and struct.unpack_from("<BI", data)[1] == live:
                    times.append((json.loads(data[13:])["number"], time.monotonic_ns()))
        except TimeoutError:
            return times


def receive_lsl(port: int, ready: Ready) -> Times:
    """A pylsl inlet."""
    import pylsl

    inlet = pylsl.StreamInlet(pylsl.resolve_byprop("name", f"bench-{port}", timeout=10.0)[0])
    inlet.open_stream(timeout=10.0)
    ready()
    times: Times = []
    while True:
        sample, _ = inlet.pull_sample(timeout=QUIET_S if times else 30.0)
        if sample is None:
            break
        times.append((-1, time.monotonic_ns()))
    return times


RECEIVERS = {
    "json-udp": receive_udp,
    "json-ws": receive_websocket,
    "igtl": receive_igtl,
    "foxglove": receive_foxglove,
    "lsl": receive_lsl,
}


def main() -> None:
    kind, port = sys.argv[1:]
    print(json.dumps(RECEIVERS[kind](int(port), lambda: print("ready", flush=True))), flush=True)


if __name__ == "__main__":
    main()
