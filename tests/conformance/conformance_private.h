/* Shared by the suites: each check is run with a device that was opened for it alone. */
#pragma once

#include "conformance.h"

struct bench; /* a suite's own */

struct check {
    const char *name;
    void (*run)(struct bench *bench); /* NULL: nothing besides what follows */
    gboolean reopens;                 /* opens and closes it twenty times: no file stays open */
    gboolean needs_fault;             /* calls conformance_fail() */
    gboolean unopened;                /* needs no device that has been opened */
};

struct suite {
    const char *class_name;
    gsize bench_size;
    /* Opens the device; FALSE as conformance_opened() */
    gboolean (*begin)(struct bench *bench, gconstpointer driver, const struct conformance *with);
    void (*end)(struct bench *bench); /* also after a check that has closed the device */
    const struct check *checks;       /* ends with a NULL name */
};

/* Asserts that a device was opened, with no error. FALSE: the driver is a skeleton, whose open()
 * says that it is not implemented. */
gboolean conformance_opened(gconstpointer device, const GError *error);

/* Adds each of the checks as a test. */
void conformance_add(const struct suite *suite, gconstpointer driver,
                     const struct conformance *with);

/* What a watch has heard: conformance_on_safety() with such a struct as its data. */
struct conformance_safety {
    int n_unsafe, n_safe;
};
void conformance_on_safety(struct device *device, const GError *error, gpointer safety);

/* A simulated device loses the answer to its n-th command if it is opened with these keys, and is
 * dead for 5 s; other devices fail by conformance_fail(), which does nothing to simulated ones.
 * g_free(). */
char *conformance_fault_keys(const struct conformance *with, int n);
void conformance_fail(const struct conformance *with, enum conformance_fault fault);

/* After a command that was not answered: the device stays unsafe while it is cut, without a further
 * event, and is safe some time later. */
void conformance_expect_unsafe(const struct conformance *with, const struct device *device,
                               const struct conformance_safety *safety);
void conformance_expect_safe(const struct conformance *with, const struct device *device,
                             const struct conformance_safety *safety);

/* Refuses every permit, with DEVICE_ERROR_UNSUPPORTED. */
gboolean conformance_refuse(const struct device *device, gpointer unused, GError **error);

Clock *conformance_clock(const struct conformance *with);

/* Asserts that the error is of the key "no_such_option", and frees it. */
void conformance_assert_unknown_option(GError *error);
