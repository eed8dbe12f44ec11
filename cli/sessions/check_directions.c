/* The error of interpolation between the measured directions of a BTF. */
#include "check.h"

#include <gio/gio.h>

#include "codecs/codec/held_out.h"

#define TEXELS 1024 /* maximum number of texels that are compared */

/* Copies every step-th texel of a BTF, whose values may be in a file. */
static struct btf_matrix *sample(const struct btf_matrix *btf, GError **error) {
    const struct btf_layout *layout = &btf->layout;
    const int texels = (int)btf_layout_texels(layout), step = (texels + TEXELS - 1) / TEXELS;
    const gsize n = (gsize)((texels + step - 1) / step), row = layout->lights.n * 3;
    struct btf_matrix *ret = g_new0(struct btf_matrix, 1);
    ret->name = g_strdup(btf->name);
    ret->layout = btf_layout_copy(layout);
    ret->layout.width = n;
    ret->layout.height = 1;
    ret->values = g_new(float, n *btf_layout_values(layout));
    for (gsize view = 0; view < layout->views.n; view++)
        for (gsize i = 0; i < n; i++) {
            const int index = 0;
            if (!btf_matrix_place_rows(btf, (int)view, (int)i * step, 1, &index,
                                       ret->values + (i * layout->views.n + view) * row, error)) {
                btf_matrix_free(ret);
                return NULL;
            }
        }
    return ret;
}

gboolean check_directions(const struct btf_matrix *btf, struct check_directions *ret,
                          const struct work *work, GError **error) {
    const struct btf_layout *layout = &btf->layout;
    *ret = (struct check_directions){.views = held_out_default(layout->views.n),
                                     .lights = held_out_default(layout->lights.n)};
    if (ret->views == 0 && ret->lights == 0)
        return TRUE;
    g_autoptr(GError) refused = NULL;
    struct held_out held = {0};
    struct btf_matrix *all = sample(btf, error), *rest = NULL;
    gboolean ok = all && held_out_draw(layout, ret->views, ret->lights, 1, &held, error);
    if (ok) {
        rest = held_out_rest(all, &held);
        ok = held_out_error(all, &held, &material_btf_codec, rest, work, &ret->error, &refused);
    }
    if (g_error_matches(refused, G_IO_ERROR, G_IO_ERROR_CANCELLED)) {
        g_propagate_error(error, g_steal_pointer(&refused));
        /* this also happens with directions below the horizon, which cannot be interpolated */
    } else if (refused) {
        *ret = (struct check_directions){0};
        ok = TRUE;
    }
    held_out_clear(&held);
    btf_matrix_free(all);
    btf_matrix_free(rest);
    return ok;
}
