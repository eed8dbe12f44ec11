/* A part of the demo's rig (etc/demo). It has a camera, a lamp and a laser at 30°, and the same at
 * 60°. The simulated world can have any target on the turntable. Errors in these functions fail the
 * test. */
#pragma once

#include <glib.h>

#define DEMO_PART_BOARD "8x8,square=9,marker=6.75,thickness=3"

/* Writes rig.conf and world.conf into a folder. */
void demo_part_write(const char *folder);

/* Writes a session file into a folder: lines of the section [sample], rings of views, lights and
 * lasers (lights and lasers may be NULL), and lines of the section [capture]. */
void demo_part_write_session(const char *folder, const char *name, const char *sample,
                             const char *views, const char *lights, const char *lasers,
                             const char *capture);

/* Writes the session files board.conf, lights.conf and tile.conf, which capture these targets. */
void demo_part_write_targets(const char *folder);
/* Writes a session file that captures a plate of this height. etc/demo/calibrate can change the
 * height in it. */
void demo_part_write_plate(const char *folder, const char *name, int height_mm);

enum demo_target { DEMO_BOARD_FLAT, DEMO_BOARD_LEANING, DEMO_POLES, DEMO_PLATE, DEMO_TILE };

/* Writes world.conf with a target instead of the sample, as etc/demo/calibrate does it. A board
 * needs the program mesorig once. height_mm is that of a plate. */
void demo_part_lay(const char *folder, enum demo_target target, double height_mm);
