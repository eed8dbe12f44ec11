/* The files of shaders/, compiled in. */
#pragma once

#include <stddef.h>

struct shader {
    const char *name, *source;
};

extern const struct shader shaders[]; /* ended by a NULL name */
