#!/usr/bin/env python3
"""Attacks a worker over raw HTTP/2 and gRPC, one after the other, and checks that its resident memory
stays below the figure that it was started with, that it answers and gives most of it back
afterwards, and that it lives.

Usage: attacks.py [--tls FOLDER] WORKER_PROGRAM [ATTACK...]. FOLDER has the certificates of
deploy/make-test-ca.sh, to attack by TLS. Prints one line per attack: name, memory before, at its peak
and afterwards, what was seen.
"""

import os
import random
import signal
import socket
import ssl
import struct
import subprocess
import sys
import threading
import time

import grpc

LIMIT_MB = 512
METHOD = "/itn.v1.RenderService/RenderGrad"
CAPABILITIES = "/itn.v1.RenderService/GetCapabilities"


# ---- Messages, without generated code ----------------------------------------------------------

def varint(value):
    out = b""
    while value > 127:
        out += bytes([value & 127 | 128])
        value >>= 7
    return out + bytes([value])


def field(number, value):
    if isinstance(value, bytes):
        return varint(number << 3 | 2) + varint(len(value)) + value
    if isinstance(value, float):
        return varint(number << 3 | 1) + struct.pack("<d", value)
    return varint(number << 3) + varint(value)


def vector(x=0.0, y=0.0, z=0.0):
    return b"".join(varint(i << 3 | 5) + struct.pack("<f", v) for i, v in ((1, x), (2, y), (3, z)))


def scene(width=16, height=16, extra=b""):
    mesh = field(3, b"cube")
    camera = (field(1, vector(0, 1.5, -4)) + field(2, vector(0, 0.5, 0)) +
              varint(4 << 3 | 5) + struct.pack("<f", 22))
    return (field(1, field(1, mesh)) + field(3, field(3, b"")) + field(4, camera) +
            field(5, field(1, width) + field(2, height)) + extra)


def request(scene_bytes, sigma_t=8.0, albedo=0.9, spp=1, extra=b""):
    material = field(1, sigma_t) + field(2, albedo)
    return field(1, scene_bytes) + field(3, material) + field(4, spp) + extra


# ---- The worker --------------------------------------------------------------------------------

class Worker:
    def __init__(self, program, *flags, tls=None, preexec=None):
        self.tls = tls
        if tls:
            flags += ("--tls-cert", f"{tls}/server.pem", "--tls-key", f"{tls}/server.key")
        self.process = subprocess.Popen(
            [program, "--listen", "127.0.0.1:0", "--log-level", "error", *flags],
            stdout=subprocess.PIPE, text=True, preexec_fn=preexec)
        self.address = self.process.stdout.readline().strip()
        self.host, port = self.address.rsplit(":", 1)
        self.port = int(port)
        self.peak = 0
        self.watching = True
        self.watcher = threading.Thread(target=self.watch, daemon=True)
        self.watcher.start()

    def resident_mb(self):
        try:
            with open(f"/proc/{self.process.pid}/statm", encoding="ascii") as file:
                return int(file.read().split()[1]) * os.sysconf("SC_PAGESIZE") / 2**20
        except (OSError, IndexError):
            return 0

    def watch(self):
        while self.watching:
            self.peak = max(self.peak, self.resident_mb())
            time.sleep(0.005)

    def authority(self):
        return f"{self.tls}/ca.pem"

    def channel(self):
        options = [
            ("grpc.max_receive_message_length", -1), ("grpc.max_send_message_length", -1),
            ("grpc.use_local_subchannel_pool", 1), ("grpc.enable_retries", 0)]
        if not self.tls:
            return grpc.insecure_channel(self.address, options=options)
        with open(self.authority(), "rb") as file:
            return grpc.secure_channel(self.address, grpc.ssl_channel_credentials(file.read()), options=options)

    def alive(self):
        return self.process.poll() is None

    def answers(self, within=60):
        """Whether it renders, and how long that took to be so."""
        begin = time.monotonic()
        while time.monotonic() - begin < within:
            with self.channel() as channel:
                try:
                    call(channel, request(scene()), timeout=10)
                    return time.monotonic() - begin
                except grpc.RpcError:
                    time.sleep(0.05)
        return None

    def returned_memory(self, within=60):
        """Whether what was taken goes back to the system."""
        end = time.monotonic() + within
        while self.resident_mb() > LIMIT_MB / 2 and time.monotonic() < end:
            time.sleep(0.05)
        return self.resident_mb() <= LIMIT_MB / 2

    def end(self):
        self.watching = False
        self.process.send_signal(signal.SIGKILL)
        self.process.wait()


def call(channel, message, method=METHOD, timeout=60, **kwargs):
    return channel.unary_unary(method)(message, timeout=timeout, **kwargs)


def status_of(channel, message, **kwargs):
    try:
        call(channel, message, **kwargs)
        return "OK"
    except grpc.RpcError as error:
        return error.code().name


def count(names):
    return ", ".join(f"{names.count(name)} {name}" for name in sorted(set(names)))


# ---- Raw HTTP/2 --------------------------------------------------------------------------------

PREFACE = b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n"
DATA, HEADERS, RST_STREAM, SETTINGS, WINDOW_UPDATE, CONTINUATION = 0, 1, 3, 4, 8, 9


def frame(kind, flags, stream, payload=b""):
    return struct.pack(">I", len(payload))[1:] + bytes([kind, flags]) + struct.pack(">I", stream) + payload


def literal(name, value):
    return b"\x00" + bytes([len(name)]) + name + bytes([len(value)]) + value


def headers(path=METHOD):
    return (b"\x83\x86" + literal(b":path", path.encode()) + literal(b":authority", b"a") +
            literal(b"te", b"trailers") + literal(b"content-type", b"application/grpc"))


def connection(worker, settings=b""):
    s = socket.create_connection((worker.host, worker.port))
    s.settimeout(5)
    if worker.tls:
        context = ssl.create_default_context(cafile=worker.authority())
        context.set_alpn_protocols(["h2"])
        s = context.wrap_socket(s, server_hostname=worker.host)
    s.sendall(PREFACE + frame(SETTINGS, 0, 0, settings))
    return s


def drain_input(s):
    """Reads and forgets, on a thread, until the connection ends."""
    def read():
        try:
            while s.recv(1 << 16):
                pass
        except OSError:
            pass
    threading.Thread(target=read, daemon=True).start()


def send(s, data, seconds):
    """As much of the repeated data as goes through in a time; bytes."""
    sent, end = 0, time.monotonic() + seconds
    try:
        while time.monotonic() < end:
            sent += s.send(data)
    except OSError:
        pass
    return sent


# ---- Attacks -----------------------------------------------------------------------------------

def unread_replies(worker):
    """Replies of many megabytes to requests of a hundred bytes, and nobody reads them."""
    message = request(scene(1024, 1024), extra=field(8, 1))
    body = b"\x00" + struct.pack(">I", len(message)) + message
    sockets = []
    for _ in range(8):
        s = connection(worker, struct.pack(">HI", 4, 0))  # initial window: 0
        for i in range(4):
            s.sendall(frame(HEADERS, 4, 2 * i + 1, headers()) + frame(DATA, 1, 2 * i + 1, body))
        sockets.append(s)
    time.sleep(6)
    for s in sockets:
        s.close()
    return "32 replies asked for"


def upload(s, size):
    """Sends a message but for its last byte, as fast as the server's windows allow; bytes."""
    windows = {0: 65535, 1: 65535}
    data = struct.pack(">BI", 0, size) + bytes(size - 1)
    at, received = 0, b""
    s.settimeout(1)
    try:
        while at < len(data):
            room = min(windows[0], windows[1], 16384, len(data) - at)
            if room > 0:
                s.sendall(frame(DATA, 0, 1, data[at:at + room]))
                at += room
                windows = {stream: window - room for stream, window in windows.items()}
                continue
            chunk = s.recv(1 << 16)
            if not chunk:
                break
            received += chunk
            while len(received) >= 9:
                length, kind = int.from_bytes(received[:3], "big"), received[3]
                stream = int.from_bytes(received[5:9], "big")
                if len(received) < 9 + length:
                    break
                payload, received = received[9:9 + length], received[9 + length:]
                if kind == WINDOW_UPDATE and stream in windows:
                    windows[stream] += int.from_bytes(payload, "big")
                elif kind == SETTINGS and payload:
                    s.sendall(frame(SETTINGS, 1, 0))
                    for i in range(0, len(payload), 6):
                        name, value = struct.unpack(">HI", payload[i:i + 6])
                        if name == 4:  # initial window of streams
                            windows[1] += value - 65535
    except OSError:
        pass
    return at


def stalled_uploads(worker):
    """Large messages, sent but for their last byte."""
    sockets, sent = [], 0
    for _ in range(24):
        s = connection(worker)
        s.sendall(frame(HEADERS, 4, 1, headers()))
        sent += upload(s, 30 << 20)
        sockets.append(s)
    for s in sockets:
        s.close()
    return f"{sent >> 20} MiB sent"


def amplification(worker):
    """Two bytes that become a submessage, a million times; unknown fields; groups."""
    seen = []
    with worker.channel() as channel:
        for unit in (b"\x12\x00", b"\x1a\x00", b"\xf8\x3f\x01", b"\xfb\x3f\xfc\x3f", b"\x0a\x04\x0a\x02\x2a\x00"):
            data = unit * (20_000_000 // len(unit))
            seen.append(status_of(channel, request(scene(extra=data))))
            for method in (METHOD, CAPABILITIES):
                seen.append(status_of(channel, data, method=method))
    return count(seen)


def gzip_bomb(worker):
    """Half a megabyte that becomes six hundred."""
    seen = []
    with worker.channel() as channel:
        for _ in range(3):
            seen.append(status_of(channel, field(1, bytes(600 << 20)), compression=grpc.Compression.Gzip))
    return count(seen)


def endless_headers(worker):
    """A block of headers that does not end, and one header that does not."""
    total = 0
    for first in (literal(b"a", b"b" * 100), b"\x00\x01a\x7f\xff\xff\xff\x7f"):
        s = connection(worker)
        drain_input(s)
        try:
            s.sendall(frame(HEADERS, 0, 1, headers() + first))
            filler = literal(b"a", b"b" * 100) * 150
            total += send(s, frame(CONTINUATION, 0, 1, filler), 3)
        except OSError:
            pass
        s.close()
    return f"{total >> 20} MiB sent"


def rapid_reset(worker):
    """Calls that are begun and reset at once."""
    total = 0
    for _ in range(2):
        s = connection(worker)
        drain_input(s)
        block, end = headers(), time.monotonic() + 3
        stream = 1
        try:
            while time.monotonic() < end:
                data = b""
                for _ in range(200):
                    data += frame(HEADERS, 4, stream, block) + frame(RST_STREAM, 0, stream, b"\0\0\0\x08")
                    stream += 2
                s.sendall(data)
                total += 200
        except OSError:
            pass
        s.close()
    return f"{total} calls"


def many_connections(worker):
    """More connections than there may be."""
    sockets = []
    try:
        for _ in range(1500):
            sockets.append(connection(worker))
    except OSError:
        pass
    for s in sockets:
        s.close()
    return f"{len(sockets)} connections"


def silent_connections(worker):
    """As many connections as there may be, on which nothing is said: they are closed after a while."""
    sockets = [socket.create_connection((worker.host, worker.port)) for _ in range(1024)]
    begin = time.monotonic()
    closed = 0
    for s in sockets:
        s.settimeout(max(0.01, begin + 60 - time.monotonic()))
        try:
            while s.recv(1 << 16):
                pass
            closed += 1
        except ConnectionError:
            closed += 1
        except OSError:
            pass
    took = time.monotonic() - begin
    for s in sockets:
        s.close()
    if closed < len(sockets):
        raise AssertionError(f"{len(sockets) - closed} silent connections are still open")
    return f"{closed} connections closed within {took:.0f} s"


def large_renders(worker):
    """What is refused because it would take too much memory, or too much at a time."""
    seen = []
    with worker.channel() as channel:
        for width, extra in ((4096, field(8, 16)), (4000, field(8, 4)), (2000, b""), (16384, b"")):
            seen.append(status_of(channel, request(scene(width, width), spp=16, extra=extra), timeout=20))
        stream = channel.unary_unary(METHOD)
        calls = [stream.future(request(scene(1000, 1000)), timeout=20) for _ in range(40)]
        for c in calls:
            try:
                c.result()
                seen.append("OK")
            except grpc.RpcError as error:
                seen.append(error.code().name)
    return count(seen)


def mutated(worker, number=2000, seed=1):
    """Requests with bytes changed, removed, repeated."""
    rng = random.Random(seed)
    seen = []
    base = [request(scene(), extra=field(8, 1)),
            request(scene(extra=field(2, field(1, field(2, vector(20)) + field(3, vector(0, 0, -20)))))),
            request(scene(8, 8), extra=field(9, 1) + field(7, 1))]
    with worker.channel() as channel:
        pending = []
        stream = channel.unary_unary(METHOD)
        for _ in range(number):
            data = bytearray(rng.choice(base))
            for _ in range(rng.choice((1, 1, 2, 5))):
                at = rng.randrange(len(data))
                kind = rng.randrange(4)
                if kind == 0:
                    data[at] = rng.randrange(256)
                elif kind == 1:
                    del data[at:at + rng.randrange(1, 8)]
                elif kind == 2:
                    data[at:at] = data[at:at + rng.randrange(1, 40)]
                else:
                    data[at:at] = rng.randbytes(rng.randrange(1, 8))
                if not data:
                    data = bytearray(b"\0")
            pending.append(stream.future(bytes(data), timeout=2))
            if len(pending) == 8:
                for p in pending:
                    seen.append(p.code().name)
                pending = []
    return count(seen)


ATTACKS = (unread_replies, stalled_uploads, amplification, gzip_bomb, endless_headers, rapid_reset,
           many_connections, silent_connections, large_renders, mutated)


def main():
    arguments = sys.argv[1:]
    tls = None
    if arguments[0] == "--tls":
        tls, arguments = arguments[1], arguments[2:]
    program, names = arguments[0], arguments[1:]
    failed = False
    for attack in ATTACKS:
        if names and attack.__name__ not in names:
            continue
        worker = Worker(program, "--max-memory-mb", str(LIMIT_MB), "--threads", "1", "--max-seconds", "5",
                        tls=tls)
        before = worker.resident_mb()
        seen = attack(worker)
        peak = worker.peak
        took = worker.answers() if worker.alive() else None
        good = peak <= LIMIT_MB and took is not None and worker.returned_memory() and worker.alive()
        failed |= not good
        print(f"{'ok' if good else 'FAILED'} {attack.__name__}: {before:.0f} MiB before, at most {peak:.0f} of "
              f"{LIMIT_MB}; {seen}; answers after "
              f"{'never' if took is None else f'{took:.1f} s'}; {worker.resident_mb():.0f} MiB then",
              flush=True)
        worker.end()
    sys.exit(1 if failed else 0)


if __name__ == "__main__":
    main()
