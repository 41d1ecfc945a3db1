"""Parrot's own protocol stack as the drone: `python parrot_peer.py DISCOVERY_PORT`.

Prints a line of JSON for every command that Parrot's decoder has understood: when it came
(monotonic ns) and its text. Needs `olympe_deps` of the wheel `parrot-olympe` on `sys.path`:
`pip install parrot-olympe==8.5.0 --no-deps --target FOLDER`, then `JUNCNET_PARROT=FOLDER`.
"""

import ctypes
import importlib
import json
import math
import re
import sys
import time
from pathlib import Path
from typing import Any

from bebop_drone import EVENTS_S, Body
from juncnet_services.command_output.vehicles import arsdk

od: Any = importlib.import_module("olympe_deps")
LIBRARIES = Path(od.__file__).parent
KEPT: list[Any] = []
"""Callbacks and structures that C holds on to."""


def kept(thing: Any) -> Any:
    KEPT.append(thing)
    return thing


def callbacks(kind: Any, **functions: Any) -> Any:
    """Return a structure of callbacks; those that are not given do nothing."""
    made = kept(kind())
    for name, c_type in kind._fields_:
        if name in functions:
            setattr(made, name, kept(c_type(functions[name])))
        elif hasattr(c_type, "_restype_"):
            setattr(made, name, kept(c_type(nothing)))
    return made


def nothing(*_: Any) -> None:
    """Be called and do nothing."""


def tell(interface: Any, name: str, *values: Any) -> None:
    """Have Parrot's encoder make an event of `ardrone3.PilotingState` and its stack send it."""
    library = ctypes.CDLL(str(LIBRARIES / "libarsdkgen.so"))
    symbol = f"g_arsdk_cmd_desc_Ardrone3_PilotingState_{name}"
    description = od.struct_arsdk_cmd_desc.in_dll(library, symbol)
    made = od.struct_arsdk_cmd()
    made.buffer_type = -1  # as arsdk_cmd_init, which is inline: the description says which
    encode = ctypes.CDLL(str(LIBRARIES / "libarsdk.so")).arsdk_cmd_enc
    assert encode(ctypes.byref(made), ctypes.byref(description), *values) == 0
    nobody = od.arsdk_cmd_itf_cmd_send_status_cb_t()
    assert od.arsdk_cmd_itf_send(interface, ctypes.byref(made), nobody, None) == 0
    od.pomp_buffer_unref(made.buf)


class Flight:
    """A body that obeys what Parrot's decoder prints."""

    def __init__(self) -> None:
        self.body = Body()
        self.interface: Any = None
        self.at_s = self.told_s = time.monotonic()

    def received(self, _itf: Any, command: Any, _data: Any) -> None:
        text = ctypes.create_string_buffer(1024)
        od.arsdk_cmd_fmt(command, ctypes.cast(text, od.POINTER_T(ctypes.c_char)), len(text))
        line = text.value.decode()
        print(json.dumps({"at_ns": time.monotonic_ns(), "command": line}), flush=True)
        numbers = [int(n) for n in re.findall(r"=(-?\d+)", line)]
        before = self.body.state
        if "Piloting.PCMD" in line:
            self.body.told(arsdk.command(1, 0, 2, "BbbbbI", *numbers), time.monotonic())
        elif "Piloting.TakeOff" in line:
            self.body.told(arsdk.TAKE_OFF, time.monotonic())
        elif "Piloting.Landing" in line:
            self.body.told(arsdk.LANDING, time.monotonic())
        elif "Piloting.Emergency" in line:
            self.body.told(arsdk.EMERGENCY, time.monotonic())
        elif "Common.AllStates" in line:
            self.report()
        if self.body.state is not before:
            self.report()

    def report(self) -> None:
        tell(self.interface, "FlyingStateChanged", ctypes.c_int32(self.body.state))

    def fly(self) -> None:
        """Move on, and tell speed and attitude 5 times a second."""
        now_s, before = time.monotonic(), self.body.state
        self.body.step(now_s - self.at_s, now_s)
        self.at_s = now_s
        if self.interface is None:
            return
        if self.body.state is not before:
            self.report()
        if now_s - self.told_s >= EVENTS_S:
            self.told_s = now_s
            body = self.body
            speed = [ctypes.c_double(v) for v in (body.north_mps, body.east_mps, -body.up_mps)]
            tell(self.interface, "SpeedChanged", *speed)
            yaw = math.remainder(body.yaw_rad, math.tau)
            attitude = [ctypes.c_double(v) for v in (0, 0, yaw)]
            tell(self.interface, "AttitudeChanged", *attitude)


def main(port: int) -> None:
    flight = Flight()
    loop = od.pomp_loop_new()
    manager = od.POINTER_T(od.struct_arsdk_mngr)()
    assert od.arsdk_mngr_new(loop, ctypes.byref(manager)) == 0
    peers = callbacks(od.struct_arsdk_mngr_peer_cbs)
    od.arsdk_mngr_set_peer_cbs(manager, ctypes.byref(peers))
    config = kept(od.struct_arsdk_backend_net_cfg())
    config.stream_supported = 1
    config.proto_v_min = config.proto_v_max = 1
    net = od.POINTER_T(od.struct_arsdk_backend_net)()
    assert od.arsdk_backend_net_new(manager, ctypes.byref(config), ctypes.byref(net)) == 0
    commands = callbacks(od.struct_arsdk_cmd_itf_cbs, recv_cmd=flight.received)

    def connected(peer: Any, _info: Any, _data: Any) -> None:
        interface = kept(od.POINTER_T(od.struct_arsdk_cmd_itf)())
        od.arsdk_peer_create_cmd_itf(peer, ctypes.byref(commands), ctypes.byref(interface))
        flight.interface = interface
        print(json.dumps({"at_ns": time.monotonic_ns(), "command": "connected"}), flush=True)

    def disconnected(_peer: Any, _info: Any, _data: Any) -> None:
        flight.interface = None
        print(json.dumps({"at_ns": time.monotonic_ns(), "command": "disconnected"}), flush=True)

    connections = callbacks(
        od.struct_arsdk_peer_conn_cbs, connected=connected, disconnected=disconnected
    )
    accept = kept(od.struct_arsdk_peer_conn_cfg())
    empty = kept(ctypes.create_string_buffer(b"{}"))
    accept.json = ctypes.cast(empty, od.POINTER_T(ctypes.c_char))

    def asked(peer: Any, _info: Any, _data: Any) -> None:
        od.arsdk_peer_accept(peer, ctypes.byref(accept), ctypes.byref(connections), loop)

    listening = callbacks(od.struct_arsdk_backend_listen_cbs, conn_req=asked)
    assert od.arsdk_backend_net_start_listen(net, ctypes.byref(listening), port) == 0
    print(json.dumps({"at_ns": time.monotonic_ns(), "command": "listening"}), flush=True)
    while True:
        od.pomp_loop_wait_and_process(loop, 10)
        flight.fly()


if __name__ == "__main__":
    main(int(sys.argv[1]))
