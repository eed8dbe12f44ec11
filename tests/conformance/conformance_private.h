/* Shared by the suites: a check is run with its driver and what the driver is to be opened with. */
#pragma once

#include "conformance.h"

struct check {
    const char *name;
    void (*run)(gconstpointer driver, const struct conformance *with);
};

/* Adds each of the checks as a test; the list ends with a NULL name. */
void conformance_add(const char *class_name, gconstpointer driver, const struct conformance *with,
                     const struct check *checks);

Clock *conformance_clock(const struct conformance *with);
