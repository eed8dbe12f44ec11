/* Shared by the suites: each check is run with a device that was opened for it alone. */
#pragma once

#include "conformance.h"

struct bench; /* a suite's own */

struct check {
    const char *name;
    void (*run)(struct bench *bench); /* NULL: nothing beside what follows */
    gboolean reopens;                 /* opens and closes it twenty times: no file stays open */
};

struct suite {
    const char *class_name;
    gsize bench_size;
    void (*begin)(struct bench *bench, gconstpointer driver, const struct conformance *with);
    void (*end)(struct bench *bench); /* also after a check that has closed the device */
    const struct check *checks;       /* ends with a NULL name */
};

/* Adds each of the checks as a test. */
void conformance_add(const struct suite *suite, gconstpointer driver,
                     const struct conformance *with);

Clock *conformance_clock(const struct conformance *with);

/* Asserts that the error is of the key "no_such_option", and frees it. */
void conformance_assert_unknown_option(GError *error);
