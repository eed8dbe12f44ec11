#!/usr/bin/python3 -IS
"""A device with its program, which keeps or breaks one promise of docs/build-a-rig/programs.md.

usage: helper.py CLASS FOLDER [FAULT]

FOLDER/hardware.json is the device. It stays as it is, or goes on moving, when the program ends.
"""
import json
import os
import select
import struct
import sys
import threading
import time

KIND, FOLDER = sys.argv[1:3]
FAULT = sys.argv[3] if len(sys.argv) > 3 else ""
HARDWARE = os.path.join(FOLDER, "hardware.json")
CRASHED = os.path.join(FOLDER, "runs")
CAPABILITIES = {"lamps": ["silence"], "axis": ["silence"], "camera": ["silence", "gain", "stop"]}
LAMPS = 3
output = threading.Lock()


def read_hardware():
    try:
        with open(HARDWARE, encoding="utf-8") as file:
            return json.load(file)
    except FileNotFoundError:
        return {
            "on": [False] * LAMPS,
            "from": 3.0,
            "to": 3.0,
            "since": 0,
            "speed": 1,
            "homed": False,
        }


def write_hardware(**changes):
    with open(HARDWARE + ".new", "w", encoding="utf-8") as file:
        json.dump(read_hardware() | changes, file)
    os.rename(HARDWARE + ".new", HARDWARE)


def send(message, version=True):
    with output:
        print(json.dumps(({"jsonrpc": "2.0"} if version else {}) | message), flush=True)


class Lamps:
    def open(self, params):
        if FAULT == "lights-at-open":
            write_hardware(on=[True] * LAMPS)
        return {} if FAULT == "no-number-of-lamps" else {"lamps": LAMPS}

    def switch(self, params):
        on = read_hardware()["on"]
        on[(params["index"] + (FAULT == "switches-neighbour")) % LAMPS] = params["on"]
        if FAULT == "switches-all":
            on = [params["on"]] * LAMPS
        write_hardware(on=on)

    def set(self, params):
        if FAULT == "ignores-off" and not params["on"]:
            return {}
        self.switch(params)
        return {}

    def stop(self, params):
        on = read_hardware()["on"]
        write_hardware(on=[False] + on[1:] if FAULT == "stops-one" else [False] * LAMPS)
        return {}

    def make_safe(self):
        write_hardware(on=[False] * LAMPS)

    def get(self, params):
        on = read_hardware()["on"]
        return {"on": on[1:] if FAULT == "short-get" else on}


class Axis:
    """It moves at a constant speed from one angle to another."""

    def open(self, params):
        if FAULT == "moves-at-open":
            self.go(50, 10)
        return {}

    def where(self):
        state = read_hardware()
        way = state["to"] - state["from"]
        gone = min((time.time() - state["since"]) * state["speed"], abs(way))
        return state["from"] + (gone if way > 0 else -gone), gone < abs(way)

    def go(self, to, speed):
        write_hardware(**{"from": self.where()[0], "to": to, "since": time.time(), "speed": speed})

    def move(self, params):
        if params.get("home"):
            write_hardware(homed=FAULT != "no-reference")
            self.go(2.0, params["speed_deg_s"])
        else:
            self.begun = time.time()
            self.go(params["deg"] + (FAULT == "misses") * 0.5, params["speed_deg_s"])
            if FAULT == "waits-for-the-end":
                while self.where()[1]:
                    time.sleep(0.01)
        return {}

    def stop(self, params):
        if FAULT != "moves-on":
            self.make_safe()
        return {}

    def make_safe(self):
        self.go(self.where()[0], 1)

    def get(self, params):
        deg, moving = self.where()
        if FAULT == "moving-late" and time.time() < getattr(self, "begun", 0) + 0.3:
            moving = False
        if FAULT == "moving-for-ever" and read_hardware()["from"] == read_hardware()["to"]:
            moving = hasattr(self, "begun") and time.time() < self.begun + 60
        return {
            "deg": str(deg) if FAULT == "text" else deg,
            "moving": moving,
            "homed": read_hardware()["homed"],
        }


class Camera:
    """Pictures of 8 × 6 pixels of 12 bits. The exposure runs in a thread of its own, and can be stopped."""

    def __init__(self):
        self.n = 0
        self.stopped = threading.Event()

    def open(self, params):
        size = {"width": 8, "height": 6, "cfa": "rgbg" if FAULT == "new-filter" else "mono"}
        times = {
            "min_exposure_us": 100,
            "max_exposure_us": 5000000,
            "trigger_ms": 5,
            "readout_ms": 50,
        }
        return size | times | {"bits": 12, "black_level": 64}

    def write(self, name):
        values = [64 + (self.n * 31 + i * 7) % 1000 for i in range(48)]
        if FAULT == "too-bright":
            values[9] = 4096
        if FAULT == "repeats-picture":
            values = list(range(48))
        data = struct.pack(">48H", *values)
        head = b"P5\n%d 6\n65535\n" % (9 if FAULT == "wider" else 8)
        with open(os.path.join(self.folder, name), "wb") as file:
            file.write(head + (data[:-6] if FAULT == "cut-off" else data))

    def trigger(self, request):
        params = request["params"]
        start_us = time.monotonic_ns() // 1000
        exposure_s = params["exposure_us"] / 1e6
        if FAULT == "exposes-half" and exposure_s < 0.5:
            exposure_s /= 2 if exposure_s > 0.1 else 1
        if FAULT == "exposed-early":
            send({"method": "exposed", "params": {}})
        given_up = self.stopped.wait(0 if FAULT == "answers-early" else exposure_s)
        failed = (
            (FAULT == "no-second-picture" and self.n == 1)
            or (FAULT == "no-gain" and params["gain_db"] != 0)
            or (FAULT == "no-picture-after-stop" and getattr(self, "dead", False))
        )
        if (given_up and FAULT != "picture-of-stop") or failed:
            self.dead = True
            send({"id": request["id"], "error": {"code": 1, "message": "there is no picture"}})
            return
        if FAULT not in ("answers-early", "exposes-half"):
            send({"method": "exposed", "params": {}})
        self.n += 1
        name = f"{self.n}.pgm"
        if FAULT != "no-file":
            self.write(name)
        if FAULT == "path":
            name = os.path.join(self.folder, name)
        number = 1 if FAULT == "repeats-number" else self.n
        if FAULT == "answers-early":  # by nearly the whole exposure, however long the file took
            start_us = time.monotonic_ns() // 1000
        if FAULT == "time-of-day":
            start_us = time.time_ns() // 1000
        if FAULT == "old-time":
            start_us -= 1000000
        result = {"file": name, "id": number, "exposure_start_us": start_us}
        send({"id": request["id"], "result": result})
        if FAULT == "exposed-twice":
            send({"method": "exposed", "params": {}})

    def stop(self, params):
        if FAULT == "no-answer-to-stop":
            return None
        self.stopped.set()
        return {}

    def make_safe(self):
        self.stopped.set()


device = {"lamps": Lamps, "axis": Axis, "camera": Camera}[KIND]()
METHODS = {"lamps": ["set", "stop", "get"], "axis": ["move", "stop", "get"], "camera": ["stop"]}[
    KIND
]


def hello(params):
    if KIND == "camera":
        device.folder = params["folder"]
    answer = {"version": 1, "class": KIND, "device": "a device", "capabilities": CAPABILITIES[KIND]}
    changes = {
        "version-2": {"version": 2},
        "other-class": {"class": "laser"},
        "capabilities-as-text": {"capabilities": "silence"},
        "serial-as-number": {"serial": 7},
    }
    return answer | changes.get(FAULT, {})


def answer(request):
    """Returns the result, or None if there is no answer."""
    method, params = request["method"], request["params"]
    if "colour" in params and FAULT == "strict":
        raise ValueError("what is colour?")
    if method == "hello":
        return hello(params)
    if method == "open":
        return device.open(params)
    if method == "ping":
        if FAULT == "late-ping":
            time.sleep(1.8)
        return {}
    if method == "close":
        if FAULT != "unsafe-at-close":
            device.make_safe()
        return {}
    if method not in METHODS:
        if FAULT == "dies-of-method":
            os._exit(3)
        if FAULT == "knows-everything":
            return {}
        raise ValueError("there is no such method")
    return getattr(device, method)(params)


def switch_later(request):
    time.sleep(0.2)
    device.switch(request["params"])
    send({"id": request["id"], "result": {}})


def serve(line):
    """Returns whether the program goes on."""
    try:
        request = json.loads(line)
    except ValueError:
        if FAULT == "dies-of-line":
            raise
        if FAULT != "silent-about-line":
            send({"id": None, "error": {"code": -32700, "message": "this is not JSON"}})
        return True
    if request["method"] == "trigger":
        device.stopped.clear()
        threading.Thread(target=device.trigger, args=[request], daemon=True).start()
        return True
    if request["method"] == "set" and FAULT == "switches-later":
        threading.Thread(target=switch_later, args=[request], daemon=True).start()
        return True
    try:
        result = answer(request)
    except ValueError as error:
        send({"id": request["id"], "error": {"code": 1, "message": str(error)}})
        return True
    if result is not None:
        number = 1 if FAULT == "counts-itself" else request["id"]
        for _ in range(1 + (FAULT == "answers-twice")):
            send({"id": number, "result": result}, FAULT != "no-jsonrpc")
    if request["method"] == "hello" and FAULT == "chatters":
        print("the device is ready", flush=True)
    if request["method"] == "open" and FAULT == "reports-loss":
        send({"method": "lost", "params": {"message": "the supply has failed"}})
    return request["method"] != "close" or FAULT == "stays-at-close"


def run():
    """Returns whether the device is to be made safe at the end."""
    silence_s = {"deaf-to-silence": 60, "impatient": 2}.get(FAULT, 10)
    unread = b""
    while True:
        if not select.select([0], [], [], silence_s)[0]:
            return FAULT != "unsafe-in-silence"
        read = os.read(0, 65536)
        if not read:
            if FAULT == "stays-at-end":
                time.sleep(60)
            return FAULT != "unsafe-at-end"
        *lines, unread = (unread + read).split(b"\n")
        if FAULT == "reads-one-line":
            lines = lines[:1]
        if FAULT == "stops-first":
            lines.sort(key=lambda line: b'"stop"' not in line)
        for line in lines:
            if not serve(line):
                return False


if FAULT == "floods":
    while True:
        sys.stdout.write("no JSON " * 1000 + "\n")
if FAULT == "closes-output":
    os.close(1)
    time.sleep(60)
if FAULT == "starts-once" and os.path.exists(CRASHED):
    os.unlink(CRASHED)
    sys.exit("another program has the device")
with open(CRASHED, "w", encoding="utf-8"):
    pass
if run():
    device.make_safe()
os.unlink(CRASHED)
os._exit(0)
