#!/usr/bin/env python3
"""A device with its program, for tests: docs/build-a-rig/programs.md has the protocol.

usage: model.py CLASS FOLDER [where]

FOLDER/hardware.json is the device. It stays as it is when the program ends, as the pin of a relay
does. FOLDER/fault is the fault of the program, which the test writes at any time; without the file
there is none. FOLDER/log has a line for each request that was read, and FOLDER/process says what the program may do.
With “where” the program prints where the axis truly is, and whether it moves.
"""
import json
import os
import random
import select
import struct
import sys
import time


class Hardware:
    """The state of the device, in a file."""

    def __init__(self, path, first):
        self.path = path
        if not os.path.exists(path):
            self.write(first)

    def read(self):
        with open(self.path, encoding="utf-8") as file:
            return json.load(file)

    def write(self, state):
        with open(self.path + ".new", "w", encoding="utf-8") as file:
            json.dump(state, file)
        os.rename(self.path + ".new", self.path)


class Lamps:
    def __init__(self, folder, fault):
        self.hardware = Hardware(os.path.join(folder, "hardware.json"), {"on": [False] * 4})
        self.fault = fault

    def open(self, params):
        return {"lamps": len(self.hardware.read()["on"])}

    def set(self, params):
        state = self.hardware.read()
        state["on"][params["index"]] = params["on"]
        self.hardware.write(state)

    def stop(self, params):
        self.hardware.write({"on": [False] * len(self.hardware.read()["on"])})

    def get(self, params):
        on = self.hardware.read()["on"]
        if self.fault() == "lies":
            on = [not lamp for lamp in on]
        return {"on": on[1:] if self.fault() == "short" else on}


class Axis:
    """An axis whose controller goes on by itself: its motion is a list of pieces, each with its
    start time, position, speed and acceleration, and the last one stands."""

    HOME_DEG = 2.0

    def __init__(self, folder, fault):
        first = {"pieces": [[0, 3.5, 0, 0]], "homed": False}
        self.hardware = Hardware(os.path.join(folder, "hardware.json"), first)
        self.fault = fault

    def open(self, params):
        return {}

    def where(self):
        now = time.monotonic()
        state = self.hardware.read()
        pieces = state["pieces"]
        last = max(i for i, piece in enumerate(pieces) if piece[0] <= now or i == 0)
        start, deg, speed, accel = pieces[last]
        t = now - start
        moving = last < len(pieces) - 1
        return deg + speed * t + accel * t * t / 2, speed + accel * t, moving, state["homed"]

    def go(self, to, params, homed):
        deg = self.where()[0]
        way = abs(to - deg)
        accel = params.get("accel_deg_s2", 100)
        speed = min(params.get("speed_deg_s", 20), (way * accel) ** 0.5)
        sign = 1 if to > deg else -1
        now = time.monotonic()
        pieces = [[now, deg, 0, sign * accel]]
        if way > 0:
            ramp = speed / accel
            cruise = way / speed - ramp
            at = deg + sign * speed * ramp / 2
            pieces.append([now + ramp, at, sign * speed, 0])
            at += sign * speed * cruise
            pieces.append([now + ramp + cruise, at, sign * speed, -sign * accel])
            now += 2 * ramp + cruise
        if self.fault() == "stalls":
            pieces = pieces[:1] + [[pieces[0][0] + 0.2, deg, 0, 0]]
        else:
            pieces.append([now, to, 0, 0])
        self.hardware.write({"pieces": pieces, "homed": homed})

    def move(self, params):
        if params.get("home"):
            self.go(self.HOME_DEG, params, self.fault() != "no-switch")
        else:
            self.go(params["deg"], params, True)

    def stop(self, params):
        deg, speed, moving, homed = self.where()
        if not moving or self.fault() == "moves-on":
            return
        now = time.monotonic()
        t = 0.05
        pieces = [[now, deg, speed, -speed / t], [now + t, deg + speed * t / 2, 0, 0]]
        self.hardware.write({"pieces": pieces, "homed": homed})

    def get(self, params):
        deg, speed, moving, homed = self.where()
        if self.fault() == "lies":
            deg += 1
        if self.fault() == "far":
            deg = 1e300
        if self.fault() == "no-number":
            deg = "thirty"
        return {"deg": deg, "moving": moving, "homed": homed and not moving}


class Camera:
    """Pictures of 8 × 6 pixels of 12 bits: the first is the exposure in µs, the others are noise, and
    are brighter while a lamp of the model in ../lamps is on."""

    WIDTH, HEIGHT = 8, 6

    def __init__(self, folder, fault):
        self.told = os.path.join(folder, "pictures")
        self.lamps = os.path.join(folder, "..", "lamps", "hardware.json")
        self.fault = fault
        self.n = 0
        self.noise = random.Random()
        self.last = b""

    def hello(self, params):
        self.folder = params["folder"]
        with open(self.told, "w", encoding="utf-8") as file:
            file.write(self.folder)

    def open(self, params):
        bits = 17 if self.fault() == "too-many-bits" else 12
        times = {"lists-times": [500, 1000, 2000], "no-times": [], "odd-times": [0.5]}
        listed = times.get(self.fault())
        return ({} if listed is None else {"exposures_us": listed}) | {
            "width": self.WIDTH,
            "height": self.HEIGHT,
            "cfa": "rgbg" if self.fault() == "new-filter" else "mono",
            "bits": bits,
            "black_level": 64,
            "min_exposure_us": 100,
            "max_exposure_us": 1000000,
            "trigger_ms": 5,
            "readout_ms": 50,
        }

    def stop(self, params):
        pass

    def is_lit(self):
        try:
            with open(self.lamps, encoding="utf-8") as file:
                return any(json.load(file)["on"])
        except FileNotFoundError:
            return False

    def write(self, name, exposure_us):
        fault = self.fault()
        width = self.WIDTH + (fault == "wider")
        base = 1064 if self.is_lit() else 64
        values = [exposure_us % 4096] + [
            base + self.noise.randrange(200) for _ in range(width * self.HEIGHT - 1)
        ]
        if fault == "too-bright":
            values[9] = 4096
        data = struct.pack(f">{len(values)}H", *values)
        if fault == "same" and self.last:
            data = self.last
        self.last = data
        head = b"P6" if fault == "colour" else b"P5"
        head += b"\n# a comment\n%d %d\n65535\n" % (width, self.HEIGHT)
        path = os.path.join(self.folder, name)
        if fault == "pipe":
            os.mkfifo(path)
            return
        if fault == "link":
            os.symlink("/etc/passwd", path)
            return
        with open(path, "wb") as file:
            file.write(head + (data[:-6] if fault == "cut-off" else data))
            if fault == "long":
                file.write(bytes(10000))

    def trigger(self, params):
        start_us = time.monotonic_ns() // 1000
        fault = self.fault()
        if fault != "early":
            time.sleep(params["exposure_us"] / 1e6)
        Program.current.send('{"jsonrpc":"2.0","method":"exposed","params":{}}')
        self.n += fault != "repeats"
        name = f"{self.n}.pgm"
        if fault == "leaves-a-copy":
            self.write("copy.pgm", params["exposure_us"])
        if fault == "names-the-copy":
            name = "copy.pgm"
        elif fault != "no-file":
            self.write(name, params["exposure_us"])
        places = {"outside": "../", "elsewhere": "pictures/../"}
        result = {"file": places.get(fault, "") + name, "id": self.n}
        if fault in ("", "late", "future", "unnumbered"):
            shift_us = {"late": -1000000, "future": 3000000}.get(fault, 0)
            result["exposure_start_us"] = start_us + shift_us
        if fault == "unnumbered":
            del result["id"]
        return result


CLASSES = {"lamps": Lamps, "axis": Axis, "camera": Camera}


class Program:
    def __init__(self, kind, folder):
        Program.current = self
        self.kind, self.folder = kind, folder
        self.device = CLASSES[kind](folder, self.fault)
        self.silence_s = 10
        self.late = []

    def fault(self):
        try:
            with open(os.path.join(self.folder, "fault"), encoding="utf-8") as file:
                return file.read()
        except FileNotFoundError:
            return ""

    def log(self, method):
        with open(os.path.join(self.folder, "log"), "a", encoding="utf-8") as file:
            file.write(f"{os.getpid()} {method}\n")

    def send(self, text):
        sys.stdout.write(text + "\n")
        sys.stdout.flush()

    def describe_process(self):
        with open("/proc/self/status", encoding="utf-8") as file:
            status = dict(line.rstrip("\n").split(":\t", 1) for line in file if ":\t" in line)
        state = {
            "rights": [status["NoNewPrivs"], int(status["CapEff"], 16), int(status["CapBnd"], 16)],
            "files": sorted(fd for fd in map(int, os.listdir("/proc/self/fd")) if fd < 100)[:-1],
            "variables": sorted(os.environ),
            "folder": os.getcwd(),
            "leads": os.getpgrp() == os.getpid() and os.getsid(0) != os.getpid(),
        }
        with open(os.path.join(self.folder, "process"), "w", encoding="utf-8") as file:
            json.dump(state, file, sort_keys=True)

    def hello(self, params):
        self.describe_process()
        self.silence_s = params["silence_ms"] / 1000
        return {
            "version": 2 if self.fault() == "newer" else 1,
            "class": "axes" if self.fault() == "other-class" else self.kind,
            "device": "model of a device",
            "serial": "7",
            "capabilities": ["silence"],
        }

    def answer(self, request):
        method, params = request["method"], request.get("params", {})
        if method == "hello":
            if self.kind == "camera":
                self.device.hello(params)
            return self.hello(params)
        if method in ("ping", "close"):
            return {}
        return getattr(self.device, method)(params) or {}

    def misbehave(self, fault, request):
        """Returns whether the request is done with."""
        method = request["method"]
        if fault == "cut" or (fault == "mute" and method != "hello"):
            return True
        if fault == "unanswered":
            self.answer(request)
            return True
        if fault == "dies" and method in ("set", "move", "trigger"):
            self.answer(request)
            os._exit(3)
        if fault == "dies-at-start":
            sys.exit("no device here")
        if fault == "crashes" and method != "hello":
            os.abort()
        if fault == "garbage":
            self.send('{"jsonrpc": "2.0", "id": 1, "resu')
            return True
        if fault == "cannot-read":
            self.send(
                '{"jsonrpc":"2.0","id":null,"error":{"code":-32700,"message":"this is not JSON"}}'
            )
            return True
        if fault == "deep":
            self.send('{"a":' + "[" * 60000)
            return True
        if fault == "huge":
            try:
                while True:
                    sys.stdout.write("[" * 4096)
            except BrokenPipeError:
                os._exit(1)
        if fault == "closes-output":
            os.close(1)
            time.sleep(3600)
        if fault == "refuses" and method in ("set", "move", "trigger"):
            self.send(
                json.dumps(
                    {
                        "jsonrpc": "2.0",
                        "id": request["id"],
                        "error": {"code": 1, "message": "the fuse has\nblown"},
                    }
                )
            )
            return True
        if fault == "chatters":
            for i in range(1000):
                self.send('{"jsonrpc": "2.0", "method": "weather", "params": {"rain": true}}')
                self.send(f'{{"jsonrpc": "2.0", "id": {100000 + i}, "result": {{}}}}')
        if fault == "waits-for-stop" and method in ("set", "stop"):
            self.late.append(request)
            if method == "set":
                return True
            for late in self.late[::-1]:
                self.send(json.dumps({"jsonrpc": "2.0", "id": late["id"], "result": {}}))
            self.late = []
            return True
        if fault == "sleeps" and method != "hello":
            time.sleep(3600)
        if fault == "slow" and method in ("set", "get", "stop"):
            time.sleep(0.3)
        return False

    def serve(self, request):
        self.log(request["method"])
        fault = self.fault()
        if self.misbehave(fault, request):
            return True
        result = self.answer(request)
        self.send(json.dumps({"jsonrpc": "2.0", "id": request["id"], "result": result}))
        if fault == "loses":
            self.send('{"jsonrpc":"2.0","method":"lost","params":{"message":"a fuse has blown"}}')
            os.unlink(os.path.join(self.folder, "fault"))
        return request["method"] != "close"

    def run(self):
        """Until the end of the input or silence: both mean that the device has to be made safe."""
        unread = b""
        while select.select([0], [], [], self.silence_s)[0]:
            read = os.read(0, 65536)
            if not read:
                break
            *lines, unread = (unread + read).split(b"\n")
            for line in lines:
                if not self.serve(json.loads(line)):
                    return
        if self.fault() != "stays":
            self.log("safe")
            self.device.stop({})


if sys.argv[3:] == ["where"]:
    print("%.4f %.4f" % Axis(sys.argv[2], str).where()[:2])
else:
    Program(*sys.argv[1:3]).run()
