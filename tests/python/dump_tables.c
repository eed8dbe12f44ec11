/* usage: dump_tables SESSION FOLDER
 * Writes the BTF and MDF of a session, as the C library reads them, to raw files in a folder, for
 * test_mesorig.py:
 *   btf.f32    height × width × views × lights × 3
 *   angles.f32 θ and φ of each view, then of each light
 *   depth.f32  views × height × width, mm below the reference plane
 *   seen.u8    in the shape of depth.f32
 * Prints the number of holes of the BTF. */
#include "btf/btf_matrix.h"
#include "lib/ok.h"
#include "mdf/mdf_table.h"

#include <stdio.h>

static void save(const char *folder, const char *name, gconstpointer data, gsize bytes) {
    g_autofree char *path = g_build_filename(folder, name, NULL);
    ok(g_file_set_contents(path, data, (gssize)bytes, ERR));
}

int main(int argc, char **argv) {
    g_assert_cmpint(argc, ==, 3);
    const struct work quiet = {0};
    struct btf_matrix *btf = ok(btf_matrix_read(argv[1], &quiet, ERR));
    const struct btf_layout *layout = &btf->layout;
    save(argv[2], "btf.f32", btf->values, (gsize)btf_matrix_bytes(layout));
    const struct direction_list *lists[] = {&layout->views, &layout->lights};
    g_autoptr(GArray) angles = g_array_new(FALSE, FALSE, sizeof(float));
    for (gsize k = 0; k < G_N_ELEMENTS(lists); k++)
        for (gsize i = 0; i < lists[k]->n; i++) {
            g_array_append_val(angles, lists[k]->theta_deg[i]);
            g_array_append_val(angles, lists[k]->phi_deg[i]);
        }
    save(argv[2], "angles.f32", angles->data, angles->len * sizeof(float));
    g_autofree char *path = g_build_filename(argv[1], "products", "mdf.exr", NULL);
    g_autoptr(MdfTable) mdf = ok(mdf_table_read(path, ERR));
    const gsize n = (gsize)mdf->width * (gsize)mdf->height * (gsize)mdf->n_views;
    save(argv[2], "depth.f32", mdf->depth_mm, n * sizeof(float));
    save(argv[2], "seen.u8", mdf->seen, n);
    printf("%" G_GINT64_FORMAT "\n", btf->holes);
    btf_matrix_free(btf);
    return 0;
}
