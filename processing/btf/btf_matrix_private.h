/* Functions that open a BTF and read its views one by one, for the files of this folder and for
 * near_field_correction.c. */
#pragma once

#include "btf_matrix.h"
#include "exr/exr.h"

/* Opens a BTF. Sets the name, the directory and the layout, but not yet the lights of the layout
 * and the angles of its views. *ret_paths are the paths of the views' files; free them with
 * g_ptr_array_unref(). If verify is TRUE, all files are checked by session_check_products(), and
 * work can cancel the check. Returns NULL with an error if no view has a file. */
struct btf_matrix *btf_open(const char *path, gboolean verify, const struct work *work,
                            GPtrArray **ret_paths, GError **error);

/* Sets the directions of the lights from the headers of the first view's file. Fails if the file
 * has no lights, or if an angle is missing or not finite. */
gboolean btf_take_lights(struct btf_matrix *btf, const struct exr_file *first, const char *path,
                         GError **error);

/* Number of pictures of a view that are in memory while its rows are read. */
#define BTF_PICTURES 16

/* Reads a view from its file: sets its direction, adds its flags to the counts of btf, and copies
 * its values with holes filled. first points to the place for the values of the first texel; values
 * of consecutive texels are stride floats apart. Fails if the view differs from the first one in
 * lights or texels, lacks a colour or an angle, or has infinite values. n_threads 0 means one
 * thread per processor. */
gboolean btf_read_rows(struct btf_matrix *btf, int view, const char *path, int n_threads,
                       float *first, gsize stride, GError **error);

/* The steps of btf_read_rows(), for callers that need the pictures as well.
 * - btf_check_lights() fails if n is not the number of lights of the first view.
 * - btf_take_view_direction() sets the direction of the view from the attributes of a part.
 * - btf_take_pictures() copies the values of the pictures in file. They belong to the lights
 *   first_light, first_light + 1, … */
gboolean btf_check_lights(const struct btf_matrix *btf, int n, const char *path, GError **error);
gboolean btf_take_pictures(struct btf_matrix *btf, const struct exr_file *file, gsize first_light,
                           const char *path, float *first, gsize stride, GError **error);
gboolean btf_take_view_direction(struct btf_matrix *btf, const struct exr_part *part, int view,
                                 const char *path, GError **error);

/* Writes n texels of a view, beginning with texel first, to the scratch file. Does not change the
 * hash of the view. Any thread, also while other threads read or write other texels. */
gboolean btf_scratch_write_rows(const struct btf_scratch *scratch, int view, int first, int n,
                                const float *values, GError **error);
