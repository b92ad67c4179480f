"""A bad radio link between two network namespaces, in user space: for kernels without netem.

    bad_link.py SEED LOSS DELAY_MS JITTER_MS RATE_KBIT NS_A ADDRESS_A NS_B ADDRESS_B

Makes a TUN device `radio` in each namespace and carries packets between them: each is lost with probability
LOSS, serialized at RATE_KBIT (a queue of half a second in front, full it drops), and arrives after DELAY_MS
plus or minus JITTER_MS, never overtaking another. The seed makes losses and jitter the same every time. The
kernel's tbf could do the rate alone. Reads commands from standard input: `down`, `up`, `end`; prints `ready`
when packets can flow, and counts at the end.
"""

import ctypes
import fcntl
import heapq
import os
import random
import select
import struct
import subprocess
import sys
import time

TUNSETIFF = 0x400454CA
IFF_TUN, IFF_NO_PI = 0x0001, 0x1000
CLONE_NEWNET = 0x40000000
QUEUE_S = 0.5


def open_tun(namespace, address, peer):
    """A TUN device in a namespace, up and with an address."""
    with open(f"/run/netns/{namespace}") as netns, open("/proc/self/ns/net") as home:
        libc = ctypes.CDLL(None, use_errno=True)
        if libc.setns(netns.fileno(), CLONE_NEWNET) != 0:
            raise OSError(ctypes.get_errno(), f"cannot enter {namespace}")
        try:
            tun = os.open("/dev/net/tun", os.O_RDWR | os.O_NONBLOCK)
            fcntl.ioctl(tun, TUNSETIFF, struct.pack("16sH", b"radio", IFF_TUN | IFF_NO_PI))
        finally:
            libc.setns(home.fileno(), CLONE_NEWNET)
    for command in (f"addr add {address} peer {peer} dev radio", "link set radio mtu 1400 up"):
        subprocess.run(["ip", "-n", namespace, *command.split()], check=True)
    return tun


class Way:
    """One direction."""

    def __init__(self, seed, loss, delay_s, jitter_s, rate_bps, out):
        self.random = random.Random(seed)
        self.loss, self.delay_s, self.jitter_s, self.rate_bps, self.out = loss, delay_s, jitter_s, rate_bps, out
        self.free_at = self.last = 0.0
        self.packets = []
        self.sent = self.lost = self.overflowed = self.count = 0

    def take(self, packet, now):
        self.count += 1
        is_lost = self.random.random() < self.loss
        jitter_s = self.random.uniform(-self.jitter_s, self.jitter_s)
        start = max(now, self.free_at)
        if start - now > QUEUE_S:
            self.overflowed += 1
            return
        self.free_at = start + 8 * len(packet) / self.rate_bps
        if is_lost:
            self.lost += 1
            return
        self.last = max(self.last, self.free_at + self.delay_s + jitter_s)
        heapq.heappush(self.packets, (self.last, self.count, packet))

    def deliver(self, now):
        while self.packets and self.packets[0][0] <= now:
            _, _, packet = heapq.heappop(self.packets)
            try:
                os.write(self.out, packet)
                self.sent += 1
            except OSError:
                self.lost += 1


def main():
    seed, loss, delay_ms, jitter_ms, rate_kbit = (float(x) for x in sys.argv[1:6])
    ns_a, address_a, ns_b, address_b = sys.argv[6:10]
    tun_a, tun_b = open_tun(ns_a, address_a, address_b), open_tun(ns_b, address_b, address_a)
    link = (loss, delay_ms * 1e-3, jitter_ms * 1e-3, rate_kbit * 1e3)
    ways = {tun_a: Way(seed, *link, tun_b), tun_b: Way(seed + 1, *link, tun_a)}
    is_up = True
    print("ready", flush=True)
    while True:
        now = time.monotonic()
        due = min((way.packets[0][0] for way in ways.values() if way.packets), default=now + 0.05)
        readable, _, _ = select.select([tun_a, tun_b, sys.stdin], [], [], max(0.0, min(due - now, 0.05)))
        now = time.monotonic()
        if sys.stdin in readable:
            command = sys.stdin.readline().strip()
            if command in ("end", ""):
                break
            is_up = command == "up"
            print(command, flush=True)
        for tun, way in ways.items():
            if tun in readable:
                try:
                    while True:
                        packet = os.read(tun, 2048)
                        if is_up:
                            way.take(packet, now)
                except BlockingIOError:
                    pass
            if is_up:
                way.deliver(now)
            else:
                way.packets.clear()
    for name, way in zip("ab", ways.values()):
        print(f"{name}: sent {way.sent} lost {way.lost} overflowed {way.overflowed}", flush=True)


if __name__ == "__main__":
    main()
