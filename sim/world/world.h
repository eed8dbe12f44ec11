/*
 * The simulated world: one physical state that all simulated devices read and change, so that
 * pictures show the effects of motion and light. It has a sample on a turntable, cameras, and lamps
 * and lasers, which are on an arc or stand alone. An arm may carry cameras, and a probe may carry
 * lamps. Each of the two is an axis. A world file describes everything (world.conf(5) has every
 * key).
 *
 * Nothing is shared with calib/ or processing/. Projection, distortion and triangulation are
 * written independently, so that an error there shows in the results.
 *
 * State may be set from any thread. world_snapshot() copies it. Any thread may render from a
 * snapshot, and the result depends only on the snapshot.
 */
#pragma once

#include "base/options.h"
#include "drivers/frame.h"

#include <gio/gio.h>

#define WORLD_MAX_CAMERAS 31
#define WORLD_MAX_LAMPS   128
#define WORLD_MAX_LASERS  16

typedef struct World World;

/* Returns the world of a file. Devices that name the same file share one world. The last
 * world_unref() frees it. Making the sample and its light transport takes about a second. */
World *world_get(const char *path, GError **error);
World *world_ref(World *world);
void world_unref(World *world); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(World, world_unref)

/* Returns the keys of a section of a world file, or NULL if there is no such section. */
const struct option *world_section_options(const char *class_name);

/* returns −1 if there is no camera of that name */
int world_find_camera(const World *world, const char *name);
int world_find_lamp(const World *world, const char *name);
int world_find_laser(const World *world, const char *name);

struct world_sensor {
    int width, height, bits;
    enum cfa cfa;
    double black_level;
    const char *serial; /* serial number in the world file, or "" */
};
void world_sensor(const World *world, int camera, struct world_sensor *ret);

/* The following functions set true positions in degrees. Devices have already added their
 * errors. */
void world_set_turntable(World *world, double deg); /* the turntable stands still */
void world_set_arc(World *world, double deg);
void world_set_arm(World *world, double deg);
void world_set_probe(World *world, double deg);
void world_set_sweep(World *world, int laser, double deg);

/* Sets the position and the speed of the turntable at a time. They hold until the next call of
 * this function or of world_set_turntable(). Pictures that are exposed during the rotation are
 * blurred. */
void world_turn_turntable(World *world, double deg, double deg_s, gint64 at_us);

/* Moves a laser, with its sweep, to the place of another laser of the file. Initially it is at its
 * own place. It keeps its number for world_set_sweep() and world_set_laser(). */
void world_mount_laser(World *world, int laser, int place);

/* Switches a lamp at a time. Its output then follows its warm-up curve and, if the world file has
 * one, a slow drift. After the warm-up it is exactly the full output. A lamp with the key dead in
 * the world file gives no light. */
void world_set_lamp(World *world, int lamp, gboolean on, gint64 at_us);
void world_set_lamp_dead(World *world, int lamp, gboolean dead);
double world_lamp_warm_up_s(const World *world);
void world_set_laser(World *world, int laser, gboolean on);

#define WORLD_INSTANTS 17
struct world_state {
    /* turntable_deg: in the middle of the exposure */
    double turntable_deg, arc_deg, arm_deg, probe_deg;
    double turning_deg[WORLD_INSTANTS]; /* positions of the turntable at equal intervals, from the
                                           beginning of the exposure to its end */
    double sweep_deg[WORLD_MAX_LASERS]; /* by place, like laser_on */
    float lamp_output[WORLD_MAX_LAMPS]; /* 0 … 1 relative to the nominal output, at time_us */
    gboolean laser_on[WORLD_MAX_LASERS];
    gint64 time_us;
};
/* Copies the state, with lamp outputs averaged over an exposure that has just ended. */
void world_snapshot(World *world, gint64 start_us, gint64 exposure_us, struct world_state *ret);

/* Computes the values that a camera's sensor reads: optics, light transport, vignetting, colour
 * filters, photon and read noise, black level, ADC. If the turntable turned, light is averaged over
 * several poses, at most 32, between which the sample's edge moves by an eighth of a pixel. The
 * noise is a function of noise_key, the camera and the pixel only. ret_pixels has height × width
 * values. Any thread. */
void world_expose(World *world, int camera, const struct world_state *state, gint64 exposure_us,
                  double gain_db, guint64 noise_key, guint16 *ret_pixels);
