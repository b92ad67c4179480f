#!/usr/bin/env python3
"""Prints the odometry of a flight on this computer, from its local socket (docs/local-socket.md). Needs nothing but Python.

    plumbline replay sim:room --speed 1 --set local.path=/tmp/plumbline
    python examples/read_local.py /tmp/plumbline
"""

import socket
import struct
import sys

HEADER = struct.Struct("<HHIQ")  # kind, version, length, sequence
ODOMETRY = struct.Struct("<qqQ3d4d3d3d45dIIIBbH")  # the layout of kind 16
HELLO, LOST, KIND_ODOMETRY, END = 1, 2, 16, 25
STATES = ["initialising", "tracking", "blind", "failed"]


def receive(flight, count):
    """Exactly so many bytes; b"" at the end of the stream."""
    data = b""
    while len(data) < count:
        piece = flight.recv(count - len(data))
        if not piece:
            return b""
        data += piece
    return data


def records(flight, kind):
    """Odometry as it comes, until the end of the flight."""
    # Request 1: these kinds alone. Without a request odometry and estimates come.
    flight.sendall(HEADER.pack(1, 1, 8, 1) + struct.pack("<Q", 1 << kind))
    while header := receive(flight, HEADER.size):
        came, _, length, _ = HEADER.unpack(header)
        content = receive(flight, length) if length else b""
        if came == HELLO and content[:8] != b"PLMBLCL1":
            sys.exit("not the local socket of a flight")
        elif came == LOST:
            print(f"lost {struct.unpack('<Q', content[:8])[0]}", flush=True)
        elif came == kind:
            # Later versions append fields.
            yield ODOMETRY.unpack(content[: ODOMETRY.size])
        elif came == END:
            return


def connected(usage):
    """The socket that the first argument names."""
    if len(sys.argv) < 2 or sys.argv[1] in ("-h", "--help"):
        print(usage.strip())
        sys.exit(0 if len(sys.argv) > 1 else 2)
    flight = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    try:
        flight.connect(sys.argv[1])
    except OSError as error:
        sys.exit(f"{sys.argv[1]}: {error.strerror or error}; is a flight running with local.path={sys.argv[1]}?")
    return flight


def main():
    flight = connected(__doc__)
    for o in records(flight, KIND_ODOMETRY):
        stamp_s, position, state, quality = o[0] * 1e-9, o[3:6], STATES[o[-3]], o[-2]
        print("%.3f s  %.3f %.3f %.3f m  %s  quality %d" % (stamp_s, *position, state, quality), flush=True)


if __name__ == "__main__":
    main()
