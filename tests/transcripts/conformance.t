A program that is a device is checked against docs/build-a-rig/programs.md. The examples of contrib/ pass.

  $ HERE=$TESTDIR/../..
  $ touch pin
  $ mesorig conformance $HERE/contrib/programs/gpio-lamp.py $PWD/pin 2>/dev/null
  ok   hello              “hello” is answered with version and class
  ok   open               “open” is answered with all its values
  ok   ping               “ping” is answered
  ok   two-lines          two requests that arrive together are both answered
  ok   further-parameter  a parameter that is not known is ignored
  ok   unknown-method     a method that is not known is answered by an error
  ok   malformed-line     a line that is not JSON is answered by an error
  ok   get                “get” has a value for each lamp, and all are off after “stop”
  ok   left-alone         “open” leaves the lamps as they are
  ok   set                “set” switches its lamp and no other
  ok   stop               “stop” switches all lamps off
  ok   stop-overtakes     a “set” has no effect after the answer to a “stop” that came after it
  ok   close              after “close” the lamps are off and the program ends
  ok   end-of-input       at the end of standard input the lamps go off and the program ends
  ok   restart            after a kill the program starts again and finds its device
  ok   silence            the capability “silence”: without requests the lamps go off and the program ends
  skip events             events come when they may
         skipped:  the program has sent no event
  ok   output             standard output has nothing but lines of JSON-RPC 2.0
  17 passed, 0 failed, 1 skipped
  $ cat pin; echo
  0

A program that breaks a promise, here that the lamps are off after “close”:

  $ mkdir device
  $ mesorig conformance --only close --only stop $HERE/tests/cli/programs/helper.py lamps $PWD/device unsafe-at-close 2>/dev/null
  ok   stop               “stop” switches all lamps off
  FAIL close              after “close” the lamps are off and the program ends
         expected: lamp 0 is off after “close”
         came:     “get” says that it is on
         to do:    switch all lamps off before the program ends, and switch none in “open”
  1 passed, 1 failed, 0 skipped
  [1]
  $ mesorig conformance --only close --json $HERE/tests/cli/programs/helper.py lamps $PWD/device unsafe-at-close 2>/dev/null | sed 's|/.*/helper|helper|'
  {"program": "helper.py", "class": "lamps", "checks": [{"check": "close", "promise": "after “close” the lamps are off and the program ends", "result": "failed", "expected": "lamp 0 is off after “close”", "came": "“get” says that it is on", "advice": "switch all lamps off before the program ends, and switch none in “open”"}], "passed": 0, "failed": 1, "skipped": 0}

An axis moves only within the range that is given:

  $ mesorig conformance $HERE/tests/cli/programs/helper.py axis $PWD/device
  mesorig conformance: the checks move the axis: give --min-deg and --max-deg, the range that they may use
  Usage: mesorig conformance FILE [ARGUMENT…]
  [2]
  $ mesorig conformance --only home --min-deg=0 --max-deg=10 $HERE/tests/cli/programs/helper.py axis $PWD/device 2>/dev/null
  ok   home               “move” with home ends at the reference
  1 passed, 0 failed, 0 skipped

Programs that are no devices:

  $ mesorig conformance /bin/true
  mesorig: /bin/true does not say its class in an answer to “hello”: see what it has printed, or give --class
  [1]
  $ mesorig conformance --class lamps --only hello /bin/true 2>/dev/null
  FAIL hello              “hello” is answered with version and class
         expected: an answer to “hello” within … s
         came:     the program has ended with exit code 0
         to do:    see what the program has printed. It is started in the folder /, so give it whole paths
  0 passed, 1 failed, 0 skipped
  [1]
  $ mesorig conformance ./nothing
  mesorig: nothing is not a program that can be run: give its path, and make it executable
  [1]
  $ mesorig conformance device
  mesorig: device is not a program that can be run: give its path, and make it executable
  [1]

Bad usage:

  $ mesorig conformance
  mesorig conformance: no program is given: give the path of the program that is the device
  Usage: mesorig conformance FILE [ARGUMENT…]
  [2]
  $ mesorig conformance --class laser x
  mesorig conformance: there is no class “laser”; choose from: lamps, axis, camera
  Usage: mesorig conformance FILE [ARGUMENT…]
  [2]
  $ mesorig conformance --only stpo x
  mesorig conformance: there is no check “stpo”; did you mean “stop”?
  Usage: mesorig conformance FILE [ARGUMENT…]
  [2]
  $ mesorig conformance --only dance x
  mesorig conformance: there is no check “dance”; “mesorig conformance --list” lists them
  Usage: mesorig conformance FILE [ARGUMENT…]
  [2]
  $ mesorig conformance --start-s 0 x
  mesorig conformance: --start-s=0: give 0.1 to 60
  Usage: mesorig conformance FILE [ARGUMENT…]
  [2]
  $ mesorig conformance --class axis --min-deg 1 --max-deg 0 $HERE/tests/cli/programs/helper.py axis $PWD/device
  mesorig conformance: the checks move the axis: give --min-deg and --max-deg, the range that they may use
  Usage: mesorig conformance FILE [ARGUMENT…]
  [2]

The checks:

  $ mesorig conformance --list --class camera
  hello              all     “hello” is answered with version and class
  open               all     “open” is answered with all its values
  ping               all     “ping” is answered
  two-lines          all     two requests that arrive together are both answered
  further-parameter  all     a parameter that is not known is ignored
  unknown-method     all     a method that is not known is answered by an error
  malformed-line     all     a line that is not JSON is answered by an error
  trigger            camera  “trigger” is answered with a picture as “open” has described it
  pictures           camera  three pictures in a row are new, and their numbers grow
  exposures          camera  a picture takes as long as its exposure
  gain               camera  the capability “gain”: a picture with 6 dB
  stop               camera  the capability “stop”: a picture is given up, and the next one is taken
  close              camera  after “close” the program ends
  end-of-input       camera  at the end of standard input the program ends
  restart            camera  after a kill the program starts again and finds its device
  silence            all     the capability “silence”: without requests the program ends
  events             all     events come when they may
  output             all     standard output has nothing but lines of JSON-RPC 2.0
