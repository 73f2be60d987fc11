"""The simulated robot outlives whatever is sent to it: 10,000 frames, then a client is served."""

from __future__ import annotations

import contextlib
import random
import socket

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from niryo_jax.hardware import SimulatedNiryo, protocol

EXAMPLES, DRAWN, VARIANTS = 100, 10, 5

numbers = st.one_of(
    st.integers(),
    st.floats(allow_nan=False),
    st.sampled_from([0, 1, -1, 10**309, -(10**400), 1e308, 1e999, 2**63, True, False, 1j]),
)
leaves = st.one_of(
    numbers,
    st.none(),
    st.text(max_size=8),
    st.binary(max_size=4),
    st.sampled_from(["TRUE", "FALSE", "AUTO", "X", "JOINTS", "POSE", "HIGH", "1A", "", "pose"]),
)
keys = st.one_of(
    st.sampled_from([*(f"joint_{i}" for i in range(7)), "obj_type", "metadata"]),
    st.sampled_from(["x", "y", "z", "roll", "pitch", "yaw"]),
    st.text(max_size=4),
)
values = st.recursive(
    leaves,
    lambda inner: st.one_of(
        st.lists(inner, max_size=7),
        st.dictionaries(keys, inner, max_size=8),
        st.tuples(inner),
    ),
    max_leaves=12,
)


def commands(sim: SimulatedNiryo) -> list[str]:
    return sorted(sim._server._interpreter._handlers)


@st.composite
def bodies(draw, names: list[str]) -> bytes:
    """Requests with odd parameters, requests with a part broken, and bytes."""
    kind = draw(st.sampled_from(["odd", "odd", "odd", "keys", "digits", "nested", "bytes"]))
    name = draw(st.sampled_from(names))
    match kind:
        case "odd":
            counts = st.sampled_from([0, 1, 1, 2, 2, 3, 4, 6, 6, 7])
            size = draw(counts)
            params = draw(st.lists(values, min_size=size, max_size=size))
            return repr({"command": name, "param_list": params}).encode(errors="replace")
        case "keys":
            message = draw(st.dictionaries(st.sampled_from(["command", "param_list", "x"]), values))
            return repr(message).encode(errors="replace")
        case "digits":
            text = b"9" * draw(st.integers(300, 6000))
            return b'{"command": "%s", "param_list": [%s]}' % (name.encode(), text)
        case "nested":
            depth = draw(st.integers(1, 3000))
            deep = b"[" * depth + b"]" * depth
            return b'{"command": "%s", "param_list": [%s]}' % (name.encode(), deep)
    return draw(st.binary(max_size=200))


def variants(body: bytes, rng: random.Random) -> list[bytes]:
    """Frames of a body as it is, and with a few of its bytes changed, left out or doubled."""
    frames = []
    for count in range(VARIANTS):
        changed = bytearray(body[:60000])
        for _ in range(count if changed else 0):
            place = rng.randrange(len(changed) or 1)
            changed[place : place + rng.choice((0, 1, 1, 2))] = rng.choice(
                (b"", bytes([rng.randrange(256)]), rng.choice((b"9", b"[", b"]", b"'", b",", b"-")))
            )
        frames.append(len(changed).to_bytes(2, "little") + bytes(changed))
    return frames


def send(sim: SimulatedNiryo, frames: list[bytes]) -> None:
    """Send frames, each once the one before was answered; a closed connection is opened again."""
    client = None
    for frame in frames:
        if client is None:
            client = socket.create_connection((sim.host, sim.port), 60.0)
        try:
            client.sendall(frame)
            head = client.recv(2, socket.MSG_WAITALL)
            if len(head) == 2:
                client.recv(int.from_bytes(head, "little"), socket.MSG_WAITALL)
                continue
        except ConnectionError:
            pass
        client.close()
        client = None
    if client is not None:
        client.close()


def is_well(sim: SimulatedNiryo) -> None:
    """A good client is served, and the arm stands somewhere."""
    with socket.create_connection((sim.host, sim.port), 60.0) as client:
        client.sendall(protocol.encode_frame(protocol.request("GET_JOINTS")))
        answer = protocol.parse_answer(
            protocol.read_frame(lambda size: client.recv(size, socket.MSG_WAITALL))
        )
    assert answer.ok
    assert np.all(np.isfinite(np.array(answer.values, dtype=float)))


@pytest.mark.filterwarnings("ignore::DeprecationWarning", "ignore::SyntaxWarning")
@pytest.mark.filterwarnings("ignore::RuntimeWarning")
@pytest.mark.parametrize("version", ["4.1.1", "5.6.3"])
def test_a_good_client_is_served_after_any_frames(version):
    with SimulatedNiryo(time_scale=1e9, version=version) as sim:
        sim.arm.calibrated = True
        names = commands(sim)

        @settings(
            max_examples=EXAMPLES,
            deadline=None,
            database=None,
            suppress_health_check=list(HealthCheck),
        )
        @given(st.data())
        def run(data) -> None:
            rng = random.Random(data.draw(st.integers(0, 2**32)))
            for body in data.draw(st.lists(bodies(names), min_size=DRAWN, max_size=DRAWN)):
                send(sim, variants(body, rng))
            is_well(sim)

        run()
        assert sim._thread.is_alive()


def test_clients_that_send_parts_of_frames_or_leave_do_not_stop_the_others():
    whole = protocol.encode_frame(protocol.request("GET_JOINTS"))
    with SimulatedNiryo() as sim:
        for cut in range(len(whole)):
            with socket.create_connection((sim.host, sim.port), 60.0) as client:
                client.sendall(whole[:cut])
            is_well(sim)
        for many in (1, 2, 3, 50):
            with socket.create_connection((sim.host, sim.port), 60.0) as client:
                client.sendall(whole * many)
        with contextlib.closing(socket.create_connection((sim.host, sim.port), 60.0)) as client:
            client.sendall(protocol.encode_frame(protocol.request("GET_POSE")))
            answered = set()
            while "GET_POSE" not in answered:
                body = protocol.read_frame(lambda size: client.recv(size, socket.MSG_WAITALL))
                answered.add(protocol.parse_answer(body).command)
            assert answered <= {"GET_JOINTS", "GET_POSE"}
