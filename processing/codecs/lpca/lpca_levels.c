#include "lpca_levels.h"

#include <cblas.h>
#include <math.h>

#include "exr/exr.h"
#include "exr/mip_parts.h"
#include "lpca_private.h"

/* Returns the share of the interval [i, i + 1) · n/half that lies in [j, j + 1), if a side of n
 * texels is reduced to `half` texels. */
static double overlap(int i, int half, int j, int n) {
    const double size = (double)n / half;
    return MAX(0, MIN((i + 1) * size, j + 1.0) - MAX(i * size, j)) / size;
}

/* Sets texel (x, y) of half to the mean of btf over the area of this texel. row is the number of
 * values of a texel. */
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

int lpca_read_levels(const char *path, struct lpca *ret_levels[LPCA_MAX_LEVELS], GError **error) {
    struct exr_file *file = exr_read(path, error);
    const int count = file ? mip_parts_count(file, "clusters", path, error) : 0;
    const int n = MIN(count, LPCA_MAX_LEVELS);
    int level = 0;
    for (; level < n; level++) {
        struct exr_file *one = mip_parts_take(file, level);
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
