The files that ./run demo writes are a rig and a session that can be captured.

  $ "$SMALL/../../etc/demo/files" conf
  $ ls conf
  balls.conf
  board.conf
  calibrate
  lights.conf
  plate.conf
  poles.conf
  rig.conf
  session.conf
  tile.conf
  world.conf
  $ mesorig plan --offline conf/rig.conf conf/session.conf
  session         demo
  directions      60 views, 60 lights, 26 laser positions; 3600 pictures of the BTF
  poses           743
  shots           1033, with 88600 camera frames
  on disk         33.4 MB to 1.3 GB of frames, depending on how many shots of lamps and sweeps are needed and how much the cameras see of the laser's lines; products need additional space
  predicted time  29 min … s, 9.4 % above the lower bound of 27 min 24 s
  if sufficient   5 min … s with only the first round of lamps and sweeps
  nested order    37 min … s, 1.26 times as long
  note            [lasers] stop = covered: 240 of the sweeps are only taken if the sweeps before them leave something unseen; the predicted time and frames are for all of them
  note            [lights] sampling = adaptive: 672 of the shots of lamps are only taken if they cannot be predicted from the shots before them; the predicted time and frames are for all of them
  note            frames of more than 256² pixels are compressed, and their size depends on their content; pixels that do not see the line of a laser sweep take almost no space; mesorig status tells what the session will take by the frames stored so far
  calibration     none: geometry and light are nominal (mesorig calibrate makes one, -c FILE gives it)
