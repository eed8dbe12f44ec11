#include "lpca_levels.h"

#include <cblas.h>
#include <math.h>
#include <string.h>

#include "exr.h"
#include "lpca_private.h"

/* Adds share × row of a source texel where intervals [i, i + 1) · n/half and [j, j + 1) overlap. */
static double overlap(int i, int half, int j, int n) {
    const double size = (double)n / half;
    return MAX(0, MIN((i + 1) * size, j + 1.0) - MAX(i * size, j)) / size;
}

static void average(const struct btf_matrix *btf, const struct btf_matrix *half, int x, int y,
                    gsize row) {
    float *to = half->values + ((gsize)y * (gsize)half->width + (gsize)x) * row;
    for (int j = 0; j < btf->height; j++) {
        const double down = overlap(y, half->height, j, btf->height);
        for (int i = 0; down > 0 && i < btf->width; i++) {
            const double share = down * overlap(x, half->width, i, btf->width);
            const float *from = btf->values + ((gsize)j * (gsize)btf->width + (gsize)i) * row;
            if (share > 0)
                cblas_saxpy((int)row, (float)share, from, 1, to, 1);
        }
    }
}

struct btf_matrix *btf_matrix_halved(const struct btf_matrix *btf) {
    const gsize row = (gsize)btf->n_views * (gsize)btf->n_lights * 3;
    const gsize views = sizeof(float) * (gsize)btf->n_views;
    const gsize lights = sizeof(float) * (gsize)btf->n_lights;
    struct btf_matrix *half = g_new0(struct btf_matrix, 1);
    if (btf->width <= 1 && btf->height <= 1) {
        g_free(half);
        return NULL;
    }
    *half = *btf;
    half->name = g_strdup(btf->name);
    half->directory = g_strdup(btf->directory);
    half->width = MAX(1, btf->width / 2);
    half->height = MAX(1, btf->height / 2);
    half->texel_mm = btf->texel_mm * btf->width / half->width;
    half->view_theta_deg = g_memdup2(btf->view_theta_deg, views);
    half->view_phi_deg = g_memdup2(btf->view_phi_deg, views);
    half->light_theta_deg = g_memdup2(btf->light_theta_deg, lights);
    half->light_phi_deg = g_memdup2(btf->light_phi_deg, lights);
    half->values = g_new0(float, (gsize)half->width *(gsize)half->height *row);
    for (int y = 0; y < half->height; y++)
        for (int x = 0; x < half->width; x++)
            average(btf, half, x, y, row);
    return half;
}

gboolean lpca_write_levels(const char *path, struct lpca *const *levels, int n, GError **error) {
    struct exr_file *file = exr_file_new();
    for (int level = 0; level < n; level++) {
        struct exr_file *one = lpca_to_exr(levels[level]);
        while (one->parts->len > 0) {
            struct exr_part *part = g_ptr_array_steal_index(one->parts, 0);
            char *name = level ? g_strdup_printf("mip%d.%s", level, part->name) : NULL;
            if (name) {
                g_free(part->name);
                part->name = name;
            }
            exr_file_add(file, part);
        }
        exr_file_free(one);
    }
    const gboolean ok =
        exr_write(path, file, levels[0]->quantise >= LPCA_8BIT ? EXR_ZIP : EXR_PIZ, TRUE, error);
    exr_file_free(file);
    return ok;
}

static int count_levels(const struct exr_file *file) {
    int n = 1;
    for (; n < LPCA_MAX_LEVELS; n++) {
        g_autofree char *name = g_strdup_printf("mip%d.clusters", n);
        if (!exr_file_part(file, name))
            break;
    }
    return n;
}

int lpca_count_levels(const char *path, GError **error) {
    struct exr_file *file = exr_read_headers(path, error);
    const int n = file ? count_levels(file) : 0;
    exr_file_free(file);
    return n;
}

/* Of the parts of a file those of one level stay, under the names they have at level 0. */
static void keep_level(struct exr_file *file, int level) {
    g_autofree char *prefix = g_strdup_printf("mip%d.", level);
    for (guint i = file->parts->len; level > 0 && i-- > 0;) {
        struct exr_part *part = file->parts->pdata[i];
        if (!g_str_has_prefix(part->name, prefix)) {
            g_ptr_array_remove_index(file->parts, i);
            continue;
        }
        char *name = g_strdup(part->name + strlen(prefix));
        g_free(part->name);
        part->name = name;
    }
}

struct lpca *lpca_read_level(const char *path, int level, GError **error) {
    struct exr_file *file = exr_read(path, error);
    struct lpca *lpca = NULL;
    if (file && (level < 0 || level >= count_levels(file)))
        g_set_error(error, EXR_ERROR, EXR_ERROR_MISSING, "%s: there is no mip level %d, but %d",
                    path, level, count_levels(file));
    else if (file) {
        keep_level(file, level);
        lpca = lpca_from_exr(file, path, error);
    }
    exr_file_free(file);
    return lpca;
}

/* Moves the parts of a level out of the file. */
static struct exr_file *take_level(struct exr_file *file, int level) {
    struct exr_file *one = exr_file_new();
    g_autofree char *prefix = g_strdup_printf("mip%d.", level);
    for (guint i = 0; i < file->parts->len;) {
        const struct exr_part *part = file->parts->pdata[i];
        if (level == 0 ? g_str_has_prefix(part->name, "mip")
                       : !g_str_has_prefix(part->name, prefix))
            i++;
        else
            exr_file_add(one, g_ptr_array_steal_index(file->parts, i));
    }
    keep_level(one, level);
    return one;
}

int lpca_read_levels(const char *path, struct lpca *ret_levels[LPCA_MAX_LEVELS], GError **error) {
    struct exr_file *file = exr_read(path, error);
    const int n = file ? count_levels(file) : 0;
    int level = 0;
    for (; level < n; level++) {
        struct exr_file *one = take_level(file, level);
        ret_levels[level] = lpca_from_exr(one, path, error);
        exr_file_free(one);
        if (!ret_levels[level])
            break;
    }
    exr_file_free(file);
    while (level < n && level > 0)
        lpca_free(ret_levels[--level]);
    return level;
}
