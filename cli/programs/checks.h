/* The checks of “mesorig conformance”: what docs/build-a-rig/programs.md promises of a program. */
#pragma once

#include "bench.h"

struct check {
    const char *name;
    const char *class_name; /* NULL: all classes */
    /* Name of the check without which this one says nothing. It is skipped if that one was run and
     * has not passed. NULL if there is none. */
    const char *after;
    const char *promise;
    gboolean (*run)(struct bench *bench);
};

/* Returns all checks in their order. The table ends with a NULL name. */
const struct check *checks_all(void);

/* Returns whether a check belongs to a class. */
gboolean checks_has(const struct check *check, const char *class_name);

/* Tries to find the class of a program by “hello”. Returns NULL if its answers do not say it. */
const char *checks_find_class(struct bench *bench);

/* What the device of a class does when the checks make it unsafe, and whether a program that was
 * started again finds it safe. The former begins with bench_ready(). */
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
