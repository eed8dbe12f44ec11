/*
 * The models of each texel (hsh_view.h, lobes_view.h) on the graphics card. Their values are in one
 * array texture of halves, divided into slices. There is one slice per view, or a single one for
 * all views. A slice has n_pages layers of four values per texel. Another array texture has the
 * reflectance of each view under an even sky. The table of views is in the textures of
 * direction_table.h.
 */
#pragma once

#include "btf/btf_layout.h"
#include "drawing/gl/direction_table.h"

#define SLICES_PAGE      4 /* number of values that a layer has for a texel */
#define SLICES_MAX_PAGES 16

/* A model, or a mip level of it. */
struct slices_level {
    const struct btf_layout *layout;
    const float *values; /* n_slices × texels × n_values */
    gsize n_values;
    gconstpointer model;
};

/* Computes the reflectance of each texel under an even sky, seen in a view: (1/π) ∫ BTF dω.
 * ret_layer is texels × SLICES_PAGE. The first three values of a texel are R, G, B, and the last is
 * 0. */
typedef void (*SlicesSky)(gconstpointer model, gsize view, float *ret_layer);

struct slices {
    /* Set by the caller. */
    const char *what; /* for messages: "hemispherical harmonics" */
    int n_levels, n_pages;
    /* 1, or the number of views. constants() of the method must define SLICED as n_slices > 1,
     * because lobes.glsl then takes the slices of the nearest views. */
    int n_slices;
    /* for each channel of each page, the index of the value in a texel; −1 if the channel is not
     * used */
    int value_at[SLICES_MAX_PAGES][SLICES_PAGE];
    /* The following members are set by slices_upload(). Textures are:
     * - values: the models' values
     * - ambients: the reflectance under an even sky, a layer for each view and one for the pole
     * - pole: the indices of the views whose mean stands for the pole (lobes.glsl) */
    int width, height; /* texels of level 0 */
    guint values, ambients, pole;
    struct direction_textures views;
};

/* slices_check_size() checks that the card can hold the slices. If they are too large, advice is
 * appended to the error; it says how to make the slices smaller. slices_check_values() checks that
 * all values of the level are finite. */
gboolean slices_check_size(const struct slices *slices, const struct btf_layout *layout,
                           const char *advice, GError **error);
gboolean slices_check_values(const struct slices *slices, const struct slices_level *level,
                             GError **error);

/* Uploads n levels. If n is smaller than slices->n_levels, the card computes the other levels as
 * means. */
gboolean slices_upload(struct slices *slices, const struct slices_level *levels, int n,
                       SlicesSky sky, GError **error);
void slices_clear(struct slices *slices);

/* For the functions bytes, texels and bind of struct method. slices_bind() uses the texture units 0
 * … 3, and then the units of direction_textures_bind(). */
gint64 slices_bytes(const struct slices *slices);
gboolean slices_texels(const struct slices *slices, int ret[2]);
void slices_bind(const struct slices *slices, guint program);
