/* The struct behind mesorig_material (material.h), which the files material_*.c use. */
#pragma once

#include "codecs/codec/place.h"
#include "codecs/codecs.h"
#include "material.h"
#include "material_relief.h"

#include <pthread.h>

/* After opening, only the members for sampling change. */
struct mesorig_material {
    const struct codec *codec;
    GPtrArray *levels;               /* models of mip levels, at least the first */
    const struct btf_layout *layout; /* layout of level 0 */
    struct codec_tables tables;      /* tables of level 0 */
    /* relative RMS error of the model against the BTF (codec.h); −1 if not known */
    double error;
    struct material_relief *relief; /* NULL if there is none */
    /* The sampler. material_sample.c makes it at the first call, under the lock, and reads the
     * pointer atomically. It is freed with the material. The lock is not one of GLib's locks,
     * because ThreadSanitizer does not know these. */
    pthread_mutex_t sampling_lock;
    gpointer sampling;
    GDestroyNotify sampling_free;
};
