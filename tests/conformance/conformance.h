/*
 * Tests that every driver must pass: one suite for each class of devices. To test a new driver,
 * describe a section of a rig file that opens the driver, and add the suite to a test program:
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
 * A driver also fails if it reports a command twice, or if it reports from within the call that
 * gave the command (reports.h).
 *
 * Each check is a separate test, /conformance/CLASS/NAME/CHECK, which opens the device anew. The
 * suite for an axis moves the axis between a quarter and three quarters of its range, or of a turn
 * if the axis wraps. The struct, and what it points to, must live until the tests have run.
 *
 * A skeleton of contrib/new-driver passes. Its open() fails with an error that says that it is not
 * implemented, and all checks that need an open device are then skipped.
 *
 * The checks of lost answers need a device that can be made to fail: by fail(), or by the options
 * fault_unheard and fault_dead_s of a simulated driver. These checks are skipped for other drivers.
 */
#pragma once

#include "drivers/axis.h"
#include "drivers/camera.h"
#include "drivers/interlock.h"
#include "drivers/lamps.h"
#include "drivers/laser.h"

enum conformance_fault {
    CONFORMANCE_WELL,
    CONFORMANCE_UNANSWERED, /* the device carries commands out if it can, but does not answer */
    CONFORMANCE_CUT,        /* the device neither carries commands out nor answers */
};

struct conformance {
    const char *name;    /* NAME in the paths of the tests */
    const char *section; /* one section of a rig file, as text */
    const char *path;    /* path of a file that would contain the section, for relative paths in it;
                            NULL: ./test.conf */
    gboolean real_clock; /* TRUE for hardware; otherwise the clock is virtual */
    double tolerance_deg; /* axis: largest error of a position that it reports; 0 means 0.01 */
    gint64 exposure_us;   /* camera: exposure time; 0 means the shortest one */
    void (*fail)(gpointer fail_data,
                 enum conformance_fault fault); /* makes the device fail in this way; NULL if it
                                                   cannot be made to fail */
    gpointer fail_data;
};

void conformance_axis(const struct axis_driver *driver, const struct conformance *with);
void conformance_lamps(const struct lamps_driver *driver, const struct conformance *with);
void conformance_camera(const struct camera_driver *driver, const struct conformance *with);
void conformance_laser(const struct laser_driver *driver, const struct conformance *with);
void conformance_interlock(const struct interlock_driver *driver, const struct conformance *with);

/* For any test that drives devices: parses with->section with more_keys added. *ret_section belongs
 * to the returned Config. */
Config *conformance_config(const struct conformance *with, const char *more_keys,
                           const struct config_section **ret_section);

/* Runs the main loop until *counter is at least n. Fails the test after limit_s on a virtual clock,
 * and after WAIT_S (lib/wait.h) on a real one. */
void conformance_wait(Clock *clock, const int *counter, int n, double limit_s);

/* Runs the main loop until this time has passed on the clock. */
void conformance_pass(Clock *clock, double seconds);

/* Asserts that *error has this domain and code and that its message contains these words. Clears
 * *error. */
void conformance_expect_error(GError **error, GQuark domain, int code, const char *words);

/* Returns the number of descriptors that are open in this process. */
int conformance_open_files(void);

/* Runs the main loop until the process has at most `files` open descriptors. This may take a
 * moment, because threads of the process close their descriptors a little later. Fails the test
 * after limit_s, which is usually WAIT_S. */
void conformance_expect_files(const struct conformance *with, int files, int limit_s);
