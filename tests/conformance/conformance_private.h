/* The contract between conformance.c, which runs the checks, and the suites. Each check runs with a
 * device that was opened only for this check. */
#pragma once

#include "conformance.h"

struct bench; /* the data of a suite; each suite defines it */

struct check {
    const char *name;
    void (*run)(struct bench *bench); /* NULL if only reopens is checked */
    gboolean reopens;     /* also opens and closes the device twenty times, and checks that no file
                             stays open */
    gboolean needs_fault; /* calls conformance_fail() */
    gboolean unopened;    /* also runs if the device could not be opened */
};

struct suite {
    const char *class_name;
    gsize bench_size;
    /* Opens the device. Returns the result of conformance_opened(). */
    gboolean (*begin)(struct bench *bench, gconstpointer driver, const struct conformance *with);
    void (*end)(struct bench *bench); /* also called if the check has closed the device */
    const struct check *checks;       /* ends with a NULL name */
};

/* Asserts that a device was opened without an error. Returns FALSE if the driver is a skeleton,
 * whose open() says that it is not implemented. */
gboolean conformance_opened(gconstpointer device, const GError *error);

/* Adds each check of a suite as a test. */
void conformance_add(const struct suite *suite, gconstpointer driver,
                     const struct conformance *with);

/* The numbers of events that device_watch_safety() has reported to conformance_on_safety(), whose
 * data is this struct. */
struct conformance_safety {
    int n_unsafe, n_safe;
};
void conformance_on_safety(struct device *device, const GError *error, gpointer safety);

/* These two functions make a device fail. For real or virtual devices, conformance_fail() calls
 * with->fail(), and conformance_fault_keys() returns "". For a simulated device, with->fail is
 * NULL, and conformance_fail() does nothing. A simulated device fails by the keys that
 * conformance_fault_keys() returns for its section. With these keys, the device loses the answer to
 * its n-th command, and is dead for 5 s afterwards. Free the keys with g_free(). */
char *conformance_fault_keys(const struct conformance *with, int n);
void conformance_fail(const struct conformance *with, enum conformance_fault fault);

/* For use after a command that was not answered. The first function cuts the device off, and checks
 * that the device stays unsafe without a further event. The second one ends the fault, and waits
 * until the device is safe. */
void conformance_expect_unsafe(const struct conformance *with, const struct device *device,
                               const struct conformance_safety *safety);
void conformance_expect_safe(const struct conformance *with, const struct device *device,
                             const struct conformance_safety *safety);

/* Refuses every permit, with DEVICE_ERROR_UNSUPPORTED. */
gboolean conformance_refuse(const struct device *device, gpointer unused, GError **error);

Clock *conformance_clock(const struct conformance *with);

/* Asserts that the error is about the unknown key "no_such_option", and frees the error. */
void conformance_assert_unknown_option(GError *error);
