import json
import shutil
import socket
import subprocess
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from pyigtl.messages import MessageBase

from tipforce.live import LiveUpdate
from tipforce.live.streams import open_sink
from tipforce.types import SessionInfo

WAIT_S = 5.0
TIP = [[0.0, -1.0, 0.0, 10.0], [1.0, 0.0, 0.0, 10.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]]


@pytest.fixture
def listener() -> Iterator[socket.socket]:
    with socket.create_server(("127.0.0.1", 0)) as server:
        server.settimeout(WAIT_S)
        yield server


def received(connection: socket.socket) -> MessageBase:
    def exactly(size: int) -> bytes:
        data = b""
        while len(data) < size:  # with a timeout, `MSG_WAITALL` returns what has arrived
            part = connection.recv(size - len(data))
            assert part, "the sink closed the connection within a message"
            data += part
        return data

    fields = MessageBase.parse_header(exactly(MessageBase.IGTL_HEADER_SIZE))
    message = MessageBase.create_message(fields["message_type"])
    message.unpack(fields, exactly(fields["body_size"]))
    return message


def test_a_server_gets_pose_and_force(
    listener: socket.socket, update: Callable[..., LiveUpdate], info: SessionInfo
) -> None:
    sink = open_sink(f"igtl://127.0.0.1:{listener.getsockname()[1]}")
    sink.start(info, "m")
    with listener.accept()[0] as server:
        sink.put(update())
        tip, force = received(server), received(server)
        assert (tip.message_type, tip.device_name) == ("TRANSFORM", "TipToBase")
        np.testing.assert_allclose(tip.matrix, TIP, atol=1e-5)
        assert (force.message_type, force.device_name) == ("STRING", "TipForce")
        values = json.loads(force.string)
        assert (values["status"], values["magnitude_n"], values["force_n"]) == ("valid", 0.25, [-0.15, 0.2, None])
        assert values["magnitude_interval_n"] == [0.22, 0.28]
        assert tip.timestamp == force.timestamp == pytest.approx(time.time() - 0.012, abs=0.5)

        sink.put(update(1, valid=False))
        tip, force = received(server), received(server)
        assert np.isnan(tip.matrix[:3]).all()
        values = json.loads(force.string)
        assert (values["status"], values["magnitude_n"], values["force_n"]) == ("stale", None, [None] * 3)
    sink.close()


def test_a_server_that_goes_and_comes_back(
    listener: socket.socket, update: Callable[..., LiveUpdate], info: SessionInfo
) -> None:
    sink = open_sink(f"igtl://127.0.0.1:{listener.getsockname()[1]}")
    sink.start(info, "m")
    with listener.accept()[0] as server:
        server.sendall(b"a server may talk, too")
        sink.put(update(0))
        received(server), received(server)
    with pytest.raises(ConnectionError, match="closed the connection"):  # noqa: PT012
        for number in range(1, 20):
            sink.put(update(number))
            time.sleep(0.01)
    sink.close()
    sink.start(info, "m")
    with listener.accept()[0] as server:
        sink.put(update(20, valid=False))
        assert np.isnan(received(server).matrix[:3]).all(), "the first message is the new one"
    sink.close()


def test_a_server_that_stops_reading_gets_what_its_machine_kept_and_then_the_newest(
    update: Callable[..., LiveUpdate], info: SessionInfo
) -> None:
    with socket.socket() as server:
        server.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 8192)
        server.bind(("127.0.0.1", 0))
        server.listen()
        sink = open_sink(f"igtl://127.0.0.1:{server.getsockname()[1]}")
        sink.start(info, "m")
        with server.accept()[0] as connection:
            began = time.monotonic()
            for number in range(300):
                sink.put(update(number))
            assert time.monotonic() - began < 1.5, "it does not wait for the server"
            connection.settimeout(WAIT_S)
            old, status = -1, "valid"
            while status == "valid":
                sink.put(update(300, valid=False))
                message = received(connection)
                if message.message_type == "STRING":
                    old, status = old + 1, json.loads(message.string)["status"]
            assert old < 60, "of 300"
    sink.close()


def test_the_last_message_reaches_a_server_that_reads_slowly(
    update: Callable[..., LiveUpdate], info: SessionInfo
) -> None:
    with socket.socket() as server:
        server.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 8192)
        server.bind(("127.0.0.1", 0))
        server.listen()
        sink = open_sink(f"igtl://127.0.0.1:{server.getsockname()[1]}")
        sink.start(info, "m")
        with server.accept()[0] as connection:
            for number in range(300):
                sink.put(update(number))
            sink.put(update(300, valid=False))
            closing = threading.Thread(target=sink.close)
            closing.start()
            connection.settimeout(WAIT_S)
            status = "valid"
            while status == "valid":
                message = received(connection)
                if message.message_type == "STRING":
                    status = json.loads(message.string)["status"]
            assert connection.recv(1) == b"", "it was the last one"
            closing.join()


def test_without_a_server_the_start_fails(info: SessionInfo, free_port: int) -> None:
    sink = open_sink(f"igtl://127.0.0.1:{free_port}")
    with pytest.raises(ConnectionRefusedError):
        sink.start(info, "m")
    sink.close()


EXAMPLE = Path("/usr/share/doc/openigtlink-examples/examples/Receiver/ReceiveServer.cxx")


@pytest.fixture(scope="module")
def receive_server(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The receiver of OpenIGTLink's own examples, compiled against its own library."""
    if not EXAMPLE.exists() or not Path("/usr/include/openigtlink").exists() or shutil.which("g++") is None:
        pytest.skip("no openigtlink-examples, libopenigtlink-dev and g++ (apt-get install them)")
    program = tmp_path_factory.mktemp("igtl") / "ReceiveServer"
    command = [
        "g++",
        "-O0",
        "-I/usr/include/openigtlink",
        str(EXAMPLE),
        "-o",
        str(program),
        "-lOpenIGTLink",
        "-lpthread",
    ]
    subprocess.run(command, check=True, timeout=120, capture_output=True)
    return program


def test_openigtlinks_own_receiver_reads_it(
    receive_server: Path, tmp_path: Path, free_port: int, update: Callable[..., LiveUpdate], info: SessionInfo
) -> None:
    said = tmp_path / "said.txt"
    with said.open("wb") as out:
        server = subprocess.Popen([receive_server, str(free_port)], stdout=out, stderr=subprocess.STDOUT)
    try:
        sink = open_sink(f"igtl://127.0.0.1:{free_port}")
        deadline = time.monotonic() + WAIT_S
        while True:
            try:
                sink.start(info, "m")
                break
            except ConnectionRefusedError:
                assert time.monotonic() < deadline
                time.sleep(0.02)
        sink.put(update(0))
        sink.put(update(1, valid=False))
        while said.read_text().count("STRING") < 2 or said.read_text().count("}") < 2:
            assert time.monotonic() < deadline, said.read_text()
            time.sleep(0.02)
        sink.close()
    finally:
        server.kill()
        server.wait()
    text = said.read_text()
    print(text)
    assert text.count("Receiving TRANSFORM data type.") == text.count("Receiving STRING data type.") == 2
    assert '"magnitude_n": 0.25' in text
    assert '"magnitude_n": null' in text
