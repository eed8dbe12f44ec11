/* Reads the files of the BTF's views. btf_make.c makes these files. */
#include "btf.h"

#include <gio/gio.h>
#include <math.h>
#include <string.h>

#include "base/data_error.h"

/* For each flag, the attribute that counts the texels with this flag. */
static const struct {
    const char *name;
    enum btf_flag flag;
    gsize sum; /* offset of the sum in struct btf_flag_counts */
} btf_flag_attributes[] = {
    {"mesorig.holes", BTF_FLAG_HOLE, G_STRUCT_OFFSET(struct btf_flag_counts, holes)},
    {"mesorig.bounds", BTF_FLAG_BOUND, G_STRUCT_OFFSET(struct btf_flag_counts, bounds)},
    {"mesorig.shorter", BTF_FLAG_SHORTER, G_STRUCT_OFFSET(struct btf_flag_counts, shorter)},
    {"mesorig.predicted", BTF_FLAG_PREDICTED, G_STRUCT_OFFSET(struct btf_flag_counts, predicted)},
};

void btf_view_free(struct btf_view *view) {
    if (!view)
        return;
    for (guint i = 0; view->lights && i < view->lights->len; i++)
        input_clear(&g_array_index(view->lights, struct btf_light, i).input);
    g_clear_pointer(&view->lights, g_array_unref);
    g_free(view->inputs);
    g_free(view);
}

/* Returns TRUE if the file has a part for each light of the view, and every part has the hash of
 * the view's inputs. Only headers are read. */
gboolean btf_is_made(const struct btf_view *view, const char *path) {
    if (!g_file_test(path, G_FILE_TEST_IS_REGULAR))
        return FALSE;
    struct exr_file *file = exr_read_headers(path, NULL);
    gboolean made = file && file->parts->len == view->lights->len;
    for (guint i = 0; made && i < file->parts->len; i++) {
        const char *inputs = NULL;
        made = exr_get_string(g_ptr_array_index(file->parts, i), "mesorig.inputs", &inputs, NULL) &&
               strcmp(inputs, view->inputs) == 0;
    }
    exr_file_free(file);
    return made;
}

void btf_set_flag_counts(struct exr_part *part, const guint8 *flags, gsize n) {
    for (gsize k = 0; k < G_N_ELEMENTS(btf_flag_attributes); k++) {
        int count = 0;
        for (gsize i = 0; i < n; i++)
            count += (flags[i] & btf_flag_attributes[k].flag) != 0;
        exr_set_int(part, btf_flag_attributes[k].name, count);
    }
}

void btf_count_flags(const struct exr_part *part, struct btf_flag_counts *sums) {
    sums->texels += (gint64)part->width * part->height;
    for (gsize k = 0; k < G_N_ELEMENTS(btf_flag_attributes); k++) {
        int count = 0;
        exr_get_int(part, btf_flag_attributes[k].name, &count, NULL);
        G_STRUCT_MEMBER(gint64, sums, btf_flag_attributes[k].sum) += count;
    }
}

#define PICTURES 16 /* number of pictures that are decoded together */

static gboolean copy_picture(const struct exr_part *part, const struct session_grid *grid,
                             const char *path, float *ret_rgb, GError **error) {
    static const char *const channels[] = {"R", "G", "B"};
    const gsize texels = (gsize)grid->width * (gsize)grid->height;
    if (part->width != grid->width || part->height != grid->height)
        return data_error_fail(
            path, 0, error,
            "part %s has %d × %d texels, but the session's grid has %d × %d" BTF_AGAIN, part->name,
            part->width, part->height, grid->width, grid->height);
    for (gsize c = 0; c < 3; c++) {
        const float *plane = exr_part_plane(part, channels[c]);
        if (!plane)
            return data_error_fail(path, 0, error, "part %s lacks channel %s" BTF_AGAIN, part->name,
                                   channels[c]);
        for (gsize i = 0; i < texels; i++)
            ret_rgb[3 * i + c] = plane[i];
    }
    return TRUE;
}

gboolean btf_read_view(const char *path, const int *lights, int n_lights,
                       const struct session_grid *grid, int n_threads, float *ret_rgb,
                       GError **error) {
    const gsize picture = 3 * (gsize)grid->width * (gsize)grid->height;
    g_autoptr(GHashTable) wanted = g_hash_table_new_full(g_str_hash, g_str_equal, g_free, NULL);
    g_autoptr(ExrReader) reader = exr_reader_new(path, error);
    if (!reader)
        return FALSE;
    for (int i = 0; i < n_lights; i++)
        g_hash_table_insert(wanted, g_strdup_printf("light_%04d", lights[i]), GINT_TO_POINTER(i));
    for (const char *name; (name = exr_reader_name(reader, 0)) != NULL;) {
        int n = 0;
        while (n < PICTURES && name && g_hash_table_contains(wanted, name))
            name = exr_reader_name(reader, ++n);
        if (n == 0) {
            exr_reader_skip(reader);
            continue;
        }
        g_autoptr(ExrFile) file = exr_reader_next(reader, n, n_threads, error);
        for (int i = 0; i < n; i++) {
            const struct exr_part *part = file ? g_ptr_array_index(file->parts, (guint)i) : NULL;
            gpointer at = part ? g_hash_table_lookup(wanted, part->name) : NULL;
            if (!part || !copy_picture(part, grid, path,
                                       ret_rgb + picture * (gsize)GPOINTER_TO_INT(at), error))
                return FALSE;
            g_hash_table_remove(wanted, part->name);
        }
    }
    for (int i = 0; i < n_lights; i++) {
        g_autofree char *name = g_strdup_printf("light_%04d", lights[i]);
        if (g_hash_table_contains(wanted, name))
            return data_error_fail(path, 0, error, "part %s is missing" BTF_AGAIN, name);
    }
    return TRUE;
}

gboolean btf_direction(const struct exr_part *part, const char *of, float *ret_theta_deg,
                       float *ret_phi_deg) {
    g_autofree char *theta_name = g_strconcat(of, ".theta_deg", NULL);
    g_autofree char *phi_name = g_strconcat(of, ".phi_deg", NULL);
    double theta = NAN, phi = NAN;
    exr_get_double(part, theta_name, &theta, NULL);
    exr_get_double(part, phi_name, &phi, NULL);
    *ret_theta_deg = (float)theta;
    *ret_phi_deg = (float)phi;
    return isfinite(theta) && isfinite(phi);
}
