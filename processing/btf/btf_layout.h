/*
 * The dimensions of a BTF, or of a model of a BTF: texels, views and lights. Plain data; any
 * thread.
 */
#pragma once

#include "exr/exr.h"

/* The directions of views or of lights: θ and φ in the sample frame (base/direction.h). */
struct direction_list {
    gsize n;
    float *theta_deg, *phi_deg; /* n each */
};

struct btf_layout {
    gsize width, height; /* texels */
    double texel_mm;     /* width of a texel */
    double reference_mm; /* height of the reference plane above the turntable */
    struct direction_list views, lights;
};

/* Makes a list of n directions whose angles are 0. direction_list_clear() frees the angles. */
struct direction_list direction_list_new(gsize n);
struct direction_list direction_list_copy(const struct direction_list *from);
void direction_list_clear(struct direction_list *list);
float *direction_list_vectors(const struct direction_list *list); /* n × 3, unit; g_free() */
/* Returns whether two lists have the same angles, bit by bit. */
gboolean direction_list_equal(const struct direction_list *a, const struct direction_list *b);

/* Copies a layout with its directions. Free the copy with btf_layout_clear(). */
struct btf_layout btf_layout_copy(const struct btf_layout *from);
void btf_layout_clear(struct btf_layout *layout);

gsize btf_layout_texels(const struct btf_layout *layout); /* width × height */
gsize btf_layout_values(
    const struct btf_layout *layout); /* values of a texel: views × lights × 3 */

/* Write a layout to the file of a model. btf_layout_write_sizes() sets the double attributes
 * texel_mm and reference_mm of a part. btf_layout_write_directions() adds the parts "views" and
 * "lights" with the float channels "phi_deg" and "theta_deg", n pixels wide and 1 high. The size in
 * texels is the size of the file's other parts. */
void btf_layout_write_sizes(const struct btf_layout *layout, struct exr_part *part);
void btf_layout_write_directions(const struct btf_layout *layout, struct exr_file *file);
/* Reads texel_mm and reference_mm from part, and the directions from file. width and height are not
 * changed. Returns NULL on success, otherwise a description of what is wrong with the file. */
const char *btf_layout_read(const struct exr_file *file, const struct exr_part *part,
                            struct btf_layout *ret);
