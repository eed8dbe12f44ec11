#!/usr/bin/env python3
"""Tests of the Python package, which tests/python/run runs.

A session of the small simulated rig is read by the package, and compared with what the C library
reads (dump_tables), with libmesorig-material, and with `mesorig info --json`.
"""
import contextlib
import dataclasses
import io
import json
import math
import os
import pathlib
import re
import shutil
import sqlite3
import subprocess
import sys
import tempfile
import unittest
from unittest import mock

import numpy as np

import mesorig
from mesorig import __main__ as command_line
from mesorig import _exr, material

SOURCE = pathlib.Path(os.environ["MESORIG_SOURCE"])
BIN = pathlib.Path(os.environ["MESORIG_BUILD"]) / "bin"

# The noise of the cameras, which gives the BTF its error bars.
NOISE = """
[camera noise {}]
black_dn=64;0.1
dark_dn_s=1;0.1
gain_dn_e=0.4;0.01
read_noise_e=6;0.1
curvature=0;0
linearity=0.001
quality=1
points=20
"""

folder = None  # everything is in it


def run(*command):
    done = subprocess.run(
        [str(part) for part in command], cwd=folder, text=True, stdout=-1, stderr=-1, check=False
    )
    if done.returncode != 0:
        raise AssertionError(f"{command}:\n{done.stdout}{done.stderr}")
    return done.stdout


def info(session):
    return json.loads(run(BIN / "mesorig", "info", "--json", session))


def setUpModule():
    """Captures 16 × 16 texels, 6 views and 10 lights. Makes two copies: one with gaps, and one
    with error bars."""
    global folder
    folder = pathlib.Path(tempfile.mkdtemp(prefix="mesorig-python-"))
    for file in (SOURCE / "tests/small").glob("*.conf"):
        shutil.copy(file, folder)
    conf = (folder / "session.conf").read_text()
    conf = conf.replace("texels = 8", "texels = 16")
    conf = conf.replace("rings = 30:2; 60:2", "rings = 30:2; 60:4", 1)
    conf = conf.replace("rings = 30:2; 60:2", "rings = 30:4; 60:6", 1)
    (folder / "session.conf").write_text(conf)
    run(BIN / "mesorig", "capture", "rig.conf", "session.conf", "-o", "weave.session")
    shutil.copytree(folder / "weave.session", folder / "gaps.session")
    run(BIN / "mesorig", "process", "weave.session")
    make_gaps()
    make_noisy()


def make_gaps():
    """The first lamp's shot is skipped, as if it could be predicted."""
    with contextlib.closing(sqlite3.connect(folder / "gaps.session/session.db")) as db, db:
        shot = db.execute("SELECT min(id) FROM shot WHERE kind = 'lamp'").fetchone()[0]
        for (path,) in db.execute("SELECT path FROM frame WHERE shot = ?", (shot,)):
            (folder / "gaps.session" / path).unlink()
        db.execute("DELETE FROM frame WHERE shot = ?", (shot,))
        db.execute("UPDATE shot SET state = 'skipped', note = 'a test' WHERE id = ?", (shot,))
    run(BIN / "mesorig", "process", "gaps.session")


def make_noisy():
    shutil.copytree(folder / "weave.session", folder / "noisy.session")
    nominal = mesorig.open(folder / "noisy.session").calibration
    text = nominal.text + "".join(NOISE.format(k) for k in range(2))
    (folder / "noise.conf").write_text(text)
    run(BIN / "mesorig", "process", "-c", "noise.conf", "noisy.session")


def tearDownModule():
    shutil.rmtree(folder)


def upper_median(values):
    return np.sort(np.ravel(values))[np.size(values) // 2]


def session(name="weave"):
    return mesorig.open(folder / f"{name}.session")


class Tables(unittest.TestCase):
    """The arrays against what the C library reads from the same files."""

    @classmethod
    def setUpClass(cls):
        cls.holes = {}
        for name in ("weave", "gaps"):
            out = folder / f"{name}.tables"
            out.mkdir()
            cls.holes[name] = int(run(BIN / "dump_tables", f"{name}.session", out))

    def table(self, name, file, dtype, *shape):
        return np.fromfile(folder / f"{name}.tables" / file, dtype).reshape(shape)

    def test_btf(self):
        for name in ("weave", "gaps"):
            btf = session(name).btf
            self.assertEqual(btf.shape, (16, 16, 6, 10, 3))
            self.assertEqual(btf.values.dtype, np.float32)
            expected = self.table(name, "btf.f32", np.float32, *btf.shape)
            known = ~np.isnan(btf.values)
            self.assertLess(np.abs(btf.values - expected)[known].max(), 1e-6)
            self.assertGreater(expected.std(), 0.01)
            holes = (btf.flags & mesorig.FLAG_HOLE) != 0
            self.assertEqual(np.count_nonzero(holes), self.holes[name])
            np.testing.assert_array_equal(known, np.repeat(~holes[..., None], 3, axis=-1))

    def test_directions(self):
        opened = session()
        btf = opened.btf
        angles = self.table("weave", "angles.f32", np.float32, 16, 2)
        for k, found in enumerate((btf.views, btf.lights)):
            expected = angles[6:] if k else angles[:6]
            np.testing.assert_allclose(found.theta_deg, expected[:, 0], atol=1e-6)
            np.testing.assert_allclose(found.phi_deg, expected[:, 1], atol=1e-6)
        np.testing.assert_allclose(btf.views.vectors, opened.views.vectors, atol=1e-6)
        np.testing.assert_allclose(btf.lights.vectors, opened.lights.vectors, atol=1e-6)
        np.testing.assert_allclose(mesorig.Directions([90], [90]).vectors, [[0, 1, 0]], atol=1e-15)
        self.assertEqual(btf.view_index, list(range(6)))
        self.assertEqual(btf.light_index, list(range(10)))

    def test_mdf(self):
        """The C library's table has depths: distances times the cosine at each texel."""
        opened = session()
        mdf = opened.mdf
        self.assertEqual(mdf.distance_mm.shape, (16, 16, 6))
        depth = self.table("weave", "depth.f32", np.float32, 6, 16, 16).transpose(1, 2, 0)
        seen = self.table("weave", "seen.u8", np.uint8, 6, 16, 16).transpose(1, 2, 0) != 0
        np.testing.assert_array_equal(~np.isnan(mdf.distance_mm), seen)
        to = mdf.camera_mm - opened.grid.centres_mm[:, :, None]
        cosine = to[..., 2] / np.linalg.norm(to, axis=-1)
        self.assertGreater(seen.sum(), 500)
        self.assertLess(np.abs(mdf.distance_mm * cosine - depth)[seen].max(), 1e-6)

    def test_mdf_sources(self):
        opened = session()
        mdf = opened.mdf
        coverage = float(opened.values["mdf_coverage"])
        self.assertAlmostEqual(mdf.seen.mean(), coverage, places=6)
        self.assertTrue((mdf.n_sweeps <= 2).all())
        measured = ~np.isnan(mdf.measured_mm)
        np.testing.assert_array_equal(measured, mdf.n_sweeps > 0)
        np.testing.assert_array_equal(measured, ~np.isnan(mdf.sigma_mm))
        self.assertTrue((mdf.sigma_mm[measured] > 0).all())
        own = mdf.source == mesorig.SOURCE_MEASURED
        np.testing.assert_array_equal(mdf.distance_mm[own], mdf.measured_mm[own])
        other = mdf.source == mesorig.SOURCE_OTHER
        np.testing.assert_array_equal(mdf.distance_mm[other], mdf.other_mm[other])
        none = mdf.source == mesorig.SOURCE_NONE
        np.testing.assert_array_equal(none, np.isnan(mdf.distance_mm))
        self.assertTrue((mdf.source == mesorig.SOURCE_PREDICTED).any())

    def test_compressed_mdf(self):
        """“mesorig compress” rounds the distances of each view to 8 bits."""
        run(
            BIN / "mesorig",
            "compress",
            "weave.session",
            "--method",
            "mdf-views",
            "-q",
            "8bit",
            "-o",
            "mdf8.exr",
        )
        mdf, packed = session().mdf, mesorig.open(folder / "mdf8.exr")
        self.assertIsInstance(packed, mesorig.Mdf)
        self.assertIsNone(packed.seen)
        known = ~np.isnan(mdf.distance_mm)
        np.testing.assert_array_equal(known, ~np.isnan(packed.distance_mm))
        most = np.nanmax(mdf.distance_mm)
        self.assertLess(np.abs(packed.distance_mm - mdf.distance_mm)[known].max(), most / 254)

    def test_near_field(self):
        """The directions in which each texel was seen and lit."""
        btf = session().btf
        camera = self.table("weave", "camera.f32", np.float32, 6, 16, 16, 3)
        lamp = self.table("weave", "lamp.f32", np.float32, 6, 10, 16, 16, 3)
        for k in range(6):
            view = btf.view(k)
            expected = np.repeat(camera[k][:, :, None], 10, axis=2)
            np.testing.assert_allclose(view.to_camera(), expected, atol=1e-6)
            np.testing.assert_allclose(view.to_lamp(), np.moveaxis(lamp[k], 0, 2), atol=1e-6)
        shutil.copy(btf.paths[0], folder / "view_0000.exr")
        alone = mesorig.open(folder / "view_0000.exr")
        self.assertIsNone(alone.texel_mm)
        with self.assertRaises(mesorig.Error):
            alone.view(0).to_camera()

    def test_lazily(self):
        btf = session().btf
        view = btf.view(3)
        np.testing.assert_array_equal(view.values, btf.values[:, :, 3])
        np.testing.assert_array_equal(view.flags, btf.flags[:, :, 3])
        self.assertEqual(view.theta_deg, btf.views.theta_deg[3])
        self.assertEqual(btf.nbytes, btf.values.nbytes)
        one = mesorig.open(folder / "weave.session/products/btf/view_0003.exr")
        self.assertEqual(one.view_index, [3])
        np.testing.assert_array_equal(one.values[:, :, 0], view.values)
        whole = mesorig.open(folder / "weave.session/products/btf")
        self.assertEqual(whole.shape, btf.shape)


class Flags(unittest.TestCase):
    def test_gaps(self):
        """The pictures of the shot that is missing are marked as predicted, and no others."""
        opened = session("gaps")
        missing = [shot for shot in opened.shots if shot.state == "skipped"]
        self.assertEqual([shot.note for shot in missing], ["a test"])
        self.assertFalse([f for f in opened.frames if f.shot == missing[0].id])
        predicted = (opened.btf.flags & mesorig.FLAG_PREDICTED) != 0
        views = [
            k
            for k, device in enumerate(opened.views.device)
            if device in missing[0].cameras
            and abs(math.remainder(opened.views.turntable_deg[k] - missing[0].turntable_deg, 360))
            < 1e-6
        ]
        self.assertTrue(views)
        expected = np.zeros(predicted.shape, bool)
        expected[:, :, views, missing[0].source] = True
        np.testing.assert_array_equal(predicted, expected)
        self.assertEqual(opened.btf.flag_counts()["predicted"], expected.sum())
        self.assertEqual(info("gaps.session")["btf_predicted"], expected.sum())
        self.assertEqual(session().btf.flag_counts()["predicted"], 0)

    def test_sigma(self):
        """`mesorig info` has the median over all pictures, which follows from the arrays."""
        said = info("noisy.session")
        btf = session("noisy").btf
        self.assertEqual(said["btf_sigma_known"], 60)
        self.assertFalse(np.isnan(btf.sigma).any())
        medians, relatives = [], []
        for v in range(6):
            for light, part in enumerate(_exr.read(btf.paths[v])):
                sigma = btf.sigma[:, :, v, light].astype(np.float64)
                rms = math.sqrt((sigma**2).mean())
                # The file rounds σ to 5 significant bits.
                self.assertAlmostEqual(rms / part.attributes["sigma.rms"], 1, delta=1 / 32)
                channel = sigma[..., 1] / part.attributes["sigma.colour"][1]
                rho = np.sqrt((btf.values[:, :, v, light].astype(np.float64) ** 2).mean(axis=-1))
                medians.append(upper_median(channel))
                relatives.append(upper_median(channel / np.maximum(rho, 0.02)))
        self.assertAlmostEqual(upper_median(medians) / said["btf_sigma_median"], 1, places=5)
        self.assertAlmostEqual(upper_median(relatives) / said["btf_sigma_relative"], 1, places=3)
        self.assertTrue(np.isnan(session().btf.sigma).all())
        # Nothing is calibrated but the noise.
        self.assertTrue((btf.view(0).sigma_common == 0).all())
        self.assertTrue(np.isnan(session().btf.view(0).sigma_common).all())

    def test_holes(self):
        """Holes are NaN in values and errors. Imported pictures mark them by black texels."""
        planes = {c: np.array([[0, 0.5], [0, 0.25]], np.float32) for c in "BGR"}
        planes["sigma"] = np.ones((2, 2), np.float32)
        attributes = {
            "view.theta_deg": 0.0,
            "view.phi_deg": 0.0,
            "light.theta_deg": 30.0,
            "light.phi_deg": 0.0,
            "mesorig.holes": 2,
            "sigma.colour": np.array([1.0, 2.0, 3.0]),
            "sigma.scale": np.array([0.1, 0.2, 0.3]),
        }
        marked = dict(planes, mark=np.array([[4, 2], [12, 1]], np.float32))
        for channels, flags in ((planes, [[4, 0], [4, 0]]), (marked, [[4, 2], [12, 1]])):
            part = _exr.Part("light_0000", 2, 2, list(channels), channels, attributes)
            with mock.patch.object(_exr, "read", return_value=[part]):
                view = mesorig.BtfView("view_0000.exr")
            np.testing.assert_array_equal(view.flags[..., 0], flags)
            for array in (view.values, view.sigma):
                np.testing.assert_array_equal(np.isnan(array[:, :, 0, 0]), [[1, 0], [1, 0]])
            np.testing.assert_array_equal(view.sigma[0, 1, 0], [1, 2, 3])
            np.testing.assert_array_equal(view.sigma_common, [[0.1, 0.2, 0.3]])


class Database(unittest.TestCase):
    def test_info(self):
        for name in ("weave", "gaps", "noisy"):
            said, opened = info(f"{name}.session"), session(name)
            self.assertEqual(opened.name, said["name"])
            self.assertEqual(opened.state, said["state"])
            for key in ("width", "height", "width_mm", "height_mm"):
                self.assertEqual(getattr(opened.grid, key), said[key])
            for key in ("views", "lights", "lasers", "shots", "frames"):
                self.assertEqual(len(getattr(opened, key)), said[key], key)
            states = [shot.state for shot in opened.shots]
            self.assertEqual(states.count("done"), said["shots_done"])
            self.assertEqual(states.count("skipped"), said["shots_skipped"])
            self.assertEqual(sum(frame.retakes for frame in opened.frames), said["retakes"])
            self.assertEqual(sum(frame.bytes for frame in opened.frames), said["bytes"])
            found = [{k: e._asdict()[k] for k in said["events"][0]} for e in opened.events]
            self.assertEqual(found, said["events"])
            found = [{"path": p.path, "bytes": p.bytes} for p in opened.products]
            self.assertEqual(found, said["products"])
            counts = opened.btf.flag_counts()
            self.assertEqual(counts["holes"], said["btf_holes"])
            self.assertEqual(counts["bounds"], said["btf_lower_bounds"])
            self.assertEqual(counts["shorter"], said["btf_shorter_exposures"])

    def test_frames(self):
        opened = session()
        shots = {shot.id: shot for shot in opened.shots}
        for frame in opened.frames:
            self.assertEqual(frame.turntable_deg, shots[frame.shot].turntable_deg)
        for shot in opened.shots:
            found = tuple(frame.camera for frame in opened.frames if frame.shot == shot.id)
            self.assertEqual(found, shot.cameras)
        self.assertGreater(len({shot.cameras for shot in opened.shots}), 1)
        frame = next(f for f in opened.frames if shots[f.shot].kind == "lamp")
        part = opened.read(frame.path)[0]
        self.assertEqual(part.name, "radiance")
        self.assertEqual(part.channels["Y"].shape, (32, 32))
        self.assertEqual(part.attributes["mesorig.shot"], frame.shot)

    def test_turned(self):
        """Frames of a turning turntable have its angle in the middle of the exposure."""
        copy = folder / "turned.session"
        copy.mkdir()
        shutil.copy(folder / "weave.session/session.db", copy)
        with contextlib.closing(sqlite3.connect(copy / "session.db")) as db, db:
            db.execute("INSERT INTO value VALUES ('turned/2/0', '12.5')")
        frames = {(f.shot, f.camera): f.turntable_deg for f in mesorig.open(copy).frames}
        self.assertEqual(frames[2, 0], 12.5)
        self.assertNotEqual(frames[2, 1], 12.5)

    def test_cameras(self):
        """A set of cameras is the bits of an integer, or a list among the values."""
        copy = folder / "cameras.session"
        copy.mkdir()
        shutil.copy(folder / "weave.session/session.db", copy)
        with contextlib.closing(sqlite3.connect(copy / "session.db")) as db, db:
            db.execute("UPDATE shot SET cameras = ? WHERE id = 1", [1 << 62 | 1 << 32 | 1])
            db.execute("UPDATE shot SET cameras = -2 WHERE id = 2")
            db.execute("INSERT INTO value VALUES ('cameras/2', '5 63 255')")
        shots = mesorig.open(copy).shots
        self.assertEqual(shots[0].cameras, (0, 32, 62))
        self.assertEqual(shots[1].cameras, (5, 63, 255))

    def test_calibration(self):
        nominal, used = session().calibration, session("noisy").calibration
        self.assertTrue(nominal.is_nominal)
        self.assertNotIn("camera noise 0", nominal.sections)
        self.assertEqual(os.path.basename(used.origin), "noise.conf")
        np.testing.assert_array_equal(used.sections["camera noise 1"]["gain_dn_e"], [0.4, 0.01])
        cameras = used.devices("camera")
        self.assertEqual([camera["name"] for camera in cameras], ["cam30", "cam60"])
        self.assertEqual(cameras[0]["fx_px"], 333)
        rotation = cameras[1]["rotation"].reshape(3, 3)
        np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-12)
        # The camera of the rig file is 650 mm from the sample, at 60°, and so is −Rᵀt.
        centre = -rotation.T @ cameras[1]["translation_mm"] - [0, 0, session().grid.reference_mm]
        self.assertAlmostEqual(np.linalg.norm(centre), 650, delta=6)
        self.assertEqual(len(used.devices("lamp")), 2)


class Errors(unittest.TestCase):
    def copy(self, name):
        copy = folder / f"{name}.session"
        shutil.copytree(folder / "weave.session", copy)
        return copy

    def error(self, function, *texts):
        with self.assertRaises(mesorig.Error) as caught:
            function()
        for text in texts:
            self.assertIn(str(text), str(caught.exception))

    def test_damaged(self):
        """One bit of a pixel, which OpenEXR does not notice; then half of the file."""
        copy = self.copy("damaged")
        file = copy / "products/btf/view_0002.exr"
        data = bytearray(file.read_bytes())
        data[-5] ^= 1
        file.write_bytes(data)
        self.error(lambda: mesorig.open(copy).btf, file, "SHA-256", "mesorig process")
        self.error(lambda: mesorig.open(file), file, "SHA-256", "mesorig process")
        frame = copy / mesorig.open(copy).frames[0].path
        frame.unlink()
        self.error(lambda: mesorig.open(copy).read(frame.relative_to(copy)), frame, "resume")

    def test_truncated(self):
        whole = (folder / "weave.session/products/mdf.exr").read_bytes()
        for share in (0, 0.001, 0.5, 0.99):
            file = folder / f"truncated{share}.exr"
            file.write_bytes(whole[: int(share * len(whole))])
            self.error(lambda: mesorig.open(file), file, "damaged")

    def test_incomplete(self):
        """A light of another size, without a colour, without its direction, and no light."""
        path = session().btf.paths[0]
        parts = _exr.read(path)
        without = {k: v for k, v in parts[9].attributes.items() if k != "light.phi_deg"}
        wrong = {
            "8 × 16 texels instead of 16 × 16": dataclasses.replace(parts[9], width=8),
            "lacks channel G": dataclasses.replace(parts[9], channel_names=["B", "R"]),
            "has no number light.phi_deg": dataclasses.replace(parts[9], attributes=without),
        }
        for text, part in wrong.items():
            with mock.patch.object(_exr, "read", return_value=[*parts[:9], part]):
                self.error(lambda: mesorig.Btf([path]), path, text)
        with mock.patch.object(_exr, "read", side_effect=[parts, parts[:9]]):
            self.error(lambda: mesorig.Btf([path, "view_0001.exr"]), "view_0001.exr", path)

    def test_future_format(self):
        copy = self.copy("future")
        with contextlib.closing(sqlite3.connect(copy / "session.db")) as db, db:
            db.execute("PRAGMA user_version = 2")
        self.error(lambda: mesorig.open(copy), copy / "session.db", "format 2", "newer version")
        with contextlib.closing(sqlite3.connect(copy / "session.db")) as db, db:
            db.execute("PRAGMA application_id = 7")
        self.error(lambda: mesorig.open(copy), copy / "session.db", "not that of a session")

    def test_not_a_session(self):
        self.error(lambda: mesorig.open(folder), folder, "session.db")
        self.error(lambda: mesorig.open(folder / "nothing"), folder / "nothing", "no such file")
        self.error(lambda: session().read("frames/none.exr"), "frames/none.exr", "no such file")
        text = folder / "rig.conf"
        self.error(lambda: mesorig.open(text), text, "not an OpenEXR file")
        broken = folder / "broken.session"
        broken.mkdir()
        (broken / "session.db").write_bytes(b"SQLite format 3\0" + bytes(4096))
        self.error(lambda: mesorig.open(broken), broken / "session.db")

    def test_nothing_made(self):
        copy = self.copy("bare")
        shutil.rmtree(copy / "products")
        self.error(lambda: mesorig.open(copy).btf, copy, "there is no BTF", "mesorig process")
        self.error(lambda: mesorig.open(copy).mdf, copy, "there is no MDF")

    def test_no_reader(self):
        with mock.patch.dict(sys.modules, OpenEXR=None, OpenImageIO=None):
            self.error(lambda: session().mdf, "apt install python3-openimageio", "pip install")

    def test_no_library(self):
        with mock.patch.object(material, "_NAME", "libmesorig-nothing.so.0"):
            self.error(
                lambda: mesorig.Material(folder / "weave.session"),
                "libmesorig-nothing.so.0",
                "libmesorig-material0",
            )


class Library(unittest.TestCase):
    """libmesorig-material by ctypes."""

    @classmethod
    def setUpClass(cls):
        cls.material = mesorig.Material(folder / "weave.session")

    @classmethod
    def tearDownClass(cls):
        cls.material.close()

    def test_info(self):
        found, opened = self.material.info, session()
        self.assertEqual((found.kind, found.width, found.height), ("btf", 16, 16))
        self.assertEqual((found.n_views, found.n_lights), (6, 10))
        self.assertEqual(found.texel_mm, opened.grid.texel_mm)
        self.assertTrue(found.has_relief)
        self.assertGreater(found.deepest_mm, 0)
        self.assertEqual(found.error, 0)
        views, lights = self.material.directions
        np.testing.assert_allclose(views, opened.btf.views.vectors, atol=1e-6)
        np.testing.assert_allclose(lights, opened.btf.lights.vectors, atol=1e-6)

    def test_evaluate(self):
        """At the texels and the measured directions, the values are those of the array."""
        btf = session().btf
        uv = self.material.texel_uv()[:, :, None, None]
        views, lights = (d.vectors for d in (btf.views, btf.lights))
        found = self.material.evaluate(uv, views[:, None], lights)
        self.assertEqual(found.shape, btf.shape)
        expected = np.maximum(btf.values, 0)
        self.assertLess(np.abs(found - expected).max(), 1e-6 * max(1, expected.max()))
        wide = self.material.evaluate([0.5, 0.5], views[0], lights[0], footprint=1.0)
        self.assertAlmostEqual(wide[0] / expected[:, :, 0, 0, 0].mean(), 1, delta=0.02)
        for wrong in ([0.5, 0.5, 0.5], [0.5], 0.5):
            with self.assertRaises(ValueError):
                self.material.evaluate(wrong, views[0], lights[0])

    def test_intersect(self):
        """Over most texels that are known, a ray meets the surface at the measured distance."""
        mdf = session().mdf
        up = self.material.intersect(self.material.texel_uv()[:, :, None], mdf.views.vectors)
        self.assertEqual(up.distance_mm.shape, mdf.distance_mm.shape)
        self.assertTrue(up.hit.all())
        np.testing.assert_allclose(np.linalg.norm(up.normal, axis=-1), 1, atol=1e-5)
        # Nominal rays differ from those of the cameras by the ratio of two cosines.
        to = mdf.camera_mm - session().grid.centres_mm[:, :, None]
        cosine = to[..., 2] / np.linalg.norm(to, axis=-1)
        expected = mdf.distance_mm * cosine / mdf.views.vectors[:, 2]
        off = np.abs(up.distance_mm - expected)[mdf.seen]
        self.assertLess(np.median(off), 1e-3)
        below = self.material.intersect([0.5, 0.5], [0, 0, -1])
        self.assertFalse(below.hit)

    def test_sample(self):
        """sample() and pdf() agree, the density integrates to 1, and directions follow it."""
        random = np.random.default_rng(1).random((20000, 2), np.float32)
        view = mesorig.Directions([30], [0]).vectors[0]
        light, density = self.material.sample([0.5, 0.5], view, random)
        self.assertTrue((density > 0).all())
        np.testing.assert_allclose(np.linalg.norm(light, axis=-1), 1, atol=1e-5)
        again = self.material.pdf([0.5, 0.5], view, light)
        np.testing.assert_allclose(again, density, rtol=2e-3)
        self.assertAlmostEqual((1 / density).mean() / (2 * math.pi), 1, delta=0.05)
        z = np.random.default_rng(2).random(20000)
        phi = np.random.default_rng(3).random(20000) * 2 * math.pi
        flat = np.sqrt(1 - z**2)
        uniform = np.stack([flat * np.cos(phi), flat * np.sin(phi), z], axis=-1)
        density = self.material.pdf([0.5, 0.5], view, uniform)
        self.assertAlmostEqual(density.mean() * 2 * math.pi, 1, delta=0.03)
        expected = (density[:, None] * uniform).mean(axis=0) * 2 * math.pi
        np.testing.assert_allclose(light.mean(axis=0), expected, atol=0.02)

    def test_compressed(self):
        run(BIN / "mesorig", "compress", "weave.session", "--method", "lpca")
        file = folder / "weave.session/products/lpca.exr"
        opened = mesorig.open(file)
        self.assertEqual(opened.kind, "lpca")
        self.assertEqual(opened["clusters"].channels["K"].shape, (16, 16))
        with mesorig.Material(file) as compressed:
            found = compressed.info
            self.assertEqual(found.kind, "lpca")
            error = opened["clusters"].attributes["mesorig.error"]
            self.assertEqual(found.error, error)
            btf = session().btf
            uv = compressed.texel_uv()[:, :, None, None]
            values = compressed.evaluate(uv, btf.views.vectors[:, None], btf.lights.vectors)
            off = np.linalg.norm(values - btf.values) / np.linalg.norm(btf.values)
            self.assertLess(off, 1.1 * error + 1e-3)
        with self.assertRaises(ValueError):
            compressed.info

    def test_no_file(self):
        with self.assertRaises(mesorig.Error) as caught:
            mesorig.Material(folder / "nothing.exr")
        self.assertIn(str(folder / "nothing.exr"), str(caught.exception))


class Commands(unittest.TestCase):
    def call(self, *arguments):
        out, err = io.StringIO(), io.StringIO()
        with mock.patch.object(sys, "argv", ["mesorig", *map(str, arguments)]):
            with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
                code = command_line.main()
        return code, out.getvalue(), err.getvalue()

    def test_info(self):
        code, out, _ = self.call("info", folder / "gaps.session")
        self.assertEqual(code, 0)
        predicted = info("gaps.session")["btf_predicted"]
        for text in ("small, done", "6 views, 10 lights", f"{predicted} predicted", "MDF"):
            self.assertIn(text, out)
        code, out, _ = self.call("info", folder / "weave.session/products/eigenmaps.exr")
        self.assertIn("kind       eigenmaps\n", out)
        code, _, err = self.call("info", folder / "nothing")
        self.assertEqual(code, 1)
        self.assertIn(str(folder / "nothing"), err)

    def test_version(self):
        said = run(BIN / "mesorig", "--version")
        self.assertIn(mesorig.__version__, said)


class Documents(unittest.TestCase):
    def test_format(self):
        """docs/research/format.md names every channel and attribute of BTF, MDF and frames."""
        text = (SOURCE / "docs/research/format.md").read_text(encoding="utf-8")
        named = set(re.findall(r"`([\w.]+)`", text))
        opened = session("noisy")
        files = ["products/btf/view_0000.exr", "products/mdf.exr"]
        files += [next(f.path for f in opened.frames if f.shot == s) for s in self.kinds(opened)]
        for file in files:
            for part in opened.read(file):
                for name in [*part.channels, *part.attributes]:
                    self.assertTrue(name in named or name.startswith("lines."), f"{file}: {name}")

    @staticmethod
    def kinds(opened):
        """The first shot of each kind."""
        return {shot.kind: shot.id for shot in reversed(opened.shots)}.values()

    def test_page(self):
        """The blocks of docs/research/python.md run one after another, as in a notebook."""
        text = (SOURCE / "docs/research/python.md").read_text(encoding="utf-8")
        blocks = re.findall(r"^```python\n(.*?)^```", text, re.M | re.S)
        self.assertGreater(len(blocks), 4)
        names = {}
        out = io.StringIO()
        before = os.getcwd()
        os.chdir(folder)
        try:
            with contextlib.redirect_stdout(out):
                for k, block in enumerate(blocks):
                    exec(compile(block, f"python.md, block {k + 1}", "exec"), names)
        finally:
            os.chdir(before)
        self.assertIn("(16, 16, 6, 10, 3)", out.getvalue())


if __name__ == "__main__":
    unittest.main()
