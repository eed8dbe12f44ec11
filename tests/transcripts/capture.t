A capture says what it has done, and the session what it is. Progress is no result.

  $ cp "$SMALL"/*.conf .
  $ mesorig capture rig.conf session.conf -o S
  calibration: none: geometry and light are nominal (mesorig calibrate makes one, -c FILE gives it)
  capture: all shots are taken
  done: 13 of 13 shots, 144 camera frames in this run, no retakes, 25 s simulated in … s
  $ ls S
  capture.lock
  frames
  laser
  products
  session.db
  $ mesorig capture rig.conf session.conf -o S
  mesorig: S exists already; choose another name, or continue that session with “mesorig resume”
  [1]
  $ mesorig info S
  session    small, S
  state      done
  sample     50 × 50 mm, 8 × 8 texels
  directions 4 views, 4 lights, 2 laser positions
  shots      13 of 13 done, 0 skipped
  files      26 of frames, 0 retakes, 248.3 kB
  calibrated none: geometry and light are nominal (mesorig process -c FILE gives one)
  
          0 s  info     calibration: none: geometry and light are nominal (mesorig calibrate makes one, -c FILE gives it)
          2 s  info     capture: homed
         25 s  info     capture: all shots are taken
  $ mesorig process S
  calibration: none: geometry and light are nominal (mesorig process -c FILE gives one)
  done in … s: BTF of 4 views × 4 lights, MDF of 4 views with 59.4 % of the texels measured and 0.78 % predicted by other views, eigen-maps with an error of 0.02 % at the measured directions (mesorig compress makes closer files)
  laser planes: nominal as in the rig file, because no laser is calibrated; no line was seen around the sample ([sample] flat_radius_mm and flat_hole_mm give the face on which it is looked for)
  $ mesorig process --json S
  {"calibration": "none: geometry and light are nominal (mesorig process -c FILE gives one)", "views": 4, "lights": 4, "predicted_pictures": 0, "left_out_pictures": 0, "mdf_views": 4, "damaged_products": 0, "eigenmaps_error": 0.000, "mdf_coverage": 0.59375, "mdf_predicted": 0.007, "line_sweeps": 8, "lines_found": 0, "lines_disagree": 0, "lines_rms_deg": 0, "lines_worst_deg": 0, "line_width": 0, "line_scatter": 0, "real_s": …, "causes": []}
  $ mesorig info --json S | python3 -m json.tool --json-lines >/dev/null

A control file that a killed daemon has left:

  $ echo unix:path=/no/such/socket >S/control
  $ mesorig status S | head -2
  session    small, S
  state      done
  $ mesorig pause S
  mesorig: no daemon captures into S at present; to continue that session: mesorig resume S
  [1]

Folders that are no sessions:

  $ mkdir empty && cd empty
  $ mesorig info .
  mesorig: .: no session there: session.db: No such file or directory; give the directory of a session
  [1]
  $ mesorig info /no/such
  mesorig: cannot read /no/such: No such file or directory
  [1]
  $ mesorig process .
  mesorig: .: no session there: session.db: No such file or directory; give the directory of a session
  [1]
  $ mesorig resume .
  mesorig: .: no session there: session.db: No such file or directory; give the directory of a session
  [1]
  $ mesorig pause .
  mesorig: no daemon captures into . at present; to continue that session: mesorig resume .
  [1]
  $ mesorig compress .
  mesorig: .: no session there: session.db: No such file or directory; give the directory of a session
  [1]
  $ mesorig check .
  mesorig: .: there is neither products/btf nor products/mdf.exr; `mesorig process .` makes them
  [1]
  $ mesorig status --address=unix:path=/no/such
  mesorig: no mesorigd answers at unix:path=/no/such (No such file or directory); start one there: mesorigd --listen unix:path=/no/such --rig RIG
  [1]
  $ cd ..

A BTF and an MDF are checked. Nothing is suspected of this session.

  $ mesorig check S --plot energy.svg
  energy       0.457 … 0.459 of a light's energy is reflected (views to 60°)
  reciprocity  no pair of directions was measured both ways
  directions   10.61 % RMS error of 1 view and 1 light, interpolated from the others
  flags        0 % of the values are holes, 0 % lower bounds (saturated), 0 % only from shorter exposures, 0 % not taken: predicted from the pictures of other lights
  error bars   not known: the noise of the session's cameras is not calibrated
  surface      19.74 % of what a view sees is confirmed by others, 0.00 % refuted, 80.26 % hidden from all of them; 0.00 % of all answers of other views contradict the view
  plot         energy.svg
  $ ls energy.svg
  energy.svg
  $ mesorig check --json S
  {"holes": 0, "lower_bounds": 0, "shorter_exposures": 0, "predicted": 0, "e_r": [0.467, 0.467, 0.435, 0.435], "e_i": [0.450, 0.450, 0.452, 0.452], "texel": 36, "texel_e_r": [0.496, 0.491, 0.493, 0.490], "texel_e_i": [0.492, 0.492, 0.494, 0.492], "albedo": [0.457, 0.457, 0.458, 0.459], "largest_albedo": 0.459, "reciprocal_pairs": 0, "asymmetry": 0, "texel_asymmetry": 0, "interpolation_error": 0.106, "interpolated_views": 1, "interpolated_lights": 1, "exposures": "", "sigma_known": 0, "sigma_median": 0, "sigma_relative": 0, "sigma_large": 0, "sigma_worst": 0, "mdf_views": 4, "mdf_texels": 256, "mdf_seen": 152, "mdf_confirmed": 30, "mdf_refuted": 0, "mdf_unknown": 122, "mdf_denied_share": 0, "line_sweeps": 8, "lines_found": 0, "lines_disagree": 0, "line_width": 0, "line_scatter": 0, "suspicions": []}
  $ mesorig check S --plot plot.jpg
  mesorig: plot.jpg: the name of a plot must end in .png or .svg
  [1]
  $ mesorig check
  mesorig check: an argument is missing
  Usage: mesorig check DIR
  [2]
