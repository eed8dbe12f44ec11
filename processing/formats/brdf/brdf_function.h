/* The types that readers and writers of BRDF files share (brdf.h). */
#pragma once

#include <glib.h>

/* A BRDF to be written, or any other function of two directions. light and view are above the
 * surface. The function is called from several threads at the same time. */
typedef void (*BrdfFunction)(const float light[3], const float view[3], float ret[3],
                             gpointer data);
/* Gives the values of a BRDF for both orders of two directions a and b. ret[0] is the value for
 * light a and view b, and ret[1] is the value for light b and view a. */
typedef void (*BrdfBothFunction)(const float a[3], const float b[3], float ret[2][3],
                                 gpointer data);

/* The conversion of the numbers in UTIA's files (utia.h): f_r = scale · decode (number /
 * divide). */
struct brdf_coding {
    double divide, scale; /* 0 means 1 */
    /* whether decode converts from sRGB to linear; if not, numbers are linear */
    gboolean srgb;
};
