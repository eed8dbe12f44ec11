#include "dome.h"

#include "text_file.h"

#include <glib.h>

#define SAMPLE_MM    20.0
#define CAMERA_MM    650.0
#define SAMPLE_SHARE 0.5 /* of the width of a picture */
#define LAMP_LINES   "distance_mm = 400\nexponent = 2\nintensity = 25\n"

const struct dome dome_of_lamps = {
    "lamps",
    (const struct dome_ring[]){{0, 1},
                               {9, 15},
                               {17, 15},
                               {25, 30},
                               {33, 30},
                               {41, 45},
                               {49, 45},
                               {57, 45},
                               {65, 60},
                               {73, 60},
                               {0, 0}},
    (const struct dome_ring[]){
        {4, 1}, {13, 1}, {21, 1}, {29, 1}, {37, 1}, {45, 1}, {53, 1}, {61, 1}, {0, 0}},
    15};

const struct dome dome_of_cameras = {
    "cameras",
    (const struct dome_ring[]){{0, 1}, {15, 9}, {30, 18}, {45, 30}, {60, 39}, {75, 45}, {0, 0}},
    (const struct dome_ring[]){{8, 4}, {22, 10}, {37, 16}, {52, 20}, {67, 20}, {0, 0}}, 1};

static int count(const struct dome_ring *rings) {
    int n = 0;
    for (; rings->count; rings++)
        n += rings->count;
    return n;
}

int dome_n_lamps(const struct dome *dome) {
    return count(dome->lamps);
}

int dome_n_cameras(const struct dome *dome) {
    return count(dome->cameras);
}

static void add_cameras(GString *to, const struct dome *dome, int side, const char *further) {
    int n = 0;
    for (const struct dome_ring *ring = dome->cameras; ring->count; ring++)
        for (int k = 0; k < ring->count; k++)
            g_string_append_printf(to,
                                   "\n[camera cam_%02d]\n%stheta_deg = %g\nphi_deg = %g\n"
                                   "distance_mm = %g\nwidth = %d\nheight = %d\nfocal_px = %g\n"
                                   "response = 6000\n",
                                   ++n, further, ring->theta_deg, k * 360.0 / ring->count,
                                   CAMERA_MM, side, side,
                                   SAMPLE_SHARE * side * CAMERA_MM / SAMPLE_MM);
}

static char *rig_text(const struct dome *dome, int side, int turns) {
    GString *to = g_string_new(NULL);
    g_string_append_printf(to, "[rig]\nid = %s\nclock = virtual\n", dome->name);
    if (turns > 1)
        g_string_append(to, "\n[axis turntable]\ndriver = sim-axis\nworld = world.conf\n"
                            "part = turntable\nwraps = yes\nspeed_deg_s = 60\naccel_deg_s2 = 120\n"
                            "settle_ms = 150\n");
    g_string_append(to, "\n[lamps dome]\ndriver = sim-lamps\nworld = world.conf\nrings = ");
    for (const struct dome_ring *ring = dome->lamps; ring->count; ring++)
        g_string_append_printf(to, "%s%g:%d", ring == dome->lamps ? "" : "; ", ring->theta_deg,
                               ring->count);
    g_string_append(to, "\n" LAMP_LINES);
    add_cameras(to, dome, side, "driver = sim-camera\nworld = world.conf\n");
    return g_string_free(to, FALSE);
}

static char *world_text(const struct dome *dome, int side) {
    GString *to = g_string_new("[world]\nsupersample = 1\ngather_rays = 0\nwarm_up_s = 0.02\n"
                               "\n[sample]\nkind = flat\n");
    g_string_append_printf(to, "width_mm = %g\nheight_mm = %g\n", SAMPLE_MM, SAMPLE_MM);
    add_cameras(to, dome, side, "");
    int n = 0;
    for (const struct dome_ring *ring = dome->lamps; ring->count; ring++)
        for (int k = 0; k < ring->count; k++)
            g_string_append_printf(to,
                                   "\n[lamp dome_%03d]\ntheta_deg = %g\nphi_deg = %g\n" LAMP_LINES,
                                   ++n, ring->theta_deg, k * 360.0 / ring->count);
    return g_string_free(to, FALSE);
}

static char *session_text(const struct dome *dome, int every, int turns) {
    GString *to = g_string_new(NULL);
    g_string_append_printf(to,
                           "[session]\nname = %s\n\n[sample]\nwidth_mm = %g\nheight_mm = %g\n"
                           "texels = 4\nreference_mm = 5\ndepth_mm = 5\n\n[views]\n",
                           dome->name, SAMPLE_MM, SAMPLE_MM);
    if (turns > 1) {
        g_string_append(to, "rings = ");
        for (const struct dome_ring *ring = dome->cameras; ring->count; ring++)
            g_string_append_printf(to, "%s%g:%d", ring == dome->cameras ? "" : "; ",
                                   ring->theta_deg, ring->count * turns);
    } else {
        g_string_append(to, "devices = all");
    }
    g_string_append(to, "\n\n[lights]\ndevices = ");
    for (int k = 0; every > 1 && k < dome_n_lamps(dome); k += every)
        g_string_append_printf(to, "%sdome_%03d", k ? "; " : "", k + 1);
    g_string_append_printf(to, "%s\n\n[capture]\nexposures_us = 4000\ndark_frames = 1\n",
                           every > 1 ? "" : "all");
    return g_string_free(to, FALSE);
}

void dome_write(const struct dome *dome, const char *folder, int side, int every, int turns) {
    g_autofree char *rig = rig_text(dome, side, turns);
    g_autofree char *world = world_text(dome, side);
    g_autofree char *session = session_text(dome, every, turns);
    text_file_write(folder, "rig.conf", rig);
    text_file_write(folder, "world.conf", world);
    text_file_write(folder, "session.conf", session);
}
