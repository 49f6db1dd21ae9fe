"""Two network namespaces and a wire between them that loses packets.

    unshare --net [--user --map-root-user] python lossy_link.py SHARE SEED

Runs in a namespace of its own, between the two. Prints `ready NEAR FAR`: processes in whose namespaces (`nsenter --net --target`) the addresses
198.51.100.1 and 198.51.100.2 are, on devices called `wire`. Of the packets in either direction SHARE is lost, by a generator with SEED. SIGUSR1 loses
all of them, until SIGUSR2. SIGTERM ends everything and prints `carried N lost M`. Where namespaces or raw sockets are not allowed it prints
`not allowed: WHY`.
"""

import array
import fcntl
import os
import random
import selectors
import signal
import socket
import struct
import subprocess
import sys
import time

ADDRESSES = ("198.51.100.1", "198.51.100.2")
LONGEST_PACKET = 65_536
SIOCETHTOOL = 0x8946
# Transmit checksums, scatter-gather, TCP segmentation, generic segmentation, generic receive offload: with any of them packets on the wire are
# longer than it takes, or unfinished.
OFFLOADS = (0x17, 0x19, 0x1F, 0x24, 0x2C)


def plain(device):
    """Makes a device send packets as a wire has them."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as any_socket:
        for number in OFFLOADS:
            value = array.array("B", struct.pack("II", number, 0))
            address, _ = value.buffer_info()
            request = bytearray(struct.pack("16sP16x", device.encode(), address))
            try:
                fcntl.ioctl(any_socket, SIOCETHTOOL, request)
            except OSError as error:
                # What a device does not have needs not be turned off.
                print(f"offload {number:#x} of {device}: {error}", file=sys.stderr)


class Namespace:
    """A network namespace that lives as long as this process."""

    def __init__(self):
        self.keeper = subprocess.Popen(["unshare", "--net", "cat"], stdin=subprocess.PIPE, stdout=subprocess.DEVNULL)
        own = os.readlink("/proc/self/ns/net")
        while os.readlink(f"/proc/{self.keeper.pid}/ns/net") == own:
            if self.keeper.poll() is not None:
                raise OSError("unshare --net ended")
            time.sleep(0.01)

    def run(self, *command):
        subprocess.run(["nsenter", f"--net=/proc/{self.keeper.pid}/ns/net", *command], check=True)


def lay_wire(name, namespace, address):
    """A cable from here to the namespace; returns this end as a socket of whole packets."""
    subprocess.run(["ip", "link", "add", name, "type", "veth", "peer", "name", "wire", "netns", str(namespace.keeper.pid)], check=True)
    namespace.run("ip", "addr", "add", f"{address}/24", "dev", "wire")
    namespace.run("ip", "link", "set", "lo", "up")
    namespace.run(sys.executable, __file__, "plain", "wire")
    plain(name)
    namespace.run("ip", "link", "set", "wire", "up")
    subprocess.run(["ip", "link", "set", name, "up"], check=True)
    # ETH_P_ALL
    end = socket.socket(socket.AF_PACKET, socket.SOCK_RAW, socket.htons(3))
    end.bind((name, 0))
    return end


class Wire:
    def __init__(self, share, seed):
        self.share, self.random = share, random.Random(seed)
        self.is_cut = self.is_over = False
        self.carried = self.lost = 0

    def carry(self, ends):
        """Carries packets until it is over."""
        ready = selectors.DefaultSelector()
        for here, there in (ends, ends[::-1]):
            ready.register(here, selectors.EVENT_READ, there)
        while not self.is_over:
            for key, _ in ready.select(0.1):
                packet, (_, _, kind, _, _) = key.fileobj.recvfrom(LONGEST_PACKET)
                if kind == socket.PACKET_OUTGOING:
                    continue
                if self.is_cut or self.random.random() < self.share:
                    self.lost += 1
                    continue
                try:
                    key.data.send(packet)
                    self.carried += 1
                except OSError as error:
                    print(f"a packet of {len(packet)} bytes: {error}", file=sys.stderr, flush=True)
                    self.lost += 1


def main():
    if sys.argv[1] == "plain":
        plain(sys.argv[2])
        return
    wire = Wire(float(sys.argv[1]), int(sys.argv[2]))
    signal.signal(signal.SIGUSR1, lambda *_: setattr(wire, "is_cut", True))
    signal.signal(signal.SIGUSR2, lambda *_: setattr(wire, "is_cut", False))
    signal.signal(signal.SIGTERM, lambda *_: setattr(wire, "is_over", True))
    try:
        spaces = [Namespace(), Namespace()]
        ends = [lay_wire(name, space, address) for name, space, address in zip(("near0", "far0"), spaces, ADDRESSES)]
    except (OSError, subprocess.CalledProcessError) as error:
        print(f"not allowed: {error}", flush=True)
        return
    print("ready", *(space.keeper.pid for space in spaces), flush=True)
    wire.carry(ends)
    for space in spaces:
        space.keeper.stdin.close()
        space.keeper.wait()
    print(f"carried {wire.carried} lost {wire.lost}", flush=True)


main()
