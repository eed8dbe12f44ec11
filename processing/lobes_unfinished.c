#include <string.h>

#include "exr.h"
#include "lobes_private.h"

/* Everything that the result depends on. */
char *lobes_inputs(const struct btf_matrix *btf, const struct lobes *lobes) {
    GChecksum *sum = g_checksum_new(G_CHECKSUM_SHA256);
    const gsize row = sizeof(float) * (gsize)btf->n_views * (gsize)btf->n_lights * 3;
    g_autofree char *head =
        g_strdup_printf("%s %d %d %d %d %d %s", lobes_model_name(lobes->model), lobes->n_lobes,
                        btf->width, btf->height, btf->n_views, btf->n_lights, MESORIG_VERSION);
    g_checksum_update(sum, (const guchar *)head, -1);
    const float *const angles[] = {btf->view_theta_deg, btf->view_phi_deg, btf->light_theta_deg,
                                   btf->light_phi_deg};
    for (int i = 0; i < 4; i++)
        g_checksum_update(sum, (const guchar *)angles[i],
                          (gssize)sizeof(float) * (i < 2 ? btf->n_views : btf->n_lights));
    for (gsize x = 0; x < (gsize)btf->width * (gsize)btf->height; x++)
        g_checksum_update(sum, (const guchar *)btf->values + x * row, (gssize)row);
    char *ret = g_strdup(g_checksum_get_string(sum));
    g_checksum_free(sum);
    return ret;
}

static gsize n_rows(const struct lobes *lobes) {
    return (gsize)lobes->n_slices * (gsize)lobes->width * (gsize)lobes->height;
}

gboolean lobes_unfinished_write(const char *path, const struct lobes *lobes, const char *inputs,
                                const int *done, int n_blocks, GError **error) {
    static const char *const value[] = {"V", NULL};
    struct exr_file *file = exr_file_new();
    struct exr_part *blocks = exr_part_new("blocks", n_blocks, 1, value, EXR_FLOAT);
    struct exr_part *values =
        exr_part_new("values", lobes->n_values, (int)n_rows(lobes), value, EXR_FLOAT);
    /* What is said to be done was so before it is copied. */
    for (int i = 0; i < n_blocks; i++)
        blocks->planes[0][i] = (float)g_atomic_int_get(&done[i]);
    memcpy(values->planes[0], lobes->values,
           sizeof(float) * n_rows(lobes) * (gsize)lobes->n_values);
    exr_set_string(blocks, "mesorig.kind", "unfinished");
    exr_set_string(blocks, "mesorig.inputs", inputs);
    exr_file_add(file, blocks);
    exr_file_add(file, values);
    const gboolean ok = exr_write(path, file, EXR_NONE, FALSE, error);
    exr_file_free(file);
    return ok;
}

static const float *plane(const struct exr_file *file, const char *name, gsize width,
                          gsize height) {
    const struct exr_part *part = exr_file_part(file, name);
    return part && (gsize)part->width == width && (gsize)part->height == height
               ? exr_part_plane(part, "V")
               : NULL;
}

int lobes_unfinished_read(const char *path, struct lobes *lobes, const char *inputs, int *done,
                          int n_blocks) {
    struct exr_file *file = exr_read(path, NULL);
    const struct exr_part *head = file ? exr_file_part(file, "blocks") : NULL;
    const char *of = NULL;
    int n = 0;
    if (head && exr_get_string(head, "mesorig.inputs", &of, NULL) && strcmp(of, inputs) == 0) {
        const float *blocks = plane(file, "blocks", (gsize)n_blocks, 1);
        const float *values = plane(file, "values", (gsize)lobes->n_values, n_rows(lobes));
        for (int i = 0; blocks && values && i < n_blocks; i++)
            n += done[i] = blocks[i] == 1;
        if (n > 0)
            memcpy(lobes->values, values, sizeof(float) * n_rows(lobes) * (gsize)lobes->n_values);
    }
    exr_file_free(file);
    return n;
}
