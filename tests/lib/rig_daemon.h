/* A mesorigd for a rig with devices of its own, which a test kills, stops or lets end. */
#pragma once

#include <gio/gio.h>

struct rig_daemon {
    char *rig, *log, *address; /* path of the rig file, path of the log, D-Bus address */
    GSubprocess *daemon;
};

/* Writes the rig file into a folder and starts mesorigd with a guardian. The log also contains what
 * the guardian prints about each device. */
void rig_daemon_begin(struct rig_daemon *run, const char *folder, const char *rig);

/* Kills mesorigd and ends the guardian. */
void rig_daemon_end(struct rig_daemon *run);

/* A simulated camera for a rig file, because each rig needs one. */
#define RIG_DAEMON_CAMERA                                                                          \
    "[camera cam30]\ndriver = sim-camera\nworld = " SOURCE_DIR                                     \
    "/tests/small/world.conf\ntheta_deg = 30\nphi_deg = 0\n"                                       \
    "distance_mm = 650\nwidth = 32\nheight = 32\nfocal_px = 333\n"
