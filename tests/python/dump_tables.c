/* usage: dump_tables SESSION FOLDER
 * Writes the BTF and MDF of a session, as the C library reads them, to raw files in a folder, for
 * test_mesorig.py:
 *   btf.f32    height × width × views × lights × 3
 *   angles.f32 θ and φ of each view, then of each light
 *   depth.f32  views × height × width, mm below the reference plane
 *   seen.u8    in the shape of depth.f32
 *   camera.f32, lamp.f32  views × height × width × 3 and views × lights × height × width × 3: unit
 *              vectors from each texel to the camera and to the lamp
 * Prints the number of holes of the BTF. */
#include "btf/btf_matrix.h"
#include "btf/near_field.h"
#include "lib/ok.h"
#include "mdf/mdf_table.h"

#include <stdio.h>

static void save(const char *folder, const char *name, gconstpointer data, gsize bytes) {
    g_autofree char *path = g_build_filename(folder, name, NULL);
    ok(g_file_set_contents(path, data, (gssize)bytes, ERR));
}

static void append(GArray *to, struct vec3 v) {
    const float xyz[] = {(float)v.x, (float)v.y, (float)v.z};
    g_array_append_vals(to, xyz, 3);
}

/* Saves the exact directions of all texels. */
static void save_near_field(const char *session, const char *folder) {
    struct near_field *near_field = ok(near_field_read(session, ERR));
    g_autoptr(GArray) camera = g_array_new(FALSE, FALSE, sizeof(float));
    g_autoptr(GArray) lamp = g_array_new(FALSE, FALSE, sizeof(float));
    const int texels = near_field->grid.width * near_field->grid.height;
    for (int view = 0; view < (int)near_field->views.n; view++) {
        for (int texel = 0; texel < texels; texel++)
            append(camera, near_field_view(near_field, view, texel));
        for (int light = 0; light < (int)near_field->lights.n; light++)
            for (int texel = 0; texel < texels; texel++)
                append(lamp, near_field_light(near_field, view, light, texel));
    }
    save(folder, "camera.f32", camera->data, camera->len * sizeof(float));
    save(folder, "lamp.f32", lamp->data, lamp->len * sizeof(float));
    near_field_free(near_field);
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
    save_near_field(argv[1], argv[2]);
    printf("%" G_GINT64_FORMAT "\n", btf->holes);
    btf_matrix_free(btf);
    return 0;
}
