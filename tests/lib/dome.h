/* Files of simulated domes with as many lamps or cameras as published ones: rig.conf, world.conf
 * and session.conf in one folder. */
#pragma once

struct dome_ring { /* devices of one elevation, at the azimuths k·360/count */
    double theta_deg;
    int count;
};

struct dome {
    const char *name;
    const struct dome_ring *lamps, *cameras; /* end with a count of 0 */
    int turns; /* angles of the turntable that show each camera another view; 1: no turntable */
};

/* 346 lamps (dome_001 …) and 8 cameras in one plane, over a turntable that stops at 15 angles. The
 * lamps look the same from each of these angles. */
extern const struct dome dome_of_lamps;
/* 142 lamps and 70 cameras (cam_01 …), without a turntable. */
extern const struct dome dome_of_cameras;

int dome_n_lamps(const struct dome *dome);
int dome_n_cameras(const struct dome *dome);

/* Writes the three files. The pictures have side × side pixels. The session has every n-th lamp as
 * a light (1: all), and each camera at `turns` angles of the turntable, at most dome->turns. */
void dome_write(const struct dome *dome, const char *folder, int side, int every, int turns);
