/* Four threads ask one material at the same time, of every codec. The target material_threads does
 * the same under ThreadSanitizer. */
#include "codecs/mdf_codecs/mdf_codec.h"
#include "lib/material_fixture.h"
#include "lib/material_threads.h"
#include "lib/mdf_file.h"
#include "lib/ok.h"
#include "lib/remove_tree.h"
#include "lib/test.h"

/* A flat relief: of the views of the fixture, 1 mm deep. */
static void write_mdf(const char *path, const struct btf_matrix *btf) {
    g_autoptr(ExrFile) file = exr_file_new();
    for (gsize v = 0; v < btf->layout.views.n; v++) {
        struct exr_part *part =
            mdf_file_add_view(file, (int)v, 8, 8, (double)btf->layout.views.theta_deg[v],
                              (double)btf->layout.views.phi_deg[v], btf->layout.texel_mm);
        for (int k = 0; k < 64; k++)
            part->planes[0][k] = 0.02F * (float)k;
    }
    g_assert_true(ok(exr_write(path, file, EXR_ZIP, FALSE, ERR)));
}

TEST(agree) {
    const char *keep = g_getenv("MESORIG_MATERIALS_TO"); /* for ThreadSanitizer */
    g_autofree char *made = keep ? NULL : g_dir_make_tmp("material-XXXXXX", NULL);
    const char *folder = keep ? keep : made;
    g_autofree char *mdf = g_build_filename(folder, "mdf.exr", NULL);
    g_autoptr(BtfMatrix) btf = material_fixture_sized(8, 8, 2, FALSE);
    write_mdf(mdf, btf);
    for (gsize i = 0; codecs[i]; i++) {
        g_autofree char *name = g_strdup_printf("material-%s.exr", codecs[i]->name);
        g_autofree char *path = g_build_filename(folder, name, NULL);
        material_fixture_write(path, codecs[i], btf, "");
        g_assert_cmpstr(material_threads_ask(path, mdf, 4), ==, NULL);
    }
    g_assert_cmpstr(material_threads_ask("/nowhere.exr", NULL, 4), !=, NULL);
    if (!keep)
        remove_tree(folder);
}
