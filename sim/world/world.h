/*
 * All simulated devices read and change the same simulated world, so that pictures follow motion
 * and light. The world has a sample on a turntable, cameras, lamps and lasers. Lamps and lasers are
 * on an arc or fixed. An arm may carry cameras, and a probe may carry lamps. An axis device moves
 * the arm, and another axis device moves the probe. A world file describes the world (world.conf(5)
 * has every key).
 *
 * The world shares no code with calib/ and processing/. Projection, distortion and triangulation
 * are written independently, so that an error in calib/ or processing/ shows in the results.
 *
 * Any thread may set the state. world_snapshot() copies the state. Any thread may render from a
 * snapshot, and the picture depends only on the snapshot.
 */
#pragma once

#include "base/options.h"
#include "drivers/frame.h"

#include <glib.h>

#define WORLD_MAX_CAMERAS 256
#define WORLD_MAX_LAMPS   1024
#define WORLD_MAX_LASERS  16

typedef struct World World;

/* Returns the world of a file. Devices that name the same file share one world, which is freed by
 * the last world_unref(). The first call for a file takes about a second, because the sample and
 * its light transport are computed. Returns NULL with an error if the file is wrong. */
World *world_get(const char *path, GError **error);
World *world_ref(World *world);
void world_unref(World *world); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(World, world_unref)

/* Returns the keys of a section of a world file, or NULL if there is no such section. */
const struct option *world_section_options(const char *class_name);

/* Return the index of a device, or −1 if no device has that name. */
int world_find_camera(const World *world, const char *name);
int world_find_lamp(const World *world, const char *name);
int world_find_laser(const World *world, const char *name);

struct world_sensor {
    int width, height, bits;
    enum cfa cfa;
    double black_level;
    const char *serial; /* owned by the world; empty if the camera has none */
};
void world_sensor(const World *world, int camera, struct world_sensor *ret);

/* These functions set true positions in degrees. Errors of the devices are already contained in
 * them. */
void world_set_turntable(World *world, double deg); /* the turntable stands at this position */
void world_set_arc(World *world, double deg);
void world_set_arm(World *world, double deg);
void world_set_probe(World *world, double deg);
void world_set_sweep(World *world, int laser, double deg);

/* Tells the world that the turntable is at deg at the time at_us, and turns at the speed deg_s
 * until the next call of this function or of world_set_turntable(). Pictures that are exposed while
 * the turntable turns are blurred. */
void world_turn_turntable(World *world, double deg, double deg_s, gint64 at_us);

/* Moves a laser, with its sweep, to the place that the file gives to the laser with the index
 * `place`. At first every laser is at its own place. world_set_sweep() and world_set_laser() still
 * take the laser's own index. */
void world_mount_laser(World *world, int laser, int place);

/* Switches a lamp on or off at the time at_us. A dead lamp (world_set_lamp_dead(), or the key dead
 * of the world file) gives no light.
 *
 * After a lamp is switched on, its output follows its warm-up curve. From the end of the warm-up
 * on, the curve is exactly the full output. If the world file says so, the output also has a slow
 * drift, and a flicker from exposure to exposure. */
void world_set_lamp(World *world, int lamp, gboolean on, gint64 at_us);
void world_set_lamp_dead(World *world, int lamp, gboolean dead);
double world_lamp_warm_up_s(const World *world);
void world_set_laser(World *world, int laser, gboolean on);

#define WORLD_INSTANTS 17
struct world_state {
    /* `turntable_deg` is the position in the middle of the exposure. The other angles are taken as
     * constant during an exposure. */
    double turntable_deg, arc_deg, arm_deg, probe_deg;
    /* Positions of the turntable at equal intervals, from the beginning of the exposure to its
     * end. */
    double turning_deg[WORLD_INSTANTS];
    /* Both arrays are in the order of places (world_mount_laser()): sweep_deg[place] is the sweep
     * angle of the laser at this place, and laser_on[place] whether it is on. */
    double sweep_deg[WORLD_MAX_LASERS];
    /* mean over the exposure, as a share of the nominal output */
    float lamp_output[WORLD_MAX_LAMPS];
    gboolean laser_on[WORLD_MAX_LASERS];
    gint64 time_us;
};
/* Returns the state for an exposure that has just ended. The outputs of the lamps are means over
 * the exposure. */
void world_snapshot(World *world, gint64 start_us, gint64 exposure_us, struct world_state *ret);

/* Computes the frame of a camera, and sets ret_pixels to its height × width values. The frame
 * contains optics, light transport, vignetting, colour filters, photon and read noise, black level
 * and ADC. The noise depends only on the seed of the world, noise_key, the camera and the pixel.
 * Any thread may call this function.
 *
 * If the turntable turned during the exposure, the light is the mean of several poses, at most 32.
 * If 32 poses are enough, the sample's edge moves by at most an eighth of a pixel from one pose to
 * the next. */
void world_expose(World *world, int camera, const struct world_state *state, gint64 exposure_us,
                  double gain_db, guint64 noise_key, guint16 *ret_pixels);
