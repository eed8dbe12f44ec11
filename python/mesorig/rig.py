"""A rig that is shown by mesorig-web: its state, events and pictures, and commands.

    rig = mesorig.Rig("http://rig.lab:8470", token=open("token").read().strip())
    print(rig.state()["doing"])
    for name, value in rig.events():
        ...

GET /api/v1/openapi.json describes every answer. The answers are returned as they are in JSON.
"""

from __future__ import annotations

import json
import urllib.error
import urllib.parse
import urllib.request
from typing import Any, Dict, Iterator, List, Optional, Sequence, Tuple, Union

from ._error import Error


class Rig:
    """The HTTP interface of mesorig-web. Every call raises Error with the server's sentence if the server refuses, or
    if it does not answer within timeout_s."""

    def __init__(
        self,
        url: str = "http://127.0.0.1:8470",
        token: Optional[str] = None,
        timeout_s: float = 90,
    ) -> None:
        self._api = urllib.parse.urljoin(url if url.endswith("/") else url + "/", "api/v1/")
        self._headers = {"Authorization": "Bearer " + token} if token else {}
        self._timeout_s = timeout_s

    def _open(self, path: str, method: str = "GET", timeout_s: Optional[float] = None) -> Any:
        request = urllib.request.Request(self._api + path, method=method, headers=self._headers)
        try:
            return urllib.request.urlopen(request, timeout=timeout_s or self._timeout_s)
        except urllib.error.HTTPError as refused:
            with refused:
                text = refused.read().decode("utf-8", "replace")
            try:
                why = json.loads(text)["error"]
            except (ValueError, KeyError, TypeError):
                why = "%d %s" % (refused.code, refused.reason)
            raise Error("%s: %s" % (self._api + path, why)) from None
        except OSError as error:
            raise Error(
                "%s does not answer: %s; is mesorig-web running?" % (self._api, error)
            ) from None

    def _json(self, path: str, method: str = "GET") -> Any:
        with self._open(path, method) as answer:
            return json.load(answer)

    def state(self) -> Dict[str, Any]:
        """State of the rig and of its capture, such as state, shots_done, left_s, unsafe and devices."""
        return self._json("state")

    def log(self) -> List[Dict[str, Any]]:
        """The last 200 events: time (seconds since 1970), level, source and message."""
        return self._json("log")

    def progress(self) -> Tuple[List[float], List[int]]:
        """Times on the rig's clock in seconds, and the number of shots done at these times."""
        answer = self._json("progress")
        return answer["elapsed_s"], answer["shots"]

    def picture(self, camera: str) -> bytes:
        """The latest picture of a camera in 8 bits, brightness adjusted, as a PNG file."""
        with self._open("cameras/%s.png" % urllib.parse.quote(camera, safe="")) as answer:
            return answer.read()

    def picture_values(self, camera: str) -> Dict[str, Any]:
        """Of that picture: width, height, time_s, shares of white and black pixels, and a histogram."""
        return self._json("cameras/%s.json" % urllib.parse.quote(camera, safe=""))

    def material(self) -> Dict[str, Any]:
        """The material so far of the session that is captured: directions of views and lights, which pairs are measured,
        and the expected errors of the others."""
        return self._json("material")

    def material_picture(self, pair: int) -> bytes:
        """The picture of the pair view · number of lights + light, measured or predicted: height × width texels of 4
        bytes, as docs/operate/web.md describes them."""
        with self._open("material/%d" % pair) as answer:
            return answer.read()

    def events(self) -> Iterator[Tuple[str, Dict[str, Any]]]:
        """Waits for news without end: ("state", state), ("event", event), ("picture", {"camera": name}) and
        ("material", news of material()). The server
        sends a line every 20 s at the latest; the iterator raises Error if none comes for a minute.
        """
        name = ""
        with self._open("events", timeout_s=60) as stream:
            try:
                for line in stream:
                    key, _, value = line.decode().rstrip("\n").partition(": ")
                    if key == "event":
                        name = value
                    elif key == "data":
                        yield name, json.loads(value)
            except OSError as error:
                raise Error("%sevents has ended: %s" % (self._api, error)) from None

    def safe(self) -> Dict[str, Any]:
        """Switches lamps and lasers off and stops all axes, until release(). Returns safe, which is true if every
        device was read back, and devices."""
        return self._json("safe", "POST")

    def release(self) -> None:
        """Allows light and movement again after safe()."""
        self._json("release", "POST")

    def pause(self) -> None:
        """Pauses the capture after the shot under way."""
        self._json("pause", "POST")

    def resume(self) -> None:
        """Continues after a pause or a fault, and says that what the prompt asks for is done."""
        self._json("continue", "POST")

    def finish(self) -> None:
        """Ends the capture as good enough. The remaining shots are left out."""
        self._json("finish", "POST")

    def abort(self) -> None:
        """Ends the capture now. It can be resumed."""
        self._json("abort", "POST")

    def files(self) -> List[Dict[str, Any]]:
        """The session files of the server's folder (--sessions): name, bytes and changed (seconds since 1970)."""
        return self._json("files")["files"]

    def sessions(self) -> List[Dict[str, Any]]:
        """The session directories of that folder: name and changed."""
        return self._json("sessions")["sessions"]

    def _command(self, path: Tuple[str, ...], **query: Any) -> Dict[str, Any]:
        place = "/".join(urllib.parse.quote(part, safe="") for part in path)
        given = {
            key: int(value) if isinstance(value, bool) else value
            for key, value in query.items()
            if value is not None
        }
        return self._json(place + "?" + urllib.parse.urlencode(given), "POST")

    def plan(
        self, file: str, session: Optional[str] = None, calibration: Optional[str] = None
    ) -> Dict[str, Any]:
        """Checks a session file. Returns ok, report (the plan, or all mistakes) and plan, with predicted_s, bytes and
        more. session is the name of the session directory; by default that of the file. calibration is the name of a
        calibration of the folder; by default that of the rig file."""
        return self._command(("files", file, "plan"), session=session, calibration=calibration)

    def start(
        self,
        file: str,
        session: Optional[str] = None,
        process: bool = False,
        calibration: Optional[str] = None,
    ) -> None:
        """Begins to capture a session file at once, without test shots."""
        self._command(
            ("files", file, "start"), session=session, process=process, calibration=calibration
        )

    def enqueue(
        self,
        file: str,
        session: Optional[str] = None,
        process: bool = False,
        yes: bool = False,
        calibration: Optional[str] = None,
    ) -> int:
        """Adds a session file at the end of the queue, which takes test shots first, and returns its number. With yes
        it is captured even if they give a warning."""
        answer = self._command(
            ("files", file, "queue"),
            session=session,
            process=process,
            yes=yes,
            calibration=calibration,
        )
        return answer["number"]

    def calibrations(self) -> Dict[str, Any]:
        """The calibrations of the folder, the targets, the drafts with the steps that were computed, and the step that
        is being computed (working, or None) or has failed (failed, or None)."""
        return self._json("calibrations")

    def calibrate(
        self,
        calibration: str,
        step: str,
        sessions: Sequence[str] = (),
        **options: Union[str, float],
    ) -> None:
        """Begins a step of a calibration: "board", "cameras", "lights", "laser", "radiometry" or "report". sessions are
        names of sessions of the target. Options are board, target and reflectance."""
        names = "/".join(sessions) or None
        self._command(("calibrations", calibration, "find"), step=step, sessions=names, **options)

    def calibration_page(self, calibration: str, step: str) -> bytes:
        """The page of a step with the pictures and what was found in them, that of the last step if it has "failed", or
        the "report"."""
        name = urllib.parse.quote(calibration, safe="")
        with self._open("calibrations/%s/page.html?step=%s" % (name, step)) as answer:
            return answer.read()

    def keep_calibration(self, calibration: str) -> None:
        """Stores the result of the last step as a calibration of the folder. No calibration is replaced."""
        self._command(("calibrations", calibration, "keep"))

    def make(self, session: str, product: str) -> None:
        """Begins to make a file of a session: "report", "page" (the material in 3D) or "gltf"."""
        self._command(("sessions", session, "make"), product=product)

    def products(self) -> Dict[str, Any]:
        """The files that were made: products, making (or None) and failed (or None)."""
        return self._json("products")

    def product(self, session: str, file: str) -> bytes:
        """A file that was made: "report.html", "page.html" or "material.glb"."""
        with self._open("sessions/%s/%s" % (urllib.parse.quote(session, safe=""), file)) as answer:
            return answer.read()

    def resume_session(self, session: str, process: bool = False) -> None:
        """Continues a session directory: captures what is missing."""
        self._command(("sessions", session, "resume"), process=process)

    def pause_queue(self) -> None:
        """Begins no further session. The current one continues."""
        self._command(("queue", "pause"))

    def resume_queue(self) -> None:
        """Continues the queue, and its session if that is paused."""
        self._command(("queue", "resume"))

    def remove_from_queue(self, number: int) -> None:
        """Removes a session that is not being captured."""
        self._command(("queue", str(number), "remove"))

    def move_in_queue(self, number: int, place: int) -> None:
        """Moves a session that waits to another place among those that wait, from 1."""
        self._command(("queue", str(number), "move"), place=place)

    def snap(self, camera: str, exposure_us: float) -> Dict[str, Any]:
        """Takes a picture and returns values of the sensor, such as mean_dn, saturated, focus and histogram."""
        return self._command(("cameras", camera, "snap"), exposure_us=exposure_us)

    def snap_picture(self, camera: str) -> bytes:
        """That picture in 8 bits, brightness adjusted, as a PNG file."""
        with self._open("cameras/%s/snap.png" % urllib.parse.quote(camera, safe="")) as answer:
            return answer.read()

    def lamp(self, name: str, for_s: float) -> None:
        """Switches a lamp on for for_s seconds, at most 15, and returns when it is stable. The same call begins this
        time again. With 0 s it switches the lamp off."""
        self._light("lamps", name, for_s)

    def laser(self, name: str, for_s: float) -> None:
        """The same for a laser."""
        self._light("lasers", name, for_s)

    def _light(self, kind: str, name: str, for_s: float) -> None:
        if for_s > 0:
            self._command((kind, name, "on"), for_s=for_s)
        else:
            self._command((kind, name, "off"))
