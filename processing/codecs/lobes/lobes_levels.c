#include "lobes_levels.h"

#include "exr/mip_parts.h"
#include "lobes_private.h"

static void free_levels(struct lobes **levels, int n) {
    while (n > 0)
        lobes_free(levels[--n]);
}

int lobes_compute_levels(const struct btf_matrix *btf, const struct lobes_options *options,
                         struct lobes *ret_levels[LOBES_MAX_LEVELS], GError **error) {
    struct lobes_options now = *options;
    struct btf_matrix *made = NULL;
    const struct btf_matrix *of = btf;
    int n = 0;
    while (of && n < LOBES_MAX_LEVELS) {
        ret_levels[n] = lobes_compute(of, &now, error);
        if (!ret_levels[n])
            break;
        n++;
        now.checkpoint = NULL;
        struct btf_matrix *half = btf_matrix_halved(of);
        btf_matrix_free(made);
        of = made = half;
    }
    const gboolean failed = of && n < LOBES_MAX_LEVELS;
    btf_matrix_free(made);
    if (failed)
        free_levels(ret_levels, n);
    return failed ? 0 : n;
}

gboolean lobes_write_levels(const char *path, struct lobes *const *levels, int n, GError **error) {
    struct exr_file *file = exr_file_new();
    for (int level = 0; level < n; level++)
        mip_parts_add(file, lobes_to_exr(levels[level]), level);
    const gboolean ok = exr_write(path, file, EXR_PIZ, TRUE, error);
    exr_file_free(file);
    return ok;
}

int lobes_read_levels(const char *path, struct lobes *ret_levels[LOBES_MAX_LEVELS],
                      GError **error) {
    struct exr_file *file = exr_read(path, error);
    const int there = file ? mip_parts_count(file, "views", path, error) : 0;
    const int n = MIN(there, LOBES_MAX_LEVELS);
    int level = 0;
    for (; level < n; level++) {
        struct exr_file *one = mip_parts_take(file, level);
        ret_levels[level] = lobes_from_exr(one, path, error);
        exr_file_free(one);
        if (!ret_levels[level])
            break;
    }
    exr_file_free(file);
    if (level == n)
        return n;
    free_levels(ret_levels, level);
    return 0;
}
