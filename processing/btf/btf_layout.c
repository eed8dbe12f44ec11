#include "btf_layout.h"

#include <math.h>
#include <string.h>

#include "base/direction.h"

#define COLOURS 3

struct direction_list direction_list_new(gsize n) {
    return (struct direction_list){n, g_new0(float, n), g_new0(float, n)};
}

struct direction_list direction_list_copy(const struct direction_list *from) {
    const gsize bytes = sizeof(float) * from->n;
    return (struct direction_list){from->n, g_memdup2(from->theta_deg, bytes),
                                   g_memdup2(from->phi_deg, bytes)};
}

void direction_list_clear(struct direction_list *list) {
    g_free(list->theta_deg);
    g_free(list->phi_deg);
}

float *direction_list_vectors(const struct direction_list *list) {
    float *ret = g_new(float, 3 * list->n);
    for (gsize i = 0; i < list->n; i++)
        direction_from_deg(list->theta_deg[i], list->phi_deg[i], ret + 3 * i);
    return ret;
}

gboolean direction_list_equal(const struct direction_list *a, const struct direction_list *b) {
    const gsize bytes = sizeof(float) * a->n;
    return a->n == b->n && memcmp(a->theta_deg, b->theta_deg, bytes) == 0 &&
           memcmp(a->phi_deg, b->phi_deg, bytes) == 0;
}

struct btf_layout btf_layout_copy(const struct btf_layout *from) {
    struct btf_layout ret = *from;
    ret.views = direction_list_copy(&from->views);
    ret.lights = direction_list_copy(&from->lights);
    return ret;
}

void btf_layout_clear(struct btf_layout *layout) {
    direction_list_clear(&layout->views);
    direction_list_clear(&layout->lights);
}

gsize btf_layout_texels(const struct btf_layout *layout) {
    return layout->width * layout->height;
}

gsize btf_layout_values(const struct btf_layout *layout) {
    return layout->views.n * layout->lights.n * COLOURS;
}

void btf_layout_write_sizes(const struct btf_layout *layout, struct exr_part *part) {
    exr_set_double(part, "texel_mm", layout->texel_mm);
    exr_set_double(part, "reference_mm", layout->reference_mm);
}

static void write_list(const char *name, const struct direction_list *list, struct exr_file *file) {
    static const char *const channels[] = {"phi_deg", "theta_deg", NULL};
    struct exr_part *part = exr_part_new(name, (int)list->n, 1, channels, EXR_FLOAT);
    memcpy(part->planes[0], list->phi_deg, sizeof(float) * list->n);
    memcpy(part->planes[1], list->theta_deg, sizeof(float) * list->n);
    exr_file_add(file, part);
}

void btf_layout_write_directions(const struct btf_layout *layout, struct exr_file *file) {
    write_list("views", &layout->views, file);
    write_list("lights", &layout->lights, file);
}

static gboolean read_list(const struct exr_file *file, const char *name,
                          struct direction_list *ret) {
    const struct exr_part *part = exr_file_part(file, name);
    const struct direction_list found = {
        .n = part ? (gsize)part->width : 0,
        .theta_deg = part ? exr_part_plane(part, "theta_deg") : NULL,
        .phi_deg = part ? exr_part_plane(part, "phi_deg") : NULL,
    };
    if (!found.theta_deg || !found.phi_deg || part->height != 1 ||
        !exr_all_finite(found.theta_deg, found.n) || !exr_all_finite(found.phi_deg, found.n))
        return FALSE;
    *ret = direction_list_copy(&found);
    return TRUE;
}

const char *btf_layout_read(const struct exr_file *file, const struct exr_part *part,
                            struct btf_layout *ret) {
    if (!exr_get_double(part, "texel_mm", &ret->texel_mm, NULL) || !(ret->texel_mm > 0) ||
        !isfinite(ret->texel_mm))
        return "attribute texel_mm is missing or not a number above 0";
    if (!exr_get_double(part, "reference_mm", &ret->reference_mm, NULL) ||
        !isfinite(ret->reference_mm))
        return "attribute reference_mm is missing or not a finite number";
    if (!read_list(file, "views", &ret->views))
        return "part views is missing or is not one row of finite angles theta_deg and phi_deg";
    if (!read_list(file, "lights", &ret->lights))
        return "part lights is missing or is not one row of finite angles theta_deg and phi_deg";
    return NULL;
}
