/* The checks of “mesorig conformance”: whether a program does what docs/build-a-rig/programs.md
 * demands of it. */
#pragma once

#include "bench.h"

struct check {
    const char *name;
    const char *class_name; /* NULL: all classes */
    /* Name of an earlier check on which this check depends, or NULL. If the earlier check was run
     * and has not passed, this check is skipped. */
    const char *after;
    const char *promise;
    gboolean (*run)(struct bench *bench);
};

/* Returns all checks in their order. The table ends with a NULL name. */
const struct check *checks_all(void);

/* Returns whether a check belongs to a class. */
gboolean checks_has(const struct check *check, const char *class_name);

/* Sends “hello” with each class in turn. Returns the class that the program names in its answer, or
 * NULL if no answer names one. */
const char *checks_find_class(struct bench *bench);

/* checks_make_unsafe() brings the device into a state that is not safe: it calls bench_ready(),
 * then switches lamps on or begins to move the axis. A camera is always safe.
 *
 * checks_find_safe() starts the program again and checks that the lamps are off or the axis stands.
 * `after` says, for the verdict, what should have made the device safe. */
gboolean checks_make_unsafe(struct bench *bench);
gboolean checks_find_safe(struct bench *bench, const char *after);

/* The checks of each class (checks_lamps.c, checks_axis.c, checks_camera.c). */
gboolean check_lamps_get(struct bench *bench);
gboolean check_lamps_set(struct bench *bench);
gboolean check_lamps_stop(struct bench *bench);
gboolean check_lamps_stop_overtakes(struct bench *bench);
gboolean check_lamps_make_unsafe(struct bench *bench);
gboolean check_lamps_expect_off(struct bench *bench, const char *after);

gboolean check_axis_get(struct bench *bench);
gboolean check_axis_home(struct bench *bench);
gboolean check_axis_moves(struct bench *bench);
gboolean check_axis_same_place(struct bench *bench);
gboolean check_axis_stops(struct bench *bench);
gboolean check_axis_stop_overtakes(struct bench *bench);
gboolean check_axis_make_unsafe(struct bench *bench);
gboolean check_axis_expect_still(struct bench *bench, const char *after);

gboolean check_camera_trigger(struct bench *bench);
gboolean check_camera_pictures(struct bench *bench);
gboolean check_camera_exposures(struct bench *bench);
gboolean check_camera_gain(struct bench *bench);
gboolean check_camera_stop(struct bench *bench);
