"""Session directories: session.db and the files of the session."""

from __future__ import annotations

import configparser
import contextlib
import dataclasses
import functools
import hashlib
import os
import pathlib
import sqlite3
import urllib.parse
from typing import Any, Dict, Iterator, List, NamedTuple, Optional, Tuple, Union

import numpy as np
from numpy.typing import NDArray

from . import _exr
from ._directions import Directions
from ._error import Error
from .btf import Btf
from .mdf import Mdf

APPLICATION_ID = 0x4D535247  # "MSRG"
FORMAT = 1  # PRAGMA user_version of the sessions that this version reads

Path = Union[str, "os.PathLike[str]"]


class Grid(NamedTuple):
    """The texels of the reference plane, in the frame of the sample."""

    width: int  # texels
    height: int
    width_mm: float
    height_mm: float
    reference_mm: float  # height of the reference plane above the turntable
    depth_mm: float  # maximum depth of the structure below that plane

    @property
    def texel_mm(self) -> float:
        """Width of a texel."""
        return self.width_mm / self.width

    @property
    def centres_mm(self) -> NDArray[np.float64]:
        """Centres of the texels in the frame of the sample, height × width × 3. Row 0 is at +y."""
        x = ((np.arange(self.width) + 0.5) / self.width - 0.5) * self.width_mm
        y = (0.5 - (np.arange(self.height) + 0.5) / self.height) * self.height_mm
        z = np.full((self.height, self.width), self.reference_mm)
        return np.stack([*np.meshgrid(x, y), z], axis=-1)


@dataclasses.dataclass(frozen=True)
class PlannedDirections(Directions):
    """Directions as planned, and the devices that show them."""

    device: NDArray[np.int64]  # number of the camera, lamp or laser in the calibration
    turntable_deg: NDArray[np.float64]  # views: the turntable's angle that shows the view
    note: List[Optional[str]]  # what was changed in the plan


class Shot(NamedTuple):
    """The frames of all cameras in one pose with one lamp, one laser sweep, or no light."""

    id: int  # 1 … n, in planned order
    kind: str  # "dark", "lamp" or "sweep"
    pose: int  # number of the pose in planned order
    turntable_deg: float  # commanded
    arc_deg: float
    source: int  # index of the light or laser position, or -1
    device: int  # number of the lamp or laser in the calibration, or -1
    cameras: Tuple[int, ...]  # numbers of the cameras that take part
    sweep_from_deg: float  # first and last angle of the laser; only for "sweep"
    sweep_to_deg: float
    sweep_steps: int
    state: str  # "planned", "done" or "skipped"
    note: Optional[str]  # why it was skipped or changed


class Frame(NamedTuple):
    """A file that the capture wrote: a picture, dark frames, or the summary of a laser sweep."""

    shot: int  # id of the shot
    camera: int  # number of the camera in the calibration, from 0
    path: str  # relative to the session directory
    sha256: str
    bytes: int
    retakes: int  # frames that were refused before this one
    captured_s: float  # on the session's clock
    turntable_deg: float  # in the middle of the exposure


class Event(NamedTuple):
    """Something that happened during the capture."""

    id: int
    time_s: float  # on the clock of the session
    level: str  # "info", "warning" or "error"
    source: str  # the device or stage
    message: str


class Product(NamedTuple):
    """A file that processing made."""

    path: str  # relative to the session directory
    made_by: str  # hash of the inputs, or the arguments with which mesorig makes the file again
    sha256: str
    bytes: int


Number = Union[str, float, NDArray[np.float64]]


@dataclasses.dataclass(frozen=True)
class Calibration:
    """The calibration of a session. mesorig-calibration(5) describes its sections and keys.

    sections has dictionaries by the name of the section, such as "camera 0". Numbers are float,
    lists of numbers are arrays, other values are str. Lengths are in millimetres, angles in
    radians.
    """

    origin: str  # "nominal", or the path of the calibration file when it was read
    text: str
    sections: Dict[str, Dict[str, Number]]

    @property
    def is_nominal(self) -> bool:
        """Whether geometry and light are those of the rig file, because nothing was calibrated."""
        return self.origin == "nominal"

    def devices(self, kind: str) -> List[Dict[str, Number]]:
        """Return the sections of all devices of a kind: "camera", "lamp", "laser" or "mark"."""
        found: List[Dict[str, Number]] = []
        while f"{kind} {len(found)}" in self.sections:
            found.append(self.sections[f"{kind} {len(found)}"])
        return found


def _number(text: str) -> Number:
    try:
        if ";" in text:
            return np.array([float(item) for item in text.split(";") if item], np.float64)
        return float(text)
    except ValueError:
        return text


def _read_calibration(origin: str, text: str, path: str) -> Calibration:
    parser = configparser.RawConfigParser(
        delimiters=("=",), comment_prefixes=("#",), inline_comment_prefixes=None, strict=False
    )
    parser.optionxform = str  # type: ignore[assignment,method-assign]
    try:
        parser.read_string(text)
    except configparser.Error as error:
        raise Error(
            f"{path}: the calibration cannot be read: {error}; restore the database from a copy"
        ) from error
    texts = ("name", "id", "format", "date", "method", "checksum", "residual_unit")
    sections = {
        name: {k: v if k in texts else _number(v) for k, v in parser.items(name)}
        for name in parser.sections()
    }
    return Calibration(origin, text, sections)


def _sha256(path: str) -> str:
    digest = hashlib.sha256()
    with open(path, "rb") as file:
        for block in iter(lambda: file.read(1 << 20), b""):
            digest.update(block)
    return digest.hexdigest()


@contextlib.contextmanager
def _database(path: str) -> Iterator[sqlite3.Connection]:
    """Open session.db for reading. Any error of SQLite names the file."""
    uri = "file:" + urllib.parse.quote(os.path.abspath(path)) + "?mode=ro"
    connection = None
    try:
        connection = sqlite3.connect(uri, uri=True)
        try:
            connection.execute("PRAGMA user_version").fetchone()
            connection.execute("SELECT count(*) FROM sqlite_master").fetchone()
        except sqlite3.OperationalError:
            # In a directory that is not writable, SQLite cannot make the files that belong to a
            # database in WAL mode. If they have no changes, the database is complete without them.
            if os.path.exists(path + "-wal") and os.path.getsize(path + "-wal") > 0:
                raise
            connection.close()
            connection = sqlite3.connect(uri + "&immutable=1", uri=True)
        connection.row_factory = sqlite3.Row
        yield connection
    except (sqlite3.Error, UnicodeDecodeError) as error:
        raise Error(
            f"{path}: {error}; the database is damaged, or is of a version of SQLite after "
            f"{sqlite3.sqlite_version}: “mesorig info” tells which"
        ) from error
    finally:
        if connection is not None:
            connection.close()


class Session:
    """A session directory. The database is read when the session is opened, files when needed."""

    path: pathlib.Path
    name: str
    program: str  # the program that made the session, with its version
    created: str  # ISO 8601, UTC
    grid: Grid
    views: PlannedDirections
    lights: PlannedDirections
    lasers: PlannedDirections
    shots: List[Shot]
    frames: List[Frame]
    events: List[Event]
    products: List[Product]
    values: Dict[str, str]  # session(5) lists the keys
    texts: Dict[str, str]  # rig.conf, session.conf, calibration.conf

    def __init__(self, path: Path) -> None:
        self.path = pathlib.Path(path)
        database = os.fspath(self.path / "session.db")
        if not os.path.isfile(database):
            raise Error(
                f"{os.fspath(path)}: there is no session.db in this directory; give the directory of "
                "a session"
            )
        with _database(database) as db:
            self._check(db, database)
            self._read(db, database)

    def _check(self, db: sqlite3.Connection, path: str) -> None:
        application = db.execute("PRAGMA application_id").fetchone()[0]
        version = db.execute("PRAGMA user_version").fetchone()[0]
        if application != APPLICATION_ID:
            raise Error(
                f"{path}: the database is not that of a session of Mesorig; give the directory of a "
                "session"
            )
        if version != FORMAT:
            newer = "; install a newer version of the package" if version > FORMAT else ""
            raise Error(
                f"{path}: the session has format {version}, but this version of the Python "
                f"package mesorig reads only format {FORMAT}{newer}"
            )

    def _read(self, db: sqlite3.Connection, path: str) -> None:
        def rows(sql: str) -> List[sqlite3.Row]:
            return db.execute(sql).fetchall()

        def one(table: str) -> sqlite3.Row:
            found = rows(f"SELECT * FROM {table}")
            if len(found) != 1:
                raise Error(
                    f"{path}: the table {table} has {len(found)} rows instead of one; restore the "
                    "database from a copy"
                )
            return found[0]

        session, grid = one("session"), one("grid")
        self.name, self.program = session["name"], session["program"]
        self.created = session["created"]
        self.grid = Grid(**{name: grid[name] for name in Grid._fields})
        by_kind: Dict[str, List[sqlite3.Row]] = {"view": [], "light": [], "laser": []}
        for row in rows("SELECT * FROM direction ORDER BY kind, idx"):
            by_kind[row["kind"]].append(row)
        self.views = _planned(by_kind["view"])
        self.lights = _planned(by_kind["light"])
        self.lasers = _planned(by_kind["laser"])
        self.texts = {name: content for name, content in rows("SELECT name, content FROM text")}
        self.values = {key: value for key, value in rows("SELECT key, value FROM value")}
        self.shots = [self._shot(row) for row in rows("SELECT * FROM shot ORDER BY id")]
        self.frames = [
            self._frame(row) for row in rows("SELECT * FROM frame ORDER BY shot, camera")
        ]
        self.events = [Event(*row) for row in rows("SELECT * FROM event ORDER BY id")]
        self.products = [
            Product(*row)
            for row in rows("SELECT path, made_by, sha256, bytes FROM product ORDER BY path")
        ]

    def _shot(self, row: sqlite3.Row) -> Shot:
        fields = {name: row[name] for name in Shot._fields}
        number = row["cameras"]
        if number >= 0:
            fields["cameras"] = tuple(k for k in range(63) if number >> k & 1)
        else:  # a set with a camera above 62 is a value
            fields["cameras"] = tuple(int(k) for k in self.values[f"cameras/{-number}"].split())
        return Shot(**fields)

    def _frame(self, row: sqlite3.Row) -> Frame:
        fields = {name: row[name] for name in Frame._fields[:-1]}
        turned = self.values.get(f"turned/{row['shot']}/{row['camera']}")
        commanded = self._turntable_deg.get(row["shot"], np.nan)
        return Frame(**fields, turntable_deg=commanded if turned is None else float(turned))

    @functools.cached_property
    def _turntable_deg(self) -> Dict[int, float]:
        return {shot.id: shot.turntable_deg for shot in self.shots}

    def __repr__(self) -> str:
        return f"<mesorig.Session {os.fspath(self.path)}: {self.name}, {self.state}>"

    @property
    def state(self) -> str:
        """ "done", "aborted", "paused", or "unfinished" if shots are left, as in “mesorig info”."""
        if all(shot.state != "planned" for shot in self.shots):
            return "done"
        stored = self.values.get("state", "running")
        return "unfinished" if stored == "running" else stored

    @functools.cached_property
    def calibration(self) -> Calibration:
        """The calibration of the products. Without products, that of the capture."""
        prefix = "products_" if "products_calibration" in self.values else ""
        text = self.texts.get(prefix + "calibration.conf", "")
        origin = self.values.get(prefix + "calibration", "nominal")
        return _read_calibration(origin, text, os.fspath(self.path / "session.db"))

    @functools.cached_property
    def btf(self) -> Btf:
        """The BTF."""
        folder = self.path / "products" / "btf"
        files = sorted(folder.glob("view_*.exr"))
        if not files:
            raise Error(
                f"{os.fspath(folder)}: there is no BTF yet; “mesorig process "
                f"{os.fspath(self.path)}” makes it"
            )
        return Btf([os.fspath(file) for file in files], self.grid, self.check)

    @functools.cached_property
    def mdf(self) -> Mdf:
        """The MDF."""
        file = os.fspath(self.path / "products" / "mdf.exr")
        if not os.path.exists(file):
            raise Error(
                f"{file}: there is no MDF; “mesorig process {os.fspath(self.path)}” makes it if "
                "the session has laser sweeps"
            )
        return Mdf(file, self.check)

    def read(self, relative: str) -> List[_exr.Part]:
        """Read an OpenEXR file of the session, such as the path of a frame, after check()."""
        path = os.fspath(self.path / relative)
        self.check(path)
        return _exr.read(path)

    def check(self, path: str) -> None:
        """Raise an Error if a file of this session differs from its checksum in the database.

        A file without a checksum passes.
        """
        relative = os.path.relpath(path, self.path).replace(os.sep, "/")
        known = self._checksums.get(relative)
        if known is None:
            return
        try:
            found = _sha256(path)
        except OSError as error:
            raise Error(f"{path}: {error.strerror}; {self._remedy(relative)}") from error
        if found != known:
            raise Error(
                f"{path}: its SHA-256 is {found}, but the session has {known}; "
                f"{self._remedy(relative)}"
            )

    @functools.cached_property
    def _checksums(self) -> Dict[str, str]:
        rows: List[Any] = [*self.frames, *self.products]
        return {row.path: row.sha256 for row in rows}

    def _remedy(self, relative: str) -> str:
        made = relative.startswith("products/")
        return f"“mesorig {'process' if made else 'resume'} {os.fspath(self.path)}” makes it again"


def _planned(rows: List[sqlite3.Row]) -> PlannedDirections:
    return PlannedDirections(
        theta_deg=np.array([row["theta_deg"] for row in rows], np.float64),
        phi_deg=np.array([row["phi_deg"] for row in rows], np.float64),
        device=np.array([row["device"] for row in rows], np.int64),
        turntable_deg=np.array([row["turntable_deg"] for row in rows], np.float64),
        note=[row["note"] for row in rows],
    )


def find_session(path: str) -> Optional[Session]:
    """Return the session whose products or frames contain a file, or None."""
    for folder in list(pathlib.Path(os.path.abspath(path)).parents)[:4]:
        if (folder / "session.db").is_file():
            return Session(folder)
    return None
