#!/usr/bin/env python3
"""Passes its input to a socket, and what comes from there to its output: the program of a replayed
device (sim/virtual/replay/replay.h).

usage: pipe.py SOCKET
"""
import os
import select
import socket
import sys

with socket.socket(socket.AF_UNIX) as wire:
    wire.connect(sys.argv[1])
    while True:
        ready, _, _ = select.select([0, wire], [], [])
        data = os.read(0, 65536) if 0 in ready else None
        if data == b"":
            break
        if data:
            wire.sendall(data)
        if wire in ready:
            data = wire.recv(65536)
            if not data:
                break
            os.write(1, data)
