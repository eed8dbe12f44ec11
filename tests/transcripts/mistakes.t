Mistakes in the files of a rig or a session are told with their place and with what would be right,
before anything moves. Each example starts from files that are right.

  $ fresh() { cp "$SMALL"/*.conf .; }
  $ plan() { fresh && change "$@" && mesorig plan rig.conf session.conf; }

Keys, numbers and units:

  $ plan rig.conf '[axis turntable]' 'setle_ms = 150'
  mesorig: rig.conf:10: [axis turntable] setle_ms: there is no such key; did you mean settle_ms?
  [1]
  $ plan rig.conf '[axis turntable]' 'settle_s = 0.15'
  mesorig: rig.conf:10: [axis turntable] settle_s: the unit is part of the name: write settle_ms (in ms)
  [1]
  $ plan rig.conf '[axis turntable]' 'speed_deg_s = -1'
  mesorig: rig.conf:10: [axis turntable] speed_deg_s: -1 is out of range: 0.001 to 100000 deg/s
  [1]
  $ plan rig.conf '[axis turntable]' 'speed_deg_s = NaN'
  mesorig: rig.conf:10: [axis turntable] speed_deg_s: "NaN" is not a number (its unit is deg/s; write only the number)
  [1]
  $ plan rig.conf '[camera cam30]' 'distance_mm = 650 mm'
  mesorig: rig.conf:50: [camera cam30] distance_mm: "650 mm" is not a number (its unit is mm; write only the number)
  [1]
  $ plan rig.conf '[camera cam30]' 'theta_deg = 0.5236'
  mesorig: session.conf:13: [views]: no camera stands at theta 30° (within 0.5°); there are: 0.5236° (cam30), 60° (cam60). Change the rings in the session file, or the rig file
  [1]
  $ plan rig.conf '[camera cam30]' 'distance_mm = 0.65'
  mesorig: rig.conf:50: [camera cam30] distance_mm: 0.65 is out of range: 1 to 100000 mm
  [1]
  $ plan world.conf '[world]' 'gather_rays = nan'
  mesorig: rig.conf:9: [axis turntable]: world.conf:4: [world] gather_rays: "nan" is not a whole number
  [1]

What does not fit together in a rig:

  $ plan rig.conf '[axis turntable]'
  mesorig: session.conf:13: [views]: no camera stands at theta 30° phi 180° (within 0.5°), and there is no [axis turntable] in the rig file that would turn the sample before one: give the directions of the cameras, or write devices = all
  [1]
  $ plan rig.conf '[lamps bank]'
  mesorig: rig.conf: 2 mistakes:
  rig.conf:30: [lamp lamp30] bank: there is no section [lamps bank]; name an existing one
  rig.conf:38: [lamp lamp60] bank: there is no section [lamps bank]; name an existing one
  [1]
  $ plan rig.conf '[lamp lamp30]' 'bank = benk'
  mesorig: rig.conf:34: [lamp lamp30] bank: there is no section [lamps benk]; name an existing one
  [1]
  $ plan rig.conf '[camera cam30]' 'width = 33'
  mesorig: rig.conf:50: [camera cam30] width: is 33, but the camera's pictures are 32 × 32: write width = 32 and height = 32
  [1]
  $ plan rig.conf '[interlock door]' 'driver = steam'
  mesorig: rig.conf:106: [interlock door] driver: there is no driver "steam" for this class; choose from: sim-interlock, modbus-inputs
  [1]
  $ plan rig.conf '[axis arc]' 'world = welt.conf'
  mesorig: rig.conf:20: [axis arc] world: there is no file welt.conf: correct the path
  [1]
  $ plan rig.conf '[axis arc]' 'part = leg'
  mesorig: rig.conf:20: [axis arc] part: world.conf has no laser "leg"; choose from: turntable, arc, arm, probe, laser30, laser60
  [1]
  $ plan rig.conf '[lamps bank]' 'fault_dead = lamp61'
  mesorig: rig.conf:30: [lamps bank] fault_dead: world.conf has no lamp "lamp61"; choose from: lamp30, lamp60
  [1]

Sessions:

  $ plan session.conf '[views]' 'rings = 30:2; 45:2'
  mesorig: session.conf:13: [views]: no camera stands at theta 45° (within 0.5°); there are: 30° (cam30), 60° (cam60). Change the rings in the session file, or the rig file
  [1]
  $ plan session.conf '[lights]' 'rings = 10:2'
  mesorig: session.conf:16: [lights]: no lamp stands at theta 10° (within 0.5°); there are: 30° (lamp30), 60° (lamp60). Change the rings in the session file, or the rig file
  [1]
  $ plan session.conf '[lasers]' 'rings = 45:1'
  mesorig: session.conf:20: [lasers]: no laser stands at theta 45° (within 0.5°); there are: 30° (laser30), 60° (laser60). Change the rings in the session file, or the rig file
  [1]
  $ plan session.conf '[views]'
  mesorig: session.conf: there is no section [views]; add it
  [1]
  $ plan session.conf '[sample]' 'texels = 100000'
  mesorig: session.conf:7: [sample] texels: 100000 is out of range: 0 to 8192
  [1]
  $ plan session.conf '[sample]' 'width_mm = 0.05'
  mesorig: session.conf:7: [sample] width_mm: 0.05 is out of range: 0.1 to 2000 mm
  [1]
  $ plan session.conf '[capture]' 'exposures_us = 4000; nan'
  mesorig: session.conf:25: [capture] exposures_us: "nan" is not a number (its unit is us; write only the number)
  [1]
  $ plan session.conf '[capture]' 'exposures_us = 0.004; 0.016'
  mesorig: session.conf:25: [capture] exposures_us: 0.004 is out of range: 1 to 60000000 us
  [1]
  $ plan session.conf '[capture]' 'exposures_ms = 4; 16'
  mesorig: session.conf:25: [capture] exposures_ms: the unit is part of the name: write exposures_us (in us)
  [1]
  $ plan session.conf '[capture]' 'sweep_steps = 60000'
  mesorig: session.conf:25: [capture] sweep_steps: 60000 is out of range: 8 to 32767
  [1]
  $ plan session.conf '[capture]' 'dark_frames = 2.5'
  mesorig: session.conf:25: [capture] dark_frames: "2.5" is not a whole number
  [1]

A capture says the same as a plan, and makes no session.

  $ same() { plan "$@" >planned 2>&1; mesorig capture rig.conf session.conf -o x.session 2>&1 | diff planned -; }
  $ same rig.conf '[axis turntable]' 'speed_deg_s = NaN'
  $ same rig.conf '[camera cam30]' 'width = 33'
  $ same rig.conf '[lamps bank]' 'fault_dead = lamp61'
  $ same session.conf '[lights]' 'rings = 10:2'
  $ same session.conf '[views]'
  $ same session.conf '[capture]' 'exposures_ms = 4; 16'
  $ same world.conf '[world]' 'gather_rays = nan'
  $ test -e x.session
  [1]

All mistakes are told together, those that only drivers know as well. Without opening devices the
same is told.

  $ fresh
  $ change rig.conf '[axis turntable]' 'speed_deg_s = -1'
  $ change rig.conf '[axis arc]' 'part = leg'
  $ change rig.conf '[lamps bank]' 'fault_dead = lamp61'
  $ change rig.conf '[camera cam60]' 'part = cam61'
  $ change rig.conf '[laser laser30]' 'world = welt.conf'
  $ change rig.conf '[axis sweep60]' 'home_deg = 20'
  $ mesorig plan rig.conf session.conf
  mesorig: rig.conf: 6 mistakes:
  rig.conf:10: [axis turntable] speed_deg_s: -1 is out of range: 0.001 to 100000 deg/s
  rig.conf:20: [axis arc] part: world.conf has no laser "leg"; choose from: turntable, arc, arm, probe, laser30, laser60
  rig.conf:30: [lamps bank] fault_dead: world.conf has no lamp "lamp61"; choose from: lamp30, lamp60
  rig.conf:62: [camera cam60] part: world.conf has no camera "cam61"; choose from: cam30, cam60
  rig.conf:84: [axis sweep60] home_deg: 20 is outside of min_deg to max_deg: give a value from -15 to 15
  rig.conf:95: [laser laser30] world: there is no file welt.conf: correct the path
  [1]
  $ mesorig plan --offline rig.conf session.conf
  mesorig: rig.conf: 6 mistakes:
  rig.conf:10: [axis turntable] speed_deg_s: -1 is out of range: 0.001 to 100000 deg/s
  rig.conf:20: [axis arc] part: world.conf has no laser "leg"; choose from: turntable, arc, arm, probe, laser30, laser60
  rig.conf:30: [lamps bank] fault_dead: world.conf has no lamp "lamp61"; choose from: lamp30, lamp60
  rig.conf:62: [camera cam60] part: world.conf has no camera "cam61"; choose from: cam30, cam60
  rig.conf:84: [axis sweep60] home_deg: 20 is outside of min_deg to max_deg: give a value from -15 to 15
  rig.conf:95: [laser laser30] world: there is no file welt.conf: correct the path
  [1]

Arguments in the wrong order are one mistake.

  $ fresh
  $ mesorig plan session.conf rig.conf
  mesorig: session.conf is a session file, and rig.conf is a rig file: give RIG before SESSION
  [1]
  $ mesorig capture rig.conf rig.conf -o x.session
  mesorig: rig.conf is a rig file: give RIG before SESSION, a file with a section [session]
  [1]
  $ mesorig info rig.conf
  mesorig: rig.conf: not an EXR file, but probably a text; “mesorig calibrate show” prints calibrations
  [1]

So is a place where no session can be.

  $ mkdir x.session
  $ mesorig capture rig.conf session.conf -o x.session
  mesorig: x.session exists already, and is not a session; choose another name
  [1]
  $ mesorig plan rig.conf session.conf -o /proc/weave.session
  mesorig: /proc/weave.session: no session can be written there, because it is not on a disk; choose a folder on a disk
  [1]

A session with a database of garbage stays as it is.

  $ head -c 9000 /bin/sh >x.session/session.db
  $ cp x.session/session.db garbage
  $ mesorig resume x.session
  mesorig: x.session/session.db: not a session's database: file is not a database; restore it from a backup
  [1]
  $ mesorig process x.session
  mesorig: x.session/session.db: not a session's database: file is not a database; restore it from a backup
  [1]
  $ mesorig info x.session
  mesorig: x.session/session.db: not a session's database: file is not a database; restore it from a backup
  [1]
  $ mesorig status x.session
  mesorig: x.session/session.db: not a session's database: file is not a database; restore it from a backup
  [1]
  $ mesorig capture rig.conf session.conf -o x.session
  mesorig: x.session exists already; choose another name, or continue that session with “mesorig resume”
  [1]
  $ cmp garbage x.session/session.db
