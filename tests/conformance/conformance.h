/*
 * What every driver must do, as tests: one suite a class, run over any driver. To test a new one,
 * describe a section of a rig file that opens it and add the suite to a test program:
 *
 *     static const struct conformance my_axis = {
 *         .name = "my-axis",
 *         .section = "[axis test]\ndriver = my-axis\nport = /dev/ttyUSB0\n",
 *         .real_clock = TRUE,
 *     };
 *     g_test_init(&argc, &argv, NULL);
 *     conformance_axis(&my_axis_driver, &my_axis);
 *     return g_test_run();
 *
 * A driver fails that reports a command twice, or from within the call that gave it (reports.h).
 *
 * Each check is a test of its own, /conformance/CLASS/NAME/CHECK, and opens the device anew. The
 * axis suite moves the axis between a quarter and three quarters of its way (a wrapping axis: of a
 * turn). The struct, and what it points to, must live until the tests have run.
 *
 * A skeleton of contrib/new-driver, whose open() says that it is not implemented, passes: checks
 * that need the device are skipped.
 *
 * The checks of lost answers need a device that can be made to fail: fail(), or a simulated driver
 * with the options fault_unheard and fault_dead_s. Without either they are skipped.
 */
#pragma once

#include "drivers/axis.h"
#include "drivers/camera.h"
#include "drivers/interlock.h"
#include "drivers/lamps.h"
#include "drivers/laser.h"

enum conformance_fault {
    CONFORMANCE_WELL,
    CONFORMANCE_UNANSWERED, /* carries commands out if it can, and does not answer */
    CONFORMANCE_CUT,        /* neither obeys nor answers */
};

struct conformance {
    const char *name;     /* in the tests' paths */
    const char *section;  /* one section of a rig file, as text */
    const char *path;     /* of the file it pretends to be in, for relative paths; NULL: here */
    gboolean real_clock;  /* hardware; otherwise virtual time */
    double tolerance_deg; /* axis: how far off its own position may be; 0: 0.01 */
    gint64 exposure_us;   /* camera: what to expose for; 0: its shortest */
    void (*fail)(gpointer fail_data, enum conformance_fault fault); /* NULL: it cannot */
    gpointer fail_data;
};

void conformance_axis(const struct axis_driver *driver, const struct conformance *with);
void conformance_lamps(const struct lamps_driver *driver, const struct conformance *with);
void conformance_camera(const struct camera_driver *driver, const struct conformance *with);
void conformance_laser(const struct laser_driver *driver, const struct conformance *with);
void conformance_interlock(const struct interlock_driver *driver, const struct conformance *with);

/* For any test that drives devices. A Config of one section lives as long as its test. */
Config *conformance_config(const struct conformance *with, const char *more_keys,
                           const struct config_section **ret_section);

/* Runs the main loop until *counter is at least n. Fails the test after limit_s on a virtual clock,
 * and after WAIT_S (lib/wait.h) on a real one. */
void conformance_wait(Clock *clock, const int *counter, int n, double limit_s);

/* Runs the main loop for so long on the clock. */
void conformance_pass(Clock *clock, double seconds);

/* Asserts that it is this error and that its message has these words; clears it. */
void conformance_expect_error(GError **error, GQuark domain, int code, const char *words);

int conformance_open_files(void);

/* Runs the main loop until at most this number of descriptors is open, because threads of this
 * process may close theirs a little later. Fails the test after limit_s, usually WAIT_S. */
void conformance_expect_files(const struct conformance *with, int files, int limit_s);
