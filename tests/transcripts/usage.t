Bad usage ends with exit code 2, and the command that was meant is named.

  $ mesorig --version
  mesorig 0.1.0
  $ mesorig develop
  mesorig: no command “develop”; “mesorig --help” lists the commands
  [2]
  $ mesorig captur rig.conf
  mesorig: no command “captur”: did you mean “capture”?
  [2]
  $ mesorig proces S
  mesorig: no command “proces”: did you mean “process”?
  [2]
  $ mesorig sing S
  mesorig: no command “sing”; “mesorig --help” lists the commands
  [2]
  $ mesorig check S --strct
  mesorig check: Unknown option --strct; did you mean --strict?
  Usage: mesorig check DIR
  [2]
  $ mesorig check S --strct=yes
  mesorig check: Unknown option --strct=yes; did you mean --strict?
  Usage: mesorig check DIR
  [2]
  $ mesorig compress S -s 4500B
  mesorig compress: Unknown option -s; did you mean --size or --samples or --seed?
  Usage: mesorig compress DIR
  [2]
  $ mesorig compress S -c 4
  mesorig compress: Unknown option -c; did you mean --components or --colours?
  Usage: mesorig compress DIR
  [2]
  $ mesorig compress S -x
  mesorig compress: Unknown option -x
  Usage: mesorig compress DIR
  [2]
  $ mesorig calibrate camras
  mesorig calibrate: there is no “calibrate camras”; did you mean “cameras”?
  Usage: mesorig calibrate WHAT …
  [2]
  $ mesorig plan rig.conf session.conf --adress=x
  mesorig plan: Unknown option --adress=x; did you mean --address?
  Usage: mesorig plan RIG SESSION
  [2]
  $ mesorig move arc -15
  mesorig move: before a negative number write --, as in “mesorig move -- … -15”: Unknown option -15
  Usage: mesorig move AXIS DEGREES
  [2]
  $ mesorig plan rig.conf
  mesorig plan: an argument is missing
  Usage: mesorig plan RIG SESSION
  [2]
  $ mesorig capture rig.conf session.conf
  mesorig capture: no session directory is given: give -o DIR
  Usage: mesorig capture RIG SESSION -o DIR
  [2]
  $ mesorig status --bus=coach
  mesorig status: there is no --bus=coach; choose from: system, session
  Usage: mesorig status [DIR]
  [2]
  $ mesorig status --bus=system --address=unix:path=/x
  mesorig status: give --bus or --address, not both
  Usage: mesorig status [DIR]
  [2]
  $ mesorig verify a b c d
  mesorig verify: too many arguments
  Usage: mesorig verify DIR
  [2]

Without a command all commands are listed.

  $ mesorig
  Usage: mesorig COMMAND …
  
  Capture a session:
    plan        Check a session file, and predict order and time of its capture.
    capture     Capture a session and show its progress.
    resume      Continue a session: capture the frames that are missing.
    status      Show what the rig does.
    watch       Follow a capture until it ends.
    pause       Pause after the shot under way.
    continue    Continue after a pause or a fault.
    finish      End a capture as good enough, after the shot under way.
    abort       End a capture now; it can be resumed.
    safe        Switch lamps and lasers off and stop all axes, until “release”.
    release     Allow light and movement again after “safe”.
    close       Make the daemon close its rig, so that another may be opened.
    queue       Capture sessions one after the other, without an operator.
  
  Devices:
    drivers     List the drivers and their options in a rig file.
    devices     List the devices on the buses, with sections for a rig file.
    new-rig     Write a first rig file for the devices that are plugged in.
    test        Test every device.
    conformance Test a program that is a device.
    snap        Take a picture, and measure it.
    live        Take and show pictures until Ctrl-C, to point and focus a camera.
    lamp        Switch a lamp on until Ctrl-C.
    laser       Switch a laser on until Ctrl-C or until an interlock opens.
    move        Move an axis to an angle.
    home        Move an axis to its reference position.
  
  Calibrate:
    board       Draw a calibration board to print.
    calibrate   Calibrate cameras, lamps and lasers from pictures.
  
  Process a session:
    process     Compute the BTF, the MDF and eigen-maps of a session.
    compress    Compress the BTF or the MDF of a session.
    resample    Make a session whose BTF has the same directions for all texels.
    synthesize  Make a larger material from a sample, as a map of its texels.
  
  Look at results:
    info        Show the contents of a session or of an EXR file.
    verify      Compare every file of a session with its checksum.
    check       Check whether the BTF and MDF of a session are plausible.
    compare     Compare two materials or pictures, or all methods of compression.
    report      Write a report of a session, and metadata for archives of data.
  
  Exchange data with other programs:
    import      Make a session of data that others have measured.
    export      Write the products of a session for other programs.
  
  “mesorig COMMAND --help” describes a command. Every command takes --json.
  Exit codes: 0 done, 1 failed, 2 bad usage.
  [2]
  $ mesorig --help | head -3
  Usage: mesorig COMMAND …
  
  Capture a session:
  $ mesorig capture --help | tail -5
  Examples:
    mesorig capture rig.conf session.conf -o weave.session
    mesorig capture rig.conf session.conf -o weave.session -c rig.calibration \
        --process
  
  $ mesorig snap --help | grep -A9 Examples
  Examples:
    mesorig snap cam45 --lamp lamp30
    mesorig snap cam45 -e 2000 -o cam45.png
  

Each command lists its options, and refuses others and too many arguments.

  $ for command in plan capture resume status watch pause abort safe continue process info drivers compress verify; do
  >     mesorig --help | grep -q "^  $command " || echo "$command is not listed"
  >     mesorig $command --help | grep -q -- --json || echo "$command has no --json"
  >     mesorig $command --nonsense 2>&1 | grep -q "Unknown option --nonsense" || echo "$command takes --nonsense"
  >     mesorig $command a b c d >/dev/null 2>&1
  >     test $? -eq 2 || echo "$command takes four arguments"
  > done

Drivers:

  $ mesorig drivers | grep -E 'sim-(axis|camera)|NAME'
  sim-axis         axis       An axis of the simulated world, with backlash and position errors
  sim-camera       camera     A camera that looks at the simulated world
  axis             section    Place of an axis, in its section [axis NAME], in addition to the options of its driver
  lamps            section    Places of the lamps of a bank, in its section [lamps NAME], in addition to the options of its driver
  lamp             section    A lamp of a bank, in a section [lamp NAME]
  camera           section    Place of a camera, in its section [camera NAME], in addition to the options of its driver
  laser            section    Place of a laser, in its section [laser NAME], in addition to the options of its driver
  mark             section    A white mark on the turntable next to the sample, in a section [mark NAME]
  “mesorig drivers NAME” lists the options of one.
  $ mesorig drivers sim-axis | grep speed_deg_s
    speed_deg_s: number, 0.001 to 100000 deg/s; default 60
  $ mesorig drivers steam
  mesorig: there is no driver “steam”; “mesorig drivers” lists the drivers
  [1]
  $ mesorig drivers modbus-axs
  mesorig: there is no driver “modbus-axs”; did you mean “modbus-axis”?
  [1]
  $ mesorig drivers steam --json
  {"error": "there is no driver “steam”; “mesorig drivers” lists the drivers"}
  [1]
  $ mesorig drivers --json | python3 -m json.tool --json-lines >/dev/null
