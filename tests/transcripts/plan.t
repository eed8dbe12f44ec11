A plan says what a session takes before anything moves.

  $ mesorig plan "$SMALL/rig.conf" "$SMALL/session.conf"
  session         small
  directions      4 views, 4 lights, 2 laser positions; 16 pictures of the BTF
  poses           4
  shots           13, with 144 camera frames
  on disk         about 352.1 kB of frames; products need additional space
  predicted time  25 s, 17.7 % above the lower bound of 21 s
  nested order    28 s, 1.10 times as long
  calibration     none: geometry and light are nominal (mesorig calibrate makes one, -c FILE gives it)
  $ mesorig plan --json "$SMALL/rig.conf" "$SMALL/session.conf" | python3 -m json.tool --json-lines --no-ensure-ascii --indent 1
  {
   "session": "small",
   "prompt": "",
   "views": 4,
   "lights": 4,
   "lasers": 2,
   "poses": 4,
   "shots": 13,
   "frames": 144,
   "mounts": 0,
   "later_sweeps": 0,
   "later_lamps": 0,
   "passes": 0,
   "passing": 0,
   "bytes": 352104,
   "bytes_least": 352104,
   "predicted_s": 24.941,
   "lower_bound_s": 21.191,
   "nested_s": 27.541,
   "first_s": 24.941,
   "standing_s": 0,
   "pass_deg_s": 0,
   "blur_texels": 0,
   "blur_mm": 0,
   "pose_texels": 0,
   "notes": [],
   "calibration": "none: geometry and light are nominal (mesorig calibrate makes one, -c FILE gives it)"
  }

A camera with a list of exposure times of its own:

  $ cat >still.conf <<END
  > [rig]
  > id = still
  > [lamps dome]
  > driver = serial-lamps
  > port = /dev/ttyUSB0
  > count = 8
  > distance_mm = 400
  > [camera top]
  > driver = gphoto2-camera
  > port = usb
  > theta_deg = 0
  > phi_deg = 0
  > distance_mm = 600
  > width = 60
  > height = 40
  > focal_px = 100
  > END
  $ sed 's/^exposures_us = .*/exposures_us = auto/' "$SMALL/../../etc/demo/dome/session.conf" >dome.conf
  $ mesorig plan --offline still.conf dome.conf
  mesorig: dome.conf:20: [capture] exposures_us: auto does not work with camera top, which has only the exposure times of its own list: write times of this list in \xc2\xb5s; \xe2\x80\x9cmesorig snap top -e US\xe2\x80\x9d takes a picture, or names the nearest time of the list (esc)
  [1]

Files that cannot be read:

  $ printf '[rig]\nid = x\narc_radius_mm = NaN\narc_width_mm = 30\n' >bad_rig.conf
  $ printf '[session]\nname = x\n\n[views]\nrings = 99:x\n' >bad_session.conf
  $ printf '\001\002\377\376[[[' >binary.conf
  $ mesorig plan bad_rig.conf "$SMALL/session.conf"
  mesorig: bad_rig.conf: 3 mistakes:
  bad_rig.conf:3: [rig] arc_radius_mm: "NaN" is not a number (its unit is mm; write only the number)
  bad_rig.conf: there is no section [camera NAME]; a rig needs cameras, and lamps or lasers
  bad_rig.conf: there is no section [lamp NAME] or [laser NAME]; a rig needs cameras, and lamps or lasers
  [1]
  $ mesorig plan "$SMALL/rig.conf" bad_session.conf
  mesorig: bad_session.conf: 4 mistakes:
  bad_session.conf:5: [views] rings: "99:x" is not theta:count or theta:count:offset with theta from 0 to 89 degrees, count from 1 to 720 (1 at theta 0), offset from -360 to 360
  bad_session.conf: there is no section [sample]; add it
  bad_session.conf: there is neither [lights] nor [lasers], so there is nothing to capture; add one of them
  bad_session.conf: there is no section [capture]; add it
  [1]
  $ mesorig plan binary.conf "$SMALL/session.conf"
  mesorig: binary.conf:1: this line is not text in UTF-8: save the file as UTF-8
  [1]
  $ mesorig plan "$SMALL/rig.conf" binary.conf --json
  {"error": "binary.conf:1: this line is not text in UTF-8: save the file as UTF-8"}
  [1]
  $ mesorig plan /no/such/rig.conf "$SMALL/session.conf"
  mesorig: cannot read /no/such/rig.conf: No such file or directory
  [1]
  $ mesorig plan "$SMALL/rig.conf" .
  mesorig: cannot read .: it is a directory, not a regular file; give the path of a file
  [1]
  $ mesorig capture bad_rig.conf "$SMALL/session.conf" -o x
  mesorig: bad_rig.conf: 3 mistakes:
  bad_rig.conf:3: [rig] arc_radius_mm: "NaN" is not a number (its unit is mm; write only the number)
  bad_rig.conf: there is no section [camera NAME]; a rig needs cameras, and lamps or lasers
  bad_rig.conf: there is no section [lamp NAME] or [laser NAME]; a rig needs cameras, and lamps or lasers
  [1]
