#include "lpca_levels.h"

#include <cblas.h>
#include <math.h>

#include "exr/exr.h"
#include "exr/mip_parts.h"
#include "lpca_private.h"

/* Adds share × row of a source texel where intervals [i, i + 1) · n/half and [j, j + 1) overlap. */
static double overlap(int i, int half, int j, int n) {
    const double size = (double)n / half;
    return MAX(0, MIN((i + 1) * size, j + 1.0) - MAX(i * size, j)) / size;
}

static void average(const struct btf_matrix *btf, const struct btf_matrix *half, int x, int y,
                    gsize row) {
    float *to = half->values + ((gsize)y * half->layout.width + (gsize)x) * row;
    for (gsize j = 0; j < btf->layout.height; j++) {
        const double down = overlap(y, half->layout.height, j, btf->layout.height);
        for (gsize i = 0; down > 0 && i < btf->layout.width; i++) {
            const double share = down * overlap(x, half->layout.width, i, btf->layout.width);
            const float *from = btf->values + ((gsize)j * btf->layout.width + (gsize)i) * row;
            if (share > 0)
                cblas_saxpy((int)row, (float)share, from, 1, to, 1);
        }
    }
}

struct btf_matrix *btf_matrix_halved(const struct btf_matrix *btf) {
    const gsize row = btf_layout_values(&btf->layout);
    struct btf_matrix *half = g_new0(struct btf_matrix, 1);
    if (btf->layout.width <= 1 && btf->layout.height <= 1) {
        g_free(half);
        return NULL;
    }
    *half = *btf;
    half->name = g_strdup(btf->name);
    half->directory = g_strdup(btf->directory);
    half->layout = btf_layout_copy(&btf->layout);
    half->layout.width = MAX(1, btf->layout.width / 2);
    half->layout.height = MAX(1, btf->layout.height / 2);
    half->layout.texel_mm = btf->layout.texel_mm * btf->layout.width / half->layout.width;
    half->values = g_new0(float, btf_layout_texels(&half->layout) * row);
    for (gsize y = 0; y < half->layout.height; y++)
        for (gsize x = 0; x < half->layout.width; x++)
            average(btf, half, x, y, row);
    return half;
}

gboolean lpca_write_levels(const char *path, struct lpca *const *levels, int n, GError **error) {
    struct exr_file *file = exr_file_new();
    for (int level = 0; level < n; level++)
        mip_parts_add(file, lpca_to_exr(levels[level]), level);
    const gboolean ok =
        exr_write(path, file, levels[0]->quantise >= LPCA_8BIT ? EXR_ZIP : EXR_PIZ, TRUE, error);
    exr_file_free(file);
    return ok;
}

/* 0 with an error. */
static int lpca_levels_count_levels(const struct exr_file *file, const char *path, GError **error) {
    const int n = file ? mip_parts_count(file, "clusters", path, error) : 0;
    return MIN(n, LPCA_MAX_LEVELS);
}

int lpca_count_levels(const char *path, GError **error) {
    struct exr_file *file = exr_read_headers(path, error);
    const int n = lpca_levels_count_levels(file, path, error);
    exr_file_free(file);
    return n;
}

static struct lpca *take_level(struct exr_file *file, int level, const char *path, GError **error) {
    struct exr_file *one = mip_parts_take(file, level);
    struct lpca *lpca = lpca_from_exr(one, path, error);
    exr_file_free(one);
    return lpca;
}

struct lpca *lpca_read_level(const char *path, int level, GError **error) {
    struct exr_file *file = exr_read(path, error);
    const int n = lpca_levels_count_levels(file, path, error);
    struct lpca *lpca = NULL;
    if (n > 0 && (level < 0 || level >= n))
        g_set_error(error, EXR_ERROR, EXR_ERROR_MISSING, "%s: there is no mip level %d, but %d",
                    path, level, n);
    else if (n > 0)
        lpca = take_level(file, level, path, error);
    exr_file_free(file);
    return lpca;
}

int lpca_read_levels(const char *path, struct lpca *ret_levels[LPCA_MAX_LEVELS], GError **error) {
    struct exr_file *file = exr_read(path, error);
    const int n = lpca_levels_count_levels(file, path, error);
    int level = 0;
    for (; level < n; level++) {
        ret_levels[level] = take_level(file, level, path, error);
        if (!ret_levels[level])
            break;
    }
    exr_file_free(file);
    while (level < n && level > 0)
        lpca_free(ret_levels[--level]);
    return level;
}
