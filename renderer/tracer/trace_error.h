/* The errors of the tracer. */
#pragma once

#include <glib.h>

#define TRACE_ERROR trace_error_quark()
GQuark trace_error_quark(void);
enum trace_error {
    /* the scene or one of its pictures cannot be used, or a setting names something that it
     * lacks */
    TRACE_ERROR_SCENE,
    TRACE_ERROR_MATERIAL, /* the file of a material cannot be used */
    TRACE_ERROR_SETTING,  /* a setting is out of range, or does not fit the scene */
};
