#!/usr/bin/python3
"""A lamp on a pin of the computer, as a program for the driver program-lamps.

usage: gpio-lamp.py VALUE_FILE, for instance /sys/class/gpio/gpio17/value

docs/build-a-rig/programs.md describes the requests. The pin must be low when the lamp is off.
"""
import json
import signal
import sys

path = sys.argv[1]


def switch(on):
    with open(path, "w", encoding="ascii") as file:
        file.write("1" if on else "0")


def make_safe(*unused):
    switch(False)
    sys.exit()


def answer(method, params):
    if method == "hello":
        device = f"lamp on {path}"
        return {"version": 1, "class": "lamps", "device": device, "capabilities": ["silence"]}
    if method == "open":
        return {"lamps": 1}
    if method == "set":
        switch(params["on"])
    if method in ("stop", "close"):
        switch(False)
    if method == "get":
        with open(path, encoding="ascii") as file:
            return {"on": [file.read().strip() == "1"]}
    if method not in ("set", "stop", "ping", "close"):
        raise ValueError(f"there is no method {method}")
    return {}


signal.signal(signal.SIGALRM, make_safe)
for line in sys.stdin:
    signal.alarm(10)  # no request for ten seconds: the lamp goes off
    reply = {"jsonrpc": "2.0", "id": None}
    try:
        request = json.loads(line)
        reply["id"] = request["id"]
        reply["result"] = answer(request["method"], request["params"])
    except (OSError, LookupError, TypeError, ValueError) as error:
        reply["error"] = {"code": 1, "message": str(error)}
    print(json.dumps(reply), flush=True)
    if "result" in reply and request["method"] == "close":
        break
make_safe()  # the end of the input: mesorigd has closed the lamp, or has ended
