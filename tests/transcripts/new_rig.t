A first rig file, from options or from answers.

  $ mesorig new-rig --offline --kind dome --lamps 64 --radius 400 dome.conf
  dome.conf: a rig of the kind dome with 64 lamps at 400 mm
  not found: a relay board for 64 lamps, for [lamps dome]
  not found: a camera, for [camera cam]
  Correct what stands below CHECK and NOT FOUND in the file. Then check it:
    mesorig plan --offline dome.conf SESSION.conf
  What switches the lamps: relays, serial, artnet, sacn, wled or program [relays]: 
  What takes the pictures: found, still or program [found]: 
  $ mesorig plan --offline dome.conf "$SMALL/../../etc/demo/dome/session.conf"
  session         dome
  directions      1 view, 64 lights, 0 laser positions; 64 pictures of the BTF
  poses           1
  shots           65, with 136 camera frames
  on disk         about 135.5 MB of frames; products need additional space
  predicted time  8.1 s, 0.4 % above the lower bound of 8.1 s
  nested order    8.1 s, 1.00 times as long
  note            frames of more than 256² pixels are compressed, and their size depends on their content; mesorig status tells what the session will take by the frames stored so far
  note            one view: the session will have its pictures under each light (an RTI set, for PTM and HSH) and no other views
  note            assumed for [camera cam]: 30 pictures a second, because only the camera knows its rate
  note            assumed for [camera cam]: that it supports the exposures of the session
  calibration     none: geometry and light are nominal (mesorig calibrate makes one, -c FILE gives it)
  $ mesorig new-rig --offline --kind dome --lamps 64 --radius 400 dome.conf
  mesorig: dome.conf exists already: give another name, or --force to replace it
  [1]
  $ printf 'ring\narc\n0\n3\n\n' | mesorig new-rig --offline arc.conf
  arc.conf: a rig of the kind arc with 3 lamps at 400 mm
  not found: a stepper controller, for [axis turntable]
  not found: a stepper controller, for [axis arc]
  not found: a relay board for 3 lamps, for [lamps arc]
  not found: a camera, for [camera cam]
  Correct what stands below CHECK and NOT FOUND in the file. Then check it:
    mesorig plan --offline arc.conf SESSION.conf
  Kind of rig: dome, turntable or arc [dome]: there is no kind of rig “ring”; choose from: dome, turntable, arc
  Kind of rig: dome, turntable or arc [dome]: Number of lamps, or a file with their positions (.lp) [5]: “0” is not a number of lamps from 1 to 1024, and there is no file of this name
  Number of lamps, or a file with their positions (.lp) [5]: Distance of the lamps from the sample, in mm [400]: What moves the axes: tic, gcode or program [tic]: 
  What switches the lamps: relays, serial, artnet, sacn, wled or program [relays]: 
  What takes the pictures: found, still or program [found]: 
  $ cat arc.conf
  # A rig of the kind “arc”, made by “mesorig new-rig”. rig.conf(5) explains every key.
  # Lengths are in millimetres, angles in degrees. Correct what stands below CHECK and NOT FOUND.
  
  [rig]
  id = arc
  # CHECK: radius of the arc's inner edge, and width of the arc with its lamps
  arc_radius_mm = 400
  arc_width_mm = 30
  
  # NOT FOUND: a stepper controller. Write the section that “mesorig devices” prints, or one of
  # /usr/share/mesorig/devices.
  [axis turntable]
  driver = tic-axis
  serial = 00000001
  # CHECK: microsteps in a degree of the axis
  steps_per_deg = 100
  wraps = yes
  
  # NOT FOUND: a stepper controller. Write the section that “mesorig devices” prints, or one of
  # /usr/share/mesorig/devices.
  [axis arc]
  driver = tic-axis
  serial = 00000002
  # CHECK: microsteps in a degree of the axis
  steps_per_deg = 100
  min_deg = -170
  max_deg = 170
  
  # NOT FOUND: a relay board for 3 lamps. Write the section that “mesorig devices” prints, or one of
  # /usr/share/mesorig/devices.
  [lamps arc]
  driver = modbus-relays
  bus = /dev/ttyUSB0
  unit = 1
  n = 3
  # CHECK: polar angles of the lamps on the arc, 0 being straight above
  theta_deg = 15; 45; 75
  # their distance from the middle of the turntable's top
  distance_mm = 400
  
  # NOT FOUND: a camera. Write the section that “mesorig devices” prints, or one of
  # /usr/share/mesorig/devices.
  [camera cam]
  driver = v4l2-camera
  device = /dev/video0
  # CHECK: size of its pictures, in pixels
  width = 1920
  height = 1080
  # CHECK: focal length of the lens divided by the width of a pixel, or width × distance_mm
  # divided by the width in mm that a picture shows there
  focal_px = 5760
  # CHECK: its place. It points at the middle of the turntable's top
  theta_deg = 30
  phi_deg = 180
  distance_mm = 600
  # A guess. Reflectances are wrong by a common factor until a white tile is measured
  # (mesorig calibrate radiometry).
  response = 1.2e+05
  $ mesorig new-rig --offline --lamps 2 --json turn.conf --kind turntable < /dev/null
  {"file": "turn.conf", "kind": "turntable", "lamps": 2, "radius_mm": 400, "missing": ["a stepper controller, for [axis turntable]", "a relay board for 2 lamps, for [lamps ring]", "a camera, for [camera cam]"], "replaced": false}
  Distance of the lamps from the sample, in mm [400]: 
  What moves the axes: tic, gcode or program [tic]: 
  What switches the lamps: relays, serial, artnet, sacn, wled or program [relays]: 
  What takes the pictures: found, still or program [found]: 
  $ printf 'turntable\n4\n\ngcode\n/tmp/printer\nhue\nwled\n10.0.0.7:8080\nprogram\n/opt/camera.py;left\n' | mesorig new-rig --offline ways.conf
  ways.conf: a rig of the kind turntable with 4 lamps at 400 mm
  Correct what stands below CHECK in the file. Then check it:
    mesorig plan --offline ways.conf SESSION.conf
  Kind of rig: dome, turntable or arc [dome]: Number of lamps, or a file with their positions (.lp) [16]: Distance of the lamps from the sample, in mm [400]: What moves the axes: tic, gcode or program [tic]: Serial port of the G-code board [/dev/ttyUSB0]: What switches the lamps: relays, serial, artnet, sacn, wled or program [relays]: there is no “hue”; choose from: relays, serial, artnet, sacn, wled or program
  What switches the lamps: relays, serial, artnet, sacn, wled or program [relays]: Address of the WLED controller [192.168.1.50]: What takes the pictures: found, still or program [found]: Path of the program, and its arguments after “;” [/usr/share/mesorig/programs/rpicam.py]:  (no-eol)
  $ sed -n '/^\[axis/,/^rings/p; /^\[camera/,/^#/p' ways.conf
  [axis turntable]
  driver = gcode-axis
  # CHECK: language of the board: grbl, marlin or klipper
  dialect = grbl
  port = /tmp/printer
  letter = X
  # CHECK: units of the board in a degree; 1 if it counts degrees
  units_per_deg = 1
  # CHECK: “here” is for an axis without a switch: its present position becomes home_deg.
  # With a switch: axis, or all for GRBL
  homing = here
  # CHECK: top speed and acceleration of the axis
  speed_deg_s = 20
  accel_deg_s2 = 40
  wraps = yes
  
  [lamps ring]
  driver = wled-lamps
  address = 10.0.0.7
  http_port = 8080
  # CHECK: first LED of the first lamp, and number of LEDs of each lamp
  first_led = 0
  leds = 1
  n = 4
  # CHECK: rings of lamps, as polar angle:number. A ring begins at azimuth 0.
  rings = 30:2; 60:2
  [camera cam]
  driver = program-camera
  program = /opt/camera.py
  arguments = left
  # CHECK: size of its pictures, in pixels
  $ mesorig new-rig --offline --kind dome --lamps 8 --radius 300 --bank sacn:multicast --cameras found sacn.conf < /dev/null
  sacn.conf: a rig of the kind dome with 8 lamps at 300 mm
  not found: a camera, for [camera cam]
  Correct what stands below CHECK and NOT FOUND in the file. Then check it:
    mesorig plan --offline sacn.conf SESSION.conf
  $ sed -n '/^\[lamps/,/^n =/p' sacn.conf
  [lamps dome]
  driver = sacn-lamps
  # CHECK: universe and first channel of the first lamp
  universe = 1
  start = 1
  n = 8
  $ mkdir lists && printf '2\na.jpg 300 0 400\nb.jpg 0 300 400\n' > dome.lp && printf '1\na.jpg 0 0 1\n' > lists/far.lp
  $ mesorig new-rig --offline --kind dome --lamps dome.lp --bank serial:/dev/ttyACM0 --cameras still:ptpip:192.168.1.2:15740:15740 list.conf
  list.conf: a rig of the kind dome with 2 lamps at 500 mm
  Correct what stands below CHECK in the file. Then check it:
    mesorig plan --offline list.conf SESSION.conf
  $ sed -n '/^\[lamps/,$p' list.conf
  [lamps dome]
  driver = serial-lamps
  port = /dev/ttyACM0
  # the lamps in the order in which the bank numbers them
  positions = dome.lp
  
  [camera cam]
  driver = gphoto2-camera
  port = ptpip:192.168.1.2:15740:15740
  # CHECK: size of its pictures, in pixels
  width = 1920
  height = 1080
  # CHECK: focal length of the lens divided by the width of a pixel, or width × distance_mm
  # divided by the width in mm that a picture shows there
  focal_px = 7200
  # CHECK: its place. It points at the middle of the sample's place
  # phi_deg = 270: azimuth 0 is at the right edge of the picture, and 90 at its upper edge
  theta_deg = 0
  phi_deg = 270
  distance_mm = 750
  # A guess. Reflectances are wrong by a common factor until a white tile is measured
  # (mesorig calibrate radiometry).
  response = 1.9e+05
  $ mesorig new-rig --offline --kind dome --lamps lists/far.lp --bank serial:/dev/ttyACM0 --cameras still:usb far.conf < /dev/null
  far.conf: a rig of the kind dome with 1 lamps at 400 mm
  Correct what stands below CHECK in the file. Then check it:
    mesorig plan --offline far.conf SESSION.conf
  Distance of the lamps from the sample, in mm [400]: 
  $ grep -A3 'lamps in the order' far.conf | sed "s|$PWD|.|"
  # the lamps in the order in which the bank numbers them
  positions = ./lists/far.lp
  # their distance from the middle of the sample's place
  distance_mm = 400
  $ mesorig new-rig --offline --kind dome --lamps 1024 --radius 400 --cameras found many.conf < /dev/null
  many.conf: a rig of the kind dome with 1024 lamps at 400 mm
  not found: a camera, for [camera cam]
  Correct what stands below CHECK and NOT FOUND in the file. Then check it:
    mesorig plan --offline many.conf SESSION.conf
  What switches the lamps: relays, serial, artnet, sacn, wled or program [artnet]: 
  Address of the Art-Net node [192.168.1.50]: 
  $ printf '65\nrelays\nwled\n\n' | mesorig new-rig --offline --kind dome --radius 400 --cameras found led.conf
  led.conf: a rig of the kind dome with 65 lamps at 400 mm
  not found: a camera, for [camera cam]
  Correct what stands below CHECK and NOT FOUND in the file. Then check it:
    mesorig plan --offline led.conf SESSION.conf
  Number of lamps, or a file with their positions (.lp) [64]: What switches the lamps: relays, serial, artnet, sacn, wled or program [artnet]: “relays” has at most 64 lamps, not 65. Choose another bank, or give fewer lamps and add the others to the rig file, in a further section [lamps NAME]
  What switches the lamps: relays, serial, artnet, sacn, wled or program [artnet]: Address of the WLED controller [192.168.1.50]:  (no-eol)
  $ mesorig new-rig --offline --bank serial:/dev/ttyACM0 --lamps 65 x.conf
  mesorig new-rig: --lamps: “serial” has at most 64 lamps, not 65. Choose another bank, or give fewer lamps and add the others to the rig file, in a further section [lamps NAME]
  Usage: mesorig new-rig FILE.conf
  [2]
  $ mesorig new-rig --offline --bank dmx:10.0.0.7 x.conf
  mesorig new-rig: --bank: there is no “dmx”; choose from: relays, serial, artnet, sacn, wled or program
  Usage: mesorig new-rig FILE.conf
  [2]
  $ mesorig new-rig --offline --axes tic:1 x.conf
  mesorig new-rig: --axes: “tic” has no port, address or path: leave out “:” and the rest
  Usage: mesorig new-rig FILE.conf
  [2]
  $ mesorig new-rig --offline --kind cube x.conf
  mesorig new-rig: --kind: there is no kind of rig “cube”; choose from: dome, turntable, arc
  Usage: mesorig new-rig FILE.conf
  [2]
  $ mesorig new-rig --offline --lamps 1025 x.conf
  mesorig new-rig: --lamps: “1025” is not a number of lamps from 1 to 1024, and there is no file of this name
  Usage: mesorig new-rig FILE.conf
  [2]
  $ mesorig new-rig --offline --radius 4m x.conf
  mesorig new-rig: --radius: “4m” is not a radius from 10 to 10000 mm
  Usage: mesorig new-rig FILE.conf
  [2]
  $ mesorig new-rig --offline
  mesorig new-rig: an argument is missing
  Usage: mesorig new-rig FILE.conf
  [2]
  $ ls
  arc.conf
  dome.conf
  dome.lp
  far.conf
  led.conf
  list.conf
  lists
  many.conf
  sacn.conf
  turn.conf
  ways.conf
