#!/usr/bin/python3
"""A camera of a Raspberry Pi, as a program for the driver program-camera: rpicam-still takes a raw
picture, and dcraw writes its values as PGM. Raspberry Pi OS has both (packages rpicam-apps, dcraw).
We have not tried it with a camera yet.

usage: rpicam.py WIDTH HEIGHT CFA BITS BLACK_LEVEL, for instance 4056 3040 bggr 12 256

docs/build-a-rig/programs.md describes the requests.
"""
import json
import os
import subprocess
import sys

width, height, cfa, bits, black_level = (a if a.isalpha() else int(a) for a in sys.argv[1:6])
count = 0


def trigger(params):
    global count
    count += 1
    shot = ["--shutter", str(params["exposure_us"]), "--gain", str(10 ** (params["gain_db"] / 20))]
    command = ["rpicam-still", "--raw", "--immediate", "--nopreview", "--output", "a.jpg"]
    run = {"check": True, "stdin": subprocess.DEVNULL, "cwd": folder}
    subprocess.run(command + shot, stdout=subprocess.DEVNULL, **run)
    with open(os.path.join(folder, "a.pgm"), "wb") as file:
        subprocess.run(["dcraw", "-D", "-4", "-c", "a.dng"], stdout=file, **run)
    return {"file": "a.pgm", "id": count}


for line in sys.stdin:
    reply = {"jsonrpc": "2.0", "id": None}
    try:
        request = json.loads(line)
        reply["id"], result = request["id"], {}
        method, params = request["method"], request["params"]
        if method == "hello":
            folder = params["folder"]
            result |= {"version": 1, "class": "camera", "capabilities": ["gain"]}
        elif method == "open":
            result |= {"width": width, "height": height, "cfa": cfa, "bits": bits}
            result |= {"black_level": black_level, "trigger_ms": 1500, "readout_ms": 1500}
            result |= {"min_exposure_us": 100, "max_exposure_us": 10000000}
        elif method == "trigger":
            result |= trigger(params)
        elif method not in ("ping", "close"):
            raise ValueError(f"there is no method {method}")
        reply["result"] = result
    except (OSError, LookupError, TypeError, ValueError, subprocess.CalledProcessError) as error:
        reply["error"] = {"code": 1, "message": str(error)}
    print(json.dumps(reply), flush=True)
    if "result" in reply and method == "close":
        break
