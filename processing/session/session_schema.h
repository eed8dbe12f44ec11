/*
 * The schema of session.db, a public format. SQLite 3.37 or later reads it (STRICT tables). Every
 * table contains its own description, so `sqlite3 session.db .schema` gives the same information
 * as this file.
 *
 *   PRAGMA application_id   SESSION_APPLICATION_ID, "MSRG"
 *   PRAGMA user_version     SESSION_FORMAT
 *   PRAGMA journal_mode     WAL
 *
 * Lengths are in millimetres, angles in degrees, and times in seconds on the session's clock.
 * Numbers are IEEE doubles, stored bit for bit, except −0, which SQLite stores as 0. A table is
 * recognised by its text below without the comments: any other change of the text needs a new
 * SESSION_FORMAT.
 */
#pragma once

#define SESSION_APPLICATION_ID 0x4d535247

struct session_table {
    const char *name, *sql;
};

static const struct session_table session_tables[] = {
    {"session", "CREATE TABLE session (\n"
                "  -- one row: whose session this is\n"
                "  id INTEGER PRIMARY KEY CHECK (id = 1),\n"
                "  name TEXT NOT NULL,\n"
                "  program TEXT NOT NULL,             -- what made it, with version\n"
                "  created TEXT NOT NULL              -- ISO 8601, UTC\n"
                ") STRICT"},
    {"text", "CREATE TABLE text (\n"
             "  -- files as they were: rig.conf, session.conf, calibration.conf\n"
             "  name TEXT PRIMARY KEY NOT NULL,\n"
             "  content TEXT NOT NULL\n"
             ") STRICT"},
    {"grid", "CREATE TABLE grid (\n"
             "  -- one row: the texels of the reference plane, in the sample frame\n"
             "  id INTEGER PRIMARY KEY CHECK (id = 1),\n"
             "  width INTEGER NOT NULL,            -- texels\n"
             "  height INTEGER NOT NULL,\n"
             "  width_mm REAL NOT NULL,\n"
             "  height_mm REAL NOT NULL,\n"
             "  reference_mm REAL NOT NULL,        -- above the turntable\n"
             "  depth_mm REAL NOT NULL             -- of the structure below, at most\n"
             ") STRICT"},
    {"direction",
     "CREATE TABLE direction (\n"
     "  -- views, lights and laser positions as planned, in the sample frame\n"
     "  kind TEXT NOT NULL CHECK (kind IN ('view', 'light', 'laser')),\n"
     "  idx INTEGER NOT NULL,              -- 0 ... n-1 of each kind\n"
     "  device INTEGER NOT NULL,           -- camera, lamp or laser of the calibration\n"
     "  theta_deg REAL NOT NULL,           -- from the normal\n"
     "  phi_deg REAL NOT NULL,             -- from +x, counter-clockwise\n"
     "  turntable_deg REAL NOT NULL,       -- views: the angle that shows this view\n"
     "  note TEXT,                         -- what was re-planned about it\n"
     "  PRIMARY KEY (kind, idx)\n"
     ") STRICT"},
    {"shot",
     "CREATE TABLE shot (\n"
     "  -- what is to be taken, in order of id\n"
     "  id INTEGER PRIMARY KEY,            -- 1 ... n\n"
     "  kind TEXT NOT NULL CHECK (kind IN ('dark', 'lamp', 'sweep')),\n"
     "  pose INTEGER NOT NULL,             -- number of the pose in planned order\n"
     "  turntable_deg REAL NOT NULL,       -- commanded\n"
     "  arc_deg REAL NOT NULL,\n"
     "  source INTEGER NOT NULL,           -- idx of the light or laser position, or -1\n"
     "  device INTEGER NOT NULL,           -- lamp or laser of the calibration, or -1\n"
     "  cameras INTEGER NOT NULL,          -- bit c: camera c takes part; -n: see cameras/n\n"
     "  sweep_from_deg REAL NOT NULL,\n"
     "  sweep_to_deg REAL NOT NULL,\n"
     "  sweep_steps INTEGER NOT NULL,\n"
     "  state TEXT NOT NULL CHECK (state IN ('planned', 'done', 'skipped')),\n"
     "  note TEXT                          -- why it was skipped or changed\n"
     ") STRICT"},
    {"frame", "CREATE TABLE frame (\n"
              "  -- what was taken; a row is committed after its file is on disk\n"
              "  shot INTEGER NOT NULL REFERENCES shot (id),\n"
              "  camera INTEGER NOT NULL,\n"
              "  path TEXT NOT NULL UNIQUE,         -- relative to the session directory\n"
              "  sha256 TEXT NOT NULL,              -- of the file, hexadecimal\n"
              "  bytes INTEGER NOT NULL,            -- its length\n"
              "  retakes INTEGER NOT NULL,          -- frames refused before this one\n"
              "  captured_s REAL NOT NULL,\n"
              "  PRIMARY KEY (shot, camera)\n"
              ") STRICT"},
    {"event", "CREATE TABLE event (\n"
              "  -- what happened, in order of id\n"
              "  id INTEGER PRIMARY KEY,\n"
              "  time_s REAL NOT NULL,\n"
              "  level TEXT NOT NULL,               -- info, warning or error\n"
              "  source TEXT NOT NULL,              -- the device or stage\n"
              "  message TEXT NOT NULL\n"
              ") STRICT"},
    {"value", "CREATE TABLE value (\n"
              "  -- small facts by name: state, clock_s and so on\n"
              "  key TEXT PRIMARY KEY NOT NULL,\n"
              "  value TEXT NOT NULL\n"
              ") STRICT"},
    {"product",
     "CREATE TABLE product (\n"
     "  -- what processing made\n"
     "  path TEXT PRIMARY KEY NOT NULL,    -- relative to the session directory\n"
     "  made_by TEXT NOT NULL,             -- the hash of its inputs, or how it was made\n"
     "  sha256 TEXT NOT NULL,\n"
     "  bytes INTEGER NOT NULL\n"
     ") STRICT"},
};
