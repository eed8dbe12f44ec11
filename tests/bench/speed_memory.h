/* The memory that processing a large session takes: part of bench_speed. */
#pragma once

#include <glib.h>

struct speed_memory {
    double peak_mib; /* of the process that ran it, as the kernel says */
    double seconds;
    int texels, views, lights; /* texels across */
    gboolean ok;
};

/* views × 96 lights of 256 × 256 texels at 2 pixels a texel, BTF and eigen-maps, in folder. What is
 * held at a time is some views and columns, however many there are; an MDF would hold 12 bytes a
 * texel and view more. */
struct speed_memory speed_memory(int views, const char *folder);
