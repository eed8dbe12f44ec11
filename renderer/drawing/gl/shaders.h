/* The files of the folder shaders, compiled into the program. */
#pragma once

#include <stddef.h>

struct shader {
    const char *name, *source;
};

extern const struct shader shaders[]; /* ends with a NULL name */
