/*
 * The simulated world: one physical truth that all simulated devices read and change, so that
 * pictures follow motion and light. It has a sample on a turntable, lamps and lasers on an arc or
 * standing by themselves, and cameras. An arm may carry cameras, and a probe lamps; each of these
 * is an axis. A world file describes it all (world.conf(5) has every key).
 *
 * Nothing here is shared with calib/ or processing/: projection, distortion and triangulation are
 * written independently, so that an error there shows in the results.
 *
 * State may be set from any thread. world_snapshot() copies it; rendering from a snapshot may be
 * done in any thread, and depends on the snapshot only.
 */
#pragma once

#include "base/options.h"
#include "drivers/frame.h"

#include <gio/gio.h>

#define WORLD_MAX_CAMERAS 31
#define WORLD_MAX_LAMPS   128
#define WORLD_MAX_LASERS  16

typedef struct World World;

/* Devices that name the same file share one world; the last world_unref() ends it. Building the
 * sample and its light transport takes a second or so. */
World *world_get(const char *path, GError **error);
World *world_ref(World *world);
void world_unref(World *world); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(World, world_unref)

/* The keys of a section of a world file; NULL: there is no such section. */
const struct option *world_section_options(const char *class_name);

int world_find_camera(const World *world, const char *name); /* −1: none of that name */
int world_find_lamp(const World *world, const char *name);
int world_find_laser(const World *world, const char *name);

struct world_sensor {
    int width, height, bits;
    enum cfa cfa;
    double black_level;
    const char *serial; /* of the world; "": none */
};
void world_sensor(const World *world, int camera, struct world_sensor *ret);

/* True positions, degrees; devices have added their own errors already. */
void world_set_turntable(World *world, double deg); /* it stands there */
void world_set_arc(World *world, double deg);
void world_set_arm(World *world, double deg);
void world_set_probe(World *world, double deg);
void world_set_sweep(World *world, int laser, double deg);

/* The turntable is at deg at a time, and turns at this speed until another of these calls, or
 * world_set_turntable(), says otherwise. Pictures exposed meanwhile are blurred. */
void world_turn_turntable(World *world, double deg, double deg_s, gint64 at_us);

/* Moves a laser, with its sweep, to the place of another laser of the file; at first it stands at
 * its own place. It keeps its number for world_set_sweep() and world_set_laser(). */
void world_mount_laser(World *world, int laser, int place);

/* Switches a lamp at a time. Its output then follows its warm-up curve (from the end of the warm-up
 * on it is exactly the full output) and, if the world file says so, a slow drift. A lamp that the
 * world file calls dead gives no light. */
void world_set_lamp(World *world, int lamp, gboolean on, gint64 at_us);
void world_set_lamp_dead(World *world, int lamp, gboolean dead);
double world_lamp_warm_up_s(const World *world);
void world_set_laser(World *world, int laser, gboolean on);

#define WORLD_INSTANTS 17
struct world_state {
    double turntable_deg, arc_deg, arm_deg, probe_deg; /* the turntable's in the middle */
    double turning_deg[WORLD_INSTANTS]; /* where the turntable was at even intervals, from the
                                           beginning of the exposure to its end */
    double sweep_deg[WORLD_MAX_LASERS]; /* by place, as laser_on */
    float lamp_output[WORLD_MAX_LAMPS]; /* 0 … 1, of nominal, at time_us */
    gboolean laser_on[WORLD_MAX_LASERS];
    gint64 time_us;
};
/* The state, with lamp outputs averaged over an exposure, which has just ended. */
void world_snapshot(World *world, gint64 start_us, gint64 exposure_us, struct world_state *ret);

/* Computes what a camera's sensor reads: optics, light transport, vignetting, colour filters,
 * photon and read noise, black level, ADC. If the turntable turned, light is the mean of that in so
 * many poses that the sample's edge moves by an eighth of a pixel from one to the next, at most 32.
 * The noise is a function of noise_key, the camera and the pixel only. pixels holds height × width
 * values. Any thread. */
void world_expose(World *world, int camera, const struct world_state *state, gint64 exposure_us,
                  double gain_db, guint64 noise_key, guint16 *ret_pixels);
